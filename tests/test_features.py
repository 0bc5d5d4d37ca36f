"""What is left out is absent, and leaving it out changes no picture."""

import dataclasses
import itertools

import msgspec
import numpy as np
import pytest
from fibres import FIBRES
from model_checks import directions
from scene_documents import fur_patch

from furcl.bench import features as bench
from furcl.bench.variants import EVERY_LAYER, VALUES, features_of, pairwise, reachable
from furcl.device import program
from furcl.device.features import Features
from furcl.device.source import kernel_text
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.fibre.double_cylinder.model import MODEL
from furcl.fibre.material import NEGLIGIBLE_SHARE
from furcl.groom.curves import Curves
from furcl.paths import scene_folder
from furcl.rendering.learning import LearningPart
from furcl.rendering.probe import Probe
from furcl.rendering.renderer import Renderer
from furcl.rendering.specialise import everything_on
from furcl.rendering.wavefront import stage_defines, stage_files
from furcl.scene.read import load_scene, with_overrides
from furcl.surface.ellipsoid import PART
from furcl.surface.mesh.mesh import EVERY_MESH, MeshPart


def _text(device, features, stage):
    """The text of a stage, as the compiler sees it."""
    file = stage_files(features)[stage]
    return bench.preprocessed(kernel_text(file, features, stage_defines(stage, device)))


ROWS, MISSING = pairwise(VALUES, reachable)


def test_every_reachable_pair_is_in_the_matrix():
    fields = {field.name for field in dataclasses.fields(Features)} - {"fibre"}
    of_fibre = {field.name for field in dataclasses.fields(DoubleCylinderFeatures)}
    assert set(VALUES) == fields | of_fibre
    for a, u, b, v in MISSING:
        row = {name: values[-1] for name, values in VALUES.items()} | {a: u, b: v}
        fixes = itertools.product((False, True), (False, True), (0, 1, 3), (1, 3))
        for medulla, scattered, profile_channels, channels in fixes:
            free = {
                "medulla": medulla, "scattered": scattered,
                "profile_channels": profile_channels, "channels": channels,
            }  # fmt: skip
            candidate = row | {k: x for k, x in free.items() if k not in (a, b)}
            assert not reachable(candidate), f"{a}={u} with {b}={v} is reachable but not covered"


@pytest.mark.slow
@pytest.mark.parametrize("row", range(len(ROWS)))
def test_compile_matrix(device, row):
    """All stages compile without a warning (-Werror)."""
    features = features_of(ROWS[row])
    for stage, file in stage_files(features).items():
        program.build(device, file, features, stage_defines(stage, device))


def _scene(name):
    scene = load_scene(scene_folder() / f"{name}.toml", size="2x2", spp=4)
    if msgspec.to_builtins(scene.curves)["generator"] in ("hair", "fur"):
        return with_overrides(scene, ["curves.n_strands=300", "curves.radius=0.01"])
    return scene


SCENES = ["black_hair", "white_hair", "raccoon", "red_fox", "single_fibre", "furnace"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_four_pixels_of_every_scene_equal_the_full_build(device, name):
    """Where only unneeded code differs, pictures differ by rounding, and where that sends paths
    elsewhere by a part of the noise (measured: 0.3 of a standard error). Another seed is farther
    away, by at least 0.9 of one."""
    # Of independent samples, whose variance says the error.
    settings = ["light_sampling=mis", "sequence=independent", "roulette=depth"]
    scene = with_overrides(_scene(name), [f"render.{word}" for word in settings], spp=256)
    lean, full, other = (
        _rendered(with_overrides(scene, seed=seed), device, specialised)
        for seed, specialised in ((0, True), (0, False), (1, True))
    )
    assert lean.variance is not None
    error = np.sqrt(lean.variance.astype(np.float64)) + 1e-6
    assert np.abs((lean.rgb - full.rgb) / error).max() < 0.5
    assert np.abs((other.rgb - full.rgb) / error).max() > 0.7


def _rendered(scene, device, specialised):
    renderer = Renderer(scene, device, specialised=specialised)
    renderer.advance(scene.render.spp)
    image = renderer.image()
    assert image.stats["nonfinite"] == 0
    return image


@pytest.fixture
def values(device, rng):
    """Values of a fibre at random directions and offsets, by kernels of some features."""
    n = 2000
    at = directions(rng, n), directions(rng, n), rng.uniform(-1, 1, n)

    def evaluate(fibre, features):
        return Probe(fibre, device=device, channels=3, features=features).evaluate(*at)

    return evaluate


@pytest.mark.parametrize("name", FIBRES)
def test_leaving_out_what_a_fibre_does_not_need_changes_no_value(values, name):
    needed = MODEL.features(FIBRES[name])
    full = values(FIBRES[name], needed.everything_on())
    np.testing.assert_allclose(values(FIBRES[name], needed), full, rtol=1e-5, atol=1e-7)


WITHOUT = {
    "medulla": {"medulla": False, "scattered": False, "profile_channels": 0},
    "scattered": {"scattered": False, "profile_channels": 0},
    "absorption": {"profile_channels": 0},
    "layered": {"layered": False},
    "tilt": {"tilt": False},
}


@pytest.mark.parametrize("part", WITHOUT)
@pytest.mark.parametrize("name", ["raccoon", "coloured"])
def test_leaving_out_what_it_needs_is_seen(values, name, part):
    """Mutants of the test above. Measured: at least 8 % of all light."""
    needed = MODEL.features(FIBRES[name])
    full = values(FIBRES[name], needed)
    wrong = values(FIBRES[name], dataclasses.replace(needed, **WITHOUT[part]))
    assert np.abs(wrong - full).sum() > 0.05 * full.sum()


def test_same_estimator_gives_almost_the_same_bits(device):
    """Where only unneeded code differs, pictures differ by rounding at most."""
    scene = with_overrides(fur_patch(light_sampling="mis"), ["fibre.preset=raccoon"])
    lean, full = (Renderer(scene, device, specialised=flag) for flag in (True, False))
    assert full.features == everything_on(lean.features)
    assert full.material.fibre_features == lean.material.fibre_features.everything_on()
    for renderer in (lean, full):
        renderer.advance(8)
    a, b = lean.image().rgb, full.image().rgb
    # A rounding may send a path elsewhere: few pixels may differ, by one of their 8 samples.
    assert np.mean(np.abs(a - b) > 1e-4 * (1 + a)) < 0.02


# What is switched off, in which stage, and words that are gone with it.
ABSENT = [
    ({"scattered": False, "profile_channels": 0}, "shade", ("profile_azimuth(", "scattered_entry")),
    ({"medulla": False, "scattered": False, "profile_channels": 0}, "shade", ("half_medulla",)),
    ({"profile_channels": 0}, "shade", ("profile_channels(",)),
    ({"residual": False}, "shade", ("residual_attenuation",)),
    ({"light_sampling": False}, "shade", ("light_sample(", "light_density(")),
    ({"point_radii": False}, "sample_lobe_h", ("typedef float4 StoredVertex",)),
    ({"surface": None, "meshes": None}, "intersect_closest", ("surface_hit(", "PS_HIT_T")),
    ({"fibres": 1}, "intersect_closest", ("material_of_vertex(",)),
    ({"absorption": "constant"}, "shade", ("take_absorption(", "mixed_node(", "absorptions")),
    ({"absorption": "point"}, "shade", ("strand_of_vertex(", "popcount")),
    ({"mode": "far"}, "sample_lobe_h", ("offset_of_ray(", "sample_in_footprint(", "camera->up")),
    ({"mode": "far"}, "shade", ("values_at_offset(", "mirrored_footprint(", "camera->up")),
    ({"mode": "near"}, "shade", ("mixed_marginal(", "mirrored_footprint(", "direction_density(")),
    ({"mode": "near"}, "sample_lobe_h", ("bin_cdf_of(", "pixel_width(", "camera->up")),
    ({"meshes": None}, "intersect_closest", ("corners", "reach", "behind")),
    ({"meshes": MeshPart(textures=False)}, "shade_surface", ("texture_colour(",)),
    ({"meshes": MeshPart(emission=False)}, "shade_surface", ("emitted_at(", "at->emission")),
    ({"meshes": MeshPart(normals=False)}, "shade_surface", ("mirrored(direction",)),
    ({"meshes": MeshPart(coat=False)}, "shade_surface", ("coat_sample(", "at->coat")),
    ({"lens": False}, "generate", ("sin_turn",)),
    ({"motion": 0}, "generate", ("groom_time(", "PS_TIME")),
    ({"motion": 0}, "intersect_closest", ("query.time", "PS_TIME", "to - from, from)")),
    ({"motion": 0}, "intersect_shadow", ("query.time", "PS_TIME")),
    ({"motion": 0}, "shade", ("PS_TIME", "vertex_at_step(vertices, i, piece)")),
    ({"camera_motion": 0}, "generate", ("moved_camera(", "vload3(3u + i, from)")),
    ({"camera_motion": 0}, "add_first_hits", ("moved_camera(", "shutter")),
    ({"motion": 0, "camera_motion": 0}, "generate", ("shutter", "&wave, pixel, sample, 1u")),
    ({"layers": None}, "generate", ("PS_FIRST", "set_path_uint(paths, PS_HIT_SEGMENT")),
    ({"layers": None}, "shade", ("note_for_layers(", "before_lobe", "PS_FIRST_LIGHT_0")),
    ({"layers": None}, "shade_surface", ("note_for_layers(", "bounce.first")),
    ({"layers": None}, "intersect_shadow", ("PS_FIRST_SEEN", "rays.depth")),
    ({"transparent": False}, "shade_escaped", ("behind",)),
    ({"crop": False}, "generate", ("p.x += wave->crop_left",)),
    ({"orthographic": False}, "generate", ("ray.origin += beside",)),
    ({"statistics": False}, "sample_lobe_h", ("atomic_add(lobe_counts",)),
    ({"light": "constant"}, "shade_escaped", ("sky_radiance",)),
    ({"variance": False, "planned": False}, "add_to_film", ("mean_before",)),
    ({"planned": False}, "generate", ("planned_sample(", "PS_SAMPLE")),
    ({"planned": False}, "shade", ("PS_SAMPLE",)),
    ({"held": False}, "shade", ("held_numbers(", "shared")),
    ({"held": False}, "generate", ("held_numbers(", "shared")),
    ({"planned": False}, "add_to_film", ("keep_pilot(", "pilots", "planned_paths(")),
    ({"roulette": False}, "shade", ("throughput /= keep_next",)),
    ({"learning": None}, "shade", ("learned_cell(", "record_arrival(")),
    ({"shadow_roulette": False}, "shade", ("light /= keep_shadow",)),
    ({"sampler": "uniform-h"}, "sample_lobe_h", ("search_remainder(bins",)),
    ({"sequence": "independent"}, "generate", ("sobol_point(", "0x3d20adea")),
    ({"sequence": "independent"}, "shade", ("sobol_", "0x3d20adea")),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "stage", "words"), ABSENT)
def test_left_out_code_is_absent(device, changes, stage, words):
    full = {
        "residual": True, "light": "sky", "light_sampling": True, "surface": PART, "lens": True,
        "layers": EVERY_LAYER, "transparent": True, "crop": True, "orthographic": True,
        "sequence": "sobol", "planned": True, "held": True,
        "fibres": 2, "absorption": "strand",
        "shadow_roulette": True, "learning": LearningPart(), "motion": 2, "camera_motion": 2,
        "mode": "multiscale",
        "meshes": EVERY_MESH,
    }  # fmt: skip
    there, gone = (_text(device, features_of(values), stage) for values in (full, full | changes))
    for word in words:
        assert word in there, f"{word} is misspelt in this test"
        assert word not in gone
    # Reading 12 bytes a vertex takes more text than reading 16.
    assert len(gone) < len(there) or changes == {"point_radii": False}


@pytest.mark.parametrize("there", [{"surface": PART}, {"meshes": MeshPart()}])
def test_surfaces_have_stages_of_their_own(there):
    with_surface, without = (set(stage_files(features_of(values))) for values in (there, {}))
    assert with_surface - without == {"shade_surface"}


def test_radii_are_stored_per_point_only_where_they_differ(device, monkeypatch):
    """12 bytes a vertex where all are equal, 16 else; the picture is the same to the bit."""
    even = ["curves.radius_variation=0.0", "curves.tip_radius=1.0", "curves.undercoat_radius=1.0"]
    scene = with_overrides(fur_patch(), even)
    n = scene.build_curves().n_points
    one = Renderer(scene, device)
    monkeypatch.setattr(Curves, "one_radius", False)
    each = Renderer(scene, device)
    assert "point_radii" in one.stats()["features"]["left_out"]
    assert "point_radii" not in each.stats()["features"]["left_out"]
    assert one.memory.bytes["vertices"] == 4 * (3 * n + 2)
    assert each.memory.bytes["vertices"] == 16 * n
    for renderer in (one, each):
        renderer.advance(2)
    assert np.array_equal(one.image().rgb, each.image().rgb)


def test_negligible_lobes_are_dropped_and_named(device):
    """Opaque fibres transmit nothing: only R is left, and says so."""
    scene = with_overrides(fur_patch(), ["fibre.preset=human-black", "fibre.sigma_ca=60.0"])
    renderer = Renderer(scene, device)
    renderer.advance(1)
    stats = renderer.stats()
    assert renderer.material.fibre_features.lobes == ("R",)
    assert f"{NEGLIGIBLE_SHARE:g}" in stats["features"]["left_out"]["lobe TT"]
    assert stats["lobes"]["TT"] == 0
    assert not renderer.material.fibre_features.optional()["scattered"][0]
    assert renderer.material.fibre_features.data_words == 0


@pytest.mark.parametrize("preset", ["human-black", "raccoon"])
def test_ordinary_lobes_stay(device, preset):
    scene = with_overrides(fur_patch(), [f"fibre.preset={preset}"])
    lobes = Renderer(scene, device).material.fibre_features.lobes
    assert {"R", "TT", "TTs"} <= set(lobes)


def test_features_of_fibres():
    clear = MODEL.features(with_overrides(fur_patch(), ["fibre.kappa=0.0"]).build_fibre())
    assert not clear.medulla
    assert not clear.scattered
    fox = fur_patch().build_fibre()
    assert MODEL.features(fox).medulla
    assert MODEL.features(fox).profile_channels == 1
    assert MODEL.is_grey(fox)
