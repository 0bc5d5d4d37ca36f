"""Device functions one at a time against float64 scipy."""

import numpy as np
import pytest
from kernel_harness import FULL, call
from scipy import special

from furcl.device.features import Features
from furcl.device.layout import SEQUENCES


def test_bessel_i0e(device):
    x = np.concatenate([np.linspace(0, 8, 4001), np.geomspace(1e-6, 1e8, 2001)]).astype(np.float32)
    got = call(device, "core/math.clh", "bessel_i0e(x)", x)
    expected = special.i0e(x.astype(np.float64))
    np.testing.assert_allclose(got, expected, rtol=1e-6)  # measured 4.6e-7


def test_bessel_i0e_mutant(device):
    """The halved 1/(8x) term that five renderers share is seen by the bound above."""
    x = np.geomspace(4, 100, 101).astype(np.float32)
    wrong = call(device, "core/math.clh", "bessel_i0e(x) - 0.0249f / (x * sqrt(x))", x)
    assert np.max(np.abs(wrong / special.i0e(x.astype(np.float64)) - 1)) > 1e-4


@pytest.mark.parametrize("scale", [1.0, 10.0, 1000.0])
def test_wrap_angle(device, rng, scale):
    x = (rng.uniform(-1, 1, 5000) * np.pi * scale).astype(np.float32)
    got = call(device, "core/math.clh", "wrap_angle(x)", x).astype(np.float64)
    assert np.all(np.abs(got) <= np.pi * (1 + 1e-6))
    difference = np.mod(got - x.astype(np.float64) + np.pi, 2 * np.pi) - np.pi
    # 2 pi is rounded to float32 once a turn.
    assert np.max(np.abs(difference)) < 2e-7 * (1 + scale)


def test_wrap_angle_of_nonfinite_ends(device):
    assert not np.isfinite(call(device, "core/math.clh", "wrap_angle(x)", [np.inf, np.nan])).any()


@pytest.mark.parametrize("beta", [1e-3, 0.05, 0.39, 0.41, 1.0, 1.49, 1.51, 2.5, 4.4])
def test_wrapped_gaussian(device, beta):
    """Against 60 images in float64; the switches at 0.4 and 1.5 rad lie inside the list."""
    x = np.linspace(-7, 7, 4001).astype(np.float32)
    got = call(
        device,
        "fibre/cylinder/directions.clh",
        "azimuthal_density(x, y)",
        x,
        np.float32(beta),
    )
    centred = np.mod(x.astype(np.float64) + np.pi, 2 * np.pi) - np.pi
    images = centred[:, None] + 2 * np.pi * np.arange(-30, 31)
    width = float(np.float32(beta))
    expected = np.exp(-0.5 * (images / width) ** 2).sum(1) / (np.sqrt(2 * np.pi) * width)
    # An angle of 7 rad is known to 2.4e-7 (half a unit in the last place), the density to that
    # over the width.
    slope = 6e-7 / width
    np.testing.assert_allclose(got, expected, rtol=2e-6, atol=(1e-6 + slope) * np.max(expected))


@pytest.mark.parametrize("kind", ["box", "tent", "gaussian"])
def test_pixel_filter_is_the_inverse_of_its_distribution(device, kind):
    radius = {"box": 0.5, "tent": 1.0, "gaussian": 1.5}[kind]
    u = ((np.arange(20000) + 0.5) / 20000).astype(np.float32)
    x = call(
        device, "camera/camera.clh", "filter_sample(x, y)", u, np.float32(radius),
        features=Features(filter=kind),
    ).astype(np.float64)  # fmt: skip
    assert np.all(np.abs(x) <= radius)
    if kind == "box":
        cdf = (x / radius + 1) / 2
    elif kind == "tent":
        t = x / radius
        cdf = np.where(t < 0, 0.5 * (1 + t) ** 2, 1 - 0.5 * (1 - t) ** 2)
    else:
        cdf = 0.5 * (1 + special.erf(3 * x / radius / np.sqrt(2)) / special.erf(3 / np.sqrt(2)))
    assert np.max(np.abs(cdf - u)) < 5e-6


def test_normal_numbers(device, rng):
    """The radius by the first number, the angle by the second; finite at the largest first one."""
    last = np.float32(1 - 2.0**-24)
    u = rng.random((2, 5000)).astype(np.float32)
    u[:, :5] = [[0.0, 0.5, last, last, 0.5], [0.0, 0.0, 0.0, 0.5, 0.25]]
    got = call(device, "core/math.clh", "normal_from_uniform(x, y)", *u)
    radius, turn = np.sqrt(-2 * np.log1p(-u[0].astype(np.float64))), 2 * np.pi * u[1]
    np.testing.assert_allclose(got, radius * np.cos(turn), rtol=1e-6, atol=3e-6)


SINE = "static inline float sine_of_turns(float x) { float c; return sincos_turns(x, &c); }"
TINY = np.geomspace(1e-30, 1e-3, 200)
UNIT = np.concatenate([np.linspace(-1, 1, 20001), TINY, -TINY, 1 - TINY, [0.5, -0.5, 0.49999997]])
ELEMENTARY = {
    # expression, arguments, float64 twin, bound relative to the value, bound relative to 1
    "arc_sine": ("arc_sine(x)", UNIT, np.arcsin, 4e-7, 0),
    "natural_log": (
        "natural_log(x)", np.concatenate([np.geomspace(1e-37, 1e37, 20001), 1 - TINY, 1 + TINY]),
        np.log, 4e-7, 1e-9,
    ),
    "one_minus_exp": (
        "one_minus_exp(x)", np.geomspace(1e-30, 200, 20001), lambda x: -np.expm1(-x), 4e-7, 0,
    ),
    "exp_negative": (
        "exp_negative(x)", np.concatenate([-np.geomspace(1e-30, 87, 20001), [0.0]]),
        np.exp, 4e-7, 0,
    ),
    "exp_negative3": (
        "exp_negative3((float3)(0.0f, x, -1.0f)).y", -np.geomspace(1e-30, 87, 20001),
        np.exp, 4e-7, 0,
    ),
    "one_minus_exp3": (
        "one_minus_exp3((float3)(1.0f, x, 0.0f)).y", np.geomspace(1e-30, 200, 20001),
        lambda x: -np.expm1(-x), 4e-7, 0,
    ),
    "bessel_i0e3": (
        "bessel_i0e3((float3)(1.0f, x, 9.0f)).y",
        np.concatenate([np.linspace(0, 8, 4001), np.geomspace(1e-6, 1e8, 2001)]),
        special.i0e, 1e-6, 0,
    ),
    "exp_negative far out": ("exp_negative(x)", [-87.5, -1e3, -1e30, -np.inf], np.exp, 0, 2e-38),
    "nearest_whole": (
        "nearest_whole(x)", np.concatenate([np.linspace(-20, 20, 801), [4e6, -4194303.5, -0.0]]),
        np.rint, 0, 0,
    ),
    "sin": (
        "sine_of_turns(x)", np.concatenate([np.linspace(-2, 2, 20001), TINY]),
        lambda x: np.sin(2 * np.pi * x), 4e-7, 3e-7,
    ),
    "cos": ("cos_turns(x)", np.linspace(-2, 2, 20001), lambda x: np.cos(2 * np.pi * x), 4e-7, 3e-7),
}  # fmt: skip


@pytest.mark.parametrize("name", ELEMENTARY)
def test_elementary_functions(device, name):
    expression, x, twin, relative, absolute = ELEMENTARY[name]
    x = np.asarray(x, np.float32)
    got = call(device, "core/math.clh", expression, x, before=SINE)
    expected = twin(x.astype(np.float64))
    np.testing.assert_allclose(got, expected, rtol=relative, atol=absolute)


def test_arc_tangent(device, rng):
    angle = np.concatenate([rng.uniform(-np.pi, np.pi, 20000), np.arange(-8, 9) * np.pi / 8])
    radius = np.exp(rng.uniform(-30, 30, len(angle)))
    y, x = (radius * np.sin(angle)).astype(np.float32), (radius * np.cos(angle)).astype(np.float32)
    got = call(device, "core/math.clh", "arc_tangent(x, y)", y, x)
    np.testing.assert_allclose(
        got, np.arctan2(y.astype(np.float64), x.astype(np.float64)), rtol=4e-7
    )
    zero = call(device, "core/math.clh", "arc_tangent(x, y)", [0.0, 0.0, 0.0], [0.0, 1.0, -1.0])
    np.testing.assert_allclose(zero, [0, 0, np.pi], rtol=1e-7)


def test_decay_of_nan_is_nan(device):
    assert np.isnan(call(device, "core/math.clh", "exp_negative(x)", [np.nan])).all()


@pytest.mark.parametrize("size", [1e-15, 1e-3, 1.0, 1e15])
def test_unit_vector(device, rng, size):
    v = (size * rng.normal(size=(3, 5000))).astype(np.float32)
    expected = v.astype(np.float64) / np.linalg.norm(v.astype(np.float64), axis=0)
    for axis, name in enumerate("xyz"):
        got = call(device, "core/math.clh", f"unit_vector((float3)(x, y, z)).{name}", *v)
        np.testing.assert_allclose(got, expected[axis], rtol=3e-7, atol=1e-30)


def test_unit_vector_of_zero_is_zero(device):
    assert call(device, "core/math.clh", "unit_vector((float3)(x)).x", [0.0]) == 0.0


# A running sum in the first elements of the array, searched for the value that each element has.
SEARCH = "#define COUNT %du\n#define FOUND(v) (float)search_cdf(px, COUNT, v)"


@pytest.mark.parametrize("count", [1, 2, 5, 64, 100, 128, 1000])
def test_search_cdf(device, rng, count):
    """The first running sum above u; steps of zero height are never found."""
    steps = rng.exponential(size=count) * (rng.random(count) < 0.7)
    steps[-1] = 0.1
    cdf = (np.cumsum(steps) / steps.sum()).astype(np.float32)
    cdf[-1] = 1.0
    u = np.concatenate([cdf[:-1], np.nextafter(cdf, 0.0), rng.random(4000), [0.0, 1 - 2.0**-24]])
    u = u.astype(np.float32)[u < 1.0]
    table = np.resize(cdf, len(u)) if len(u) >= count else cdf
    got = call(device, "core/cdf.clh", "FOUND(y)", table, u, before=SEARCH % count)
    np.testing.assert_array_equal(got, np.searchsorted(cdf, u, side="right"))


LANE_ERROR = """
static float lane_error(uint i)
{
    UintLanes pixel, sample;
    for (uint k = 0; k < FURCL_LANES; k++) {
        set_uint_lane(&pixel, k, 977u * i + k);
        set_uint_lane(&sample, k, i ^ k);
    }
    const Lanes4 u = uniform_lanes(7u, pixel, sample, DIMENSION);
    float4 worst = (float4)(0.0f);
    for (uint k = 0; k < FURCL_LANES; k++)
        worst = fmax(worst, fabs(lane4(&u, k) - uniform4(7u, 977u * i + k, i ^ k, DIMENSION)));
    return worst.x + worst.y + worst.z + worst.w;
}
"""


@pytest.mark.parametrize("lanes", [1, 16])
@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("dimension", [4, 5])
def test_lanes_have_the_random_numbers_of_their_paths(device, lanes, sequence, dimension):
    error = call(
        device,
        "core/lanes.clh",
        "lane_error((uint)x)",
        np.arange(1000),
        features=FULL.with_(sequence=sequence),
        before=f"#define DIMENSION {dimension}u" + LANE_ERROR,
        lanes=lanes,
    )
    assert not error.any()
