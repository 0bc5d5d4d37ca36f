"""The one list of what crosses to the device: structs, planes of path state, constants.

`device_text(features)` is the virtual include "layout.clh"; the numpy dtypes of the same names are
what the host fills. Structs hold 4-byte scalars and float4 only, so one dtype is valid on every
device; `check_structs` asks the device and refuses any difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from furcl.device.features import Features
from furcl.errors import LayoutError

NO_SEGMENT = 0xFFFFFFFF
BODY_SEGMENT = 0xFFFFFFFE

# Entries of the buffer of queue lengths; the lobe counters are in a buffer of their own.
COUNT_NEXT, COUNT_HITS, COUNT_MISSES, COUNT_SHADOWS = range(4)
N_COUNTS = 4

# The record of index checks, in words behind a buffer's contents (furcl/device/index_checks.py).
CHECK_FAILURES, CHECK_LINE, CHECK_INDEX, CHECK_SIZE = range(4)
CHECK_N_VERTICES, CHECK_N_BLOCKS, CHECK_N_FILM, CHECK_FILE = range(4, 8)
CHECK_WORDS = 16

# Slots of the path state whose planes lie together: a cache line of each.
STATE_BLOCK = 16

# The tree over fibre segments (kernels/include/bvh/block.clh).
BVH_BLOCK_WORDS = 32
BVH_STACK_SIZE = 128

# Attenuation tables (SPEC 4.2-4.3): rows over |theta|, bins over |h|; 100 bins of |h| are the
# paper's 200 bins of h, A being even in h.
TABLE_ROWS = 32
TABLE_BINS = 100

# Medulla profiles (SPEC 2.6).
PROFILE_TAUS = 4
PROFILE_OFFSETS = 32
PROFILE_PHIS = 128
PROFILE_THETAS = 16
PROFILE_SINES = 64

CONSTANTS = {
    "NO_SEGMENT": f"{NO_SEGMENT:#x}u",
    "BODY_SEGMENT": f"{BODY_SEGMENT:#x}u",
    "COUNT_NEXT": COUNT_NEXT,
    "COUNT_HITS": COUNT_HITS,
    "COUNT_MISSES": COUNT_MISSES,
    "COUNT_SHADOWS": COUNT_SHADOWS,
    "CHECK_FAILURES": CHECK_FAILURES,
    "CHECK_LINE": CHECK_LINE,
    "CHECK_INDEX": CHECK_INDEX,
    "CHECK_SIZE": CHECK_SIZE,
    "CHECK_N_VERTICES": CHECK_N_VERTICES,
    "CHECK_N_BLOCKS": CHECK_N_BLOCKS,
    "CHECK_N_FILM": CHECK_N_FILM,
    "CHECK_FILE": CHECK_FILE,
    "CHECK_FILE_BYTES": f"{4 * (CHECK_WORDS - CHECK_FILE)}u",
    "STATE_BLOCK": f"{STATE_BLOCK}u",
    "BVH_BLOCK_WORDS": BVH_BLOCK_WORDS,
    "BVH_STACK_SIZE": BVH_STACK_SIZE,
    "TABLE_ROWS": TABLE_ROWS,
    "TABLE_BINS": TABLE_BINS,
    "PROFILE_TAUS": PROFILE_TAUS,
    "PROFILE_OFFSETS": PROFILE_OFFSETS,
    "PROFILE_PHIS": PROFILE_PHIS,
    "PROFILE_THETAS": PROFILE_THETAS,
    "PROFILE_SINES": PROFILE_SINES,
}

# Every struct: field name and OpenCL type. Sizes are multiples of 16 bytes.
STRUCTS: dict[str, list[tuple[str, str]]] = {
    "FibreParams": [
        ("sigma_ca", "float4"),  # cortex absorption per fibre radius, one value a channel
        ("sigma_ma", "float4"),  # medulla absorption
        ("eta", "float"),
        ("eta_sq_minus_one", "float"),  # formed in float64: no cancellation near eta = 1
        ("kappa", "float"),
        ("one_minus_kappa", "float"),
        ("sigma_ms", "float"),
        ("layers", "float"),
        ("beta_m", "float"),
        ("beta_n", "float"),
        ("tilt", "float"),  # a <= 0 [rad], SPEC 2.3
        ("sin_tilt", "float"),
        ("cos_tilt", "float"),
        ("sin_tilt_trt", "float"),  # of 3 a
        ("cos_tilt_trt", "float"),
        ("profile_taus_per_cos", "float"),  # profile nodes per unit of 1 - cos(theta_t), SPEC 2.6
        ("kappa_low", "float"),  # what float32 leaves of kappa
        ("kappa_sq_e", "float"),  # kappa^2 (eta^2 - 1), and ...
        ("kappa_sq_e_low", "float"),  # ... what float32 leaves of it
        ("unused_1", "float"),
        ("unused_2", "float"),
        ("unused_3", "float"),
    ],
    "Camera": [
        ("origin", "float4"),
        ("right", "float4"),  # scaled so that x in [-1, 1] spans the film
        ("up", "float4"),  # scaled likewise
        ("forward", "float4"),  # unit
        ("aperture_radius", "float"),
        ("focus_distance", "float"),
        ("filter_radius_px", "float"),
        ("unused", "float"),
    ],
    "Wave": [
        ("width", "uint"),
        ("height", "uint"),
        ("first_pixel", "uint"),  # the wave's first path: its pixel in tile order ...
        ("first_sample", "uint"),  # ... and its sample
        ("n_paths", "uint"),
        ("n_slots", "uint"),  # of the path state, a multiple of STATE_BLOCK
        ("seed", "uint"),
        ("roulette_depth", "uint"),
    ],
    "Body": [
        ("centre", "float4"),
        ("inv_radii", "float4"),
        ("albedo", "float4"),
    ],
}

# Parameters at the start of the environment buffer, by Features.environment: name, floats.
# Tables of the image follow them, see furcl/light/latlong.py.
ENVIRONMENT_FIELDS: dict[str, list[tuple[str, int]]] = {
    "constant": [("RADIANCE", 3)],
    "sky": [
        ("SUN", 3),  # unit, to the sun's centre
        ("SUN_TANGENT", 3),  # unit, with SUN_BITANGENT a right-handed frame around SUN
        ("SUN_BITANGENT", 3),
        ("SUN_VERSINE", 1),  # 1 - cos(radius)
        ("SUN_RADIANCE", 3),
        ("SUN_PDF", 1),  # chance of sampling the sun over its solid angle [1/sr]
        ("SUN_CHANCE", 1),
        ("SKY_CHANCE", 1),  # of the upper hemisphere; the rest is the lower one
        ("GROUND_RADIANCE", 3),
        ("ZENITH", 3),
        ("PEREZ_A", 3),  # of Y, x, y; so are the next four
        ("PEREZ_B", 3),
        ("PEREZ_C", 3),
        ("PEREZ_D", 3),
        ("PEREZ_E", 3),
    ],
    "image": [("WIDTH", 1), ("HEIGHT", 1), ("ROTATION", 1)],  # rotation in turns
}

_NUMPY_TYPES = {"float": np.float32, "uint": np.uint32, "float4": (np.float32, 4)}


def struct_dtype(name: str) -> np.dtype:
    """The numpy dtype of a struct of STRUCTS."""
    return np.dtype([(field, _NUMPY_TYPES[kind]) for field, kind in STRUCTS[name]])


@dataclass(frozen=True)
class Plane:
    """One field of the path state.

    width is a number of planes or "spectrum" (Features.channels planes); `when` says for which
    features the field exists at all.
    """

    name: str
    kind: str
    width: int | str
    when: Callable[[Features], bool] = lambda _: True


PATH_STATE = (
    Plane("ORIGIN", "float", 3),
    Plane("DIR", "float", 3),  # unit
    Plane("SKIP_SEGMENT", "uint", 1),  # segment that the ray leaves; NO_SEGMENT for camera rays
    Plane("SKIP_DISTANCE", "float", 1),  # nearer hits on that strand are inside the fibre
    Plane("HIT_T", "float", 1, lambda f: f.body),  # fibres need HIT_U alone
    Plane("HIT_SEGMENT", "uint", 1),  # first vertex of the segment, NO_SEGMENT or BODY_SEGMENT
    Plane("HIT_U", "float", 1),  # along the segment, 0..1
    Plane("THROUGHPUT", "float", "spectrum"),
    Plane("RADIANCE", "float", "spectrum"),
    Plane("LOBE", "uint", 1),
    Plane("OFFSET_H", "float", 1),
    Plane("JOINT", "float", 1),  # q(lobe, h)
    Plane("DIR_PDF", "float", 1, lambda f: f.light_sampling),  # q(p,h) p(w|p,h) / f(h); 0: camera
    Plane("SHADOW_DIR", "float", 3, lambda f: f.light_sampling),
    Plane("SHADOW_SKIP_DISTANCE", "float", 1, lambda f: f.light_sampling),
    Plane("SHADOW_RADIANCE", "float", "spectrum", lambda f: f.light_sampling),
)


def environment_offsets(kind: str) -> dict[str, int]:
    """Place of every parameter in the environment buffer, and SIZE, where the tables begin."""
    offsets, at = {}, 0
    for name, width in ENVIRONMENT_FIELDS[kind]:
        offsets[name] = at
        at += width
    return {**offsets, "SIZE": at}


def planes(features: Features) -> list[str]:
    """Names of the planes in memory order, e.g. ORIGIN_X, ORIGIN_Y, ORIGIN_Z, DIR_X, ..."""
    names = []
    for plane in PATH_STATE:
        if not plane.when(features):
            continue
        width = features.channels if plane.width == "spectrum" else int(plane.width)
        if width == 1:
            names.append(plane.name)
        else:
            names += [f"{plane.name}_{axis}" for axis in "XYZ"[:width]]
    return names


def whole_blocks(n_slots: int) -> int:
    """The least number of slots in whole blocks of the path state that is not below `n_slots`."""
    return -(-n_slots // STATE_BLOCK) * STATE_BLOCK


def device_text(features: Features) -> str:
    """The OpenCL text of "layout.clh": constants, structs, planes and their accessors."""
    lines = [f"#define FURCL_{name} {value}" for name, value in CONSTANTS.items()]
    for name, fields in STRUCTS.items():
        body = " ".join(f"{kind} {field};" for field, kind in fields)
        lines.append(f"typedef struct {{ {body} }} {name};")
    for name, offset in environment_offsets(features.environment).items():
        lines.append(f"#define ENV_{name} {offset}u")
    names = planes(features)
    for plane in PATH_STATE:
        if plane.width == "spectrum" and plane.when(features) and features.channels == 1:
            continue
        first = f"{plane.name}_X"
        if first in names:
            lines.append(f"#define PS_{plane.name} PS_{first}")
    lines.append("enum { " + ", ".join(f"PS_{name}" for name in names) + ", PS_COUNT };")
    return "\n".join(lines) + "\n" + _ACCESSORS


_ACCESSORS = """\
/* `state` holds all planes of FURCL_STATE_BLOCK slots, then those of the slots after them:
   neighbours are read together, and what a path needs is not far apart. */
#define PS_PLACE(name, slot) \\
    ((size_t)(FURCL_INDEX(slot, n_slots) / FURCL_STATE_BLOCK) * (FURCL_STATE_BLOCK * PS_COUNT) + \\
     FURCL_STATE_BLOCK * PS_##name + (slot) % FURCL_STATE_BLOCK)
#define PS_F(name, slot) state[PS_PLACE(name, slot)]
#define PS_U(name, slot) (((__global uint*)state)[PS_PLACE(name, slot)])
#define PS_LOAD3(name, slot) \\
    ((float3)(PS_F(name##_X, slot), PS_F(name##_Y, slot), PS_F(name##_Z, slot)))
#define PS_STORE3(name, slot, v) do { const float3 ps_v = (v); PS_F(name##_X, slot) = ps_v.x; \\
    PS_F(name##_Y, slot) = ps_v.y; PS_F(name##_Z, slot) = ps_v.z; } while (0)
"""


def check_structs_text() -> str:
    """OpenCL text of `struct_offsets`: sizes and field offsets as the device sees them."""
    writes = []
    for name, fields in STRUCTS.items():
        writes.append(f"out[n++] = sizeof({name});")
        writes += [
            f"{{ {name} s; out[n++] = (uint)((char*)&s.{field} - (char*)&s); }}"
            for field, _ in fields
        ]
    return (
        "__kernel void struct_offsets(__global uint* out)\n{\n    uint n = 0;\n    "
        + "\n    ".join(writes)
        + "\n}\n"
    )


def check_structs(found: np.ndarray) -> None:
    """Compare what `struct_offsets` wrote with the numpy dtypes.

    Parameters
    ----------
    found : (n_struct_words(),) uint32

    Raises
    ------
    LayoutError     if the device's layout of a struct is not the host's
    """
    expected = struct_words()
    if not np.array_equal(found, expected):
        raise LayoutError(
            f"the device lays structs out as {found.tolist()} (size, then field offsets, of "
            f"{', '.join(STRUCTS)}), the host as {expected.tolist()}; furcl allows no padding: "
            f"report this device"
        )


def struct_words() -> np.ndarray:
    """Size and field offsets [bytes] of every struct, in the order of `struct_offsets`."""
    words: list[int] = []
    for name in STRUCTS:
        dtype = struct_dtype(name)
        offsets = {field: place[1] for field, place in (dtype.fields or {}).items()}
        words += [dtype.itemsize, *(offsets[field] for field, _ in STRUCTS[name])]
    return np.array(words, np.uint32)
