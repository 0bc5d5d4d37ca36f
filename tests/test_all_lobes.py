"""The sampler "all-lobes": a direction is worth what all lobes send there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cylinders import FIBRES as CYLINDERS
from cylinders import reference_of
from fibres import FIBRES as DOUBLE
from fibres import YAN2015
from kernel_mutants import substitute
from model_checks import check_mean_weight, directions
from offset_cells import wo_at

from furcl.errors import SamplerError
from furcl.fibre import samplers
from furcl.fibre.marschner.parameters import MarschnerFibre
from furcl.rendering.probe import Probe

FIBRES: dict[str, Any] = {
    "human-black": DOUBLE["human-black"],
    "coloured": DOUBLE["coloured"],
    "chiang": CYLINDERS["chiang"],
    "deon cone, 5 orders": CYLINDERS["deon cone, 5 orders"],
    "yan2015 air": YAN2015["air"],
    "marschner": MarschnerFibre(sigma_a=(0.1, 0.4, 1.2)),
}
WITH_OFFSETS = [name for name in FIBRES if name != "marschner"]


def largest_error(probe: Probe, wo: np.ndarray, seed: int, within=None) -> float:
    """Of the weights against values over densities, both of all lobes, relative."""
    wi, h, lobe, weight, _ = probe.sample(wo, seed=seed % 2**32, within=within)
    drawn = lobe < len(probe.lobes)
    arguments = () if within is None else (within,)
    value, density = probe.evaluate_lobes(wo[drawn], wi[drawn], h[drawn], *arguments)
    # Values are per unit of h where it is drawn from the whole width.
    of_width = 0.5 if within is None else 1.0
    expected = of_width * value.sum(0) / density.sum(0)[:, None]
    # Profiles are constant within bins, and a direction may be found again in the next one.
    error = np.abs(weight[drawn] - expected) / (np.abs(expected) + 1e-3)
    return float(np.quantile(error, 0.98))


@pytest.mark.parametrize("name", FIBRES)
def test_weight_is_the_value_of_all_lobes_over_their_density(device, rng, seed, name):
    probe = Probe(FIBRES[name], "all-lobes", device)
    assert largest_error(probe, directions(rng, 8000), seed) < 1e-3
    # Mutant: the weights of single lobes; 4e-3 of black hair, whose lobes hardly overlap.
    other = Probe(FIBRES[name], "uniform-h", device)
    assert largest_error(other, directions(rng, 8000), seed) > 2e-3


@pytest.mark.parametrize("name", WITH_OFFSETS)
def test_at_a_known_offset(device, rng, seed, name):
    probe = Probe(FIBRES[name], "all-lobes", device, mode="near")
    wo = directions(rng, 8000)
    assert largest_error(probe, wo, seed, within=(0.3, 0.3)) < 1e-3


@pytest.mark.statistical
@pytest.mark.parametrize("name", FIBRES)
def test_mean_weight_is_the_albedo(device, name):
    fibre = FIBRES[name]
    probe = Probe(fibre, "all-lobes", device)
    albedo = reference_of(fibre).albedo(fibre, 0.4, probe.material.profiles)
    check_mean_weight(probe, 0.4, albedo)


@pytest.mark.statistical
@pytest.mark.parametrize("name", WITH_OFFSETS)
@pytest.mark.parametrize("mode", ["near", "multiscale"])
def test_mean_weight_within_limits(device, seed, name, mode):
    """That of single lobes, which have the energy as their mean, within 4.5 standard errors, and
    less spread."""
    within = (0.3, 0.3) if mode == "near" else (-0.6, 0.4)
    of = {}
    for sampling in ("uniform-h", "full-cdf", "all-lobes"):
        probe = Probe(FIBRES[name], sampling, device, mode=mode)
        weight = probe.sample(wo_at(-0.5), n=100_000, seed=seed % 2**32, within=within)[3]
        of[sampling] = weight.astype(np.float64).mean(1)
    one, all_lobes = of["full-cdf"], of["all-lobes"]
    error = np.hypot(one.std(), all_lobes.std()) / np.sqrt(len(one))
    assert abs(one.mean() - all_lobes.mean()) < 4.5 * error + 1e-5
    assert abs(one.mean() - 1.02 * all_lobes.mean()) > 4.5 * error + 1e-5
    assert all_lobes.std() < 1.01 * of["uniform-h"].std() + 1e-5


MUTANTS = {
    "lobes count alike": (r"pdf \+= share\[p\] \* terms\.pdf", "pdf += terms.pdf / FURCL_LOBES"),
    "one lobe's value is forgotten": (
        r"value \+= terms\.value;",
        "if (p > 0u) value += terms.value;",
    ),
}


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", MUTANTS)
def test_wrong_weights_are_seen(device, monkeypatch, mutant):
    substitute(
        monkeypatch, *MUTANTS[mutant], within="tools/probe.cl", header="fibre/lobe_shares.clh"
    )
    fibre = FIBRES["chiang"]
    probe = Probe(fibre, "all-lobes", device)
    with pytest.raises(AssertionError):
        check_mean_weight(probe, 0.4, reference_of(fibre).albedo(fibre, 0.4))


def test_it_is_a_sampler_of_furcl():
    assert "all-lobes" in samplers.BUILT_IN
    with pytest.raises(SamplerError, match="all-lobes"):
        samplers.register("all-lobes", "any.clh")
