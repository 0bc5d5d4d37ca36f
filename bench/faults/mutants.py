"""Damaged files by the thousand: every reader ends in its own error, and in little memory.

`bash bench/faults.sh mutants` reads two million; FURCL_MUTANTS=0.1 the first tenth of them, 0.1:0.2
the second. `python -m faults.mutants KIND FIRST END SEED FOLDER` reads numbers FIRST to END - 1 of
a kind and prints how many were refused.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import logging
import os
import resource
import struct
import sys
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from faults import exr_seeds, groom_seeds
from faults.case import Case
from faults.harness import Ended, environment, run
from furcl.errors import (
    BenchError,
    BvhError,
    CheckpointError,
    FurclError,
    GroomError,
    ImageError,
    MeshError,
    SamplerError,
    SceneError,
)

QUICK = 60
# Of grooms, whose readers take some milliseconds.
QUICK_GROOMS = 1000
USD_TOGETHER = 200  # by a fork, whose first takes longer than a hundred more
EVERY = "every kind"
MOST_SECONDS = 3600  # of the processor, to read those of a kind
PEAK_BYTES = 512 << 20
FOLDER = Path(tempfile.gettempdir())
WORDS = (0, 1, 2, 127, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1)
LETTERS = b"[]{}()=\"'.,#\\\n0123456789eE+-_ax\x00\xff"


def part(text: str) -> tuple[float, float]:
    """The shares at which a part of all begins and ends: "0.1:0.2"; "0.1" is the first tenth."""
    first, _, end = text.rpartition(":")
    return float(first or 0), float(end)


PART = part(os.environ.get("FURCL_MUTANTS", "1"))


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Data with one to four changes: bytes, words, parts left out, doubled, or cut off."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, max(len(out), 1)))
        n = int(rng.integers(1, 9))
        kind = rng.integers(0, 7)
        if kind == 0:
            out[at : at + 1] = rng.bytes(1)
        elif kind == 1:
            out[at : at + 4] = struct.pack("<I", WORDS[rng.integers(len(WORDS))])
        elif kind == 2:
            del out[at : at + n]
        elif kind == 3:
            out[at:at] = out[at : at + n]
        elif kind == 4 and rng.random() < 0.3:
            del out[at:]
        elif kind == 5:
            out[at : at + 1] = bytes([LETTERS[rng.integers(len(LETTERS))]])
        else:
            out[at:at] = bytes([LETTERS[rng.integers(len(LETTERS))]]) * int(rng.integers(1, 5))
    return bytes(out)


def _hair(rng: np.random.Generator) -> bytes:
    return mutated(_hair_seed(), rng)


@cache
def _hair_seed() -> bytes:
    from furcl.groom.curves import Curves
    from furcl.groom.formats import save_curves

    rng = np.random.default_rng(1)
    curves = Curves.from_arrays(rng.random((9, 3)), rng.random(9) + 0.1, [0, 3, 5, 9])
    path = FOLDER / "seed.hair"
    save_curves(curves, path)
    return path.read_bytes()


def _npz(rng: np.random.Generator) -> bytes:
    """Half of them with damage inside whole zip files, where no checksum finds it."""
    arrays = {"points": rng.random((9, 3)), "radii": rng.random(9), "counts": np.array([3, 2, 4])}
    inside = rng.random() < 0.7
    packing = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", packing[rng.choice(4, p=[0.6, 0.3, 0.05, 0.05])]) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array)
            data = member.getvalue()
            archive.writestr(f"{name}.npy", mutated(data, rng) if inside else data)
    return file.getvalue() if inside else mutated(file.getvalue(), rng)


def _exr(rng: np.random.Generator) -> bytes:
    return mutated(
        exr_seeds.seed(exr_seeds.COMPRESSIONS[rng.integers(len(exr_seeds.COMPRESSIONS))], FOLDER),
        rng,
    )


def _zip_exr(rng: np.random.Generator) -> bytes:
    """Of those that are decoded in the reader's own process."""
    return mutated(exr_seeds.seed(("NO", "ZIPS", "ZIP")[rng.integers(3)], FOLDER), rng)


def _hdr(rng: np.random.Generator) -> bytes:
    """Flat, or of runs."""
    head = b"#?RADIANCE\nEXPOSURE=2.0\nPRIMARIES= .64 .33 .3 .6 .15 .06 .3127 .329\n"
    head += b"FORMAT=32-bit_rle_rgbe\n\n-Y 3 +X 9\n"
    pixels = rng.integers(0, 256, (27, 4), np.uint8)
    pixels[:, 3] = rng.integers(118, 140, 27)
    body = pixels.tobytes()
    if rng.random() < 0.3:
        body = (body[:4] + b"\1\1\1\6" + body[4:12]) * 3
    elif rng.random() < 0.5:
        body = (b"\2\2\0\x09" + 3 * b"\x86\x80\3abc" + b"\x89\x80") * 3
    return mutated(head + body, rng)


def _toml(rng: np.random.Generator) -> bytes:
    from furcl.paths import scene_folder

    scenes = sorted(scene_folder().glob("*.toml"))
    return mutated(scenes[rng.integers(len(scenes))].read_bytes(), rng)


def _override(rng: np.random.Generator) -> bytes:
    """Something like `--set`."""
    texts = (b"film.width=32", b"render.spp=16", b"fibre={model='double-cylinder', sigma_ca=1}")
    texts += (b"environment.kind=constant", b"curves.centre=[0.0, 1.0, 2.0]", b"fibre.g=0.25")
    return mutated(texts[rng.integers(len(texts))], rng)


def _results(rng: np.random.Generator) -> bytes:
    """A results.json, or what it is not."""
    text = b'{"schema": "furcl-convergence-1", "scenes": [{"name": "a"}], "renders": [1, null]}'
    return mutated(text, rng)


def _header(rng: np.random.Generator) -> bytes:
    from furcl.paths import kernel_folder

    return mutated((kernel_folder() / "include/samplers/uniform_h.clh").read_bytes(), rng)


def _tables(rng: np.random.Generator) -> bytes:
    """A file of medulla tables in the cache."""
    return mutated(_tables_seed(), rng)


SHAPES = {"density": (4, 3), "summary": (3,)}


@cache
def _tables_seed() -> bytes:
    from furcl.fibre.double_cylinder.profiles import store_cached

    path = FOLDER / "seed.tables"
    store_cached(path, {name: np.ones(shape) for name, shape in SHAPES.items()})
    return path.read_bytes()


def _obj(rng: np.random.Generator) -> bytes:
    """Two triangles and a square, of one object or of two."""
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvn 0 0 1\nvt 0 0\nvt 1 0.5\n"
    faces = ("f 1 2 3\nf 1 3 4\n", "f 1/1/1 2/2/1 3/1/1\no b\nf 1//1 3//1 4//1\n")
    faces += ("f 1/1 2/2 3/2 4/1\n", "usemtl a\nf -4 -3 -2 \\\n-1\nf 1 2 4\n")
    return mutated((text + faces[rng.integers(len(faces))]).encode(), rng)


def _ply(rng: np.random.Generator) -> bytes:
    """A square, as text or binary."""
    kinds = ("ascii", "binary_little_endian", "binary_big_endian")
    kind = kinds[rng.integers(len(kinds))]
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")[: (3, 6, 8)[rng.integers(3)]]
    rows, faces = rng.random((4, len(names))).astype("<f4"), [[0, 1, 2], [0, 2, 3]]
    head = f"ply\nformat {kind} 1.0\ncomment TextureFile a.png\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in names)
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        lines = [" ".join(f"{x:.3f}" for x in row) for row in rows.tolist()]
        lines += [f"3 {a} {b} {c}" for a, b, c in faces]
        return mutated(head.encode() + "\n".join(lines).encode() + b"\n", rng)
    order = "<" if "little" in kind else ">"
    body = b"".join(b"\x03" + np.array(face, f"{order}i4").tobytes() for face in faces)
    return mutated(head.encode() + rows.astype(f"{order}f4").tobytes() + body, rng)


def _texture(rng: np.random.Generator) -> bytes:
    """PNG and JPEG."""
    modes = ("RGB", "RGBA", "L", "LA", "P", "1", "I;16", "JPEG RGB", "JPEG L", "JPEG CMYK")
    return mutated(_texture_seed(modes[rng.integers(len(modes))]), rng)


@cache
def _texture_seed(mode: str) -> bytes:
    from PIL import Image as Pillow

    file = io.BytesIO()
    colours = np.random.default_rng(1).integers(0, 256, (9, 11, 3), np.uint8)
    name = mode.removeprefix("JPEG ")
    if name == "I;16":
        picture = Pillow.fromarray(colours[..., 0].astype(np.uint16) * 257)
    else:
        picture = Pillow.fromarray(colours).convert(name)
    picture.save(file, "JPEG" if mode.startswith("JPEG") else "PNG")
    return file.getvalue()


STORED = b"a binary, or the name of a device" * 3


def _stored(rng: np.random.Generator) -> bytes:
    """A kernel's binary or a verdict, in the cache."""
    return mutated(_stored_seed(), rng)


@cache
def _stored_seed() -> bytes:
    from furcl.cache import store

    store(FOLDER / "seed.bin", STORED)
    return (FOLDER / "seed.bin").read_bytes()


def _part() -> Any:
    """A part of a reference, as it is rendered."""
    from furcl.image.image import Image

    pixels = np.random.default_rng(1).random((6, 5, 3)).astype(np.float32)
    return Image(pixels, stats={"device": "a", "wall_seconds": 1.5})


def _reference(rng: np.random.Generator) -> bytes:
    """A part of a reference of a convergence run, in the cache."""
    return mutated(_reference_seed(), rng)


@cache
def _reference_seed() -> bytes:
    from furcl.bench.convergence_reference import keep_part

    keep_part(FOLDER / "seed part.exr", _part())
    return (FOLDER / "seed part.exr").read_bytes()


def _state(rng: np.random.Generator) -> bytes:
    """What a convergence run has measured so far."""
    names = ("seconds", "cpu_seconds", "mse_against_reference", "mse", "rmse", "relmse", "flip")
    names += ("variance", "mean", "path_length", "hits_per_path")
    record = dict.fromkeys(names, 0.25) | dict.fromkeys(("seed", "rays", "paths"), 7)
    record |= {"key": "a|b|2|0", "lobes": {"R": 3}, "nonfinite": 0}
    facts = {"reference": {"spp": 8, "mean": 0.5, "mean_error": 0.01}}
    stored = {"scenes": {"a": facts}, "setup": {"a|b": {}}, "renders": {"a|b|2|0": record}}
    return mutated(json.dumps(stored).encode(), rng)


def _checkpoint(rng: np.random.Generator) -> bytes:
    """A render that was stopped; every second file's digest is of what the damage left."""
    from furcl.rendering.state import MAGIC

    header = {"identity": {"scene": "a"}, "numbers": {"paths_done": 3}, "sizes": {"film": 16}}
    inside = rng.random() < 0.5
    text = json.dumps(header).encode() + b"\n" + bytes(16)
    content = MAGIC + (mutated(text, rng) if inside else text)
    data = content + hashlib.sha256(content).digest()
    return data if inside else mutated(data, rng)


def _read_mesh(path: Path) -> None:
    from furcl.scene.mesh import MeshTable

    MeshTable(file=str(path)).build("mesh.a")


def _usd_mesh(rng: np.random.Generator) -> bytes:
    """A square and a triangle with normals and places."""
    return mutated(groom_seeds.usd_mesh(), rng)


def _read_texture(path: Path) -> None:
    from furcl.surface.mesh.texture import read_texture

    read_texture(path)


def _read_stored(path: Path) -> None:
    """What was stored, or nothing."""
    from furcl.cache import load

    content = load(path)
    if content is None:
        raise BvhError("rebuilt")
    assert content == STORED, "another content"


def _read_reference(path: Path) -> None:
    """As it was rendered, or to be rendered again."""
    from furcl.bench.convergence_reference import kept_part

    kept = kept_part(path, (6, 5))
    if kept is None:
        raise BenchError("to be rendered again")
    assert np.array_equal(kept.rgb, _part().rgb), "another picture"
    assert kept.stats["wall_seconds"] == 1.5, "other statistics"


def _read_state(path: Path) -> None:
    from furcl.bench.convergence_state import State

    State(path).of_variant("a", "b")


def _read_checkpoint(path: Path) -> None:
    from furcl.rendering.state import read_header

    read_header(path)


def _read_groom(path: Path) -> None:
    from furcl.groom.formats import load_curves

    load_curves(path)


def _read_exr(path: Path) -> None:
    from furcl.image import exr
    from furcl.image.image import Image

    exr.decode_apart = exr_seeds.by_fork
    Image.load(path)


def _read_light(path: Path) -> None:
    from furcl.image import exr
    from furcl.light.latlong import LatLong

    exr.decode_apart = exr_seeds.by_fork
    LatLong.load(path)


def _read_scene(path: Path) -> None:
    from furcl.scene.read import load_scene

    load_scene(path)


def _compare(path: Path) -> None:
    from furcl.image import exr
    from furcl.image.compare import compare
    from furcl.image.image import Image

    exr.decode_apart = exr_seeds.by_fork
    image = Image.load(path)
    compare(image, image)


def _read_override(path: Path) -> None:
    from furcl.scene.read import load_scene

    load_scene("single_fibre", overrides=[path.read_bytes().decode("utf-8", "surrogateescape")])


def _read_results(path: Path) -> None:
    from furcl.report.pages import write_pages

    write_pages(path.parent)


def _read_header(path: Path) -> None:
    from furcl.fibre import samplers

    samplers.register("mutant", path)


def _read_tables(path: Path) -> None:
    """Damage must not be noticed by an error, but by what is read: the same, or nothing."""
    from furcl.fibre.double_cylinder.profiles import load_cached

    arrays = load_cached(path, SHAPES)
    if arrays is None:
        raise BvhError("rebuilt")
    assert all((arrays[name] == 1.0).all() for name in SHAPES), "other tables"


Kind = tuple[Callable[[np.random.Generator], bytes], str, Callable[[Path], None], type[FurclError]]
#: What makes the file, its suffix, what reads it, and the error it may end in.
KINDS: dict[str, Kind] = {
    "hair": (_hair, ".hair", _read_groom, GroomError),
    "npz": (_npz, ".npz", _read_groom, GroomError),
    "exr": (_exr, ".exr", _read_exr, ImageError),
    "exr light": (_exr, ".exr", _read_light, ImageError),
    "hdr": (_hdr, ".hdr", _read_light, ImageError),
    "toml": (_toml, ".toml", _read_scene, SceneError),
    "compare": (_zip_exr, ".exr", _compare, ImageError),
    "override": (_override, ".txt", _read_override, SceneError),
    "results": (_results, ".json", _read_results, BenchError),
    "sampler": (_header, ".clh", _read_header, SamplerError),
    "cache": (_tables, ".tables", _read_tables, BvhError),
    "mesh obj": (_obj, ".obj", _read_mesh, MeshError),
    "mesh ply": (_ply, ".ply", _read_mesh, MeshError),
    "mesh usda": (_usd_mesh, ".usda", _read_mesh, MeshError),
    "texture": (_texture, ".png", _read_texture, ImageError),
    "stored": (_stored, ".bin", _read_stored, BvhError),
    "reference": (_reference, ".exr", _read_reference, BenchError),
    "state": (_state, ".json", _read_state, BenchError),
    "checkpoint": (_checkpoint, ".checkpoint", _read_checkpoint, CheckpointError),
}


def _groom(kind: str, rng: np.random.Generator) -> bytes:
    """A groom of one of the other formats; of packed ones most are damaged inside."""
    data = groom_seeds.seed(kind, FOLDER)
    if kind.endswith(".gz") and rng.random() < 0.7:
        return gzip.compress(mutated(gzip.decompress(data), rng), 1, mtime=0)
    return mutated(data, rng)


KINDS |= {
    kind: (partial(_groom, kind), suffix, partial(groom_seeds.read, kind), GroomError)
    for kind, (suffix, *_) in groom_seeds.SEEDS.items()
}
#: Two million in all.
FULL = {"hair": 100_000, "npz": 100_000, "exr": 20_000, "exr light": 10_000, "hdr": 80_000}
FULL |= {"toml": 60_000, "compare": 10_000, "override": 30_000, "results": 40_000}
FULL |= {"sampler": 40_000, "cache": 50_000, "mesh obj": 100_000, "mesh ply": 100_000}
FULL |= {"texture": 40_000, "stored": 20_000, "reference": 5_000, "state": 20_000}
FULL |= {"checkpoint": 20_000, "mesh usda": 100_000}
FULL |= dict.fromkeys(groom_seeds.SEEDS, 100_000)


def read_mutants(kind: str, first: int, end: int, seed: int, folder: Path) -> int:
    """Read numbers `first` to `end` - 1 of a seed; returns how many were refused.

    Raises
    ------
    AssertionError      where one ends in another error; says its number
    """
    make, suffix, read, error = KINDS[kind]
    n_refused = 0
    n_together = USD_TOGETHER if suffix.startswith(".usd") else 1
    name = "results.json" if kind == "results" else f"mutant{suffix}"
    for begin in range(first, end, n_together):
        numbers = range(begin, min(begin + n_together, end))
        paths = [folder / (name if n_together == 1 else f"{index}{suffix}") for index in numbers]
        for index, path in zip(numbers, paths, strict=True):
            path.write_bytes(make(np.random.default_rng([seed, index])))
        together = groom_seeds.usd_read_together(paths) if n_together > 1 else nullcontext()
        with together:
            for index, path in zip(numbers, paths, strict=True):
                try:
                    read(path)
                except error:
                    n_refused += 1
                except Exception as other:
                    said = f"{type(other).__name__}: {str(other)[:150]}"
                    raise AssertionError(f"{kind} number {index} of seed {seed}: {said}") from other
                path.unlink()
    return n_refused


def main() -> int:
    """Read those of a kind, or a few of every kind in turn; 1 where one goes wrong."""
    global FOLDER
    kind, (first, end, seed), FOLDER = sys.argv[1], map(int, sys.argv[2:5]), Path(sys.argv[5])
    logging.disable()
    code = 0
    for each in KINDS if kind == EVERY else [kind]:
        last = _few(each) if kind == EVERY else end
        try:
            n_refused = read_mutants(each, first, last, seed, FOLDER)
        except AssertionError as error:
            print(str(error).replace("\n", " "))
            code = 1
        else:
            print(f"{last - first} files, {n_refused} refused")
    return code


def _few(kind: str) -> int:
    """How many of a kind the short form reads."""
    if kind in groom_seeds.SEEDS:
        return QUICK_GROOMS
    return QUICK // 4 if kind.startswith(("exr", "reference")) else QUICK


def _limit_seconds() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))


def _read_apart(kind: str, first: int, end: int, folder: str) -> Ended:
    # numpy warns of headers that Python 2 may have written, which some damage looks like.
    quiet = ["-W", "ignore:Reading:UserWarning"]
    numbers = [str(first), str(end), "1"]
    module = [sys.executable, "-P", *quiet, "-m", "faults.mutants", kind, *numbers, folder]
    # Time of the processor tells a reader without an end from a busy machine.
    return run(module, environment(), timeout_s=1e5, preexec_fn=_limit_seconds)


def _case(kind: str, folder: Path, quick: bool) -> str:
    """Nothing but the last line is written, and no more memory taken than a process takes."""
    first, end = (0, QUICK) if quick else (round(FULL[kind] * share) for share in PART)
    if quick and kind.startswith(("exr", "reference")):
        end //= 4
    ended = _read_apart(kind, first, end, str(folder))
    lines = ended.out.strip().splitlines()
    assert not ended.err, f"something was written: {ended.err[-200:]}"
    assert len(lines) == 1, f"code {ended.code}, and not one line: {lines[-1:]}"
    said = lines[0]
    assert said.endswith("refused"), said
    # What is decoded is small; a header may claim 4 times as much as its file can hold.
    assert ended.peak_bytes <= PEAK_BYTES, f"{ended.peak_bytes / 1e6:.0f} MB: {said}"
    return f"{said}; at most {ended.peak_bytes / 1e6:.0f} MB"


CASES = [Case(f"damaged files: {kind}", partial(_case, kind)) for kind in KINDS]

if __name__ == "__main__":
    sys.exit(main())
