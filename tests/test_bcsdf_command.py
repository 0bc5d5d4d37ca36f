"""`furcl bcsdf`: numbers of the references as they are, means over h, and tables."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cylinders import FIBRES, reference_of
from typer.testing import CliRunner

from furcl import bcsdf
from furcl.errors import FurclError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.oracle.bcsdf_values import bcsdf_values, save_tables

WO = np.array([0.6, 0.8, 0.0])
WI = np.array([-0.5, np.sqrt(0.75) * np.cos(2.8), np.sqrt(0.75) * np.sin(2.8)])


def run(*arguments: str) -> str:
    """What the command prints."""
    result = CliRunner().invoke(command_of(), ["bcsdf", *arguments])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def command_of():
    """The command, as click has it, in the shape that the runner takes."""
    import furcl.cli

    return furcl.cli.app


def joined(w: np.ndarray) -> str:
    return ",".join(repr(float(x)) for x in w)


def test_prints_the_reference_to_the_last_digit():
    fibre = Fibre.preset("blond")
    directions = [f"--wo={joined(WO)}", f"--wi={joined(WI)}", "--h=-0.3"]
    told = ["double-cylinder", "--set", "preset=blond", "--unscattered", *directions]
    found = json.loads(run(*told, "--json"))
    left_out = bcsdf.UNSCATTERED
    wo, wi = np.array(found["wo"]), np.array(found["wi"])
    np.testing.assert_allclose(wo, WO, rtol=1e-15)
    assert found["value"] == bcsdf.evaluate(fibre, wo, wi, -0.3, left_out).tolist()
    assert found["pdf"] == float(bcsdf.pdf(fibre, wo, wi, -0.3, left_out, sampling="full-cdf"))
    theta = np.arctan2(wo[0], np.hypot(wo[1], wo[2]))
    energies = bcsdf.attenuation(fibre, -0.3, theta, left_out)
    assert list(found["lobes"]) == list(energies)
    for name, lobe in found["lobes"].items():
        assert lobe["value"] == bcsdf.evaluate(fibre, wo, wi, -0.3, left_out, lobe=name).tolist()
        assert lobe["attenuation"] == energies[name].tolist()
        assert lobe["direction_pdf"] == float(
            bcsdf.direction_pdf(fibre, wo, wi, -0.3, left_out, lobe=name, sampling="full-cdf")
        )
    assert found["fibre"]["kappa"] == fibre.kappa
    # Without --json the same numbers, which 17 digits tell from their neighbours.
    first = run(*told).split()
    assert first[:3:2] == ["value", "pdf"]
    assert [float(x) for x in first[1].split(",")] == found["value"]
    assert float(first[3]) == found["pdf"]


@pytest.mark.parametrize("name", FIBRES)
def test_left_out_h_is_the_mean_over_it(name):
    """Sums over other nodes, and the lobes add up; half a fibre is not the mean."""
    fibre = FIBRES[name]
    found = bcsdf_values(fibre, WO, WI, residual=True)
    h = np.cos((np.arange(20_000) + 0.5) * np.pi / 20_000)
    weight = np.sqrt(1.0 - h * h) * np.pi / 40_000
    values = reference_of(fibre).evaluate(fibre, WO, WI, h, residual=True)
    np.testing.assert_allclose(found["value"], weight @ values, rtol=1e-6)
    assert not np.allclose(found["value"], 2.0 * weight[h > 0] @ values[h > 0], rtol=1e-2)
    np.testing.assert_allclose(
        found["value"], np.sum([x["value"] for x in found["lobes"].values()], axis=0), rtol=1e-12
    )
    density = reference_of(fibre).pdf(fibre, WO, WI, h, None, sampling="full-cdf", residual=True)
    assert found["pdf"] == pytest.approx(2.0 * weight @ density, rel=1e-3)
    albedo = reference_of(fibre).albedo(fibre, np.arcsin(0.6), residual=True)
    energies = np.sum([x["attenuation"] for x in found["lobes"].values()], axis=0)
    np.testing.assert_allclose(energies, albedo, rtol=1e-9)


def test_far_field_of_the_double_cylinder():
    fibre = Fibre.preset("human-black")
    found = bcsdf_values(fibre, WO, WI, None, bcsdf.UNSCATTERED)
    expected = bcsdf.far_field(fibre, WO, WI, bcsdf.UNSCATTERED)
    np.testing.assert_allclose(found["value"], expected, rtol=1e-6)


def test_tables_of_a_model(device, tmp_path):
    fibre = FIBRES["chiang"]
    path = tmp_path / "chiang.npz"
    shapes = save_tables(path, fibre, device=device)
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    assert {name: array.shape for name, array in arrays.items()} == shapes
    assert list(arrays["lobes"]) == ["R", "TT", "TRT", "residual"]
    assert arrays["params"]["eta"] == np.float32(fibre.eta)
    theta, row = arrays["theta"], 9
    albedo = reference_of(fibre).albedo(fibre, theta[row], residual=True).mean()
    # Bins with a narrow peak are lifted: the chances are shares of a little more.
    assert arrays["energy"][row] == pytest.approx(albedo, rel=0.1)
    joint = arrays["joint"][row].astype(np.float64)
    assert joint.mean(axis=1).sum() == pytest.approx(1.0, abs=1e-5)
    assert arrays["bin_cdf"].shape[2] + 1 == len(arrays["h_edges"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["chang", "--wo", "0,1,0", "--wi", "0,1,0"], "did you mean 'chiang'"),
        (["chiang", "--wo", "0,1,0"], "give --wo and --wi, or --tables"),
        (["chiang", "--set", "sigma_a=1", "--wo", "0,1", "--wi", "0,1,0"], "three numbers X,Y,Z"),
        (["chiang", "--set", "sigma_a=1", "--wo", "0,0,0", "--wi", "0,1,0"], "not all 0"),
        (["chiang", "--set", "sigma_a=1", "--wo", "0,1,0", "--wi", "0,1,0", "--h", "2"], "h is"),
        (["chiang", "--wo", "0,1,0", "--wi", "0,1,0"], "neither a preset nor a colour"),
        (["chiang", "--set", "kappa=1", "--wo", "0,1,0", "--wi", "0,1,0"], "fibre.kappa"),
        (["chiang", "--set", "sigma_a=1", "--tables", "a.txt"], "end the name with .npz"),
        (["double-cylinder", "--set", "preset=blond", "--tables", "a.npz", "--h", "0"], "--h"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(FurclError) as caught:
        run(*arguments)
    assert message in str(caught.value)
