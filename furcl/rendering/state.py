"""What a render has to remember between two waves, and the file that keeps it.

The file is a line that says what it is, a line of JSON, the bytes of the buffers that the JSON
lists, and the SHA-256 of all this. Numbers are the bits of the device: a render that goes on from
them ends with the bits of one that never stopped.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
import pyopencl as cl

from furcl.errors import CheckpointError
from furcl.files import atomic_path, named

MAGIC = b"furcl checkpoint 1\n"
DIGEST_BYTES = 32
MOST_HEADER_BYTES = 1 << 20
#: Buffers are copied in pieces of so many bytes.
PIECE_BYTES = 1 << 24

#: A part of the state: on the device, or on the host.
Part = cl.Buffer | np.ndarray


class _Header(msgspec.Struct):
    identity: dict[str, Any]
    numbers: dict[str, Any]
    sizes: dict[str, int]


@dataclass(frozen=True)
class Saved:
    """The header of a file, whose bytes are those that were written.

    Attributes
    ----------
    path : Path
    identity : dict     what the render is: the same in the render that goes on
    numbers : dict      the state that is no buffer
    sizes : dict        name -> bytes of each part, in the order of the file
    """

    path: Path
    identity: dict[str, Any]
    numbers: dict[str, Any]
    sizes: dict[str, int]


def write_state(
    path: Path,
    queue: cl.CommandQueue,
    identity: Mapping[str, Any],
    numbers: Mapping[str, Any],
    parts: Mapping[str, Part],
) -> None:
    """Write a state, whole or not at all; parts are copied piece by piece.

    Raises
    ------
    OSError     of the system, such as a full disk
    """
    header = {
        "identity": identity,
        "numbers": numbers,
        "sizes": {name: _size(part) for name, part in parts.items()},
    }
    digest = hashlib.sha256()
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        pieces = (piece for part in parts.values() for piece in _pieces(queue, part))
        for piece in (MAGIC, json.dumps(header).encode() + b"\n", *pieces):
            digest.update(piece)
            file.write(piece)
        file.write(digest.digest())
        file.flush()
        os.fsync(file.fileno())


def read_header(path: str | os.PathLike[str]) -> Saved:
    """The header of a file, all of whose bytes were compared with its digest.

    Raises
    ------
    CheckpointError     no such file, another kind of file, a damaged one
    """
    path = named(path, CheckpointError)
    if not path.is_file():
        raise CheckpointError(
            f"{path}: there is no such file; give the checkpoint of a render that was stopped"
        )
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise CheckpointError(
                    f"{path}: does not start as a checkpoint of furcl does; give the file that "
                    f"a stopped render wrote"
                )
            _check_digest(path, file)
            file.seek(len(MAGIC))
            header = msgspec.json.decode(file.readline(MOST_HEADER_BYTES), type=_Header)
        return Saved(path, header.identity, header.numbers, header.sizes)
    except (ValueError, RecursionError) as error:
        raise CheckpointError(
            f"{path}: its header is none: {error!s:.200}; its render has to begin again"
        ) from None
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror}") from None


def read_parts(queue: cl.CommandQueue, saved: Saved, parts: Mapping[str, Part]) -> None:
    """Fill parts from a file; those of other sizes are refused before any is filled.

    Raises
    ------
    CheckpointError
    """
    wanted = {name: _size(part) for name, part in parts.items()}
    if wanted != saved.sizes:
        raise CheckpointError(
            f"{saved.path}: holds {saved.sizes} bytes, this render has {wanted}; continue with the "
            f"version of furcl that began it"
        )
    with saved.path.open("rb") as file:
        file.seek(len(MAGIC))
        file.readline(MOST_HEADER_BYTES)
        for part in parts.values():
            _fill(queue, part, file)
    queue.finish()


def _size(part: Part) -> int:
    return part.nbytes if isinstance(part, np.ndarray) else part.size


def _pieces(queue: cl.CommandQueue, part: Part) -> Iterator[bytes]:
    """The bytes of a part."""
    if isinstance(part, np.ndarray):
        yield part.tobytes()
        return
    for start in range(0, part.size, PIECE_BYTES):
        piece = np.empty(min(PIECE_BYTES, part.size - start), np.uint8)
        cl.enqueue_copy(queue, piece, part, src_offset=start)
        yield piece.tobytes()


def _fill(queue: cl.CommandQueue, part: Part, file: BinaryIO) -> None:
    """Give a part the next bytes of a file."""
    if isinstance(part, np.ndarray):
        part[...] = np.frombuffer(file.read(part.nbytes), part.dtype).reshape(part.shape)
        return
    for start in range(0, part.size, PIECE_BYTES):
        piece = np.frombuffer(file.read(min(PIECE_BYTES, part.size - start)), np.uint8)
        cl.enqueue_copy(queue, part, piece, dst_offset=start)


def _check_digest(path: Path, file: BinaryIO) -> None:
    """Refuse a file whose last bytes are not the digest of all others."""
    file.seek(0, os.SEEK_END)
    left, digest = file.tell() - DIGEST_BYTES, hashlib.sha256()
    file.seek(0)
    while left > 0 and (piece := file.read(min(left, PIECE_BYTES))):
        digest.update(piece)
        left -= len(piece)
    if file.read(DIGEST_BYTES + 1) != digest.digest():
        raise CheckpointError(f"{path}: is damaged or cut short; its render has to begin again")
