"""Finds HDF5 files that refer to other files: external storage, virtual datasets and external links.

The library opens such files unasked. What points to them is found in the bytes of the file by the layout of the format (HDF5 File
Format Specification 3.0, IV.A.2.g, IV.A.2.h and IV.A.2.i) and by where it points, so that no file is opened by the library first.
"""

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
PLACES = (0, *(512 << k for k in range(16)))  # offsets of the signature after a user block
PIECE, OVERLAP = 2**24, 64  # bytes searched at a time, and overlap of the pieces
NAME_SIZES = (1, 2, 4, 8)

Bytes = Any  # ndarray (n,) of uint8


def require_own_storage(path: Path, error: type[InputError]) -> None:
    """Raise an error if a file is HDF5 and its values lie in other files.

    Raises InputError of the given kind for external storage, virtual datasets and external links.
    """
    if path.is_dir():
        return
    status = os.stat(path)
    what = _elsewhere(path, status.st_size, status.st_mtime_ns, status.st_ino)
    if what:
        raise error(
            f"{path}: holds {what}: numbers that lie in another file, which is not read; if you trust it, write all into one "
            f"file, for example `h5repack -l CONTI {path} elevation.nc` or `ncks -4 {path} elevation.nc`"
        )


@lru_cache(maxsize=64)
def _elsewhere(path: Path, size: int, modified: int, inode: int) -> str | None:
    """Kind of reference to another file that a file holds; None if it holds none. Its status is part of the key of the cache."""
    if size < len(SIGNATURE):
        return None
    content = np.memmap(path, np.uint8, "r")
    start = next((place for place in PLACES if content[place : place + len(SIGNATURE)].tobytes() == SIGNATURE), None)
    if start is None:
        return None
    address = _size_of_addresses(content, start)
    for first in range(0, len(content), PIECE):
        piece = np.asarray(content[first : first + PIECE + OVERLAP])
        if _names_marks(content, start, first + _external(piece) + 8, address, b"HEAP"):
            return "external storage"
        if _names_marks(content, start, first + _virtual(piece) + 2, address, b"GCOL"):
            return "a virtual dataset"
        if any(_is_external_link(content, int(place)) for place in first + _links(piece)):
            return "an external link"
    return None


def _size_of_addresses(content: Bytes, start: int) -> int:
    """Bytes of an address by the superblock, at most eight."""
    version = int(content[start + 8]) if start + 8 < len(content) else 0
    place = start + (13 if version < 2 else 9)
    size = int(content[place]) if place < len(content) else 8
    return size if size in (2, 4) else 8


def _external(b: Bytes) -> Bytes:
    """Possible starts of external file messages: version 1, three zeros, slots allocated and used (two bytes each, not 0)."""
    heads = np.flatnonzero((b[:-7] == 1) & (b[1:-6] == 0) & (b[2:-5] == 0) & (b[3:-4] == 0))
    return heads[((b[heads + 4] | b[heads + 5]) != 0) & ((b[heads + 6] | b[heads + 7]) != 0)]


def _virtual(b: Bytes) -> Bytes:
    """Possible starts of layout messages of virtual datasets: version 4 to 15, class 3."""
    return np.flatnonzero((b[1:] == 3) & (b[:-1] >= 4) & (b[:-1] <= 15))


def _links(b: Bytes) -> Bytes:
    """Possible starts of external link messages: version 1, flags with link type, link type 64."""
    return np.flatnonzero((b[:-2] == 1) & (b[2:] == 64) & ((b[1:-1] & 0b1110_1000) == 8))


def _names_marks(content: Bytes, start: int, places: Bytes, size: int, mark: bytes) -> bool:
    """Whether an address [size bytes] at any of the places points to the mark."""
    places = places[places + size <= len(content)]
    places = places[content[places + size - 1] == 0] if size == 8 else places  # no file has 2^56 bytes
    target = np.full(len(places), start, np.uint64)
    for k in range(size):
        target += content[places + k].astype(np.uint64) << np.uint64(8 * k)
    target = target[target <= len(content) - len(mark)].astype(np.int64)
    matches = np.ones(len(target), bool)
    for k, byte in enumerate(mark):
        matches &= content[target + k] == byte
    return bool(matches.any())


def _is_external_link(content: Bytes, place: int) -> bool:
    """Whether a link message holds flags, a name, a length, and then file and path, both terminated by a zero."""
    flags = int(content[place + 1])
    width = NAME_SIZES[flags & 3]
    place += 3 + (8 if flags & 4 else 0) + (1 if flags & 16 else 0)
    length = int.from_bytes(content[place : place + width].tobytes(), "little")
    place += width + length
    if length == 0 or place + 2 > len(content):
        return False
    told = int.from_bytes(content[place : place + 2].tobytes(), "little")
    target = content[place + 2 : place + 2 + told].tobytes()
    return len(target) == told >= 4 and target[0] == 0 and target[-1] == 0 and target[1:-1].count(0) == 1
