"""The curve shapes of pbrt-v3 and pbrt-v4 scenes (pbrt-v4's src/pbrt/shapes.cpp)."""

from __future__ import annotations

import re
import warnings
from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from furcl.errors import GroomError
from furcl.groom.flatten import Spans, places
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.groom.formats.pbrt_tokens import Directive, directives
from furcl.values import shown

SPANS_AT_ONCE = 1 << 15
_COMMENT = re.compile(r"#[^\n]*")
_POINT_TYPES = ("point", "point3", "P")


@dataclass
class _Curves:
    """Curves of one basis and degree: control points, and of each curve how many and how wide."""

    points: array = field(default_factory=lambda: array("f"))
    counts: array = field(default_factory=lambda: array("q"))
    widths: array = field(default_factory=lambda: array("f"))  # at both ends
    transforms: array = field(default_factory=lambda: array("q"))


@dataclass
class _State:
    """What directives have made of the current transformation."""

    current: np.ndarray = field(default_factory=lambda: np.eye(4))
    saved: list[np.ndarray] = field(default_factory=list)
    named: dict[str, np.ndarray] = field(default_factory=dict)
    in_object: bool = False


def read_pbrt(path: Path, asked: Asked) -> Strands:
    """Read all curve shapes of a scene, in world space, as polylines.

    Curves that begin where the one before ends, as wide, are one strand: many exporters write a
    shape a segment.

    Raises
    ------
    GroomError      the file and line, and a remedy
    """
    state, groups = _State(), {}
    transforms, last = [np.eye(4)], state.current
    dropped = {"curves_of_objects": 0, "other_shapes": 0}
    for each in directives(path):
        if each.name == "Shape":
            if each.arguments[:1] != ['"curve"']:
                dropped["other_shapes"] += 1
            elif state.in_object:
                dropped["curves_of_objects"] += 1
            else:
                if state.current is not last:
                    transforms.append(state.current)
                    last = state.current
                _add_curve(each, groups, len(transforms) - 1)
        else:
            _transform(each, state)
    if not groups:
        raise GroomError(
            f'{path}: has no Shape "curve" outside of objects, among {dropped["other_shapes"]} '
            "other "
            f"shapes and {dropped['curves_of_objects']} curves of objects; is the groom in another "
            "file?"
        )
    parts = [
        _flat(group, basis, degree, transforms, path) for (basis, degree), group in groups.items()
    ]
    points, radii = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    counts = np.concatenate([np.diff(part[2]) for part in parts])
    points, radii, offsets = _joined(points, radii, np.concatenate([[0], np.cumsum(counts)]))
    return Strands(points, radii, offsets, str(path), dropped=dropped)


def _add_curve(shape: Directive, groups, transform: int) -> None:
    given = _parameters(shape)
    degree = int(_one(given, "degree", 3, shape))
    basis = _text(given, "basis", "bezier")
    if degree not in (2, 3) or basis not in ("bezier", "bspline"):
        raise GroomError(
            f"{shape.where}: a curve of degree {degree} and basis {shown(basis)}; pbrt has "
            "degrees 2 "
            'and 3, "bezier" and "bspline". Repair the file.'
        )
    points = _numbers(given.get("P", ("", ""))[1], shape)
    n = len(points) // 3
    fits = (n - 1) % degree == 0 and n > degree if basis == "bezier" else n > degree
    if len(points) % 3 or not fits:
        rule = f"1 more than a multiple of {degree}" if basis == "bezier" else f"more than {degree}"
        raise GroomError(
            f"{shape.where}: the curve has {len(points)} numbers of points P; a {basis} curve of "
            f"degree {degree} has {rule} points x y z. Repair the file."
        )
    width = _one(given, "width", 1.0, shape)
    group = groups.setdefault((basis, degree), _Curves())
    with np.errstate(over="ignore"):
        group.points.frombytes(points.astype(np.float32).tobytes())
        ends = [_one(given, name, width, shape) for name in ("width0", "width1")]
        group.widths.frombytes(np.array(ends, np.float64).astype(np.float32).tobytes())
    group.counts.append(n)
    group.transforms.append(transform)


def _parameters(shape: Directive) -> dict[str, tuple[str, str]]:
    """Name -> type and value of a shape's parameters."""
    words = shape.arguments[1:]
    found = {}
    for declared, value in zip(words[::2], words[1::2], strict=False):
        parts = declared.strip('"').split()
        if declared[0] != '"' or len(parts) != 2:
            raise GroomError(
                f'{shape.where}: {shown(declared)}: a parameter is declared as "TYPE NAME". Repair '
                "the file."
            )
        found[parts[1]] = (parts[0], value)
    if len(words) % 2:
        raise GroomError(f"{shape.where}: {shown(words[-1])} has no value. Repair the file.")
    return found


def _one(given, name: str, default: float, shape: Directive) -> float:
    if name not in given:
        return default
    values = _numbers(given[name][1], shape)
    if len(values) != 1 or not np.isfinite(values[0]):
        raise GroomError(
            f"{shape.where}: {name} = {shown(given[name][1])}; expected one number. Repair the "
            "file."
        )
    return float(values[0])


def _text(given, name: str, default: str) -> str:
    return given[name][1].strip('[]" \t\n') if name in given else default


def _numbers(value: str, where: Directive) -> np.ndarray:
    text = _COMMENT.sub("", value.strip("[]"))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
    except (ValueError, DeprecationWarning):
        raise GroomError(
            f"{where.where}: {shown(value)} are no numbers. Repair the file."
        ) from None


def _transform(each: Directive, state: _State) -> None:
    """Follow what changes the current transformation; all else is left out."""
    name = each.name
    if name in ("AttributeBegin", "TransformBegin", "ObjectBegin"):
        state.saved.append(state.current)
        state.in_object |= name == "ObjectBegin"
    elif name in ("AttributeEnd", "TransformEnd", "ObjectEnd"):
        if not state.saved:
            raise GroomError(f"{each.where}: {name} without its beginning. Repair the file.")
        state.current = state.saved.pop()
        state.in_object &= name != "ObjectEnd"
    elif name in ("Identity", "WorldBegin"):
        state.current = np.eye(4)
    elif name == "CoordinateSystem" and each.arguments:
        state.named[each.arguments[0]] = state.current
    elif name == "CoordSysTransform" and each.arguments:
        state.current = state.named.get(each.arguments[0], state.current)
    elif name in _MATRICES:
        n, matrix = _MATRICES[name]
        values = _numbers(" ".join(a.strip("[]") for a in each.arguments), each)
        if len(values) != n:
            raise GroomError(
                f"{each.where}: {name} has {len(values)} numbers instead of {n}. Repair the file."
            )
        with np.errstate(all="ignore"):  # what is not finite is refused with the points
            made = matrix(values)
            state.current = made if name == "Transform" else state.current @ made


def _translation(v):
    matrix = np.eye(4)
    matrix[:3, 3] = v
    return matrix


def _rotation(v):
    """By v[0] degrees around the axis v[1:4] (Rodrigues)."""
    angle, axis = np.radians(v[0]), v[1:] / np.linalg.norm(v[1:])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return matrix


#: Directive -> how many numbers it has, and their matrix. A camera's LookAt ends with WorldBegin.
_MATRICES = {
    "Translate": (3, _translation),
    "Scale": (3, lambda v: np.diag([*v, 1.0])),
    "Rotate": (4, _rotation),
    "Transform": (16, lambda v: v.reshape(4, 4).T),
    "ConcatTransform": (16, lambda v: v.reshape(4, 4).T),
}


def _flat(group: _Curves, basis: str, degree: int, transforms, path: Path):
    """Points, radii and offsets of the polylines of a group of curves."""
    points = np.frombuffer(group.points, np.float32).reshape(-1, 3)
    counts = np.frombuffer(group.counts, np.int64)
    widths = np.frombuffer(group.widths, np.float32).reshape(-1, 2)
    which = np.frombuffer(group.transforms, np.int64)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    found = []
    per_block = max(SPANS_AT_ONCE // int(counts.max()), 1)
    for first in range(0, len(counts), per_block):
        part = slice(first, first + per_block)
        begin, end = offsets[first], offsets[min(first + per_block, len(counts))]
        world, scales = _to_world(points[begin:end], counts[part], which[part], transforms)
        cubic, cubic_counts, kind = _cubic(world, counts[part], basis, degree)
        spans = Spans(np.concatenate([[0], np.cumsum(cubic_counts)]), kind, source=str(path))
        n_spans = np.diff(spans.offsets)
        at = np.arange(spans.varying_offsets[-1]) - np.repeat(
            spans.varying_offsets[:-1], n_spans + 1
        )
        share = at / np.repeat(n_spans, n_spans + 1)
        ends = np.repeat(widths[part] * (0.5 * scales)[:, None], n_spans + 1, axis=0)
        radii = spans.bezier_of_ends(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share)
        bezier = spans.bezier(cubic)
        where = places(spans, [bezier], radii)
        found.append((where.of(bezier), where.of(radii), np.diff(where.offsets)))
    counts = np.concatenate([part[2] for part in found])
    return (
        np.concatenate([part[0] for part in found]),
        np.concatenate([part[1] for part in found]),
        np.concatenate([[0], np.cumsum(counts)]),
    )


def _to_world(points, counts, which, transforms):
    """Points (n, 3) float64 of curves, and by how much each one's width is scaled."""
    world = points.astype(np.float64)
    scales = np.ones(len(counts))
    of_points = np.repeat(which, counts)
    with np.errstate(all="ignore"):  # what is not finite is refused with the points
        for index in np.unique(which):
            matrix = transforms[index]
            if index:
                chosen = of_points == index
                world[chosen] = world[chosen] @ matrix[:3, :3].T + matrix[:3, 3]
                scales[which == index] = np.cbrt(abs(np.linalg.det(matrix[:3, :3])))
    return world, scales


def _cubic(points, counts, basis, degree):
    """Control points of cubic curves, how many each has, and their basis."""
    if degree == 3:
        return points, counts, basis
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    if basis == "bspline":
        n_spans, step = counts - 2, 1
    else:
        n_spans, step = (counts - 1) // 2, 2
    curve = np.repeat(np.arange(len(counts)), n_spans)
    local = np.arange(len(curve)) - np.repeat(np.cumsum(n_spans) - n_spans, n_spans)
    a, b, c = (points[starts[curve] + step * local + i] for i in range(3))
    if basis == "bspline":
        a, c = (a + b) / 2, (b + c) / 2
    # A quadratic as a cubic: inner points two thirds of the way to its middle one.
    made = np.zeros((len(curve) * 3 + len(counts), 3))
    first = 3 * np.arange(len(curve)) + curve
    for i, values in enumerate((a, (a + 2 * b) / 3, (2 * b + c) / 3, c)):
        made[first + i] = values
    return made, 3 * n_spans + 1, "bezier"


def _joined(points, radii, offsets):
    """Strands of which each begins where the one before ends, as one."""
    first, last = offsets[1:-1], offsets[1:-1] - 1
    same = (points[first] == points[last]).all(axis=1) & (radii[first] == radii[last])
    if not same.any():
        return points, radii, offsets
    kept = np.ones(len(points), bool)
    kept[first[same]] = False
    before = np.concatenate([[0], np.cumsum(kept)])
    ends = np.concatenate([[True], ~same, [True]])
    return points[kept], radii[kept], before[offsets[ends]]


FORMAT = Format(
    name="pbrt curves",
    suffixes=(".pbrt", ".pbrt.gz"),
    read=read_pbrt,
    write=None,
    about='The `Shape "curve"` of scenes of pbrt-v3 and v4, packed or not, with the files that '
    "they `Include`.",
    points="flat, cylinder and ribbon curves alike, bezier or bspline, of degree 2 or 3, in world "
    "space; curves that begin where the one before ends are one strand",
    radius="half of `width`, `width0` to `width1`, which pbrt makes 1 where they are missing; "
    "scaled with the transformation",
    curved=True,
    left_out="other shapes and curves of objects are counted. Materials, normals and cameras are "
    "not used.",
)
