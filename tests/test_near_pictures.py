"""Pictures of fibres in modes "near" and "multiscale": where they take h from, and that the far
field is their mean."""

from __future__ import annotations

import numpy as np
import pytest
from cylinders import FIBRES as CYLINDERS
from cylinders import document, reference_of
from fibres import YAN2015
from kernel_mutants import substitute
from scene_documents import INDEPENDENT

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.yan2015.parameters import Yan2015Fibre
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene

SIDE = {
    "kind": "distant", "position": [5.0, -100.0, 90.0], "target": [0.0, 0.0, 0.0],
    "angle_deg": 0.0, "irradiance": 3.0,
}  # fmt: skip
# Large enough for samples of the fibre to find, in front and behind, on one side.
QUADS = {
    name: {
        "kind": "quad", "position": place, "target": [0.0, 0.0, 0.0], "size": [700.0, 700.0],
        "radiance": 1.0,
    }
    for name, place in (("front", [300.0, -700.0, 500.0]), ("back", [0.0, 700.0, 500.0]))
}  # fmt: skip


def wide_fibre(mode, fibre, lamps, width=48, **render):
    """A straight fibre that fills the middle of a picture 1.2 times as wide."""
    height = 4
    return decode_scene(
        {
            "film": {"width": width, "height": height, "filter": "box"},
            "camera": {
                "origin": [0.0, -2000.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [1.0, 0.0, 0.0],
                "projection": "orthographic", "height": 2.4 * height / width,
            },
            "fibre": {**fibre, "mode": mode},
            "lamp": lamps,
            "curves": {"generator": "fibre", "axis": "x", "radius": 1.0, "length": 1000.0},
            "render": {"max_depth": 1, **INDEPENDENT, **render},
        },
        "wide fibre",
    )  # fmt: skip


def picture(scene, device):
    """Mean over rows (width, 3), and its standard error."""
    renderer = Renderer(scene, device)
    renderer.advance(scene.render.spp)
    image = renderer.image()
    assert image.stats["nonfinite"] == 0
    assert image.variance is not None
    rows = image.height
    error = np.sqrt(image.variance.astype(np.float64).sum(0)) / rows
    return image.rgb.astype(np.float64).mean(0), error


def profile_z(device, fibre, table) -> float:
    """Largest difference of the columns of a near picture from the float64 values at their h, in
    standard errors."""
    scene = wide_fibre("near", table, {"side": SIDE}, light_sampling="mis", spp=64)
    found, error = picture(scene, device)
    n = len(found)
    # Columns from the left look at z falling; h is z over the radius, wo being -y.
    fine = 32
    z = 1.2 - (np.arange(n * fine) + 0.5) * (2.4 / (n * fine))
    light = np.array([5.0, -100.0, 90.0]) / np.linalg.norm([5.0, -100.0, 90.0])
    # The frame: x the tangent, wo = -y in its y, and so -z in its z. A point at z is at -z there.
    wo, wi = np.array([0.0, 1.0, 0.0]), np.array([light[0], -light[1], -light[2]])
    h = np.where(np.abs(z) <= 1.0, z, 0.0)
    values = reference_of(fibre).evaluate(fibre, wo, wi, h, None)
    values = np.where(np.abs(z)[:, None] <= 1.0, 3.0 * values, 0.0)
    expected = values.reshape(n, fine, 3).mean(1)
    edge = np.abs(z.reshape(n, fine) - np.sign(z.mean())).min(1) < 0.06
    off = np.abs(found - expected) / (error + 2e-3 * expected.max() + 1e-6)
    return float(off[~edge].max())


CLEAR = Fibre(sigma_ca=(0.2, 0.4, 0.8), beta_n_deg=6.0, alpha_deg=2.0)
CLEAR_TABLE = {"sigma_ca": [0.2, 0.4, 0.8], "beta_n_deg": 6.0, "alpha_deg": 2.0}
CLEAR_MEDULLA = Yan2015Fibre(
    eta_m=1.3, kappa=0.6, sigma_ca=(0.2, 0.4, 0.8), beta_n_deg=6.0, alpha_deg=2.0
)
PROFILES = {
    "double-cylinder": (CLEAR, CLEAR_TABLE),
    "chiang": (CYLINDERS["chiang"], document(CYLINDERS["chiang"])),
    "deon": (CYLINDERS["deon"], document(CYLINDERS["deon"])),
    "yan2015": (CLEAR_MEDULLA, document(CLEAR_MEDULLA)),
}


@pytest.mark.statistical
@pytest.mark.parametrize("model", PROFILES)
def test_a_wide_fibre_shows_every_offset(device, model):
    assert profile_z(device, *PROFILES[model]) < 4.5


@pytest.mark.statistical
def test_h_of_the_wrong_sign_is_seen(device, monkeypatch):
    substitute(
        monkeypatch, r"dot\(gap, frame->side\)", "-dot(gap, frame->side)",
        within="stages/sample_lobe_h.cl",
    )  # fmt: skip
    assert profile_z(device, *PROFILES["double-cylinder"]) > 20.0


# Energies that differ between the rim and the middle, and lobes of all kinds.
TABLES = {
    "human-black": {"preset": "human-black"},
    "chiang": document(CYLINDERS["chiang"]),
    "yan2015": document(YAN2015["air"]),
}


def mean(scene, device) -> tuple[np.ndarray, np.ndarray]:
    """Mean (3,) of a picture, and its standard error."""
    columns, error = picture(scene, device)
    return columns.mean(0), np.sqrt((error**2).sum(0)) / len(columns)


@pytest.fixture(scope="module")
def far_means(device):
    """Of each fibre the mean of the far field's picture."""
    return {
        name: mean(wide_fibre("far", table, QUADS, spp=512, light_sampling="mis"), device)
        for name, table in TABLES.items()
    }


def mean_z(far, scene, device) -> float:
    """Largest difference of the mean of a picture from another mean, in standard errors."""
    (a, a_error), (b, b_error) = far, mean(scene, device)
    return float((np.abs(a - b) / np.hypot(a_error, b_error)).max())


@pytest.mark.statistical
@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize(
    ("mode", "width"), [("near", 48), ("multiscale", 48), ("multiscale", 2), ("multiscale", 1)]
)
@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_the_mean_of_a_wide_fibre_is_the_far_field(
    device, far_means, name, mode, width, light_sampling
):
    """Samples of the fibre and of the light, given h, weigh 1 together; footprints of 0.05, 1.2 and
    2.4 radii leave the mean as it is."""
    scene = wide_fibre(
        mode, TABLES[name], QUADS, width, spp=256 * 48 // width, light_sampling=light_sampling
    )
    assert mean_z(far_means[name], scene, device) < 4.5


@pytest.mark.statistical
@pytest.mark.parametrize("mode", ["far", "near"])
def test_weights_of_all_lobes_have_the_same_mean(device, far_means, monkeypatch, mode):
    scene = wide_fibre(
        mode, TABLES["human-black"], QUADS, spp=256, light_sampling="mis", sampling="all-lobes"
    )
    assert mean_z(far_means["human-black"], scene, device) < 4.5
    substitute(
        monkeypatch, r"value \+= terms\.value;", "if (p > 0u) value += terms.value;",
        within="stages/shade.cl", header="fibre/lobe_shares.clh",
    )  # fmt: skip
    assert mean_z(far_means["human-black"], scene, device) > 9.0


MEAN_MUTANTS = {
    "a footprint ends at the rim": (
        r"fmax\(-1\.0f - low, 0\.0f\), above = fmax\(high - 1\.0f, 0\.0f\)",
        "0.0f, above = 0.0f", "bcsdf",
    ),
    "light is weighed at another h": (
        r"direction_density_within\(fibre, in, within, b\.h, d\)",
        "direction_density_within(fibre, in, within, -b.h, d)", "mis",
    ),
}  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", MEAN_MUTANTS)
def test_wrong_means_are_seen(device, far_means, monkeypatch, mutant):
    pattern, text, light_sampling = MEAN_MUTANTS[mutant]
    scene = wide_fibre(
        "multiscale", TABLES["human-black"], QUADS, 2, spp=20_000, light_sampling=light_sampling
    )
    substitute(monkeypatch, pattern, text, within="stages/sample_lobe_h.cl")
    assert mean_z(far_means["human-black"], scene, device) > 9.0


# A groom --------------------------------------------------------------------------------------

SIDE_PX, FINER = 16, 8


def groom(mode: str, size: int, spp: int, table, **render):
    """Strands that stand apart by many of their widths: what is beside a strand hides all of its
    width or nothing of it, as the far field takes for granted. Closer ones differ by what
    `bench/near_far.py` prints."""
    return decode_scene(
        {
            "film": {
                "width": size, "height": size, "filter": "box", "background": "transparent",
            },
            "camera": {"azimuth_deg": 25.0, "elevation_deg": 15.0, "vfov_deg": 25.0},
            "fibre": {**table, "mode": mode},
            "environment": {
                "kind": "sky", "sun_radius_deg": 20.0, "sun_azimuth_deg": -10.0,
                "sun_elevation_deg": 45.0, "sun_scale": 0.6, "scale": 0.05,
            },
            "curves": {
                "generator": "hair", "n_strands": 1000, "length": 1.6, "radius": 0.002,
                "style": "straight", "seed": 1,
            },
            "render": {"spp": spp, "light_sampling": "mis", **INDEPENDENT, **render},
        },
        "groom",
    )  # fmt: skip


def blocks(scene, device, finer: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of finer x finer pixels (n, n, 3), and their standard errors."""
    renderer = Renderer(scene, device)
    renderer.advance(scene.render.spp)
    image = renderer.image()
    assert image.variance is not None
    n = image.width // finer
    rgb, variance = (
        x.astype(np.float64).reshape(n, finer, n, finer, 3).mean((1, 3))
        for x in (image.rgb, image.variance)
    )
    return rgb, np.sqrt(variance) / finer


@pytest.fixture(scope="module")
def far_groom(device):
    return blocks(groom("far", SIDE_PX, 2048, TABLES["human-black"], seed=1), device, 1)


def groom_z(far, scene, device) -> tuple[float, float]:
    """Largest difference of a block, and of the whole picture, in standard errors."""
    (a, a_error), (b, b_error) = far, blocks(scene, device, FINER)
    error = np.hypot(a_error, b_error)
    seen = error > 0.0
    whole = np.abs((a - b).sum((0, 1))) / np.sqrt((error**2).sum((0, 1)))
    return float((np.abs(a - b)[seen] / error[seen]).max()), float(whole.max())


@pytest.mark.statistical
@pytest.mark.parametrize("mode", ["near", "multiscale"])
def test_a_groom_at_eight_times_the_resolution_is_the_far_field(device, far_groom, mode):
    """Every pixel of the far picture is the mean of 64 near ones: of 768 values at most 4.5
    standard errors off, 5.6 in a thousand by chance, and the whole picture 3.5."""
    scene = groom(mode, FINER * SIDE_PX, 32, TABLES["human-black"], seed=2)
    block, whole = groom_z(far_groom, scene, device)
    assert block < 4.5
    assert whole < 3.5


@pytest.mark.statistical
def test_a_groom_of_wrong_offsets_is_seen(device, far_groom, monkeypatch):
    substitute(
        monkeypatch, r"dot\(gap, frame->side\)", "0.5f * dot(gap, frame->side)",
        within="stages/sample_lobe_h.cl",
    )  # fmt: skip
    scene = groom("near", FINER * SIDE_PX, 32, TABLES["human-black"], seed=2)
    block, whole = groom_z(far_groom, scene, device)
    assert block > 9.0
    assert whole > 9.0
