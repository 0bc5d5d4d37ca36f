"""Scenes: what is read, what is refused and in which words, overrides, cameras."""

from __future__ import annotations

import gc
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scene_documents import minimal

from furcl.errors import SceneError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.pigment import sigma_ca_from_colour, sigma_ca_from_melanin
from furcl.groom import grow
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves
from furcl.scene import camera as camera_module
from furcl.scene.camera import Camera
from furcl.scene.read import decode_scene, find_scene, load_scene
from furcl.scene.tables import Render, Scene
from furcl.surface.ellipsoid import Body

SCENES = Path(__file__).parents[1] / "scenes"
NAMES = sorted(path.stem for path in SCENES.glob("*.toml") if path.stem != "groom")

TEXT = """
[fibre]
preset = "human-black"

[environment]
kind = "constant"

[curves]
generator = "fibre"
"""


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(TEXT)
    return path


@pytest.fixture
def groom_file(tmp_path):
    points = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 2, 3]]
    path = tmp_path / "two.npz"
    save_curves(Curves.from_arrays(points, [0.1, 0.1, 0.2, 0.2], [0, 2, 4]), path)
    return path


@pytest.mark.parametrize("name", NAMES)
def test_scenes_of_the_project_load(name):
    scene = load_scene(SCENES / f"{name}.toml")
    assert scene.name == name
    assert all(isinstance(fibre, Fibre) for fibre in scene.build_fibres().values())


def test_the_collector_survives_the_tables():
    # msgspec up to 0.22 crashed here on a union of a constrained number and a tuple of such
    # numbers.
    for name in NAMES:
        load_scene(SCENES / f"{name}.toml")
        gc.collect()


def test_the_papers_three_scenes_use_its_fibres_and_no_settings_of_their_own():
    """Its comparison of samplers names its settings in bench/results.sh."""
    for name, preset in (
        ("black_hair", "human-black"),
        ("white_hair", "human-white"),
        ("raccoon", "raccoon"),
    ):
        scene = load_scene(SCENES / f"{name}.toml")
        assert scene.build_fibre() == Fibre.preset(preset)
        assert scene.render == Render()


def has_body(name):
    """Whether a scene has a body within one groom that grows."""
    scene = load_scene(SCENES / f"{name}.toml")
    return scene.body is not None and scene.curves is not None


@pytest.mark.parametrize("name", [n for n in NAMES if has_body(n)])
def test_bodies_are_just_inside_the_skin(name):
    """No root is inside the body, and none is farther from it than a hundredth of its size;
    mutants: a body two hundredths larger, or smaller."""
    scene = load_scene(SCENES / f"{name}.toml", overrides=["curves.n_strands=2000"])
    assert isinstance(scene.body, Body)
    curves = scene.build_curves()
    roots = curves.points[curves.offsets[:-1]].astype(np.float64)
    level = np.linalg.norm((roots - scene.body.centre) / scene.body.radii, axis=1)
    assert _just_outside(level)
    assert not _just_outside(level / 1.02)
    assert not _just_outside(level * 1.02)


def _just_outside(level):
    return level.min() > 1.0 and level.max() < 1.01


def test_groom_scene_asks_for_a_file():
    with pytest.raises(
        SceneError, match=r"groom\.toml: curves\.file is missing; .* --set curves\.file=VALUE"
    ):
        load_scene(SCENES / "groom.toml")


def test_groom_scene_renders_any_file(groom_file, monkeypatch):
    monkeypatch.chdir(groom_file.parent)
    scene = load_scene(SCENES / "groom.toml", overrides=["curves.file=two.npz"])
    curves = scene.build_curves()
    assert curves.n_strands == 2
    assert scene.resolved_camera(curves).origin is not None


def test_scenes_that_come_with_furcl_are_found_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_scene("black_hair", spp=1) == load_scene(SCENES / "black_hair.toml", spp=1)
    assert find_scene("black_hair.toml") == SCENES / "black_hair.toml"
    assert find_scene("extreme/opaque") == Path("extreme/opaque")  # a path is a path
    (tmp_path / "black_hair").write_text(TEXT)  # a file of that name is preferred
    assert msgspec.to_builtins(load_scene("black_hair").curves)["generator"] == "fibre"
    with pytest.raises(SceneError, match="did you mean white_hair, which comes with furcl"):
        load_scene("white_hare")
    with pytest.raises(SceneError, match="check the path, or give one of furcl's: black_hair, "):
        load_scene("some/scene.toml")


def test_repr_is_a_short_line():
    scene = load_scene(SCENES / "red_fox.toml")
    assert repr(scene) == "Scene('red_fox', 512 x 512, double-cylinder, sky, fur, ellipsoid)"


def test_defaults(scene_file):
    scene = load_scene(scene_file)
    assert scene.name == "tiny"
    assert (scene.render.spp, scene.render.max_depth, scene.body) == (64, 1000, None)
    assert scene.film.support_px == 1.5


def test_files_are_relative_to_the_scene_or_the_current_folder(groom_file, tmp_path, monkeypatch):
    folder = tmp_path / "scenes"
    folder.mkdir()
    path = folder / "a.toml"
    path.write_text(TEXT.replace('generator = "fibre"', 'file = "../two.npz"'))
    scene = load_scene(path)
    assert scene.build_curves().n_strands == 2
    monkeypatch.chdir(tmp_path)
    assert load_scene(path, overrides=["curves.file=two.npz"]).build_curves().n_strands == 2
    monkeypatch.chdir(folder)
    with pytest.raises(SceneError, match=r"curves\.file = .*two\.npz': there is no such file"):
        load_scene(path, overrides=["curves.file=two.npz"])


def test_y_up_grooms_are_turned(groom_file):
    curves = {"generator": "file", "file": str(groom_file), "radius_scale": 2.0, "up_axis": "y"}
    turned = decode_scene(minimal(curves=curves)).build_curves()
    np.testing.assert_allclose(turned.points[[1, 3]], [[0, 0, 1], [1, -3, 2]])
    np.testing.assert_allclose(turned.radii, [0.2, 0.2, 0.4, 0.4])


def test_generators_get_their_parameters():
    curves = {"generator": "fur", "n_strands": 50, "length": 0.1, "seed": 5, "comb": [1, 0, 0]}
    found = decode_scene(minimal(curves=curves)).build_curves()
    expected = grow.fur(n_strands=50, length=0.1, seed=5, comb=(1.0, 0.0, 0.0))
    assert np.array_equal(found.points, expected.points)


@pytest.mark.parametrize("generator", grow.GENERATORS)
def test_every_parameter_of_a_generator_is_a_key(generator):
    parameters = grow.GENERATORS[generator].__kwdefaults__ or {}
    table = {k: list(v) if isinstance(v, tuple) else v for k, v in parameters.items()}
    scene = decode_scene(minimal(curves={"generator": generator, **table}))
    assert {k: getattr(scene.curves, k) for k in parameters} == parameters


@pytest.mark.parametrize(
    ("table", "sigma_ca"),
    [
        ({"preset": "human-white"}, (0.41,) * 3),
        ({"preset": "human-white", "sigma_ca": 1}, (1.0,) * 3),
        ({"preset": "human-white", "sigma_ca": [1, 2, 3]}, (1.0, 2.0, 3.0)),
        (
            {"preset": "human-white", "melanin": {"eumelanin": 1, "pheomelanin": 2}},
            sigma_ca_from_melanin(1.0, 2.0),
        ),
        (
            {"colour": [0.5, 0.3, 0.1], "beta_n_deg": 20},
            sigma_ca_from_colour((0.5, 0.3, 0.1), 20.0),
        ),
    ],
)
def test_colours_of_fibres(table, sigma_ca):
    assert decode_scene(minimal(fibre=table)).build_fibre().sigma_ca == pytest.approx(sigma_ca)


def test_fibre_parameters_replace_those_of_the_preset():
    fibre = decode_scene(minimal(fibre={"preset": "raccoon", "kappa": 0.5})).build_fibre()
    assert fibre == Fibre.preset("raccoon", kappa=0.5)


BAD = [
    ({"rendr": {}}, "unknown key rendr; did you mean render?"),
    ({"render": {"ssp": 3}}, "unknown key render.ssp; did you mean render.spp?"),
    ({"environment": {"kind": "sky", "turbidty": 3}}, "did you mean environment.turbidity?"),
    ({"environment": {"kind": "constant", "file": "a"}}, "environment.file with kind = 'constant'"),
    ({"curves": {"generator": "hair", "strands": 9}}, "did you mean curves.n_strands?"),
    ({"fibre": {"preset": "raccoon", "melanin": {"eu": 1}}}, "unknown key fibre.melanin.eu"),
    ({"fiber": {"preset": "raccoon"}}, "unknown key fiber; did you mean fibre?"),
    ({"body": {"albedo": [0, 2, 0]}}, "body.albedo = (0.0, 2.0, 0.0): allowed is 0 to 1"),
    (
        {"environment": {"kind": "constant", "radiance": math.nan}},
        "environment.radiance = nan: allowed is 0 to 1e+09",
    ),
    (
        {"body": {"center": [0, 0, 0]}},
        "unknown key body.center with kind = 'ellipsoid'; did you mean body.centre?",
    ),
    ({"render": {"spp": 0}}, "render.spp = 0: expected `int` >= 1"),
    ({"render": {"spp": 1.5}}, "render.spp = 1.5: expected `int`, got `float`"),
    ({"render": {"spp": True}}, "render.spp = True: expected `int`, got `bool`"),
    ({"render": {"sampling": "full-cfd"}}, "did you mean 'full-cdf'?"),
    ({"render": 3}, "render = 3: expected a table, for example render.spp=64"),
    ({"render": {"spp": {"a": 1}}}, "render.spp: expected `int`, got a table"),
    ({"film": {"filter": "sinc"}}, "film.filter = 'sinc': allowed are box, tent, gaussian"),
    ({"film": {"width": 0}}, "film.width = 0: expected `int` >= 1"),
    ({"film": {"filter_radius_px": 9}}, "film.filter_radius_px = 9: expected `float` <= 4.0"),
    ({"camera": {"vfov_deg": 180}}, "camera.vfov_deg = 180: expected `float` <= 170.0"),
    ({"camera": {"vfov_deg": math.nan}}, "camera.vfov_deg = nan: expected `float`"),
    ({"camera": {"up": [0, math.inf, 0]}}, "camera.up[1] = inf: expected `float` <="),
    ({"camera": {"up": [0, 1]}}, "camera.up = [0, 1]: expected `array` of length 3, got 2"),
    ({"camera": {"up": [0, 0, 0]}}, "camera.up = (0.0, 0.0, 0.0) is zero or along the view"),
    ({"camera": {"origin": [1, 0, 0]}}, "camera: origin is given without target"),
    (
        {"camera": {"origin": [1, 0, 0], "target": [1, 0, 0]}},
        "camera: origin and target are the same point",
    ),
    (
        {"camera": {"origin": [0, 0, 9], "target": [0, 0, 0]}},
        "camera.up = (0.0, 0.0, 1.0) is zero or along the view",
    ),
    (
        {"camera": {"origin": [1, 0, 0], "target": [0, 0, 0], "margin": 0.1}},
        "camera: margin frame the groom automatically",
    ),
    ({"environment": {"kind": "moon"}}, "environment.kind = 'moon': allowed are constant, sky"),
    ({"environment": {}}, "environment.kind is missing"),
    ({"environment": {"kind": "image"}}, "environment.file is missing"),
    (
        {"environment": {"kind": "image", "file": "/none.exr"}},
        "environment.file = '/none.exr': there is no such file",
    ),
    (
        {"environment": {"kind": "constant", "radiance": -1}},
        "environment.radiance = -1.0: allowed is 0 to 1e+09",
    ),
    ({"environment": {"kind": "sky", "turbidity": 1}}, "environment.turbidity = 1: expected"),
    ({"curves": {"generator": "hare"}}, "did you mean 'hair'?"),
    ({"curves": {}}, "curves.file is missing"),
    ({"curves": {"generator": "hair", "style": "bob"}}, "allowed are straight, wavy, curly"),
    ({"curves": {"generator": "hair", "n_strands": 0}}, "curves.n_strands = 0: expected"),
    ({"curves": {"generator": "hair", "scalp_radii": [1, 1]}}, "curves.scalp_radii = [1, 1]"),
    ({"fibre": {}}, "fibre: there is neither a preset nor a colour"),
    ({"fibre": {"preset": "racoon"}}, "did you mean 'raccoon'?"),
    ({"fibre": {"preset": "raccoon", "kappa": 2}}, "fibre.kappa = 2.0"),
    ({"fibre": {"preset": "raccoon", "sigma_ca": -1}}, "fibre.sigma_ca = -1.0 - allowed is"),
    ({"fibre": {"colour": [2, 0.5, 0.5]}}, "fibre.colour = [2.0, 0.5, 0.5]"),
    (
        {"fibre": {"sigma_ca": 1, "colour": [0.5, 0.5, 0.5]}},
        "fibre: the colour is given by sigma_ca and colour; keep one",
    ),
    ({"fibre": None}, "fibre is missing"),
    (
        {"curves": "a.hair"},
        "curves = 'a.hair': expected a table, for example curves.file=groom.hair",
    ),
    (
        {"environment": 1},
        "environment = 1: expected a table, for example environment.kind=constant",
    ),
    ({"body": [1]}, "body = [1]: expected a table, for example body.albedo=0.05"),
    ({"environment": {"kind": ["sky"]}}, "environment.kind = ['sky']: allowed are constant, sky"),
    ({"melanin": 1}, "unknown key melanin. Known are name, camera, "),
]


@pytest.mark.parametrize(("tables", "message"), BAD, ids=[m for _, m in BAD])
def test_bad_values_are_refused_by_name(tables, message):
    with pytest.raises(SceneError) as caught:
        decode_scene(minimal(**tables), "a.toml")
    assert str(caught.value).startswith("a.toml: ")
    assert message in str(caught.value)


@pytest.mark.parametrize("table", ["fibre", "environment", "curves"])
def test_missing_tables(table):
    with pytest.raises(SceneError, match=f"a.toml: {table} is missing; add it"):
        decode_scene({k: v for k, v in minimal().items() if k != table}, "a.toml")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "there is no such scene file"),
        (b"[render\n", "not valid TOML: .* line 1"),
        (b"HAIR\xff\xfe", "byte 4 is not UTF-8; a scene is a TOML text"),
        (b"[render]\nspp = 1\nspp = 2\n", "not valid TOML"),
        (b"", "cannot be read: it is empty"),
    ],
)
def test_bad_files(tmp_path, content, message):
    path = tmp_path / "bad.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match=rf"bad\.toml: {message}"):
        load_scene(path)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_byte_order_mark_is_no_part_of_a_scene(tmp_path, end):
    """As editors of Windows write it."""
    path, text = tmp_path / "a.toml", (SCENES / "red_fox.toml").read_text()
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", end).encode())
    assert msgspec.structs.replace(load_scene(path), name="") == msgspec.structs.replace(
        load_scene(SCENES / "red_fox.toml"), name=""
    )


def test_a_folder_is_no_scene(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path)


def test_scenes_survive_a_round_trip(scene_file):
    scene = load_scene(SCENES / "red_fox.toml")
    again = decode_scene(msgspec.to_builtins(scene))
    assert again == scene
    assert isinstance(again, Scene)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("view", [(0.0, 0.0), (30.0, 20.0), (-120.0, -60.0), (90.0, 89.0)])
@pytest.mark.parametrize("margin", [0.0, 0.3])
def test_framing_holds_the_points_and_touches_two_sides(aspect, view, margin, rng):
    points = rng.normal(size=(200, 3)) * [1.0, 2.0, 4.0] + [10.0, -3.0, 7.0]
    camera = Camera(azimuth_deg=view[0], elevation_deg=view[1], margin=margin, vfov_deg=40.0)
    found = camera.resolved(points, aspect)
    origin, right, up, forward = found.frame()
    seen = points - origin
    depth = seen @ forward
    slope = math.tan(math.radians(20.0))
    places = np.stack([seen @ right / aspect, seen @ up]) / (depth * slope)
    assert (depth > 0.0).all()
    sides = np.stack([places.max(axis=1), -places.min(axis=1)])
    assert sides.max() == pytest.approx(1.0 - margin, rel=1e-9)
    tight = np.argmax(sides.max(axis=0))
    np.testing.assert_allclose(sides[:, tight], 1.0 - margin, rtol=1e-9)
    assert np.linalg.det([right, up, -forward]) == pytest.approx(1.0)
    assert depth.min() < found.focus_distance < depth.max()


def test_framing_takes_points_a_part_at_a_time(monkeypatch, rng):
    points = rng.normal(size=(200, 3)) * [1.0, 2.0, 4.0]
    whole = Camera().resolved(points, 1.5, 0.1)
    monkeypatch.setattr(camera_module, "POINTS_AT_ONCE", 7)
    assert Camera().resolved(points, 1.5, 0.1) == whole
    assert len(Camera().outermost(points[:70])) == 60


def test_framing_makes_room_for_radii():
    camera = Camera(azimuth_deg=-90, elevation_deg=0, margin=0.0, vfov_deg=60.0)
    found = camera.resolved([[0.0, 0.0, 0.0], [0.0, 0.0, 1e-9]], radius=1.0)
    # A sphere of radius 1 touches the edge of a view of 60 degrees from a distance of 1 / sin(30).
    assert found.origin == pytest.approx((0.0, -2.0, 0.0), abs=1e-6)


def test_framing_one_point_is_refused():
    with pytest.raises(ValueError, match="the points to frame are one point"):
        Camera().resolved([[1.0, 2.0, 3.0]])


def test_an_explicit_camera_focuses_on_its_target():
    camera = Camera(origin=(0, -5, 0), target=(0, 0, 0)).resolved(np.zeros((1, 3)))
    assert camera.focus_distance == 5.0
    origin, right, up, forward = camera.frame()
    np.testing.assert_allclose(
        [origin, right, up, forward], [[0, -5, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]]
    )


def test_a_camera_must_be_resolved_first():
    with pytest.raises(ValueError, match=r"call resolved\(points, aspect\) first"):
        Camera().frame()
