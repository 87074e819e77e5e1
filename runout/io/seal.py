"""Seal of a NetCDF file: the checksum of its content as an attribute, so that damage is found where no record tells of the file.

It covers dimensions, coordinates, values and attributes of all groups. HDF5 itself finds damage of compressed values only.
"""

import hashlib
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.netcdf import LOCK

if TYPE_CHECKING:
    import netCDF4

SEAL = "content_sha256"
# what the library raises for damaged files; AttributeError and KeyError: a name is damaged
DAMAGED = (OSError, RuntimeError, ValueError, IndexError, AttributeError, KeyError, TypeError, MemoryError, OverflowError)


def seal(path: str | os.PathLike[str]) -> None:
    """Seal a file that was just written; an error of the library as it comes."""
    import netCDF4

    with LOCK:
        with netCDF4.Dataset(path) as file:
            content = _checksum(file)
        with netCDF4.Dataset(path, "a") as file:
            file.setncattr(SEAL, content)


def broken_seal(path: str | os.PathLike[str]) -> str | None:
    """What is wrong with a sealed file; None if every value of every group is what was sealed."""
    import netCDF4

    try:
        with LOCK, netCDF4.Dataset(path) as file:
            if SEAL not in file.ncattrs():
                return "has no checksum of its content"
            return None if file.getncattr(SEAL) == _checksum(file) else "does not hold what was written"
    except DAMAGED as cause:
        return f"cannot be read ({cause})"


def _checksum(file: "netCDF4.Dataset") -> str:
    file.set_auto_maskandscale(False)
    digest = hashlib.sha256()
    for part in _parts(file):
        digest.update(part)
    return digest.hexdigest()


def _parts(group: "netCDF4.Dataset") -> Iterable[bytes]:
    """Content of a group and its groups, part by part."""
    yield from (f"{name} {len(group.dimensions[name])}\n".encode() for name in sorted(group.dimensions))
    yield from _attributes(group)
    for name in sorted(group.variables):
        variable = group.variables[name]
        yield f"{name} {variable.dtype} {variable.dimensions}\n".encode()
        yield from _attributes(variable)
        yield _bytes(variable[...])
    for name in sorted(group.groups):
        yield f"group {name}\n".encode()
        yield from _parts(group.groups[name])


def _attributes(of: Any) -> Iterable[bytes]:
    for name in sorted(set(of.ncattrs()) - {SEAL}):
        value = np.asarray(of.getncattr(name))
        yield f"{name} {value.dtype} {value.tolist()!r}\n".encode()


def _bytes(values: Any) -> bytes:
    array = np.asarray(values)
    return repr(array.tolist()).encode() if array.dtype.kind in "OU" else np.ascontiguousarray(array).tobytes()
