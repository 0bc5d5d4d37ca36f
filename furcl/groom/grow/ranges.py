"""The allowed range of every parameter of the generators, in one place.

Each table maps a parameter to (lowest, highest), both allowed. Triples and pairs are checked
component by component. Choices map to a tuple of words.
"""

from collections.abc import Mapping
from typing import Any

from furcl.errors import GroomError
from furcl.groom.curves import MAX_POINTS
from furcl.memory import available_bytes

# The most that growing takes, of which bench/faults/memory.py holds the generators to: copies of
# points in float64 among them.
POINT_BYTES, STRAND_BYTES = 60, 400

_PLACE = (-1e6, 1e6)
_UNIT = (0.0, 1.0)
_DEPTH = (0.0, 0.95)
_COMMON = {
    "n_strands": (1, 50_000_000),
    "n_points": (2, 4096),
    "seed": (0, 2**63 - 1),
    "length": (1e-4, 100.0),
    "length_variation": _DEPTH,
    "radius": (1e-7, 1.0),
    "radius_variation": (0.0, 0.9),
    "tip_radius": (0.01, 1.0),
    "n_clumps": (0, 1_000_000),
    "clumping": _UNIT,
    "frizz": _UNIT,
}

HAIR_RANGES: dict[str, tuple] = {
    **_COMMON,
    "scalp_centre": _PLACE,
    "scalp_radii": (1e-3, 1e3),
    "hairline_front_deg": (-90.0, 90.0),
    "hairline_side_deg": (-90.0, 90.0),
    "hairline_back_deg": (-90.0, 90.0),
    "style": ("straight", "wavy", "curly"),
    "lift_deg": (0.0, 90.0),
    "parting": _UNIT,
    "parting_x": (-0.9, 0.9),
    "comb_back": _UNIT,
    "gravity": (0.0, 100.0),
    "volume": (0.005, 1.0),
    "wave_amplitude": _UNIT,
    "wave_frequency": (0.0, 100.0),
    "helix": _UNIT,
    "flyaways": _UNIT,
}

FUR_RANGES: dict[str, tuple] = {
    **_COMMON,
    "surface": ("sphere", "patch"),
    "centre": _PLACE,
    "sphere_radius": (1e-3, 1e3),
    "patch_size": (1e-3, 1e3),
    "length_noise": _DEPTH,
    "length_noise_scale": (0.01, 1e3),
    "density_noise": _DEPTH,
    "density_noise_scale": (0.01, 1e3),
    "comb": _PLACE,
    "lean_deg": (0.0, 85.0),
    "bend_deg": (-90.0, 120.0),
    "comb_noise_deg": (0.0, 180.0),
    "comb_noise_scale": (0.01, 1e3),
    "undercoat": _UNIT,
    "undercoat_length": (0.01, 1.0),
    "undercoat_radius": (0.01, 1.0),
}

FIBRE_RANGES: dict[str, tuple] = {
    "count": (1, 1_000_000),
    "length": (1e-6, 1e6),
    "radius": (1e-9, 1e5),
    "spacing": (0.0, 1e6),
    "axis": ("x", "y", "z"),
    "centre": _PLACE,
    "n_points": (2, 4096),
}

_WIDTH = {"scalp_centre": 3, "scalp_radii": 3, "centre": 3, "comb": 3, "patch_size": 2}
_WHOLE = {"n_strands", "n_points", "seed", "n_clumps", "count"}


def check(generator: str, ranges: Mapping[str, tuple], parameters: Mapping[str, Any]) -> None:
    """Refuse a parameter of a wrong kind or outside its range; None is left to the generator.

    Raises
    ------
    GroomError                   names the generator, the parameter, the value and the range
    """
    for name, value in parameters.items():
        allowed = ranges[name]
        if value is None:
            continue
        if isinstance(allowed[0], str):
            if value not in allowed:
                raise GroomError(
                    f"{generator}: {name} = {value!r} is unknown; choose one of "
                    f"{', '.join(allowed)}."
                )
            continue
        _check_number(f"{generator}: {name}", name, value, *allowed)


def _check_number(where, name, value, lowest, highest):
    width = _WIDTH.get(name)
    try:
        values = [value] if width is None else list(value)
        values = [v if isinstance(v, int) else float(v) for v in values]
    except (TypeError, ValueError):
        values = []
    if len(values) != (width or 1) or (name in _WHOLE and values[0] % 1 != 0):
        kind = f"{width} numbers" if width else "a whole number" if name in _WHOLE else "a number"
        raise GroomError(f"{where} = {value!r}; expected {kind}. Correct it.")
    if not all(lowest <= v <= highest for v in values):
        raise GroomError(
            f"{where} = {value!r} is outside [{lowest:g}, {highest:g}]; choose a value inside."
        )


def check_size(generator: str, n_strands: int, n_points: int, n_clumps: int = 0) -> None:
    """Refuse a groom of more points than can be indexed, or than fit into the memory.

    Raises
    ------
    GroomError
    """
    if n_strands * n_points > MAX_POINTS:
        raise GroomError(
            f"{generator}: {n_strands} strands of {n_points} points make {n_strands * n_points}; "
            f"at most {MAX_POINTS} can be indexed. Lower n_strands or n_points."
        )
    n_grown = n_strands + n_clumps
    needed = n_grown * (STRAND_BYTES + POINT_BYTES * n_points)
    there = available_bytes()
    if needed > there:
        raise GroomError(
            f"{generator}: {n_grown} strands of {n_points} points take {needed / 2**20:.0f} MiB to "
            f"grow; {there / 2**20:.0f} MiB of memory are available. Lower n_strands or n_points."
        )
