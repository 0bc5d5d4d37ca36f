"""Strands in USD: bases, wraps and interpolations as the schema has them, prims, colours, units."""

import numpy as np
import pytest

from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves, usd, usd_stage
from furcl.groom.units import Units

pytest.importorskip("pxr", reason="usd-core is an extra")
RNG = np.random.default_rng(6)
WALK = np.cumsum(RNG.normal(size=(20, 3)), axis=0)


@pytest.fixture
def here(monkeypatch):
    """Files that are known to be whole are read by this process, which is faster."""

    def extracted(path, what="curves"):
        said, arrays = usd_stage.extract(str(path), what)
        return said, {name: array.copy() for name, array in arrays.items()}

    monkeypatch.setattr(usd, "extracted", extracted)


def listed(values):
    def text(v):
        return f"({', '.join(map(text, v))})" if np.ndim(v) else repr(float(v))

    return "[" + ", ".join(map(text, values)) + "]"


def prim(name="a", points=WALK, counts=(10, 10), kind="linear", widths=(0.2,), more="", **said):
    """A prim of BasisCurves as text."""
    interpolation = said.pop("interpolation", "constant")
    tokens = "".join(f'    uniform token {key} = "{word}"\n' for key, word in said.items())
    of_widths = (
        f'    float[] widths = {listed(widths)} (interpolation = "{interpolation}")\n'
        if widths is not None
        else ""
    )
    return (
        f'def BasisCurves "{name}"\n{{\n    uniform token type = "{kind}"\n{tokens}'
        f"    int[] curveVertexCounts = [{', '.join(map(str, counts))}]\n"
        f"    point3f[] points = {listed(points)}\n{of_widths}{more}}}\n"
    )


def written(folder, text, head=""):
    path = folder / "a.usda"
    path.write_text(f"#usda 1.0\n({head}\n)\n{text}")
    return path


#: Control points of two curves, and how many widths are of their points and of ends of spans.
SIZES = {
    ("linear", "bezier", "nonperiodic"): (10, 20, 20),
    ("cubic", "bezier", "nonperiodic"): (10, 20, 8),
    ("cubic", "bezier", "periodic"): (9, 18, 6),
    ("cubic", "bspline", "nonperiodic"): (10, 20, 16),
    ("cubic", "catmullRom", "nonperiodic"): (10, 20, 16),
    ("cubic", "bspline", "periodic"): (10, 20, 20),
}


@pytest.mark.parametrize("interpolation", ["vertex", "varying", "uniform", "constant"])
@pytest.mark.parametrize("case", SIZES, ids="-".join)
def test_widths_of_every_interpolation(here, tmp_path, case, interpolation):
    kind, basis, wrap = case
    count, of_points, of_ends = SIZES[case]
    n = {"vertex": of_points, "varying": of_ends, "uniform": 2, "constant": 1}[interpolation]
    widths = np.linspace(0.1, 0.2, n)
    text = prim(
        points=WALK[: 2 * count], counts=(count, count), kind=kind, basis=basis, wrap=wrap,
        widths=widths, interpolation=interpolation,
    )  # fmt: skip
    curves = load_curves(written(tmp_path, text))
    assert curves.n_strands == 2
    second = curves.radii[curves.offsets[1]]
    if interpolation == "constant":
        np.testing.assert_allclose(curves.radii, 0.05, rtol=1e-6)
    elif interpolation == "uniform":
        assert set(np.round(curves.radii, 6).tolist()) == {np.float32(0.05), np.float32(0.1)}
    elif basis == "bezier":
        np.testing.assert_allclose(curves.radii[0], 0.05, rtol=1e-6)
        np.testing.assert_allclose(second, widths[n // 2] / 2, rtol=1e-6)
    else:
        assert 0.05 <= curves.radii[0] < second <= 0.1
    if kind == "linear":
        np.testing.assert_array_equal(curves.points, WALK.astype(np.float32))
    else:
        assert curves.n_points > 4 * count


@pytest.mark.parametrize("basis", ["bspline", "catmullRom"])
def test_pinned_curves_reach_their_ends(here, tmp_path, basis):
    text = prim(kind="cubic", basis=basis, wrap="pinned", widths=[0.1] * 20, interpolation="vertex")
    curves = load_curves(written(tmp_path, text))
    np.testing.assert_allclose(curves.points[[0, -1]], WALK[[0, -1]], atol=1e-5)


COLOUR = '    color3f[] primvars:displayColor = {} (interpolation = "{}")\n'


def test_several_prims(here, tmp_path):
    """With their transformations, visibility, purpose, colours, and what is left out."""
    red = COLOUR.format("[(1, 0, 0)]", "constant")
    moved = prim("moved", widths=[0.2, 0.4], interpolation="uniform", more=red)
    bound = prim("bound", more="    rel material:binding = </m>\n")
    bound = bound.replace("\n{", ' (prepend apiSchemas = ["MaterialBindingAPI"])\n{', 1)
    text = (
        'def Xform "x"\n{\n    double3 xformOp:translate = (1, 2, 3)\n    float3 xformOp:scale = '
        '(2, 2, 2)\n    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n'
        + moved
        + "}\n"
        + bound
        + prim("hidden", more='    token visibility = "invisible"\n')
        + prim("guide", more='    uniform token purpose = "guide"\n')
        + prim("plain")
        + 'def Mesh "mesh"\n{\n}\ndef NurbsCurves "nurbs"\n{\n}\n'
        + 'def Material "m"\n{\n    token outputs:surface.connect = </m/s.outputs:surface>\n'
        + '    def Shader "s"\n    {\n        uniform token info:id = "UsdPreviewSurface"\n'
        + "        color3f inputs:diffuseColor = (0, 0.5, 0)\n        token outputs:surface\n"
        + "    }\n}\n"
    )
    curves = load_curves(written(tmp_path, text, '    metersPerUnit = 0.1\n    upAxis = "Z"'))
    assert curves.n_strands == 6
    np.testing.assert_allclose(curves.points[:20], 2 * WALK + [1, 2, 3], rtol=1e-6)
    np.testing.assert_allclose(curves.radii[[0, 10, 20]], [0.2, 0.4, 0.1], rtol=1e-6)
    grey = np.array(usd_stage.FALLBACK_COLOUR, np.float32).tolist()
    assert curves.colours is not None
    np.testing.assert_array_equal(curves.colours[::2], [[1, 0, 0], [0, 0.5, 0], grey])
    assert dict(curves.dropped) == {
        "invisible_prims": 1, "guide_or_proxy_prims": 1, "meshes": 1, "NurbsCurves_prims": 1,
    }  # fmt: skip
    assert curves.units == Units(0.1, "z")


def in_time(name, samples):
    """A prim of linear curves whose points change with time."""
    points = ", ".join(f"{time}: {listed(points)}" for time, points in samples.items())
    still = f"point3f[] points = {listed(WALK)}"
    return prim(name).replace(still, f"point3f[] points.timeSamples = {{{points}}}")


def turning(text, degrees):
    """A prim below one that turns about z from time 0 to time 1, as it is 1 along x from there."""
    return (
        'def Xform "x"\n{\n    float xformOp:rotateZ.timeSamples = '
        f"{{0: 0, 1: {degrees}}}\n    double3 xformOp:translate = (1, 0, 0)\n"
        '    uniform token[] xformOpOrder = ["xformOp:rotateZ", "xformOp:translate"]\n'
        + text
        + "}\n"
    )


def test_points_in_time(here, tmp_path):
    """Prims have times of their own: between they go straight, before and after they keep still."""
    text = in_time("a", {3: WALK, 9: 9 * WALK}) + in_time("b", {5: WALK, 7: -WALK}) + prim("c")
    curves = load_curves(written(tmp_path, text))
    assert curves.times == (3.0, 5.0, 7.0, 9.0)
    assert curves.steps is not None
    a, b, c = np.split(curves.steps, 3, axis=1)
    part = np.array([0.0, 1 / 3, 2 / 3, 1.0])[:, None, None]
    np.testing.assert_allclose(a, WALK * (1 + 8 * part), rtol=1e-5)
    np.testing.assert_allclose(b, WALK * np.array([1, 1, -1, -1])[:, None, None], rtol=1e-6)
    np.testing.assert_allclose(c, np.broadcast_to(WALK, c.shape), rtol=1e-6)
    assert curves.units == Units(None, "y")


def test_transformations_in_time(here, tmp_path):
    """Turns are followed in steps of at most 4 degrees."""
    curves = load_curves(written(tmp_path, turning(prim(), 90)))
    assert curves.steps is not None
    np.testing.assert_allclose(curves.times, np.linspace(0.0, 1.0, 24), atol=1e-12)
    angle = np.radians(90 * np.array(curves.times))[:, None]
    x, y = WALK[:, 0] + 1.0, WALK[:, 1]
    np.testing.assert_allclose(
        curves.steps[:, :, 0], x * np.cos(angle) - y * np.sin(angle), atol=1e-5
    )
    np.testing.assert_allclose(
        curves.steps[:, :, 1], x * np.sin(angle) + y * np.cos(angle), atol=1e-5
    )


def test_cubic_curves_in_time_keep_the_tolerance(here, tmp_path):
    """Straight at first and bent later: the polyline has the points that it needs then."""
    straight = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    bent = straight + np.array([[0, 0, 0], [0, 3, 0], [0, -3, 0], [0, 0, 0]])
    still = prim(kind="cubic", counts=(4,), points=straight)
    alone = load_curves(written(tmp_path, prim(kind="cubic", counts=(4,), points=bent)))
    text = still.replace(
        f"points = {listed(straight)}",
        f"points.timeSamples = {{0: {listed(straight)}, 1: {listed(bent)}}}",
    )
    curves = load_curves(written(tmp_path, text))
    assert load_curves(written(tmp_path, still)).n_points == 2
    assert curves.steps is not None
    assert curves.n_points >= alone.n_points > 8
    assert not curves.steps[0][:, 1].any()
    assert np.ptp(curves.steps[1][:, 1]) > 1.5


def test_points_that_change_in_number_keep_still(here, tmp_path, caplog):
    curves = load_curves(written(tmp_path, in_time("a", {3: WALK, 9: WALK[:10]})))
    assert curves.steps is None
    np.testing.assert_array_equal(curves.points, WALK.astype(np.float32))
    assert "change in number with time" in caplog.text


@pytest.mark.parametrize("suffix", [".usda", ".usd"])
def test_round_trip_in_time(here, tmp_path, suffix):
    steps = RNG.normal(size=(3, 9, 3)).astype(np.float32)
    curves = Curves.from_arrays(steps, 0.1, [0, 3, 9], times=[1001.0, 1002.5, 1004.0])
    save_curves(curves, tmp_path / f"a{suffix}")
    found = load_curves(tmp_path / f"a{suffix}")
    assert found.times == curves.times
    np.testing.assert_array_equal(found.steps, steps)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no visible BasisCurves, but nothing else"),
        ('def Mesh "m"\n{\n}\n', "has no visible BasisCurves, but 1 meshes"),
        ("def {", "usd-core cannot read it"),
        (prim(counts=(10, 11)), "/a: 2 curves of together 21 points, .* 20 points"),
        (prim(counts=(21, -1)), "the least of -1"),
        (prim(widths=[1] * 7), "/a: 7 widths of interpolation 'constant'; expected 1"),
        (prim(widths=None), "/a: the curves have no widths.*--default-radius"),
        (prim(kind="cubic", basis="hermite"), "/a: curves of type 'cubic', basis 'hermite'"),
        (prim(kind="cubic", counts=(9, 11)), "/a: strand 0 has 9 control points; .*4, 7, 10"),
        (prim(wrap="periodic"), "/a: closed linear curves"),
        (prim(points=np.where(WALK[12, 1] == WALK, np.nan, WALK)), "cannot read|strand 1, point 2"),
    ],
)
def test_bad_stages(tmp_path, text, message):
    """By the process that reads damaged files."""
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, text))


def test_a_library_that_crashes_or_hangs(tmp_path, monkeypatch):
    path = written(tmp_path, prim())
    monkeypatch.setattr(usd, "python_command", lambda *_: ["sh", "-c", "kill -SEGV $$"])
    with pytest.raises(GroomError, match=r"usd-core crashes on it .signal 11"):
        load_curves(path)
    monkeypatch.setattr(usd, "python_command", lambda *_: ["sh", "-c", "kill -XCPU $$"])
    with pytest.raises(GroomError, match="not done with it after 60 s of processor time"):
        load_curves(path)
    monkeypatch.setattr(usd, "python_command", lambda *_: ["sleep", "60"])
    monkeypatch.setattr(usd, "PATIENCE", 0.001)
    with pytest.raises(GroomError, match="usd-core was not done with it after 0 s"):
        load_curves(path)


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_round_trip(here, tmp_path, suffix):
    points = RNG.normal(size=(9, 3)).astype(np.float32)
    curves = Curves.from_arrays(
        points, 0.1 + RNG.random(9), [0, 3, 9], colours=RNG.random((2, 3)),
        attributes={"melanin": RNG.random(9), "two words": RNG.random(2)},
    )  # fmt: skip
    save_curves(curves, tmp_path / f"a{suffix}")
    found = load_curves(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(found.points, curves.points)
    np.testing.assert_array_equal(found.radii, curves.radii)
    np.testing.assert_array_equal(found.offsets, curves.offsets)
    assert set(found.attributes) == {"colours", "melanin"}
    for name in found.attributes:
        np.testing.assert_array_equal(found.attributes[name], curves.attributes[name])
    assert found.units == Units(None, "z")


def test_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setattr(usd.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(GroomError, match=r"pip install 'furcl\[usd\]'"):
        load_curves(written(tmp_path, prim()))
    with pytest.raises(GroomError, match=r"pip install 'furcl\[usd\]'"):
        save_curves(Curves.from_arrays(WALK, 0.1, [0, 20]), tmp_path / "b.usd")


def test_the_shared_stage(shared_data):
    """Houdini's, of linear curves with widths of points."""
    curves = load_curves(shared_data / "curves/arnoldusd_test0189_linear_uv.usda")
    assert (curves.n_strands, curves.n_points) == (2484, 22356)
    assert curves.units == Units(1.0, "y")
    assert curves.radii.max() == np.float32(0.035)


@pytest.mark.parametrize(
    ("of_schema", "said", "strands"),
    [
        ("int[] curveVertexCounts = [20]", "int curveVertexCounts = 20", 1),
        ("int[] curveVertexCounts = [20]", "int2 curveVertexCounts = (10, 10)", 2),
        ("float[] widths = [0.2]", "float widths = 0.2", 1),
    ],
)
def test_numbers_of_another_type_than_the_schema_s(tmp_path, here, of_schema, said, strands):
    text = prim(counts=(20,))
    assert of_schema in text
    curves = load_curves(written(tmp_path, text.replace(of_schema, said)))
    assert curves.n_strands == strands
    np.testing.assert_allclose(curves.radii, 0.1)
