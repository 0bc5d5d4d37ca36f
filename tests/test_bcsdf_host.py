"""The float64 reference: optics and attenuation against ray traces, series and 60 digits."""

import numpy as np
import pytest
from fibre_oracles import (
    angles,
    direction,
    flat_profiles,
    fresnel_series,
    random_profiles,
    trace_cylinder,
    turn,
)

from furcl import bcsdf
from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import UNSCATTERED
from furcl.oracle.mp_reference import exact_attenuation

PRESETS = ("human-white", "human-black", "raccoon", "red-fox", "unlabelled-a", "unlabelled-b")


@pytest.mark.parametrize("eta", [1.01, 1.19, 1.55, 2.9])
@pytest.mark.parametrize("kappa", [0.0, 0.41, 0.9, 1.0])
@pytest.mark.parametrize("theta", [-1.4, -0.3, 0.0, 0.7, 1.5])
def test_against_vector_ray_trace(eta: float, kappa: float, theta: float) -> None:
    """Exit directions of R, TT and TRT, lengths in cortex and medulla, the entry azimuth."""
    fibre = Fibre(eta=eta, kappa=kappa)
    for h in (-0.97, -0.5, -0.1, 0.2, 0.63, 0.9, 0.999):
        wo = direction(theta, 0.8)
        ray = trace_cylinder(wo, h, eta, kappa)
        geo = bcsdf.geometry(fibre, h, theta)
        for p in range(3):
            theta_out, phi_out = angles(ray.leaving[p])
            assert theta_out == pytest.approx(-theta, abs=1e-9)
            assert turn(phi_out - 0.8, float(geo.Phi(p))) == pytest.approx(0, abs=1e-7)
        for p in range(2):
            assert ray.cortex[p] == pytest.approx(2 * geo.cortex / geo.cos_theta_t, abs=1e-9)
            assert ray.core[p] == pytest.approx(2 * geo.medulla / geo.cos_theta_t, abs=1e-9)


@pytest.mark.parametrize("h", [-0.6, 0.35, 0.8])
@pytest.mark.parametrize("lobe", [0, 1, 2])
def test_lobes_bend_the_way_light_does(lobe: int, h: float) -> None:
    """A lobe is where the traced ray leaves, and not at its mirror image."""
    fibre = Fibre(alpha_deg=0, beta_m_deg=1, beta_n_deg=1)
    wo = direction(0.3, -0.5)
    out = trace_cylinder(wo, h, fibre.eta, 0.0).leaving[lobe]
    theta, phi = angles(out)
    mirrored = direction(theta, -0.5 - (phi + 0.5))
    there, beside = (bcsdf.evaluate(fibre, wo, w, h, lobe=lobe)[0] for w in (out, mirrored))
    peak = bcsdf.evaluate(fibre, wo, direction(theta, phi + 0.002), h, lobe=lobe)[0]
    assert there > 1e3 * beside
    assert there >= peak


@pytest.mark.parametrize("h", [-0.5, -0.1, 0.3, 0.55])
@pytest.mark.parametrize(("lobe", "stretch"), [("TTs", 0), ("TRTs", 1)])
def test_profiles_turn_with_the_ray(lobe: str, stretch: int, h: float) -> None:
    """What a profile puts into one bin leaves at that azimuth from the ray in the medulla.

    The profile's photon comes from azimuth 0, flies along -x and passes the axis at y = -h; the
    trace gives the direction of flight, and on which side of the axis it passes.
    """
    fibre = Fibre(kappa=0.7, sigma_ms=1.0)
    profiles = flat_profiles()
    profiles.azimuth.density = np.zeros((4, 32, 128))
    profiles.azimuth.density[..., 90] = 128 / (2 * np.pi)
    centre = (90.5 / 128 * 2 - 1) * np.pi
    wo = direction(0.2, 0.4)
    ray = trace_cylinder(wo, h, fibre.eta, fibre.kappa)
    flight, start = ray.inside[stretch], ray.starts[stretch]
    _, arrival = angles(-flight)
    side = -(np.cos(arrival) * start[2] - np.sin(arrival) * start[1])
    assert np.sign(side) == np.sign(h)
    expected = arrival + np.sign(side) * centre
    width = 2 * np.pi / 128
    wi = [direction(-0.1, expected + k * width) for k in (-0.9, -0.4, 0.0, 0.4, 0.9)]
    value = bcsdf.evaluate(fibre, wo, np.array(wi), h, profiles, lobe=lobe)[:, 0]
    assert list(value > 0) == [False, True, True, True, False]


@pytest.mark.parametrize("layers", [0, 1, 2, 3])
@pytest.mark.parametrize("eta", [1.0001, 1.49, 3.0])
@pytest.mark.parametrize("theta", [0.0, 0.6, 1.5, 1.5707])
def test_cuticle_against_series(layers: int, eta: float, theta: float) -> None:
    """Reflected and passed light to 1e-10 against multiple reflections counted at 60 digits."""
    fibre = Fibre(eta=eta, layers=layers or 0.5)
    for h in (0.0, 0.4, 0.95, 1 - 1e-9):
        reflected, passed = bcsdf.cuticle(fibre, h, theta)
        exact_r, exact_t = fresnel_series(eta, h, theta, layers)
        assert float(abs(reflected - exact_r)) <= 1e-10 * float(exact_r) + 1e-30
        assert float(abs(passed - exact_t)) <= 1e-10 * float(exact_t)


def test_cuticle_without_layers_and_at_the_rim() -> None:
    assert bcsdf.cuticle(Fibre(layers=0), [0.0, 1.0], 0.3)[0].tolist() == [0.0, 0.0]
    for theta, h in ((0.0, 1.0), (np.pi / 2, 0.0)):
        reflected, passed = bcsdf.cuticle(Fibre(), h, theta)
        assert reflected == pytest.approx(1.0, abs=1e-9)
        assert passed == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("theta", [0.0, 0.9, 1.57, np.pi / 2 - 1e-6])
@pytest.mark.parametrize(
    "parameters",
    [
        {"kappa": 0.99999, "sigma_ca": 3.0, "sigma_ms": 1e-9},
        {"kappa": 0.41, "sigma_ca": 1e-9, "sigma_ms": 1e4, "sigma_ma": 1.0},
        {"kappa": 0.41, "sigma_ca": 150.0, "sigma_ms": 2.0, "sigma_ma": 0.3},
        {"kappa": 1.0, "sigma_ms": 1e-6, "eta": 1.0001},
        {"kappa": 1e-6, "sigma_ms": 5.0, "eta": 3.0},
        {"kappa": 0.86, "sigma_ca": 0.39, "sigma_ms": 3.15, "sigma_ma": 0.21, "eta": 1.49},
        {"kappa": 0.7, "sigma_ca": 0.1, "sigma_ms": 1.0, "layers": 3.0},
    ],
)
def test_attenuation_against_60_digits(parameters: dict, theta: float) -> None:
    """Every lobe to 1e-9 of itself where it is above 1e-280, hostile corners included."""
    fibre = Fibre(**parameters)
    for h in (0.0, -0.3, 0.7, 0.999, 1 - 1e-8):
        found = bcsdf.attenuation(fibre, h, theta, flat_profiles(), residual=True)
        for name, exact in exact_attenuation(fibre, h, theta).items():
            error = float(abs(found[name][0] - exact))
            assert error <= 1e-9 * float(exact) + 1e-280, (name, h)


def test_rim_and_grazing_are_finite() -> None:
    """h = +-1, theta = +-pi/2, no or full medulla, sigma 0 and 1e4: finite, >= 0, sum <= 1."""
    h, theta = np.meshgrid([-1.0, -0.5, 0.0, 1.0], [-np.pi / 2, 0.0, np.pi / 2])
    for kappa in (0.0, 0.5, 1.0):
        for sigma in (0.0, 1.0, 1e4):
            for layers in (0.0, 0.5, 10.0):
                f = Fibre(kappa=kappa, sigma_ms=sigma, sigma_ca=(sigma, sigma, 0), layers=layers)
                lobes = bcsdf.attenuation(f, h, theta, flat_profiles(), residual=True)
                total = np.sum(list(lobes.values()), axis=0)
                assert np.all(np.isfinite(total))
                assert np.all((total >= 0) & (total <= 1 + 1e-12))
                assert all(np.all(a >= 0) for a in lobes.values())


@pytest.mark.parametrize("name", PRESETS)
def test_symmetries(name: str) -> None:
    """A is even in h and theta; the value is that of the mirror image; no tilt: mirrored theta."""
    fibre = Fibre.preset(name)
    rng = np.random.default_rng(1)
    h, theta = rng.uniform(-1, 1, 50), rng.uniform(-1.5, 1.5, 50)
    profiles = random_profiles(rng)
    a = bcsdf.attenuation(fibre, h, theta, profiles)
    b = bcsdf.attenuation(fibre, -h, -theta, profiles)
    assert all(np.allclose(a[p], b[p], rtol=1e-13, atol=0) for p in bcsdf.LOBES)
    wo, wi = rng.normal(size=(2, 50, 3))
    wo, wi = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wo, wi))
    flip_y, flip_x = np.array([1, -1, 1]), np.array([-1, 1, 1])
    value = bcsdf.evaluate(fibre, wo, wi, h, profiles)
    assert np.allclose(value, bcsdf.evaluate(fibre, wo * flip_y, wi * flip_y, -h, profiles))
    straight = fibre.replace(alpha_deg=0)
    value = bcsdf.evaluate(straight, wo, wi, h, profiles)
    assert np.allclose(value, bcsdf.evaluate(straight, wo * flip_x, wi * flip_x, h, profiles))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: bcsdf.attenuation(f, 1.1, 0.0, UNSCATTERED), "h has values outside"),
        (lambda f: bcsdf.attenuation(f, np.nan, 0.0, UNSCATTERED), "h has values outside"),
        (lambda f: bcsdf.geometry(f, 0.0, 2.0), "theta has values outside"),
        (lambda f: bcsdf.evaluate(f, [1, 1, 0], [0, 0, 1], 0.0), r"wo .*unit vectors"),
        (lambda f: bcsdf.evaluate(f, [0, 0, 1], [0, 1], 0.0), r"wi .*unit vectors"),
        (lambda f: bcsdf.evaluate(f, [0, 0, 1], [0, 1, 0], 0.0, lobe="TTT"), "lobe 'TTT'"),
        (lambda f: bcsdf.evaluate(f, [0, 0, 1], [0, 1, 0], 0.0, lobe=6), "lobe 6"),
    ],
)
def test_refusals(call, message: str) -> None:
    with pytest.raises(FibreError, match=message):
        call(Fibre.preset("raccoon"))


SIDE, BACK = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
NEED_PROFILES = {
    "attenuation": lambda f, p: bcsdf.attenuation(f, 0.3, 0.1, p),
    "evaluate": lambda f, p: bcsdf.evaluate(f, SIDE, BACK, 0.3, p),
    "evaluate TTs": lambda f, p: bcsdf.evaluate(f, SIDE, BACK, 0.3, p, lobe="TTs"),
    "evaluate residual": lambda f, p: bcsdf.evaluate(f, SIDE, BACK, 0.3, p, lobe="residual"),
    "direction_pdf": lambda f, p: bcsdf.direction_pdf(
        f, SIDE, BACK, 0.3, p, lobe="TRTs", sampling="full-cdf"
    ),
    "joint_densities": lambda f, p: bcsdf.joint_densities(f, 0.1, 0.3, p, sampling="uniform-h"),
    "pdf": lambda f, p: bcsdf.pdf(f, SIDE, BACK, 0.3, p, sampling="uniform-h", lobe="R"),
    "sample": lambda f, p: bcsdf.sample(f, SIDE, 10, p, sampling="full-cdf", rng=1),
    "albedo": lambda f, p: bcsdf.albedo(f, 0.1, p),
    "lobe_albedos": lambda f, p: bcsdf.lobe_albedos(f, 0.1, p),
    "lobe_shares": lambda f, p: bcsdf.lobe_shares(f, p),
    "attenuation_tables": lambda f, p: bcsdf.attenuation_tables(f, p, rows=3, bins=5),
}


@pytest.mark.parametrize("name", NEED_PROFILES)
def test_scattered_lobes_are_not_dropped_unasked(name: str) -> None:
    """A medulla that scatters needs its profiles; one that does not needs none, and the caller may
    ask for the unscattered lobes."""
    call = NEED_PROFILES[name]
    with pytest.raises(FibreError, match=r"no profiles, .*bcsdf\.UNSCATTERED"):
        call(Fibre.preset("raccoon"), None)
    with pytest.raises(FibreError, match=r"profiles = 'TTs'"):
        call(Fibre.preset("raccoon"), "TTs")
    for fibre, nothing in (
        (Fibre.preset("raccoon"), UNSCATTERED),
        (Fibre.preset("raccoon", sigma_ms=0.0), None),
        (Fibre.preset("raccoon", kappa=0.0), None),
    ):
        call(fibre, nothing)


def test_unscattered_is_what_profiles_leave() -> None:
    """R, TT and TRT do not depend on the profiles, TTs and TRTs are zero without them, and the
    residual is smaller."""
    fibre, h = Fibre.preset("raccoon"), np.linspace(-1, 1, 9)
    without = bcsdf.attenuation(fibre, h, 0.4, UNSCATTERED, residual=True)
    whole = bcsdf.attenuation(fibre, h, 0.4, flat_profiles(), residual=True)
    assert all(np.array_equal(without[p], whole[p]) for p in ("R", "TT", "TRT"))
    assert all(not without[p].any() for p in bcsdf.SCATTERED)
    assert np.all(without["residual"][1:-1] < whole["residual"][1:-1])
