"""What crosses to the device, declared once: constants, structs, planes of the path state.

`declarations` is the text in front of a kernel: of all that is declared here, and by the parts of
its `Features`, what the kernel names. The numpy dtypes of the same structs are what the host fills.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from furcl.errors import KernelBuildError, LayoutError

if TYPE_CHECKING:
    from furcl.device.features import Features

Fields = tuple[tuple[str, str], ...]
"""Names and OpenCL types of a struct's fields."""

NO_SEGMENT = 0xFFFFFFFF
SURFACE_HIT = 0xFFFFFFFE
LAMP_HIT = 0xFFFFFFFD
# Of triangles: this and the number of the first of their vertices. Segments are below.
TRIANGLE = 0x80000000
NO_LAMP = 0xFFFFFFFF
NO_BLOCK = 0xFFFFFFFF
NOTHING_MET = 0xFFFFFFFF

Filter = Literal["box", "tent", "gaussian"]
"""Pixel filters."""
FILTERS: tuple[Filter, ...] = get_args(Filter)

Sequence = Literal["independent", "sobol"]
"""Sequences of random numbers."""
SEQUENCES: tuple[Sequence, ...] = get_args(Sequence)

Layer = Literal[
    "alpha",
    "depth",
    "position",
    "normal",
    "tangent",
    "strand",
    "strand_u",
    "groom",
    "albedo",
    "direct",
    "indirect",
    "lobes",
    "samples",
    "cryptomatte_groom",
    "cryptomatte_strand",
]
"""Layers of the film beside the picture."""
LAYERS: tuple[Layer, ...] = get_args(Layer)

# Entries of the buffer of queue lengths. Those of the hit queues follow each other: of each fibre
# material, then of the surface (Features.hit_queues). The counters of chosen lobes are in buffers
# of their own.
COUNT_NEXT, COUNT_MISSES, COUNT_SHADOWS, COUNT_HITS = range(4)

# The record of index checks, in words behind a buffer's contents (furcl/device/index_checks.py).
CHECK_FAILURES, CHECK_LINE, CHECK_INDEX, CHECK_SIZE = range(4)
CHECK_N_VERTICES, CHECK_N_CORNERS, CHECK_N_BLOCKS, CHECK_N_FILM, CHECK_FILE = range(4, 9)
CHECK_WORDS = 24

# Slots of the path state whose planes lie together: a cache line of each.
STATE_BLOCK = 16

# The tree over fibre segments: lanes and words of its blocks (kernels/include/bvh/block.clh).
BVH_WIDTH = 8
# Blocks of which lanes wait on a ray's stack. Real grooms need 7 or 8, and those whose sizes and
# distances fill six orders of magnitude up to 20 (tests/test_bvh.py; Embree does not build the same
# tree on all processors).
BVH_STACK_SIZE = 20
BLOCK_ORIGIN, BLOCK_UNIT, BLOCK_STEP, BLOCK_ROWS = 0, 3, 4, 8
BLOCK_LANES, BLOCK_REFERENCES, BLOCK_WORDS = 22, 24, 32
BLOCK_BOXES = 0x10000
BLOCK_TRIANGLES = 0x20000
ROW_RADIUS = 6
# Room, in steps of a block's grid, between a box and its faces on the grid.
GRID_MARGIN = 0.015625

# Attenuation tables: rows over |theta|, bins over |h|; 100 bins of |h| are the paper's 200 bins of
# h, A being even in h.
TABLE_ROWS = 32
TABLE_BINS = 100

# Where absorption differs from hit to hit: by what, and for how many absorptions there are tables.
Absorption = Literal["constant", "given", "strand", "point"]
"""What the absorption of a fibre is: the same at all hits, that of its parameters at a hit (probe),
or a value of each strand or point."""
ABSORPTIONS: tuple[Absorption, ...] = get_args(Absorption)
ABSORPTION_NODES = 8

# What is known of the offset h at a hit.
Mode = Literal["far", "near", "multiscale"]
"""The offset h of a hit: any on the fibre, that of the ray, or for camera rays one in the footprint
of their pixel."""
MODES: tuple[Mode, ...] = get_args(Mode)
ABSORPTION_HEADER = 4

# Marginal densities, with the same rows: nodes of |phi| from 0 to pi; offsets of their quadrature,
# shared out among so many work-items.
MARGINAL_PHIS = 65
MARGINAL_OFFSETS = 128
MARGINAL_PARTS = 8

# The numbers that the samples of a pixel share (furcl/rendering/held.py), in the word Wave.held: a
# bit for the camera; bits of kinds for the bounces before one, for it and for those after it; which
# it is.
HELD_CAMERA = 1
HELD_KINDS = {"h": 1, "lobe": 2, "direction": 4, "light": 8, "roulette": 16}
HELD_BEFORE, HELD_AT, HELD_AFTER, HELD_BOUNCE = 1, 6, 11, 16

# Of plans how many samples each pixel takes: the numbers of samples after which a pixel's variance
# is kept are PILOT_SAMPLES and that times powers of PILOT_GROWTH (furcl/rendering/allocation.py).
PILOT_SAMPLES = 4
PILOT_GROWTH = 4
# Added to the squared radiance that relative errors are over (furcl.image.compare.relmse).
RELATIVE_EPSILON = 0.01


def block_bytes(row: int) -> slice:
    """The bytes of a row in a block of the tree, one a lane: row 2 axis + end, or ROW_RADIUS."""
    start = 4 * BLOCK_ROWS + BVH_WIDTH * row
    return slice(start, start + BVH_WIDTH)


def hex_float(value: float) -> str:
    """A float32 literal of OpenCL C, exact."""
    return f"{float(np.float32(value)).hex()}f"


def _constants() -> dict[str, str]:
    """Names without FURCL_ and values of all constants of this file."""
    words = {
        "NO_SEGMENT": NO_SEGMENT,
        "SURFACE_HIT": SURFACE_HIT,
        "TRIANGLE": TRIANGLE,
        "LAMP_HIT": LAMP_HIT,
        "NO_LAMP": NO_LAMP,
        "NO_BLOCK": NO_BLOCK,
        "NOTHING_MET": NOTHING_MET,
        "COUNT_NEXT": COUNT_NEXT,
        "COUNT_MISSES": COUNT_MISSES,
        "COUNT_SHADOWS": COUNT_SHADOWS,
        "COUNT_HITS": COUNT_HITS,
        "CHECK_FAILURES": CHECK_FAILURES,
        "CHECK_LINE": CHECK_LINE,
        "CHECK_INDEX": CHECK_INDEX,
        "CHECK_SIZE": CHECK_SIZE,
        "CHECK_N_VERTICES": CHECK_N_VERTICES,
        "CHECK_N_CORNERS": CHECK_N_CORNERS,
        "CHECK_N_BLOCKS": CHECK_N_BLOCKS,
        "CHECK_N_FILM": CHECK_N_FILM,
        "CHECK_FILE": CHECK_FILE,
        "CHECK_FILE_BYTES": 4 * (CHECK_WORDS - CHECK_FILE),
        "STATE_BLOCK": STATE_BLOCK,
        "BLOCK_BOXES": BLOCK_BOXES,
        "BLOCK_TRIANGLES": BLOCK_TRIANGLES,
        "PILOT_SAMPLES": PILOT_SAMPLES,
        "PILOT_GROWTH": PILOT_GROWTH,
        "HELD_CAMERA": HELD_CAMERA,
        "HELD_BEFORE": HELD_BEFORE,
        "HELD_AT": HELD_AT,
        "HELD_AFTER": HELD_AFTER,
        "HELD_BOUNCE": HELD_BOUNCE,
        **{f"HELD_{name.upper()}": bit for name, bit in HELD_KINDS.items()},
    }
    numbers = {
        "BVH_WIDTH": BVH_WIDTH,
        "BVH_STACK_SIZE": BVH_STACK_SIZE,
        "BLOCK_ORIGIN": BLOCK_ORIGIN,
        "BLOCK_UNIT": BLOCK_UNIT,
        "BLOCK_STEP": BLOCK_STEP,
        "BLOCK_ROWS": BLOCK_ROWS,
        "BLOCK_LANES": BLOCK_LANES,
        "BLOCK_REFERENCES": BLOCK_REFERENCES,
        "BLOCK_WORDS": BLOCK_WORDS,
        "ROW_RADIUS": ROW_RADIUS,
        "TABLE_ROWS": TABLE_ROWS,
        "TABLE_BINS": TABLE_BINS,
        "ABSORPTION_NODES": ABSORPTION_NODES,
        "ABSORPTION_HEADER": ABSORPTION_HEADER,
        "MARGINAL_PHIS": MARGINAL_PHIS,
        "MARGINAL_OFFSETS": MARGINAL_OFFSETS,
        "MARGINAL_PARTS": MARGINAL_PARTS,
    }
    return {
        **{name: f"{value:#x}u" for name, value in words.items()},
        **{name: str(value) for name, value in numbers.items()},
        **{f"ABSORPTION_{name.upper()}": str(i) for i, name in enumerate(ABSORPTIONS)},
        **{f"FILTER_{name.upper()}": str(i) for i, name in enumerate(FILTERS)},
        **{f"MODE_{name.upper()}": str(i) for i, name in enumerate(MODES)},
        "GRID_MARGIN": hex_float(GRID_MARGIN),
        "RELATIVE_EPSILON": hex_float(RELATIVE_EPSILON),
    }


STRUCTS: dict[str, Fields] = {
    "Example": (  # of the self-test: every kind of field
        ("vector", "float4"),
        ("real", "float"),
        ("whole", "uint"),
        ("pair_x", "float"),
        ("pair_y", "float"),
        ("last", "float4"),
    ),
    "Camera": (
        ("origin", "float4"),
        ("right", "float4"),  # scaled so that x in [-1, 1] spans the film
        ("up", "float4"),  # scaled likewise
        ("forward", "float4"),  # unit
        ("aperture_radius", "float"),
        ("focus_distance", "float"),
        ("filter_radius_px", "float"),
        ("unused", "float"),
    ),
    "Wave": (
        ("width", "uint"),
        ("height", "uint"),
        ("first_pixel", "uint"),  # the wave's first path: its pixel in tile order ...
        ("first_sample", "uint"),  # ... and its sample
        ("n_paths", "uint"),
        ("n_slots", "uint"),  # of the path state, a multiple of STATE_BLOCK
        ("seed", "uint"),
        ("roulette_depth", "uint"),  # from here on paths whose throughput is below ...
        ("roulette_threshold", "float"),  # ... this may end
        ("shadow_threshold", "float"),  # light samples that bring less may be left out
        ("recording", "uint"),  # whether what is learned from is noted
        ("picture_width", "uint"),  # of the whole picture, of which ...
        ("picture_height", "uint"),
        ("crop_left", "uint"),  # ... the film holds a window that begins here
        ("crop_top", "uint"),
        ("held", "uint"),  # numbers that the samples of a pixel share (with FURCL_HELD)
    ),
}

_NUMPY_TYPES = {"float": np.float32, "uint": np.uint32, "float4": (np.float32, 4)}
_BYTES = {"float": 4, "uint": 4, "float4": 16}


def struct_dtype(fields: str | Fields) -> np.dtype:
    """The numpy dtype of a struct: a name of STRUCTS, or the fields of a part's own.

    Fields are 4-byte scalars and float4 at offsets that are multiples of their size, and the whole
    is a multiple of 16 bytes: so one dtype is valid on every device that passes the self-test.

    Raises
    ------
    LayoutError     another type, a float4 that is out of line, or a size that is no multiple of 16
    """
    fields = STRUCTS[fields] if isinstance(fields, str) else fields
    at = 0
    for name, kind in fields:
        if kind not in _BYTES or at % _BYTES[kind]:
            raise LayoutError(
                f"struct field {name}: {kind} at byte {at}; allowed are float and uint, and float4 "
                f"at multiples of 16: put the float4s first"
            )
        at += _BYTES[kind]
    if at % 16:
        raise LayoutError(
            f"struct of {', '.join(name for name, _ in fields)}: {at} bytes are no multiple of 16; "
            f"fill it up with unused fields"
        )
    return np.dtype([(name, _NUMPY_TYPES[kind]) for name, kind in fields])


@dataclass(frozen=True)
class Plane:
    """One field of the path state.

    width is a number of planes, "spectrum" (Features.channels planes) or "lobes" (a spectrum for
    each of Features.lobe_layers, NAME_0 and so on); `when` says for which features the field
    exists at all.
    """

    name: str
    width: int | str
    when: Callable[[Features], bool] = lambda _: True


PATH_STATE = (
    Plane("ORIGIN", 3),
    Plane("DIR", 3),  # unit
    Plane("FROM_SEGMENT", 1),  # uint: segment or triangle that the ray leaves; camera: NO_SEGMENT
    Plane("TIME", 1, lambda f: f.motion > 0),  # in the groom's time steps, 0 .. motion
    Plane("PIXEL", 1, lambda f: f.planned),  # uint: index, row by row
    Plane("SAMPLE", 1, lambda f: f.planned),  # uint: of the pixel
    Plane("HIT_T", 1, lambda f: f.has_surfaces or f.area_lamps),  # fibres need HIT_U alone
    Plane("HIT_SEGMENT", 1),  # uint: first vertex of the segment, TRIANGLE + that, or *_HIT
    Plane("HIT_U", 1),  # along the segment, 0..1; of LAMP_HIT which lamp
    Plane("THROUGHPUT", "spectrum"),
    Plane("RADIANCE", "spectrum"),
    Plane("LOBE", 1),  # uint
    Plane("OFFSET_H", 1),
    Plane("JOINT", 1),  # q(lobe, h), relative to uniform h
    Plane("DIR_PDF", 1, lambda f: f.light_sampling),  # about that of DIR, of any h; 0: camera
    Plane("SHADOW_DIR", 3, lambda f: f.light_sampling),
    Plane("SHADOW_DISTANCE", 1, lambda f: f.light_sampling and f.shadow_distances),
    Plane("SHADOW_LAMP", 1, lambda f: f.light_sampling and f.area_lamps),  # uint, or NO_LAMP
    Plane("SHADOW_RADIANCE", "spectrum", lambda f: f.light_sampling),
    Plane("FIRST", 1, lambda f: f.light_layers),  # uint: layer of the first scattering, NOTHING_MET
    Plane("ALBEDO", "spectrum", lambda f: f.has_layer("albedo")),  # weight of the first bounce
    Plane("DIRECT", "spectrum", lambda f: f.has_layer("direct", "indirect")),  # below 0: RADIANCE
    Plane("FIRST_LIGHT", "lobes", lambda f: f.has_layer("lobes") and f.light_sampling),
    Plane("FIRST_SEEN", 1, lambda f: f.has_layer("lobes") and f.light_sampling),  # uint
)


def planes(features: Features) -> list[str]:
    """Names of the planes in memory order, e.g. ORIGIN_X, ORIGIN_Y, ORIGIN_Z, DIR_X, ..."""
    names = []
    for plane in PATH_STATE:
        if not plane.when(features):
            continue
        width = features.channels if isinstance(plane.width, str) else plane.width
        each = [plane.name]
        if plane.width == "lobes":
            each = [f"{plane.name}_{i}" for i in range(len(features.lobe_layers))]
        for name in each:
            names += [name] if width == 1 else [f"{name}_{axis}" for axis in "XYZ"[:width]]
    return names


def whole_blocks(n_slots: int) -> int:
    """The least number of slots in whole blocks of the path state that is not below `n_slots`."""
    return -(-n_slots // STATE_BLOCK) * STATE_BLOCK


def _plane_text(features: Features) -> str:
    """PS_*: the planes numbered in memory order; of vectors PS_NAME is the first."""
    names = planes(features)
    first = [name.removesuffix("_X") for name in names if name.endswith("_X")]
    return "".join(
        [
            f"enum {{ {', '.join(f'PS_{name}' for name in names)}, PS_COUNT }};\n",
            *(f"#define PS_{name} PS_{name}_X\n" for name in first),
        ]
    )


def struct_text(name: str, fields: Iterable[tuple[str, str]]) -> str:
    """The OpenCL declaration of a struct."""
    return (
        f"typedef struct {{ {' '.join(f'{kind} {field};' for field, kind in fields)} }} {name};\n"
    )


_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*")
_DEFINED = re.compile(r"^\s*#\s*define\s+(\w+)", re.MULTILINE)


def _without_comments(text: str) -> str:
    return _COMMENT.sub(lambda match: "\n" * match[0].count("\n"), text)


def declarations(text: str, features: Features, extra: Mapping[str, int] | None = None) -> str:
    """The declarations that belong in front of a kernel's text: those that it names.

    So a text changes with what it uses alone, and with it every key that is made of it.

    Parameters
    ----------
    text : str                  of a kernel with all includes expanded
    features : Features         `defines` and `structs` of it and of its parts
    extra : dict or None        further defines, such as the launch sizes

    Raises
    ------
    KernelBuildError    for a name FURCL_* that nobody declares, with the place where it stands
    """
    code = _without_comments(text)
    named = set(_NAME.findall(code))
    values = {f"FURCL_{name}": value for name, value in _constants().items()}
    values |= {name: str(value) for name, value in features.defines().items()}
    values |= {name: str(value) for name, value in (extra or {}).items()}
    structs = {**STRUCTS, **features.structs()}
    unknown = {name for name in named if name.startswith("FURCL_")} - values.keys()
    unknown -= set(_DEFINED.findall(code))
    if unknown:
        name = min(unknown)
        raise KernelBuildError(
            f"{_place(code, name)}: {name} is declared neither by furcl.device.layout nor by the "
            f"features of this build ({features.describe()}); declare it, or correct the spelling"
        )
    lines = [f"#define {name} {values[name]}\n" for name in sorted(named & values.keys())]
    lines += [struct_text(name, structs[name]) for name in structs if name in named]
    if any(name.startswith("PS_") for name in named):
        lines.append(_plane_text(features))
    return "".join(lines)


def _place(code: str, name: str) -> str:
    """File and line where a name stands first."""
    for number, text in enumerate(code.splitlines(), 1):
        if re.search(rf"\b{name}\b", text) and not _LINE.match(text):
            return place_in_file(code, number)
    return "?"


_LINE = re.compile(r'#line (\d+) "(.*)"')


def place_in_file(text: str, number: int) -> str:
    """What line `number` of a text is by its #line directives: "file:line".

    "declarations:line" for what stands before all of them.
    """
    file, line = "declarations", 0
    for above in text.splitlines()[:number]:
        directive = _LINE.match(above)
        if directive:
            file, line = directive[2], int(directive[1]) - 1
        else:
            line += 1
    return f"{file}:{line}"
