"""Layers of the film beside float64: every ray of a wave is traced again on the host."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest
from kernel_mutants import substitute
from scene_documents import fur_patch
from scipy import stats

import furcl
from furcl.device import layout
from furcl.device.layout import LAYERS
from furcl.errors import SceneError
from furcl.image import cryptomatte, size
from furcl.image.image import Image
from furcl.oracle.host_render import Segments
from furcl.rendering.layers import NO_DEPTH, RANKED_IDS, RANKS
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, with_overrides

SPP = 8
# Of coordinates up to 3. Measured: 3e-7 at fibres, 6e-5 where a ray grazes the body, whose float32
# distance is a root of a difference.
TOLERANCE = {"fibres": 2e-6, "body": 3e-4}


def with_layers(scene, *names):
    return with_overrides(scene, [f"film.layers={list(names)}"])


def patch(**extra):
    """Fur whose points have radii of their own, on a ball."""
    scene = fur_patch(spp=SPP)
    overrides = ["camera.azimuth_deg=-60", "curves.n_strands=120", "curves.surface=sphere"]
    overrides += ["curves.length=0.4", "curves.radius=0.02", "body={radii=[0.95, 0.95, 0.95]}"]
    return with_overrides(scene, overrides + [f"{k}={v}" for k, v in extra.items()])


class Recorded:
    """A render, and what the host finds of the camera rays of its only wave.

    Attributes
    ----------
    image : Image
    pixel : (n,)            of each camera ray, row by row
    hit : (n,) bool         whether it meets something
    fibre : (n,) bool       whether that is a fibre
    values : dict           layer -> (n, k) float64
    strand : (n,)           number; -1: none
    joint : (n,) bool       whether it meets a fibre where two segments join, which are equally near
    """

    def __init__(self, scene, device, monkeypatch) -> None:
        renderer = Renderer(scene, device)
        rays: dict[str, Any] = {}
        stages = renderer.wavefront
        add = stages.add_first_hits

        def record(wave, n_pixels):
            names = layout.planes(stages.features)
            n_slots = int(stages.n_slots)
            state = renderer.memory.read(stages.state, (n_slots // 16, len(names), 16))
            planes = np.moveaxis(state, 1, 0).reshape(len(names), n_slots)[
                :, : int(wave["n_paths"])
            ]
            for name in ("ORIGIN", "DIR"):
                at = names.index(f"{name}_X")
                rays[name] = planes[at : at + 3].T.astype(np.float64)
            rays["wave"] = wave.copy()
            add(wave, n_pixels)

        monkeypatch.setattr(stages, "add_first_hits", record)
        renderer.advance(scene.render.spp)
        self.image = renderer.image()
        assert int(rays["wave"]["n_paths"]) == scene.film.window.n_pixels * scene.render.spp
        self._trace(scene, rays["ORIGIN"], rays["DIR"])
        self._number(renderer)

    def _number(self, renderer) -> None:
        from furcl.rendering.plan import tile_order

        film = renderer.film
        order = tile_order(film.width, film.height)
        self.pixel = np.tile(order, len(self.hit) // len(order))
        self.shape = (film.height, film.width)

    def _trace(self, scene, origin, direction) -> None:
        curves = scene.build_curves().traced()
        segments = Segments(curves)
        t, segment, u = segments.closest(origin, direction, np.full(len(origin), -1))
        self.fibre = segment >= 0
        self.hit = self.fibre.copy()
        n = len(origin)
        position, normal, tangent = np.zeros((3, n, 3))
        self.joint = self.fibre & ((u < 1e-6) | (u > 1.0 - 1e-6))
        f = np.flatnonzero(self.fibre)
        axis = segments.axis[segment[f]]
        position[f] = segments.start[segment[f]] + u[f, None] * axis
        tangent[f] = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        across = -direction[f] + (direction[f] * tangent[f]).sum(1, keepdims=True) * tangent[f]
        normal[f] = across / np.linalg.norm(across, axis=1, keepdims=True)
        if scene.body is not None:
            radius = scene.body.radii[0]
            along, square = (origin * direction).sum(1), (origin**2).sum(1) - radius**2
            root = along**2 - square
            distance = np.where(root > 0.0, -along - np.sqrt(np.maximum(root, 0.0)), np.inf)
            s = np.flatnonzero(distance < t)
            self.fibre[s], self.hit[s] = False, True
            position[s] = origin[s] + distance[s, None] * direction[s]
            normal[s] = position[s] / radius
            tangent[s] = 0.0
        self.strand = np.where(self.fibre, segments.strand[np.maximum(segment, 0)], -1)
        lengths = np.linalg.norm(segments.axis, axis=1)
        before = np.cumsum(lengths) - lengths
        first = np.searchsorted(segments.strand, np.arange(curves.n_strands))
        whole = np.add.reduceat(lengths, first)
        place = before[segment] - before[first[segments.strand[segment]]] + u * lengths[segment]
        along = np.where(self.fibre, place / whole[segments.strand[segment]], 0.0)
        camera, _, _, forward = scene.resolved_camera(curves).frame()
        self.values = {
            "depth": ((position - camera) @ forward)[:, None],
            "position": position,
            "normal": normal,
            "tangent": tangent,
            "strand_u": along[:, None],
        }

    def count(self, which) -> np.ndarray:
        return np.bincount(self.pixel[which], minlength=self.shape[0] * self.shape[1])

    def mean(self, layer, which) -> np.ndarray:
        """(pixels, k) mean over the rays of a pixel that are in `which`; 0 where there are none."""
        n = self.shape[0] * self.shape[1]
        sums = [
            np.bincount(self.pixel[which], column[which], minlength=n)
            for column in self.values[layer].T
        ]
        return np.stack(sums, 1) / np.maximum(self.count(which), 1)[:, None]

    def nearest(self) -> np.ndarray:
        """The strand of the nearest hit of each pixel; -1 for a surface or none."""
        depth = np.where(self.hit, self.values["depth"][:, 0], np.inf)
        order = np.lexsort((depth, self.pixel))
        pixels, first = np.unique(self.pixel[order], return_index=True)
        found = np.full(self.shape[0] * self.shape[1], -1)
        found[pixels] = np.where(self.hit, self.strand, -1)[order[first]]
        return found


CHANNELS = {
    "depth": ("Z",),
    "position": ("P.X", "P.Y", "P.Z"),
    "normal": ("N.X", "N.Y", "N.Z"),
    "tangent": ("tangent.X", "tangent.Y", "tangent.Z"),
    "strand_u": ("strand_u",),
}
FIRST_HITS = ("alpha", *CHANNELS, "strand", "groom", "cryptomatte_strand", "cryptomatte_groom")


def errors(device, monkeypatch, scene=None) -> dict[str, float]:
    """Largest difference of each layer of first hits from the host's."""
    found = Recorded(with_layers(scene or patch(), *FIRST_HITS), device, monkeypatch)
    layers = {name: values.ravel() for name, values in found.image.layers.items()}
    hits, spp = found.count(found.hit), found.image.stats["spp"]
    out = {"alpha": float(np.abs(layers["A"] - hits / spp).max())}
    for layer, names in CHANNELS.items():
        which = found.fibre if layer in ("tangent", "strand_u") else found.hit
        expected = found.mean(layer, which)
        if layer == "depth":
            expected[hits == 0] = NO_DEPTH
        got = np.stack([layers[name] for name in names], 1)
        smooth = np.full(len(hits), True)
        if layer in ("normal", "tangent"):
            smooth = found.count(found.joint) == 0
            assert smooth.mean() > 0.5
        out[layer] = float(np.abs(got - expected)[smooth].max())
    nearest = found.nearest()
    out["strand"] = float((layers["strand"] != nearest).mean())
    out["groom"] = float((layers["groom"] != np.minimum(nearest, 0)).mean())
    for name, ids in (("CryptoStrand", found.strand), ("CryptoObject", found.fibre - 2.0)):
        out[name] = matte_error(found, name, ids)
    return out


def matte_error(found, name, ids) -> float:
    """Largest difference of the coverage that a matte gives an id from the host's."""
    [manifest] = [
        json.loads(found.image.attributes[f"{key.rpartition('/')[0]}/manifest"])
        for key, value in found.image.attributes.items()
        if key.endswith("/name") and value == name
    ]
    worst, few = 0.0, distinct(found, ids) <= RANKS
    assert few.mean() > 0.5
    names = {
        text: -2.0 if text == "body" else float(text.partition("/")[2] or -1) for text in manifest
    }
    if {names[text] for text in manifest} != {i for i in ids[found.hit].tolist() if i != -1} | (
        {-1.0} if name == "CryptoObject" else set()
    ):
        return 1.0
    spp = found.image.stats["spp"]
    for text, bits in manifest.items():
        value = np.array(int(bits, 16), np.uint32).view(np.float32)
        covered = np.zeros(found.shape, np.float64)
        for level in range(RANKS // 2):
            for of_id, of_coverage in ("RG", "BA"):
                match = found.image.layers[f"{name}{level:02}.{of_id}"] == value
                covered += np.where(match, found.image.layers[f"{name}{level:02}.{of_coverage}"], 0)
        expected = found.count(found.hit & (ids == names[text])) / spp
        worst = max(worst, float(np.abs(covered.ravel() - expected)[few].max()))
    return worst


def distinct(found, ids) -> np.ndarray:
    """How many ids each pixel has."""
    pairs = np.unique(np.stack([found.pixel[found.hit], ids[found.hit]], 1), axis=0)
    pairs = pairs[pairs[:, 1] != -1] if ids is found.strand else pairs
    return np.bincount(pairs[:, 0].astype(int), minlength=found.shape[0] * found.shape[1])


@pytest.mark.parametrize("body", TOLERANCE)
@pytest.mark.parametrize("lens", [0.0, 0.05])
def test_layers_of_first_hits_are_the_hosts(device, monkeypatch, body, lens):
    scene = with_overrides(
        patch() if body == "body" else fur_patch(spp=SPP), [f"camera.aperture_radius={lens}"]
    )
    found = errors(device, monkeypatch, scene)
    assert max(found.values()) < TOLERANCE[body], found


MUTANTS = {
    "depth": (r"dot\(hit\.position - seen_by\.origin\.xyz, seen_by\.forward\.xyz\)",
              "distance(hit.position, seen_by.origin.xyz)"),
    "position": (r"hit\.position = from \+ hit\.u \* along", "hit.position = from + 0.5f * along"),
    "normal": (r"hit\.normal = frame\.across", "hit.normal = frame.side"),
    "tangent": (r"fibre \? 1\.0f : 0\.0f", "1.0f"),
    "strand_u": (r"if \(vertex == segment\) before \+= u \* length_of;", ""),
    "strand": (r"\|\| depth < as_float\(nearest\[0\]\)", ""),
    "CryptoStrand": (r"popcount\(groom->ends\[word\] & below\)", "0u"),
    "CryptoObject": (r"if \(fibre\) while \(groom_starts", "while (groom_starts"),
    "alpha": (r"values\[FURCL_SUM_HITS\] = 1\.0f", "values[FURCL_SUM_HITS] = fibre ? 1.0f : 0.0f"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTANTS)
def test_layers_of_other_hits_are_not(device, monkeypatch, name):
    """Mutants of the test above."""
    substitute(monkeypatch, *MUTANTS[name], "stages/first_hits.cl")
    assert errors(device, monkeypatch)[name] > 30 * TOLERANCE["body"]


def test_a_crowded_pixel_keeps_the_ids_that_cover_most(device):
    """Two strands of half a pixel's width among many thin ones: more ids than there is room for."""
    thick, thin = [(-0.26, 0.2), (0.26, 0.2)], [(0.0, 0.004)] * 3 * RANKED_IDS
    x = [place for place, _ in thick] + list(np.linspace(-0.05, 0.05, len(thin)))
    points = [[[place, 0.0, -5.0], [place, 0.0, 5.0]] for place in x]
    radii = np.repeat([[radius] for _, radius in thick + [(0.0, 0.0015)] * len(thin)], 2, axis=1)
    scene = decode_scene(
        {
            "film": {
                "width": 1, "height": 1, "filter": "box", "layers": ["alpha", "cryptomatte_strand"]
            },
            "camera": {
                "projection": "orthographic", "origin": [0, -5, 0], "target": [0, 0, 0],
                "height": 1.0,
            },
            "fibre": {"preset": "human-black"},
            "environment": {"kind": "constant"},
            "curves": {"generator": "fibre"},
            "render": {"spp": 4096, "max_depth": 1},
        }
    )  # fmt: skip
    curves = furcl.Curves.from_arrays(np.array(points), radii)
    layers = furcl.render(scene, device=device, curves=curves).layers
    coverage = [float(layers[f"CryptoStrand00.{c}"][0, 0]) for c in "GA"]
    # Well over the error of 4096 samples, 0.008, and as many as the thin ones take places.
    np.testing.assert_allclose(coverage, 0.4, atol=0.03)
    assert 0.8 < layers["A"][0, 0] < 0.95


# Of the reference implementation's unit tests.
KNOWN = {
    "hello": 6.0705627102400005616e-17,
    "cube": -4.08461912519e15,
    "sphere": 2.79018604383e15,
    "plane": 3.66557617593e-11,
}


@pytest.mark.parametrize("name", KNOWN)
def test_names_have_the_ids_of_the_specification(name):
    bits = np.array(cryptomatte.hash_bits(name), np.uint32)
    assert float(bits.view(np.float32)) == pytest.approx(KNOWN[name], rel=1e-6)


def test_ids_are_normal_numbers():
    """Of 20,000 names about 160 would be none."""
    bits = [cryptomatte.hash_bits(f"groom1/{i}", plain=True) for i in range(20_000)]
    ids = [cryptomatte.hash_bits(f"groom1/{i}") for i in range(20_000)]
    tiny = np.finfo(np.float32).tiny
    for hashes, good in ((bits, False), (ids, True)):
        values = np.array(hashes, np.uint32).view(np.float32)
        assert bool((np.isfinite(values) & (np.abs(values) >= tiny)).all()) == good


def lit(light_sampling, **render):
    scene = patch(environment='{kind="sky", sun_radius_deg=5.0}')
    settings = {"light_sampling": light_sampling, "max_depth": 20, **render}
    return with_overrides(scene, [f"render.{k}={v}" for k, v in settings.items()])


def rgb(image, *names):
    layers = [np.stack([image.layers[f"{name}.{c}"] for c in "RGB"], 2) for name in names]
    return np.sum(layers, axis=0, dtype=np.float64)


def lobes_of(image):
    return sorted({name[:-2] for name in image.layers if name.startswith("lobe_")})


def light_errors(device, light_sampling, **render) -> dict[str, float]:
    """How far layers of light are from what they should add up to, over the mean radiance."""
    scene = with_layers(
        with_overrides(lit(light_sampling, **render), ["film.background=transparent"]),
        "direct", "indirect", "lobes",
    )  # fmt: skip
    image = furcl.render(scene, device=device)
    once = furcl.render(with_overrides(scene, ["render.max_depth=1"]), device=device)
    scale = float(image.rgb.mean())
    difference = {
        "sum": rgb(image, "direct", "indirect") - image.rgb,
        "lobes": rgb(image, *lobes_of(image)) - image.rgb,
        "direct": rgb(image, "direct") - once.rgb,
    }
    return {name: float(np.abs(values).max()) / scale for name, values in difference.items()}


# Of roundings of sums of 8 samples.
ADDED = 1e-5


@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_layers_of_light_add_up(device, light_sampling):
    """To the picture; the direct light is that of paths of one bounce with the same numbers."""
    found = light_errors(device, light_sampling)
    assert max(found.values()) < ADDED, found


@pytest.mark.parametrize("shadow_threshold", [0.3])
def test_they_add_up_where_light_samples_are_left_out(device, shadow_threshold):
    found = light_errors(device, "mis", shadow_threshold=shadow_threshold)
    assert max(found["sum"], found["lobes"]) < ADDED, found


def test_a_split_at_another_bounce_is_not_the_direct_light(device, monkeypatch):
    """A mutant of the test above."""
    substitute(
        monkeypatch, r"depth == 1u\) set_path_spectrum", "depth == 2u) set_path_spectrum", ""
    )
    assert light_errors(device, "mis")["direct"] > 1e3 * ADDED


BODIES = {"human-black": 45.0, "red-fox": 30.0}


def lobe_z(device, preset, light_sampling, seed) -> dict[str, float]:
    """Differences of the lobes' light, and of the albedo, from float64 quadrature in standard
    errors: a fibre that fills the picture, in white light."""
    from scene_documents import single_fibre

    from furcl import bcsdf

    theta = BODIES[preset]
    scene = single_fibre(theta, {"preset": preset}, seed=seed, light_sampling=light_sampling)
    renderer = Renderer(with_layers(scene, "lobes", "albedo"), device)
    renderer.advance(512)
    image = renderer.image()
    profiles = renderer.material.profiles
    expected = bcsdf.lobe_albedos(scene.build_fibre(), np.deg2rad(theta), profiles)
    expected = {f"lobe_{name}": value for name, value in expected.items()}
    expected["albedo"] = np.sum(list(expected.values()), axis=0)
    z = {}
    for name, value in expected.items():
        if not any(channel.startswith(f"{name}.") for channel in image.layers):
            continue
        values = rgb(image, name).mean(axis=2).ravel()
        error = values.std(ddof=1) / np.sqrt(len(values))
        # Some lobes leave so little noise that float32 counts.
        z[name] = float(abs(values.mean() - np.mean(value)) / (error + 3e-5))
    return z


@pytest.mark.statistical
@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
@pytest.mark.parametrize("preset", BODIES)
def test_lobes_have_their_light(device, preset, light_sampling, seed):
    z = lobe_z(device, preset, light_sampling, seed)
    assert len(z) == 6
    assert max(z.values()) < stats.t.isf(0.5e-3 / (4 * len(z)), 63), z


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (r">> \(4u \* lobe\)\) & 15u", ">> (4u * (FURCL_LOBES - 1u - lobe))) & 15u"),
        (r"rays->depth == 0u\) set_path_uint", "rays->depth == 7u) set_path_uint"),
    ],
)
def test_lobes_with_the_light_of_others_are_seen(device, monkeypatch, pattern, text, seed):
    """Mutants of the test above."""
    substitute(monkeypatch, pattern, text, "")
    z = lobe_z(device, "red-fox", "mis", seed)
    assert max(z.values()) > 2 * stats.t.isf(0.5e-3 / (4 * len(z)), 63)


@pytest.mark.parametrize("allocation", ["even", "adaptive"])
def test_the_size_of_waves_changes_no_bit_of_a_layer(device, allocation):
    scene = with_layers(lit("mis", allocation=allocation, spp=20), *LAYERS)
    plain = furcl.render(with_layers(scene), device=device)
    whole, small = (furcl.render(scene, device=device, wave_size=n) for n in (1 << 18, 100))
    assert np.array_equal(plain.rgb, whole.rgb)
    assert set(whole.layers) == set(small.layers)
    for name, values in whole.layers.items():
        assert np.array_equal(values, small.layers[name], equal_nan=True), name
    if allocation == "adaptive":
        assert len(np.unique(whole.layers["samples"])) > 1


def test_a_window_and_a_frame_have_the_layers_of_the_whole(device):
    from furcl.rendering.frames import render_frames

    scene, box = with_layers(patch(), *FIRST_HITS), (3, 2, 17, 9)
    whole = furcl.render(scene, device=device).cropped(*box)
    part = furcl.render(with_overrides(scene, [f"film.crop={list(box)}"]), device=device)
    frames = dict(render_frames(scene, range(2), orbit_deg=0.0, device=device))
    for name, values in part.layers.items():
        assert np.array_equal(values, whole.layers[name], equal_nan=True), name
        again, first = (frames[i].layers[name] for i in (1, 0))
        assert np.array_equal(again, first, equal_nan=True), name


def test_a_film_that_is_read_by_strips_has_the_same_layers(device, monkeypatch):
    """Of which a strip may show fewer objects than the picture."""
    renderer = Renderer(with_layers(patch(), *LAYERS), device)
    renderer.advance(2)
    whole = renderer.image()
    monkeypatch.setattr(size, "STRIP_PIXELS", 64)
    found = renderer.image()
    assert found.layers.keys() == whole.layers.keys()
    assert found.attributes == whole.attributes
    for name, values in whole.layers.items():
        assert np.array_equal(found.layers[name], values, equal_nan=True), name


def test_layers_are_written_and_read(device, tmp_path):
    import OpenEXR

    image = furcl.render(with_layers(patch(), *LAYERS), device=device)
    image.save(tmp_path / "all.exr")
    loaded = Image.load(tmp_path / "all.exr")
    assert set(loaded.layers) == set(image.layers)
    for name, values in image.layers.items():
        assert np.array_equal(values.view(np.uint32), loaded.layers[name].view(np.uint32)), name
    assert loaded.attributes == image.attributes
    header = OpenEXR.File(str(tmp_path / "all.exr")).header()
    named = {v for k, v in header.items() if k.startswith("cryptomatte/") and k.endswith("/name")}
    assert named == {"CryptoObject", "CryptoStrand"}
    loaded.save(tmp_path / "again.exr")
    assert set(Image.load(tmp_path / "again.exr").layers) == set(image.layers)


def test_a_transparent_picture_has_alpha_and_no_background(device):
    """What lies over the light of a constant background is the picture that shows it."""
    from PIL import Image as PillowImage

    scene = with_overrides(patch(), ["environment={kind='constant', radiance=0.7}"])
    shown = furcl.render(scene, device=device)
    image = furcl.render(with_overrides(scene, ["film.background=transparent"]), device=device)
    alpha = image.layers["A"][..., None]
    np.testing.assert_allclose(image.rgb + 0.7 * (1 - alpha), shown.rgb, atol=1e-6)
    assert not image.rgb[alpha[..., 0] == 0.0].any()
    png = np.asarray(PillowImage.open(io.BytesIO(image.png_bytes())), np.float64) / 255.0
    np.testing.assert_allclose(png[..., 3], alpha[..., 0], atol=0.5 / 255)
    inside = alpha[..., 0] == 1.0
    opaque = np.asarray(PillowImage.open(io.BytesIO(shown.png_bytes())), np.float64) / 255.0
    np.testing.assert_allclose(png[inside, :3], opaque[inside], atol=1e-6)
    assert np.asarray(PillowImage.open(io.BytesIO(shown.png_bytes()))).shape[2] == 3


def test_what_is_not_asked_for_is_not_there(device):
    renderer = Renderer(patch(), device)
    assert renderer.film.layers is None
    assert not [name for name in renderer.memory.bytes if name.startswith("layers")]
    assert not {"add_first_hits", "add_light_layers"} & set(renderer.wavefront._stages)
    planes = layout.planes(renderer.features)
    assert not [name for name in planes if name.startswith(("FIRST", "ALBEDO", "DIRECT"))]
    few = Renderer(with_layers(patch(), "depth"), device)
    held = {name: n for name, n in few.memory.bytes.items() if name.startswith("layers")}
    # Number of hits and depth, two words each.
    assert held == {"layers: first hits": 4 * 4 * few.n_pixels}
    assert layout.planes(few.features) == planes


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        (["depht"], "film.layers.*'depht'.*depth"),
        (["depth", "depth"], r"film\.layers = .* has 'depth' twice"),
    ],
)
def test_other_layers_are_refused(layers, words):
    with pytest.raises(SceneError, match=words):
        with_layers(patch(), *layers)


def test_cryptomatte_names_the_package_that_it_needs(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mmh3", None)
    with pytest.raises(furcl.FurclError, match=r"mmh3.*furcl\[cryptomatte\]"):
        cryptomatte.hash_bits("a")
