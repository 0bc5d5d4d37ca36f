"""Grooms of two materials, a mesh, a lamp, an environment and layers at once."""

from __future__ import annotations

import json

import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from mesh_files import obj_text
from mesh_shapes import box
from scene_documents import INDEPENDENT
from scipy import stats

import furcl
from furcl.scene.read import decode_scene, with_overrides

ALBEDO = (0.8, 0.4, 0.2)
RADIANCE = 3.0
LAYERS = (
    "alpha", "depth", "position", "normal", "tangent", "strand", "groom", "albedo", "direct",
    "indirect", "lobes", "cryptomatte_groom", "cryptomatte_strand",
)  # fmt: skip
GLOW = (0.0, 0.5, 0.1)
FLOOR, LAMP_HEIGHT = -0.05, 0.9
FUR = {
    "generator": "fur", "surface": "patch", "n_strands": 150, "length": 0.3, "radius": 0.03,
    "patch_size": [0.6, 0.8], "lean_deg": 20.0,
}  # fmt: skip
CLEAR = {"preset": "human-black", "kappa": 0.0, "beta_n_deg": 20.0}
# Sources of light -> what switches them off; the lamp stays in the way.
SOURCES = {
    "environment": "environment.radiance=0",
    "lamp": "lamp.key.radiance=0",
    "mesh": "mesh.floor.emission=0",
}


@pytest.fixture
def document(tmp_path):
    """Two patches of fur on a shining floor below a quad, 24 x 16 pixels; the quad is in view."""
    path = tmp_path / "floor.obj"
    path.write_text(obj_text(box((-2.0, -2.0, FLOOR - 0.2), (2.0, 2.0, FLOOR))))
    return {
        "camera": {"origin": [0, -4.0, 2.2], "target": [0, 0, 0.3], "vfov_deg": 30.0},
        "film": {"width": 24, "height": 16, "filter": "box", "layers": list(LAYERS)},
        "material": {"light": {**CLEAR, "sigma_ca": 0.2}, "dark": {**CLEAR, "sigma_ca": 2.0}},
        "groom": {
            "left": {
                "curves": FUR, "material": "light", "transform": {"translate": [-0.6, 0, 0]},
            },
            "right": {
                "curves": {**FUR, "seed": 2}, "material": "dark",
                "transform": {"translate": [0.6, 0, 0]},
            },
        },
        "mesh": {"floor": {"file": str(path), "albedo": ALBEDO, "emission": GLOW}},
        "lamp": {
            "key": {
                "kind": "quad", "position": [0, 0.6, LAMP_HEIGHT], "target": [0, -1.0, 0.0],
                "size": [0.9, 0.5], "radiance": RADIANCE,
            }
        },
        "environment": {"kind": "constant", "radiance": 0.4},
        "render": {"spp": 16, "max_depth": 8, **INDEPENDENT},
    }  # fmt: skip


def render(device, document, *overrides, **render):
    return furcl.render(
        with_overrides(decode_scene(document), [*overrides], **render), device=device
    )


def without(document, kind, name):
    """The document without one of its tables."""
    return {**document, kind: {k: v for k, v in document[kind].items() if k != name}}


def means(image):
    """Mean over blocks of 8 x 8 pixels and its variance, (6, 3)."""

    def blocks(values):
        return values.astype(np.float64).reshape(2, 8, 3, 8, 3).mean(axis=(1, 3)).reshape(-1, 3)

    return blocks(image.rgb), blocks(image.variance) / 64.0


def largest_z(device, document, **options):
    """Of the difference between the whole light and the sum of its sources, block by block."""
    spp = 512
    whole, variance = means(render(device, document, spp=spp, **options))
    total = np.zeros_like(whole)
    for seed, source in enumerate(SOURCES, 1):
        others = [off for name, off in SOURCES.items() if name != source]
        part, own = means(render(device, document, *others, spp=spp, seed=seed, **options))
        total += part
        variance = variance + own
    return np.abs((whole - total) / np.sqrt(variance)).max()


LIMIT = stats.norm.isf(0.5 * sidak(18))


@pytest.mark.statistical
def test_sources_of_light_add_up(device, document):
    """Independent samples of all sources at once and of each alone."""
    assert largest_z(device, document) < LIMIT


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("pattern", "text", "within"),
    [
        # light samples of the lamp as if it were always taken
        (r"taken\.chance \* placed", "taken.chance", "stages/shade.cl"),
        # rays to the lamp weighed as if it were never sampled
        (
            r"return (radiance \* ray_weight\(pdf,) near_chance",
            r"return \1 0.0f * near_chance",
            "stages/shade_escaped.cl",
        ),
    ],
    ids=["chance left out", "weight left out"],
)
def test_sources_that_do_not_add_up_are_seen(device, document, monkeypatch, pattern, text, within):
    """The mutants of the test above."""
    substitute(monkeypatch, pattern, text, within=within)
    assert largest_z(device, document) > LIMIT


def coverages(image) -> dict[str, np.ndarray]:
    """Name of each object -> how much of each pixel it covers, by the cryptomatte."""
    [text] = [
        value
        for key, value in image.attributes.items()
        if key.endswith("/manifest") and "/" not in next(iter(json.loads(value)))
    ]
    found = {}
    for name, bits in json.loads(text).items():
        id_ = np.array([int(bits, 16)], np.uint32).view(np.float32)[0]
        ranks = [("R", "G"), ("B", "A")]
        found[name] = sum(
            np.where(
                image.layers[f"CryptoObject{level:02}.{i}"] == id_,
                image.layers[f"CryptoObject{level:02}.{c}"],
                0.0,
            )
            for level in range(3)
            for i, c in ranks
        )
    return found


def vector(image, name, axes="XYZ"):
    return np.stack([image.layers[f"{name}.{axis}"] for axis in axes], axis=-1)


def test_layers_tell_the_parts_apart(device, document):
    """Where a pixel is one object's alone, layers say what is known of it."""
    image = render(device, document)
    found = coverages(image)
    assert set(found) == {"left", "right", "mesh.floor", "lamp.key"}
    total = sum(found.values())
    assert total == pytest.approx(image.layers["A"], abs=1e-6)
    whole = {name: coverage > 1.0 - 1e-6 for name, coverage in found.items()}
    for name, pixels in whole.items():
        assert pixels.sum() >= 2, name
    floor, lamp = whole["mesh.floor"], whole["lamp.key"]
    position, normal = vector(image, "P"), vector(image, "N")
    albedo, direct = vector(image, "albedo", "RGB"), vector(image, "direct", "RGB")
    # Measured: 3e-7 of coordinates up to 4.
    assert position[floor][:, 2] == pytest.approx(FLOOR, abs=3e-6)
    assert normal[floor] == pytest.approx(np.array([[0.0, 0.0, 1.0]] * floor.sum()), abs=1e-6)
    assert albedo[floor] == pytest.approx(np.array([ALBEDO] * floor.sum()), rel=1e-5)
    axis = np.array([0.0, -1.6, -LAMP_HEIGHT]) / np.hypot(1.6, LAMP_HEIGHT)
    assert normal[lamp] == pytest.approx(np.array([axis] * lamp.sum()), abs=1e-6)
    from_lamp = (position[lamp] - np.array([0.0, 0.6, LAMP_HEIGHT])) @ axis
    assert from_lamp == pytest.approx(0.0, abs=3e-6)
    assert (image.rgb[lamp] == np.float32(RADIANCE)).all()
    assert (albedo[lamp] == 0.0).all()
    assert (direct[lamp] == 0.0).all()
    for number, name in enumerate(("left", "right")):
        assert (image.layers["groom"][whole[name]] == number).all()
    assert (image.layers["groom"][floor | lamp] == -1).all()


def test_layers_of_light_add_up(device, document):
    """Direct and indirect light, and that by lobes, are the picture where light is scattered."""
    image = render(device, document)
    found = coverages(image)
    scattering = found["lamp.key"] + (1.0 - image.layers["A"]) < 1e-6
    assert scattering.sum() > 100
    parts = vector(image, "direct", "RGB") + vector(image, "indirect", "RGB")
    # Measured: 3e-7, of float32 sums.
    assert parts[scattering] == pytest.approx(image.rgb[scattering], rel=1e-5, abs=1e-5)
    lobes = {name.split(".")[0] for name in image.layers if name.startswith("lobe_")}
    assert "lobe_surface" in lobes
    assert len(lobes) > 3
    by_lobe = np.sum([vector(image, name, "RGB") for name in sorted(lobes)], axis=0)
    assert by_lobe[scattering] == pytest.approx(image.rgb[scattering], rel=1e-5, abs=1e-5)
    floor = found["mesh.floor"] > 1.0 - 1e-6
    surface = vector(image, "lobe_surface", "RGB")
    assert surface[floor] == pytest.approx(image.rgb[floor], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(
    ("kind", "name", "objects"),
    [("groom", "right", ("left", "mesh.floor", "lamp.key")), ("mesh", "floor", ("left", "right")),
     ("lamp", "key", ("left", "right", "mesh.floor"))],
)  # fmt: skip
def test_what_is_not_hidden_stays_as_it_is(device, document, kind, name, objects):
    """Without one part camera rays meet the others where they met them before, to the bit."""
    image = render(device, document)
    other = render(device, without(document, kind, name))
    here, there = coverages(image), coverages(other)
    assert set(there) == set(here) - {name, f"{kind}.{name}"}
    for seen in objects:
        pixels = here[seen] > 1.0 - 1e-6
        assert pixels.any()
        assert (there[seen][pixels] == here[seen][pixels]).all()
        for layer in ("Z", "P.X", "N.Z", "tangent.X"):
            assert (image.layers[layer][pixels] == other.layers[layer][pixels]).all(), (seen, layer)


def test_direct_light_has_that_of_meshes(device, document):
    """All that shines is met or sampled after one scattering: with two bounces at most, nothing is
    indirect but what was scattered twice; with one, nothing at all."""
    image = render(device, document, max_depth=1)
    assert vector(image, "direct", "RGB").max() > 0.0
    assert np.abs(vector(image, "indirect", "RGB")).max() < 1e-6


def test_transparent_pictures_hold_lamps_and_meshes(device, document):
    """Alpha is what the objects cover, and behind them nothing shines."""
    image = render(device, document, "film.background='transparent'")
    opaque = render(device, document)
    assert (image.layers["A"] == opaque.layers["A"]).all()
    nothing = image.layers["A"] == 0.0
    assert nothing.any()
    assert (image.rgb[nothing] == 0.0).all()
    covered = image.layers["A"] == 1.0
    assert (image.rgb[covered] == opaque.rgb[covered]).all()
    behind = 0.4 * (1.0 - image.layers["A"][..., None])
    assert image.rgb + behind == pytest.approx(opaque.rgb, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("allocation", ["even", "adaptive"])
def test_a_stopped_render_goes_on_to_the_same_bits(device, document, tmp_path, allocation):
    """Layers of everything at once are in checkpoints."""
    scene = with_overrides(decode_scene(document), [f"render.allocation='{allocation}'"])
    path = tmp_path / "kept.furcl"
    options = {"device": device, "wave_size": 512}
    furcl.render(scene, checkpoint=path, progress=lambda done, total: 3 * done > total, **options)
    gone_on, whole = furcl.render(scene, resume=path, **options), furcl.render(scene, **options)
    assert (gone_on.rgb == whole.rgb).all()
    assert set(gone_on.layers) == set(whole.layers)
    for name, values in whole.layers.items():
        assert np.array_equal(gone_on.layers[name], values, equal_nan=True), name
