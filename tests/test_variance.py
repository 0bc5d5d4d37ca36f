"""`furcl bench variance` on scenes whose parts are known: what camera, h, lobe, direction, light
and roulette leave of the variance, by bounce."""

import json
from pathlib import Path

import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from mesh_files import obj_text
from mesh_shapes import sphere
from scipy import stats

from furcl.bench import variance
from furcl.errors import BenchError, SceneError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.energy import nodes_over_h
from furcl.fibre.double_cylinder.reference.optics import attenuation
from furcl.rendering.held import KINDS, Held, all_but
from furcl.rendering.renderer import Renderer
from furcl.report.variance import write_figures
from furcl.scene.read import decode_scene, with_overrides

GROUPS, SAMPLES, BOUNCES = 16, 8, 3
# Of the whole variance: pixels see the fibre and the ball under slightly different angles.
SLACK = 2e-3
OUT_OF_SIGHT = {"generator": "fibre", "length": 0.001, "radius": 0.0001, "centre": [0, -900, 0]}
WITHOUT_MEDULLA = {"kappa": 0.0, "sigma_ca": (0.3, 1.2, 3.0)}
ALBEDO, THRESHOLD, DEPTH = 0.3, 0.5, 4
RADIUS, HALF_HEIGHT, DISTANCE = 2.0, 2.5, 2000.0


def document(**tables):
    """A scene of 8 x 8 pixels whose strand is out of sight, of a sampler that takes h evenly."""
    render = {"sampling": "uniform-h", "light_sampling": "bcsdf", "roulette": "depth"}
    tables["render"] = {**render, **tables.get("render", {})}
    camera = {"origin": [0, -50, 0], "target": [0, 0, 0], "vfov_deg": 0.5}
    return decode_scene(
        {
            "film": {"width": 8, "height": 8, "filter": "box"},
            "camera": camera,
            "fibre": {"preset": "human-black", **WITHOUT_MEDULLA},
            "curves": OUT_OF_SIGHT,
            **tables,
        }
    )


def fibre(folder):
    """A coloured fibre across the picture, in even light that is seen above and below it."""
    del folder
    return document(
        camera={
            "origin": [0, -DISTANCE, 0],
            "target": [0, 0, 0],
            "vfov_deg": float(2.0 * np.degrees(np.arctan(HALF_HEIGHT / DISTANCE))),
        },
        environment={"kind": "constant"},
        curves={"generator": "fibre", "axis": "x", "radius": RADIUS, "length": 1000.0},
    )


def parts_of_fibre():
    """By quadrature over h of float64 attenuations: one reflection, and no light is hidden."""
    own = Fibre.preset("human-black", **WITHOUT_MEDULLA)
    h, weight, _ = nodes_over_h(own, 0.0, 1, 64)
    a = np.stack(list(attenuation(own, h, 0.0).values()))
    chance = a.mean(axis=-1, keepdims=True) / a.mean(axis=-1, keepdims=True).sum(axis=0)
    of_lobe = np.divide(a * a, chance, out=np.zeros_like(a), where=chance > 0.0).sum(axis=0)
    total = a.sum(axis=0)

    def mean(values):
        return np.einsum("pn,pnc->c", weight, values)

    edges = np.linspace(-HALF_HEIGHT, HALF_HEIGHT, 9)
    seen = np.clip(edges[1:], -RADIUS, RADIUS) - np.clip(edges[:-1], -RADIUS, RADIUS)
    cover = seen / np.diff(edges)
    return {
        ("camera", None): (cover * (1 - cover)).mean() * ((1 - mean(total)) ** 2).mean(),
        ("h", 0): cover.mean() * (mean(total**2) - mean(total) ** 2).mean(),
        ("lobe", 0): cover.mean() * mean(of_lobe - total**2).mean(),
    }


def half_space(folder):
    """A diffuse wall that sees light in half of its directions."""
    del folder
    return document(
        body={"centre": [0, 100, 0], "radii": [100, 100, 100], "albedo": 0.8},
        lamp={"sky": {"kind": "distant", "target": [0, 0, -1], "angle_deg": 180, "radiance": 1.0}},
    )


LAMPS = ((1.0, 0.9), (3.0, 0.3))  # irradiance, cosine


def two_lamps(folder):
    """The wall with two lamps at infinity, of which light samples take one by its irradiance."""
    del folder
    lamps = {}
    for side, (irradiance, cosine) in zip((1, -1), LAMPS, strict=True):
        towards = [side * float(np.sqrt(1 - cosine**2)), cosine, 0.0]
        lamps[f"lamp{side}"] = {
            "kind": "distant", "target": towards, "angle_deg": 0, "irradiance": irradiance,
        }  # fmt: skip
    return document(
        body={"centre": [0, 100, 0], "radii": [100, 100, 100], "albedo": 0.8},
        lamp=lamps,
        render={"light_sampling": "mis"},
    )


def part_of_lamps():
    irradiance, cosine = np.array(LAMPS).T
    chance = irradiance / irradiance.sum()
    found = 0.8 / np.pi * cosine * irradiance / chance
    return {("light", 0): chance.prod() * (found[0] - found[1]) ** 2}


def glowing_ball(folder):
    """Inside a ball that glows and reflects alike everywhere paths differ by their lengths only."""
    file = Path(folder) / "inside.obj"
    # Fronts inside: a triangle far away keeps the mesh from being closed, and so from being turned.
    ball, stray = sphere(6, 2.0).corners[:, ::-1], np.eye(3)[None] + 900.0
    file.write_text(obj_text(np.concatenate([ball, stray])))
    return document(
        camera={"origin": [0, -0.5, 0], "target": [0, 0, 0], "vfov_deg": 30},
        environment={"kind": "constant", "radiance": 1e-7},
        mesh={"ball": {"file": str(file), "albedo": ALBEDO, "emission": 1.0, "smooth": False}},
        render={
            "roulette": "throughput",
            "roulette_threshold": THRESHOLD,
            "max_depth": DEPTH,
        },
    )


def parts_of_ball():
    """A path that lives brings the threshold at every hit; it is kept with the chance albedo over
    threshold at the first bounce and with the albedo at later ones."""
    parts, alive, chance = {}, 1.0, ALBEDO / THRESHOLD
    for bounce in range(DEPTH - 1):
        worth = THRESHOLD * np.sum(ALBEDO ** np.arange(DEPTH - 1 - bounce))
        parts["roulette", bounce] = alive * chance * (1 - chance) * worth**2
        alive, chance = alive * chance, ALBEDO
    return parts


CASES = {
    "fibre": (fibre, parts_of_fibre),
    "half space": (half_space, lambda: {("direction", 0): 0.8**2 / 4}),
    "lamps": (two_lamps, part_of_lamps),
    "ball": (glowing_ball, parts_of_ball),
}


def deviations(device, folder, name):
    """Of every part: measured less true, in its own standard errors beyond the slack; and the
    bound."""
    make, parts = CASES[name]
    scene = variance.prepared(make(folder))
    found, _, _ = variance.measure(
        scene, device, bounces=BOUNCES, groups=GROUPS, samples=SAMPLES, seed=7
    )
    true = parts()
    total = sum(true.values())
    assert set(true) <= {(part["kind"], part["bounce"]) for part in found["parts"]}
    z = []
    for part in found["parts"]:
        e = part["variance"]
        error = max((e["high"] - e["mean"]) / stats.t.ppf(0.975, GROUPS - 1), 1e-12)
        off = abs(e["mean"] - true.get((part["kind"], part["bounce"]), 0.0))
        z.append(max(off - SLACK * total, 0.0) / error)
    return np.array(z), stats.t.isf(sidak(15 * len(CASES)) / 2, GROUPS - 1)


@pytest.mark.statistical
@pytest.mark.parametrize("name", CASES)
def test_parts_are_those_of_the_closed_form(device, tmp_path, name):
    """All parts of all scenes together: one per cent."""
    z, bound = deviations(device, tmp_path, name)
    assert (z < bound).all()


MUTANTS = {
    "h": ("fibre", "kinds & FURCL_HELD_H", "stages/sample_lobe_h.cl"),
    "lobe": ("fibre", "kinds & FURCL_HELD_LOBE", "stages/sample_lobe_h.cl"),
    "camera": ("fibre", "held & FURCL_HELD_CAMERA", "stages/generate.cl"),
    "direction": ("half space", "kinds & FURCL_HELD_DIRECTION", "stages/shade_surface.cl"),
    "light": ("lamps", "kinds & FURCL_HELD_LIGHT", "stages/shade_surface.cl"),
    "roulette": ("ball", "kinds & FURCL_HELD_ROULETTE", "stages/shade_surface.cl"),
    "bounce": ("ball", "bounce == at", "stages/shade_surface.cl"),
}


@pytest.mark.statistical
@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_numbers_that_are_not_held_are_seen(device, tmp_path, monkeypatch, name):
    """Mutants of the test above."""
    case, pattern, within = MUTANTS[name]
    substitute(monkeypatch, pattern, "0u", within=within)
    z, bound = deviations(device, tmp_path, case)
    assert (z > bound).any()


def test_a_path_whose_numbers_are_all_held_has_no_variance(device, tmp_path):
    """And every kind is held by one word alone."""
    scene = variance.prepared(fibre(tmp_path), ["render.sampling=attenuation-cdf"])
    renderer = Renderer(scene, device, held=Held())
    everything = Held(camera=True, at=KINDS, after=KINDS)
    none = variance.left(renderer, everything, 2, 4)
    assert none.groups.max() < 1e-12
    assert variance.left(renderer, Held(), 2, 4).groups.min() > 1e-3
    words = {all_but(kind).word for kind in (None, *KINDS)}
    assert len({everything.word, Held().word, *words}) == 3 + len(KINDS)


def test_results_and_figures(device, tmp_path):
    """Parts add up to the variance, and maps to the parts."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'film={width=8,height=8}\nfibre={preset="human-black",kappa=0.0}\n'
        'environment={kind="constant"}\ncurves={generator="fibre",count=4,radius=0.05}\n'
    )
    variants = [variance.Variant.of_sampler(name) for name in ("uniform-h", "attenuation-cdf")]
    out = tmp_path / "out"
    returned = variance.run(
        [scene], out, variants=variants, device=device, bounces=1, groups=3, samples=4
    )
    written = json.loads((out / "results.json").read_text())
    assert written == json.loads(json.dumps(returned))
    [row] = returned["scenes"]
    for found in row["variants"]:
        total = found["variance"]["mean"]
        parts = [part["variance"]["mean"] for part in found["parts"]]
        assert sum(parts) == pytest.approx(total, rel=1e-9)
        assert sum(part["share"] for part in found["parts"]) == pytest.approx(1.0)
        kinds = [part["kind"] for part in found["alone"]]
        assert kinds == ["camera", "h", "lobe", "direction", "roulette"]
        with np.load(out / variance.maps_of("scene", found["name"])) as maps:
            each = [maps[name].mean() for name in maps.files]
        assert each == pytest.approx(parts, rel=1e-4, abs=1e-6 * total)
    assert row["variants"][0]["rmse"]["mean"] == pytest.approx(1.0)
    assert row["variants"][1]["path_rmse"]["mean"] < 1.0
    files = write_figures(returned, out)
    assert len(files) == 3
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)


def test_too_few_are_refused(tmp_path):
    with pytest.raises(BenchError, match="--groups 1: give 2 or more"):
        variance.run([], tmp_path, groups=1)
    with pytest.raises(BenchError, match="--group-size 1: give 2 or more"):
        variance.run([], tmp_path, samples=1)


def test_variants_have_names_of_their_own(tmp_path):
    twice = [variance.Variant("a"), variance.Variant("a")]
    with pytest.raises(BenchError, match="a name is there twice"):
        variance.run([], tmp_path, variants=twice)


def test_numbers_of_sobol_are_not_held(device, tmp_path):
    scene = with_overrides(fibre(tmp_path), ["render.sequence=sobol"])
    with pytest.raises(SceneError, match="set it to 'independent'"):
        Renderer(scene, device, held=Held())


@pytest.mark.parametrize(
    ("keywords", "message"),
    [({"at": ("colour",)}, "kind 'colour': allowed are h"), ({"bounce": 1 << 16}, "0 to 65535")],
)
def test_what_cannot_be_held_is_refused(keywords, message):
    with pytest.raises(ValueError, match=message):
        Held(**keywords)


def test_ratios_of_groups(rng):
    """The interval of a known ratio, 2 in RMSE, holds it in 95 of 100 times; exact ones have
    none."""
    truth, over = [], np.ones(16)
    for _ in range(400):
        of, over = 4.0 * rng.exponential(size=16), rng.exponential(size=16)
        truth.append(variance.rmse_ratio(of, over).contains(2.0))
    assert stats.binomtest(sum(truth), len(truth), 0.95).pvalue > 0.001
    exact = variance.rmse_ratio(4.0 * over, over)
    assert (exact.low, exact.mean, exact.high) == pytest.approx((2.0, 2.0, 2.0))
    assert np.isnan(variance.rmse_ratio(np.zeros(4), np.ones(4)).mean)
