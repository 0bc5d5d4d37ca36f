"""Readers take at most four times the memory of what they decode; more is refused before it is
allocated.

`python -m faults.memory READER FILE` prints what reading a file took, and how it ended.
"""

from __future__ import annotations

import json
import re
import resource
import struct
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from faults.case import Case
from faults.harness import environment, furcl, refused, run, told
from furcl.errors import FurclError, GroomError

#: Allowed beside: modules that a reader loads, stacks of threads, freed blocks that are kept.
BESIDE_BYTES = 48 << 20
#: What a process that decodes a picture takes before it begins.
PROCESS_BYTES = 64 << 20


def _read_groom(path: Path) -> object:
    from furcl.groom.formats import load_curves

    return load_curves(path)


def _read_image(path: Path) -> object:
    from furcl.image.image import Image

    return Image.load(path)


def _read_light(path: Path) -> object:
    from furcl.light.latlong import LatLong

    return LatLong.load(path)


def _read_texture(path: Path) -> object:
    from furcl.surface.mesh.texture import read_texture

    return read_texture(path)


def _read_mesh(path: Path) -> object:
    from furcl.scene.mesh import MeshTable

    return MeshTable(file=str(path)).build("mesh.a")


def _grow(path: Path) -> object:
    from furcl.groom.grow import GENERATORS

    keys = json.loads(path.read_text())
    return GENERATORS[keys.pop("generator")](**keys)


READERS: dict[str, Callable[[Path], object]] = {
    "groom": _read_groom,
    "image": _read_image,
    "light": _read_light,
    "texture": _read_texture,
    "mesh": _read_mesh,
    "generator": _grow,
}


def _status(name: str) -> int:
    text = Path("/proc/self/status").read_text()
    found = re.search(rf"{name}:\s*(\d+) kB", text)
    assert found
    return 1024 * int(found[1])


def main() -> None:
    """Read a file once, of which the peak is measured."""
    import OpenEXR  # noqa: F401

    import furcl.groom.formats
    import furcl.groom.grow
    import furcl.image.image
    import furcl.light.latlong
    import furcl.scene.mesh  # noqa: F401

    if sys.argv[1] == "mesh":  # what it loads first
        import plyfile  # noqa: F401

    reader, path = READERS[sys.argv[1]], Path(sys.argv[2])
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins here
    before, outcome = _status("VmRSS"), "read"
    try:
        kept = reader(path)  # noqa: F841
    except FurclError as error:
        outcome = str(error)
    apart = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    print(json.dumps([_status("VmHWM") - before, apart, outcome]))


def peak(reader: str, path: Path) -> tuple[int, str]:
    """Bytes that reading a file took at most, here or in a process for it, and how it ended."""
    command = [sys.executable, "-P", "-m", "faults.memory", reader, str(path)]
    ended = run(command, environment())
    assert ended.code == 0, f"code {ended.code}: {ended.err[-300:]}"
    own, apart, outcome = json.loads(ended.out)
    return max(own, apart - PROCESS_BYTES), outcome


def _hair(coloured: bool, path: Path, n: int) -> int:
    n_strands = n // 50
    flags = 2 | (1 | 4 | 8 | 16 if coloured else 0)
    head = b"HAIR" + struct.pack("<4I5f", n_strands, 50 * n_strands, flags, 49, 0.1, 0, 0, 0, 0)
    rng = np.random.default_rng(1)
    with path.open("wb") as file:
        file.write(head.ljust(128, b"\0"))
        if coloured:
            np.full(n_strands, 49, "<u2").tofile(file)
        rng.random((50 * n_strands, 3), np.float32).tofile(file)
        if coloured:
            (rng.random(50 * n_strands, np.float32) + np.float32(0.1)).tofile(file)
            np.zeros(50 * n_strands, "<f4").tofile(file)
            rng.random((50 * n_strands, 3), np.float32).tofile(file)
    return 50 * n_strands * (28 if coloured else 16) + 8 * n_strands


def _npz(form: str, path: Path, n: int) -> int:
    n_strands = n // 50
    n = 50 * n_strands
    rng = np.random.default_rng(1)
    points: Any = rng.random((n_strands, 50, 3), np.float32)
    arrays: dict[str, Any] = {"points": points, "radius": 0.1}
    if form == "float64":
        arrays = {"points": rng.random((n, 3)), "radii": rng.random(n) + 0.1}
        arrays["counts"] = np.full(n_strands, 50)
    if form == "coloured":
        arrays["colours"] = rng.random((n_strands, 50, 3), np.float32)
    if form == "repeated points":  # every second one is dropped
        arrays["points"] = np.repeat(points[:, ::2], 2, axis=1)
    save = np.savez_compressed if form == "packed" else np.savez
    save(path, **arrays)
    members = sum(np.asarray(array).nbytes for array in arrays.values())
    return max(members, n * (28 if form == "coloured" else 16) + 8 * n_strands)


def _exr(compression: str, form: str, path: Path, n: int) -> int:
    import OpenEXR

    height = max(int((n / 2) ** 0.5) // 32, 1) * 32
    shape = (height, 2 * height)
    rng = np.random.default_rng(1)
    half = form == "half" or compression.startswith("B44")
    plane = rng.random(shape, np.float32).astype(np.float16 if half else np.float32)
    names = ["R", "G", "B"]
    if form == "variance":
        names += [f"variance.{name}" for name in "RGB"]
    header: dict[str, Any] = {
        "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
        "type": OpenEXR.scanlineimage,
    }
    if form == "primaries":
        header["chromaticities"] = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    if form == "window":
        header["displayWindow"] = (
            np.array([-9, -9], np.int32),
            np.array([shape[1] - 9, shape[0] - 9], np.int32),
        )
    if form == "tiled":
        header |= {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    with OpenEXR.File(header, dict.fromkeys(names, plane)) as file:
        file.write(str(path))
    return 4 * len(names) * shape[0] * shape[1]


def _hdr(form: str, path: Path, n: int) -> int:
    height = max(int((n / 2) ** 0.5) // 32, 4) * 32
    width = 2 * height
    head = b"#?RADIANCE\n"
    if form == "primaries":
        head += b"PRIMARIES= 0.7347 0.2653 0.1596 0.8404 0.0366 0.0001 0.3457 0.3585\n"
    head += b"FORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width)
    quads = np.random.default_rng(1).integers(64, 192, (height, width, 4), np.uint8)
    quads[..., 3] = 128
    with path.open("wb") as file:
        file.write(head)
        if form == "old runs":  # a pixel, and runs of 255 and 255 * 256 of it
            runs = bytes([1, 1, 1, width - 1 & 255, 1, 1, 1, width - 1 >> 8])
            file.write((bytes([9, 9, 9, 128]) + runs) * height)
        elif form == "new runs":
            start = bytes([2, 2, width >> 8, width & 255])
            for row in quads:
                planes = (row[:, k].reshape(-1, 64) for k in range(4))
                file.write(start + b"".join(b"\x40" + part.tobytes() for p in planes for part in p))
        else:
            file.write(quads.tobytes())
    return 12 * height * width


def _picture(kind: str, path: Path, n: int) -> int:
    from PIL import Image as Pillow

    height = max(int((n / 2) ** 0.5) // 32, 1) * 32
    rng = np.random.default_rng(1)
    shape = (height, 2 * height)
    if kind in ("grey", "16 bits"):
        pixels = rng.integers(0, 256 if kind == "grey" else 65536, shape)
        picture = Pillow.fromarray(pixels.astype(np.uint8 if kind == "grey" else np.uint16))
    else:
        channels = 4 if kind == "alpha" else 3
        pixels = rng.integers(0, 256, (*shape, channels), np.uint8)
        picture = Pillow.fromarray(pixels)
        if kind == "palette":
            picture = picture.convert("P")
    picture.save(path)
    return 12 * shape[0] * shape[1]


def _grid(n: int) -> tuple[Any, Any]:
    """A height field of about n triangles: vertices and faces."""
    side = max(int((n / 2) ** 0.5), 2)
    y, x = np.divmod(np.arange((side + 1) ** 2), side + 1)
    z = np.random.default_rng(1).random(len(x))
    corner = np.arange(side * (side + 1)).reshape(side, side + 1)[:, :-1].reshape(-1, 1)
    below = corner + np.array([0, 1, side + 1])
    above = corner + np.array([1, side + 2, side + 1])
    return np.stack([x, y, z], axis=1), np.concatenate([below, above])


def _mesh(form: str, path: Path, n: int) -> int:
    """Decoded are corners of triangles and their normals; places are left, without a texture."""
    vertices, faces = _grid(n // 4)
    if "apart" in form:  # every corner has a vertex of its own
        vertices, faces = vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3)
    smooth = "smooth" in form
    places = "places" in form
    with path.open("wb") as file:
        if path.suffix == ".obj":
            np.savetxt(file, vertices, "v %.6f %.6f %.6f")
            if smooth:
                np.savetxt(file, vertices, "vn %.6f %.6f %.6f")
            if places:
                np.savetxt(file, vertices[:, :2], "vt %.6f %.6f")
            corner = "%d" + ("/%d" if places else "/" * smooth) + "/%d" * smooth
            rows = np.repeat(faces + 1, corner.count("%"), axis=1)
            np.savetxt(file, rows, f"f {corner} {corner} {corner}")
            return 72 * len(faces)
        names = "x y z" + " nx ny nz" * smooth + " s t" * places
        kind = "ascii" if "text" in form else "binary_little_endian"
        head = f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n"
        head += "".join(f"property float {name}\n" for name in names.split())
        head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
        file.write(f"{head}end_header\n".encode())
        rows = np.tile(vertices, 3)[:, : len(names.split())]
        if "text" in form:
            np.savetxt(file, rows, "%.6f")
            np.savetxt(file, faces, "3 %d %d %d")
        else:
            file.write(rows.astype("<f4").tobytes())
            records = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
            records["n"], records["v"] = 3, faces
            file.write(records.tobytes())
    return 72 * len(faces)


_FILES: dict[str, tuple[str, str, Callable[[Path, int], int]]] = {
    ".hair": ("groom", ".hair", partial(_hair, False)),
    ".hair of all arrays": ("groom", ".hair", partial(_hair, True)),
    ".npz": ("groom", ".npz", partial(_npz, "plain")),
    **{
        f".npz, {form}": ("groom", ".npz", partial(_npz, form))
        for form in ("packed", "float64", "coloured", "repeated points")
    },
    **{
        f"EXR {kind}, {form}": ("image", ".exr", partial(_exr, kind, form))
        for kind, form in (
            ("ZIP", "plain"), ("ZIP", "variance"), ("ZIP", "half"), ("PIZ", "plain"),
            ("PIZ", "half"), ("DWAA", "plain"), ("DWAB", "half"), ("PXR24", "plain"),
            ("RLE", "plain"), ("B44", "plain"), ("NO", "plain"), ("ZIP", "primaries"),
            ("ZIP", "window"), ("ZIP", "tiled"),
        )
    },
    "light, EXR ZIP": ("light", ".exr", partial(_exr, "ZIP", "plain")),
    "light, EXR PIZ half": ("light", ".exr", partial(_exr, "PIZ", "half")),
    "light, EXR of a part": ("light", ".exr", partial(_exr, "ZIP", "window")),
    **{
        f"light, HDR of {form}": ("light", ".hdr", partial(_hdr, form))
        for form in ("plain pixels", "old runs", "new runs", "primaries")
    },
    **{
        f"texture, {suffix[1:]} of {form}": ("texture", suffix, partial(_picture, form))
        for suffix, form in (
            (".png", "colours"), (".png", "grey"), (".png", "16 bits"), (".png", "alpha"),
            (".png", "palette"), (".jpg", "colours"),
        )
    },
    "texture, EXR": ("texture", ".exr", partial(_exr, "ZIP", "plain")),
    **{
        f"mesh{suffix}, {form}": ("mesh", suffix, partial(_mesh, form))
        for suffix, form in (
            (".obj", "plain"), (".obj", "smooth"), (".obj", "places"), (".obj", "smooth places"),
            (".obj", "smooth places apart"), (".ply", "plain"), (".ply", "smooth"),
            (".ply", "smooth places"), (".ply", "smooth places apart"), (".ply", "text"),
            (".ply", "text smooth places"), (".ply", "text smooth places apart"),
        )
    },
}  # fmt: skip


def _measured(name: str, folder: Path, quick: bool) -> str:
    reader, suffix, make = _FILES[name]
    path = folder / f"a{suffix}"
    decoded = make(path, 1 << (20 if quick else 24))
    taken, outcome = peak(reader, path)
    assert outcome == "read", outcome
    limit = 4 * decoded + BESIDE_BYTES
    assert taken <= limit, f"{taken / decoded:.2f} times {decoded / 1e6:.0f} MB"
    return f"{decoded / 1e6:.0f} MB decoded: {taken / decoded:.2f} times as much"


def _claims(reader: str, data: bytes, path: Path) -> str:
    """What a small file that is refused took."""
    path.write_bytes(data)
    taken, outcome = peak(reader, path)
    assert outcome != "read", "accepted"
    assert taken <= BESIDE_BYTES, f"{taken / 1e6:.0f} MB: {outcome}"
    return f"{len(data)} bytes, {taken / 1e6:.0f} MB: {outcome}"


def _with_window(folder: Path, compression: str, width: int, height: int) -> bytes:
    """A small EXR file whose header claims another size."""
    _exr(compression, "plain", folder / "seed.exr", 2048)
    data = (folder / "seed.exr").read_bytes()
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(name) + len(name) + 4
        data = data[:at] + struct.pack("<4i", 0, 0, width - 1, height - 1) + data[at + 16 :]
    return data


def _exr_claim(compression: str, width: int, height: int, folder: Path, quick: bool) -> str:
    data = _with_window(folder, compression, width, height)
    return _claims("image", data, folder / "a.exr")


def _png_claim(folder: Path, quick: bool) -> str:
    import zlib

    _picture("colours", folder / "seed.png", 2048)
    data = bytearray((folder / "seed.png").read_bytes())
    data[16:24] = struct.pack(">2I", 16384, 16384)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return _claims("texture", bytes(data), folder / "a.png")


def _ply_claim(folder: Path, quick: bool) -> str:
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n"
    head += b"property float x\nproperty float y\nproperty float z\nelement face 4000000000\n"
    head += b"property list uchar int vertex_indices\nend_header\n"
    return _claims("mesh", head + bytes(1000), folder / "a.ply")


def _entries(folder: Path, quick: bool) -> str:
    """A zip file of so many members that their list alone fills the memory."""
    import io
    import zipfile

    n = 20_000 if quick else 400_000
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for i in range(n):
            archive.writestr(zipfile.ZipInfo(f"{i:x}"), b"")
    return _claims("groom", file.getvalue(), folder / "a.npz")


def _generator(folder: Path, quick: bool) -> str:
    """Within all ranges, and more than the machine has."""
    from furcl.groom.grow import GENERATORS
    from furcl.memory import available_bytes

    n_strands = min(available_bytes() // (4096 * 60) + 1000, 524_287)
    said = ""
    for name, sizes in (
        ("fur", {"n_strands": n_strands}),
        ("hair", {"n_strands": n_strands}),
        ("fur", {"n_strands": 1, "n_clumps": n_strands}),
        ("fibre", {"count": n_strands}),
    ):
        grow = partial(GENERATORS[name], **sizes, n_points=4096)
        said = refused(grow, GroomError, "MiB of memory are available")
    changes = ["--set", f"curves.n_strands={n_strands}", "--set", "curves.n_points=4096"]
    ended = furcl("render", "red_fox", *changes, "-o", folder / "a.exr")
    assert ended.peak_bytes < 1e9, f"{ended.peak_bytes / 1e6:.0f} MB"
    told(ended, 2, "MiB of memory are available")
    return said


def _grown(generator: str, sizes: dict[str, int], folder: Path, quick: bool) -> str:
    """What growing takes is within what is asked for before."""
    from furcl.groom.grow.ranges import POINT_BYTES, STRAND_BYTES

    scale = 1 if quick else 16
    keys = {name: size * (1 if name == "n_points" else scale) for name, size in sizes.items()}
    (folder / "a.json").write_text(json.dumps({"generator": generator, **keys}))
    taken, outcome = peak("generator", folder / "a.json")
    assert outcome == "read", outcome
    n_grown = sum(size for name, size in keys.items() if name != "n_points")
    asked = n_grown * (STRAND_BYTES + POINT_BYTES * keys["n_points"])
    assert taken <= asked + BESIDE_BYTES, f"{taken / 1e6:.0f} MB, asked for {asked / 1e6:.0f}"
    return f"{taken / 1e6:.0f} MB of {asked / 1e6:.0f} that are asked for"


_GROWN: tuple[tuple[str, dict[str, int]], ...] = (
    ("fur", {"n_strands": 10_000, "n_points": 100}),
    ("fur", {"n_strands": 300_000, "n_points": 2}),
    ("fur", {"n_strands": 10_000, "n_points": 100, "n_clumps": 10_000}),
    ("hair", {"n_strands": 10_000, "n_points": 100}),
    ("hair", {"n_strands": 10_000, "n_points": 100, "n_clumps": 10_000}),
    ("fibre", {"count": 10_000, "n_points": 100}),
    ("fibre", {"count": 60_000, "n_points": 2}),
)

CASES = [
    *(Case(f"memory: {name}", partial(_measured, name)) for name in _FILES),
    *(
        Case(f"EXR {kind} that claims {width} x {height}", partial(_exr_claim, kind, width, height))
        for kind, width, height in (
            ("PIZ", 16777216, 8),
            ("PIZ", 32768, 8192),
            ("DWAA", 32768, 8192),
            ("DWAA", 32768, 256),
            ("ZIP", 32768, 64),
        )
    ),
    Case("PNG that claims 16384 x 16384", _png_claim),
    Case("PLY that claims 4 billion vertices", _ply_claim),
    Case("npz of very many members", _entries),
    *(
        Case(f"memory: {name}, {' '.join(map(str, sizes.values()))}", partial(_grown, name, sizes))
        for name, sizes in _GROWN
    ),
    Case("generators that fill the memory", _generator),
]

if __name__ == "__main__":
    main()
