"""Damaged files by the thousand: every reader ends in its own error, and in little memory.

`python -m faults.mutants KIND N SEED FOLDER` reads N of a kind and prints how many were refused.
"""

from __future__ import annotations

import io
import struct
import sys
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case
from faults.harness import environment, run
from furcl.errors import FurclError, GroomError, ImageError, SceneError

QUICK = 60
PEAK_BYTES = 1 << 30
WORDS = (0, 1, 2, 127, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1)
LETTERS = b"[]{}()=\"'.,#\\\n0123456789eE+-_ax\x00\xff"


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
    from furcl.groom.curves import Curves
    from furcl.groom.formats import save_curves

    curves = Curves.from_arrays(rng.random((9, 3)), rng.random(9) + 0.1, [0, 3, 5, 9])
    path = Path(sys.argv[4]) / "seed.hair"
    save_curves(curves, path)
    return mutated(path.read_bytes(), rng)


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
    import OpenEXR

    kinds = [OpenEXR.ZIP_COMPRESSION, OpenEXR.PIZ_COMPRESSION, OpenEXR.DWAA_COMPRESSION]
    kinds += [OpenEXR.RLE_COMPRESSION, OpenEXR.NO_COMPRESSION, OpenEXR.PXR24_COMPRESSION]
    path = str(Path(sys.argv[4]) / "seed.exr")
    header = {"compression": kinds[rng.integers(len(kinds))], "type": OpenEXR.scanlineimage}
    pixels = rng.random((12, 17, 3)).astype(np.float32)
    with OpenEXR.File(header, {"RGB": pixels}) as file:
        file.write(path)
    return mutated(Path(path).read_bytes(), rng)


def _hdr(rng: np.random.Generator) -> bytes:
    head = b"#?RADIANCE\nEXPOSURE=2.0\nPRIMARIES= .64 .33 .3 .6 .15 .06 .3127 .329\n"
    head += b"FORMAT=32-bit_rle_rgbe\n\n-Y 3 +X 9\n"
    pixels = rng.integers(0, 256, (27, 4), np.uint8)
    pixels[:, 3] = rng.integers(118, 140, 27)
    return mutated(head + pixels.tobytes(), rng)


def _toml(rng: np.random.Generator) -> bytes:
    from furcl.paths import scene_folder

    scenes = sorted(scene_folder().glob("*.toml"))
    return mutated(scenes[rng.integers(len(scenes))].read_bytes(), rng)


def _read_groom(path: Path) -> None:
    from furcl.groom.formats import load_curves

    load_curves(path)


def _read_exr(path: Path) -> None:
    from furcl.image.image import Image

    Image.load(path)


def _read_light(path: Path) -> None:
    from furcl.light.latlong import LatLong

    LatLong.load(path)


def _read_scene(path: Path) -> None:
    from furcl.scene.read import load_scene

    load_scene(path)


def _compare(path: Path) -> None:
    from furcl.image.compare import compare
    from furcl.image.image import Image

    image = Image.load(path)
    compare(image, image)


Kind = tuple[Callable[[np.random.Generator], bytes], str, Callable[[Path], None], type[FurclError]]
#: What makes the file, its suffix, what reads it, and the error it may end in.
KINDS: dict[str, Kind] = {
    "hair": (_hair, ".hair", _read_groom, GroomError),
    "npz": (_npz, ".npz", _read_groom, GroomError),
    "exr": (_exr, ".exr", _read_exr, ImageError),
    "exr light": (_exr, ".exr", _read_light, ImageError),
    "hdr": (_hdr, ".hdr", _read_light, ImageError),
    "toml": (_toml, ".toml", _read_scene, SceneError),
    "compare": (_exr, ".exr", _compare, ImageError),
}
FULL = {"hair": 100_000, "npz": 40_000, "exr": 40_000, "exr light": 15_000, "hdr": 40_000}
FULL |= {"toml": 40_000, "compare": 20_000}


def main() -> int:
    """Read them; 1 where one ends in another error."""
    kind, n, seed, folder = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    make, suffix, read, error = KINDS[kind]
    n_refused = 0
    for index in range(n):
        path = folder / f"mutant{suffix}"
        path.write_bytes(make(np.random.default_rng([seed, index])))
        try:
            read(path)
        except error:
            n_refused += 1
        except Exception as other:
            print(f"number {index} of seed {seed}: {type(other).__name__}: {str(other)[:150]}")
            return 1
    print(f"{n} files, {n_refused} refused")
    return 0


def _case(kind: str, folder: Path, quick: bool) -> str:
    n = QUICK if quick else FULL[kind]
    module = [sys.executable, "-P", "-m", "faults.mutants", kind, str(n), "1", str(folder)]
    ended = run(module, environment())
    # Lines before the last are the OpenEXR library's.
    said = (ended.out.strip() or ended.err.strip()[-200:]).splitlines()[-1]
    assert ended.code == 0, f"code {ended.code}: {said}"
    assert ended.peak_bytes <= PEAK_BYTES, f"{ended.peak_bytes / 1e6:.0f} MB: {said}"
    return f"{said}; at most {ended.peak_bytes / 1e6:.0f} MB"


CASES = [Case(f"damaged files: {kind}", partial(_case, kind)) for kind in KINDS]

if __name__ == "__main__":
    sys.exit(main())
