"""Generators: same seed same bits, documented ranges, and the shapes that parameters promise."""

import itertools
from typing import Any

import numpy as np
import pytest
from groom_shapes import PLAIN_FUR, PLAIN_HAIR, arc_lengths, mean_turn, strands_of

from furcl.errors import GroomError
from furcl.groom import grow
from furcl.groom.grow import fur, hair

DEFAULTS: dict[str, dict[str, Any]] = {
    name: function.__kwdefaults__ or {} for name, function in grow.GENERATORS.items()
}
SMALL = {"hair": {"n_strands": 300}, "fur": {"n_strands": 300, "n_clumps": 20}, "fibre": {}}
WHOLE_SCALP = ("hairline_front_deg", "hairline_side_deg", "hairline_back_deg")
TABLE = [(g, p) for g, ranges in grow.RANGES.items() for p in ranges]


@pytest.mark.parametrize("generator", grow.RANGES)
def test_ranges_cover_all_parameters_and_hold_the_defaults(generator):
    defaults = DEFAULTS[generator]
    assert set(grow.RANGES[generator]) == set(defaults)
    for name, value in defaults.items():
        allowed = grow.RANGES[generator][name]
        if isinstance(value, str):
            assert value in allowed
        elif value is not None:
            assert allowed[0] <= np.min(value) <= np.max(value) <= allowed[1]


def outside(name, allowed, default):
    """A value beyond each end of a range, shaped as the parameter is."""
    if isinstance(allowed[0], str):
        return ["unheard-of"]
    values = [allowed[0] - 1, allowed[1] + 1, float("nan")]
    return [(v,) * len(default) if isinstance(default, tuple) else v for v in values]


@pytest.mark.parametrize(("generator", "name"), TABLE)
def test_values_outside_a_range_are_refused(generator, name):
    function = grow.GENERATORS[generator]
    for value in outside(name, grow.RANGES[generator][name], DEFAULTS[generator][name]):
        with pytest.raises(GroomError, match=f"^{generator}: {name} = "):
            function(**{**SMALL[generator], name: value})


@pytest.mark.parametrize(
    ("generator", "parameters", "message"),
    [
        ("hair", {"n_strands": 1.5}, r"hair: n_strands = 1.5; expected a whole number"),
        ("hair", {"length": "long"}, r"hair: length = 'long'; expected a number"),
        ("hair", {"scalp_radii": (1, 1)}, r"scalp_radii = \(1, 1\); expected 3 numbers"),
        ("hair", {"style": "afro"}, r"style = 'afro' is unknown; choose one of straight, wavy"),
        ("hair", {"style": "curly", "n_points": 16}, r"n_points = 16 is too few for 4.8 turns"),
        ("hair", {"length": 35.0, "scalp_radii": (1e-3, 1, 1)}, r"want 420001 points each; at"),
        ("hair", {"n_strands": 50_000_000, "n_points": 100}, r"make 5000000000; at most 2147"),
        ("fur", {"comb": (0, 0, 0)}, r"comb = \(0, 0, 0\) is no direction"),
        ("fur", {"patch_size": 2}, r"patch_size = 2; expected 2 numbers"),
    ],
)  # fmt: skip
def test_unusable_parameters_are_refused(generator, parameters, message):
    with pytest.raises(GroomError, match=message):
        grow.GENERATORS[generator](**{"n_strands": 10, **parameters})


@pytest.mark.parametrize("generator", ["hair", "fur"])
def test_same_seed_same_bits(generator):
    make, small = grow.GENERATORS[generator], SMALL[generator]
    first, again, other = make(**small), make(**small), make(**small, seed=2)
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.radii, again.radii)
    assert not (first.points == other.points).any()


@pytest.mark.parametrize(
    ("generator", "parameters"),
    [
        ("hair", {"n_strands": 1, "n_clumps": 0}),
        ("hair", {"n_strands": 1, "n_clumps": 50}),
        ("hair", {"n_strands": 3, "n_points": 2, "wave_amplitude": 0}),
        ("hair", {"n_strands": 9, **dict.fromkeys(WHOLE_SCALP, 90)}),
        ("hair", {"n_strands": 20_000, "n_points": 8}),
        ("hair", {"n_strands": 500, "gravity": 0, "comb_back": 0, "parting": 0, "lift_deg": 90}),
        ("hair", {"n_strands": 500, "style": "curly", "helix": 0, "wave_amplitude": 0.2}),
        ("fur", {"n_strands": 1, "n_clumps": 1, "n_points": 2}),
        ("fur", {"n_strands": 20_000, "undercoat": 1.0}),
        ("fur", {"n_strands": 500, "surface": "patch", "lean_deg": 85, "bend_deg": 120}),
        ("fur", {"n_strands": 500, "comb": (0, 0, 1), "comb_noise_deg": 180, "clumping": 1}),
    ],
    ids=str,
)
def test_any_corner_makes_a_clean_groom(generator, parameters):
    curves = grow.GENERATORS[generator](**parameters)
    assert curves.n_strands == parameters["n_strands"]
    assert dict(curves.dropped) == {}
    if "n_points" in parameters:
        assert curves.n_points == parameters["n_points"] * parameters["n_strands"]


@pytest.mark.parametrize("style", ["straight", "wavy", "curly"])
@pytest.mark.parametrize("scalp_radii", [(0.85, 1.0, 0.95), (2.0, 1.0, 1.5)], ids=str)
def test_hair_stays_out_of_the_scalp(style, scalp_radii):
    centre = (3.0, -1.0, 2.0)
    curves = hair(n_strands=3000, style=style, scalp_radii=scalp_radii, scalp_centre=centre)
    q = (strands_of(curves) - centre) / scalp_radii
    level = np.linalg.norm(q, axis=2)
    np.testing.assert_allclose(level[:, 0], 1.0, atol=1e-6)
    assert level[:, 1:].min() > 1.0
    for t in (0.25, 0.5, 0.75):
        along = q[:, :-1] * (1.0 - t) + q[:, 1:] * t
        assert np.linalg.norm(along, axis=2).min() > 1.0 - 1e-6


def test_hairline():
    curves = hair(n_strands=20_000, hairline_front_deg=50, hairline_side_deg=10)
    roots = strands_of(curves)[:, 0] / (0.85, 1.0, 0.95)
    elevation = np.degrees(np.arcsin(np.clip(roots[:, 2], -1, 1)))
    azimuth = np.degrees(np.arctan2(roots[:, 0], -roots[:, 1]))
    for place, line in ((0, 50), (90, 10), (-90, 10), (180, -35)):
        near = np.abs((azimuth - place + 180) % 360 - 180) < 3
        lowest = elevation[near].min()
        # Feathered by 3 degrees; within 3 degrees of azimuth the line moves by up to 2.3 more.
        assert line - 5.3 < lowest < line + 5.3, place


def test_roots_are_even_over_the_area_of_the_scalp():
    radii = np.array([0.5, 0.5, 2.0])
    whole: dict[str, Any] = dict.fromkeys(WHOLE_SCALP, -90)
    roots = strands_of(hair(n_strands=20_000, scalp_radii=radii.tolist(), **whole))[:, 0]
    found, edges = np.histogram(roots[:, 2] / 2.0, bins=10, range=(-1, 1))
    z = np.linspace(-1, 1, 200_001)
    area = np.sqrt(1.0 - z**2 * (1.0 - 0.5**2 / 2.0**2))  # of a spheroid, between z and z + dz
    expected = np.array([area[(z >= a) & (z < b)].sum() for a, b in itertools.pairwise(edges)])
    expected /= expected.sum()
    np.testing.assert_allclose(found / 20_000, expected, atol=0.004)
    assert np.abs(expected - 0.1).max() > 0.02  # roots even over directions would be seen


@pytest.mark.parametrize("variation", [0.0, 0.4])
def test_hair_length_and_radius(variation):
    curves = hair(
        n_strands=2000, length=1.5, length_variation=variation, radius=0.001,
        radius_variation=variation, tip_radius=0.25, gravity=0.0, lift_deg=90.0, **PLAIN_HAIR,
    )  # fmt: skip
    lengths = arc_lengths(curves)
    assert lengths.max() == pytest.approx(1.5, rel=2e-3)
    assert lengths.min() == pytest.approx(1.5 * (1.0 - variation), rel=2e-2)
    radii = curves.radii.reshape(2000, -1)
    np.testing.assert_allclose(radii[:, -1] / radii[:, 0], 0.25, rtol=1e-5)
    assert radii[:, 0].max() == pytest.approx(0.001 * (1.0 + variation), rel=1e-2)
    assert radii[:, 0].min() == pytest.approx(0.001 * (1.0 - variation), rel=1e-2)
    assert (np.diff(radii, axis=1) <= 0.0).all()


def test_styles_turn_more_and_more():
    turns = [mean_turn(hair(n_strands=1000, style=s)) for s in ("straight", "wavy", "curly")]
    assert turns[1] > 1.5 * turns[0]
    assert turns[2] > 1.5 * turns[1]


def test_wave_frequency_is_turns_per_unit():
    """A strand without scalp, gravity or variation is a helix of the asked number of turns."""
    curves = hair(
        n_strands=200, n_points=400, scalp_radii=(1e-3,) * 3, gravity=0.0, length=2.0,
        length_variation=0.0, helix=1.0, wave_amplitude=0.05, wave_frequency=4.0, volume=0.005,
        n_clumps=0, frizz=0.0, flyaways=0.0,
    )  # fmt: skip
    points = strands_of(curves)
    axis = points[:, -1] - points[:, 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    step = np.diff(points[:, 200:], axis=1)
    step /= np.linalg.norm(step, axis=2, keepdims=True)
    step -= (step * axis[:, None]).sum(axis=2, keepdims=True) * axis[:, None]
    step /= np.linalg.norm(step, axis=2, keepdims=True)
    angle = np.arccos(np.clip((step[:, 1:] * step[:, :-1]).sum(axis=2), -1, 1)).sum(axis=1)
    turns_per_unit = angle / (2 * np.pi)  # the outer half of the strand is one unit long
    assert turns_per_unit.mean() == pytest.approx(4.0, rel=0.05)
    assert 3.2 < turns_per_unit.min() < turns_per_unit.max() < 4.8


def test_gravity_lets_hair_hang():
    def downward(gravity):
        """Mean cosine between the last segment and -z."""
        last = np.diff(strands_of(hair(n_strands=1000, gravity=gravity))[:, -2:], axis=1)[:, 0]
        return -(last[:, 2] / np.linalg.norm(last, axis=1)).mean()

    assert downward(0.0) < 0.7
    assert downward(3.0) > 0.9
    assert downward(30.0) > 0.9


def tip_distance(curves):
    """Median distance of a tip to the nearest other tip."""
    from scipy.spatial import KDTree

    tips = strands_of(curves)[:, -1]
    return np.median(KDTree(tips).query(tips, k=2)[0][:, 1])


def test_clumping_draws_tips_together():
    def spread(clumping):
        return tip_distance(hair(n_strands=3000, n_clumps=20, clumping=clumping, flyaways=0.0))

    assert spread(0.95) < 0.7 * spread(0.0)
    fur_like = {**PLAIN_FUR, "n_strands": 3000, "n_clumps": 100}
    assert tip_distance(fur(**fur_like, clumping=0.9)) < 0.7 * tip_distance(
        fur(**fur_like, clumping=0.0)
    )


@pytest.mark.parametrize("changes", [{"frizz": 0.05}, {"frizz": 0.01, "flyaways": 1.0}], ids=str)
def test_frizz_and_flyaways_disturb_strands(changes):
    def turn(**changes: Any):
        return mean_turn(hair(n_strands=1000, n_clumps=10, **{"flyaways": 0.0, **changes}))

    assert turn(**changes) > 1.2 * turn(frizz=0.0)
