"""Maps of one member in its file: the part of the raster that its flow reached, and where that part lies in the raster.

A file is sealed: its checksum of dimensions, coordinates, values and attributes of all groups is an attribute, so that damage is
found where no record tells of the file. HDF5 itself finds damage of compressed values only.
"""

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from runout.errors import StorageError
from runout.io import netcdf
from runout.io.grid import crs_as_variable, grid_dataset
from runout.io.netcdf import LOCK
from runout.io.window import NEVER_BELOW, Part
from runout.model.terrain import Terrain
from runout.quantities import WITHOUT_VALUE, bed_map_names, member_map_names
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import netCDF4
    import pandas as pd
    import xarray as xr

MEMBER_MAPS, BED_MAPS = member_map_names(), bed_map_names()
SNAPSHOTS = "snapshots"  # group with thickness and speed at some times, where the site keeps them
LEDGERS, RECORDS = "ledgers", "records"  # group of members.nc with the ledgers one behind another, and number of records of each
RASTER = "raster"  # group with the place of the whole raster, in files that hold a part of it
STEP = 64  # cells; parts begin and end on multiples of it
SMALLEST_BLOCK = netcdf.CHUNK  # rows, and columns
READ_CACHE = 8 * 1024**2  # bytes of each map of an open file: 2 million cells, which members.nc and hazard.nc need in turn
_PLACE = ("x", "y", "crs", "longitude", "latitude")
_SHIFT = 1e-6  # of a cell, by which coordinates of a part may differ from those of the raster
_ATTRIBUTES = ("first_row", "first_column", "raster_rows", "raster_columns")
SEAL = "content_sha256"
# what the library raises for damaged files; AttributeError and KeyError: a name is damaged
DAMAGED = (OSError, RuntimeError, ValueError, IndexError, AttributeError, KeyError, TypeError, MemoryError, OverflowError)


@dataclass(frozen=True)
class Block:
    """Maps of one member in a rectangle of the raster."""

    # rows, columns: rows and columns of the raster
    rows: slice
    columns: slice
    maps: Mapping[str, np.ndarray]  # (rows, columns): float32; NaN where there is no value


def reached_part(maps: Mapping[str, np.ndarray]) -> Part:
    """The part of a raster with all cells in which a map is above 0, between multiples of :data:`STEP`; all where none is."""
    reached = np.any([np.nan_to_num(values) > 0 for values in maps.values()], axis=0)
    if not reached.any():
        return Part(0, 0, *reached.shape)
    row, rows = _steps(reached.any(axis=1))
    column, columns = _steps(reached.any(axis=0))
    return Part(row, column, rows, columns)


def _steps(reached: np.ndarray) -> tuple[int, int]:
    """First place and number of places along an axis, three at least."""
    places = np.flatnonzero(reached)
    first = min(int(places[0]), reached.size - NEVER_BELOW) // STEP * STEP
    return first, min(-(-int(places[-1] + 1) // STEP) * STEP, reached.size) - first


def cut_to_reached(
    terrain: Terrain, maps: Mapping[str, np.ndarray]
) -> "tuple[Terrain, dict[str, np.ndarray], dict[str, np.int32], xr.Dataset]":
    """The part of a raster that a flow reached.

    Returns
    -------
    terrain : Terrain
        The part.
    maps : dict of str to ndarray
        Maps on the part.
    attributes : dict of str to int
        Attributes that tell the file's reader where the part lies.
    raster : xarray.Dataset
        Content of the group :data:`RASTER`: the place of the whole raster, and which cells have an elevation unless all have.
    """
    part = reached_part({name: terrain.where_known(values) for name, values in maps.items()})
    attributes = dict(zip(_ATTRIBUTES, map(np.int32, (part.row, part.column, *terrain.shape)), strict=True))
    raster = grid_dataset(terrain)
    known = np.isfinite(terrain.elevation)
    if not known.all():
        netcdf.add_map(raster, "elevation_known", known)
    return terrain.part(*part.slices), {name: values[part.slices] for name, values in maps.items()}, attributes, raster


class _MapsFile:
    """An open file with maps of members; its values come as they are stored."""

    def __init__(self, path: str | os.PathLike[str], file: "netCDF4.Dataset | None" = None):
        import netCDF4

        self.path = Path(path)
        with netcdf.reading(path):
            self.file = netCDF4.Dataset(path) if file is None else file
            self.file.set_auto_maskandscale(False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with netcdf.LOCK:
            self.file.close()

    def held(self) -> tuple[str, ...]:
        """Maps of a member that the file holds: those of a bed where there is one; a file of an earlier version may lack some."""
        return tuple(name for name in (*MEMBER_MAPS, *BED_MAPS) if name in self.file.variables)


class MemberMaps(_MapsFile):
    """The open file of a member, for the block of a ``with`` statement; it holds the whole raster, or a part of it.

    Parameters
    ----------
    path : path
        File with the maps of :data:`MEMBER_MAPS`.

    Attributes
    ----------
    attributes : dict
        Global attributes of the file.
    shape : tuple of int
        Rows and columns of the raster.
    part : Part
        Rows and columns that the file holds.

    Raises
    ------
    StorageError
        From all methods, if the file cannot be read.
    """

    def __init__(self, path: str | os.PathLike[str]):
        super().__init__(path)
        with netcdf.reading(path):
            self.attributes: dict[str, Any] = self.file.__dict__
            dimensions = self.file.dimensions
            for name in self.held():
                self.file[name].set_var_chunk_cache(READ_CACHE)
        rows, columns = (len(dimensions[name]) if name in dimensions else 0 for name in netcdf.MAP_DIMS)
        self.is_part = set(_ATTRIBUTES) <= set(self.attributes)
        row, column, *shape = (int(self.attributes[name]) for name in _ATTRIBUTES) if self.is_part else (0, 0, rows, columns)
        self.part, self.shape = Part(row, column, rows, columns), (shape[0], shape[1])

    def grid(self) -> "xr.Dataset":
        """Place of the whole raster: ``x``, ``y``, ``crs`` and, where the file has them, ``longitude`` and ``latitude``."""
        import xarray as xr

        with netcdf.reading(self.path, "coordinates "):
            store = xr.backends.NetCDF4DataStore(self.file.groups[RASTER] if self.is_part else self.file)
            dataset = xr.open_dataset(store, decode_coords="all", decode_timedelta=False)
            wanted = [name for name in _PLACE if name in dataset.variables]
            return crs_as_variable(xr.Dataset(coords={name: dataset.variables[name].load() for name in wanted}))

    def known(self) -> np.ndarray | None:
        """Cells of the whole raster that have an elevation, (rows, columns) of bool; None if the file names none that have not."""
        with netcdf.reading(self.path, "cells with an elevation "):
            raster = self.file.groups[RASTER] if self.is_part else None
            return raster["elevation_known"][:] == 1 if raster and "elevation_known" in raster.variables else None

    def require_grid(self, grid: "xr.Dataset", first: str) -> None:
        """StorageError if the file lies on another raster than that of ``grid``, which is that of the file ``first``."""
        with netcdf.reading(self.path, "coordinates "):
            axes = [self.file[name][:] for name in netcdf.MAP_DIMS]
        expected = [grid[name].values for name in netcdf.MAP_DIMS]
        if self.shape == tuple(axis.size for axis in expected) and all(
            np.allclose(axis, whole[part], rtol=0.0, atol=_SHIFT * abs(whole[1] - whole[0]))
            for axis, whole, part in zip(axes, expected, self.part.slices, strict=True)
        ):
            return

        reason = "the file is damaged" if broken_seal(self.path) else f"this file or {first} is damaged or of another raster"
        raise StorageError(
            f"{self.path}: its grid ({self.shape[0]} rows, {self.shape[1]} columns) is not that of {first}; "
            f"{reason}, remove it and run the ensemble again"
        )

    def blocks(self, cells: int, names: Sequence[str] = MEMBER_MAPS) -> Iterator[Block]:
        """Maps of these names, each cell once, in blocks of at most ``cells`` cells or of one chunk of the file."""
        wide = max(SMALLEST_BLOCK, cells // SMALLEST_BLOCK // SMALLEST_BLOCK * SMALLEST_BLOCK)
        for row in range(0, self.part.rows, SMALLEST_BLOCK):
            rows = slice(row, min(row + SMALLEST_BLOCK, self.part.rows))
            for column in range(0, self.part.columns, wide):
                columns = slice(column, min(column + wide, self.part.columns))
                maps = {name: self._values(name, rows, columns) for name in names}
                yield Block(_moved(rows, self.part.row), _moved(columns, self.part.column), maps)

    def layer(self, name: str, known: np.ndarray | None) -> np.ndarray:
        """One map on the whole raster: 0 or, of some maps, no value beyond the part; NaN there on cells that are not ``known``."""
        values = self._values(name, slice(None), slice(None))
        if not self.is_part:
            return values
        whole = np.full(self.shape, np.nan if name in WITHOUT_VALUE else 0.0, np.float32)
        if known is not None:
            whole[~known] = np.nan
        whole[self.part.slices] = values
        return whole

    def within(self, name: str, place: tuple[slice, slice]) -> np.ndarray:
        """One map in a rectangle of the whole raster: 0 or, of some maps, no value beyond the part that the file holds."""
        rows, columns = (range(size)[span] for size, span in zip(self.shape, place, strict=True))
        window_values = np.full((len(rows), len(columns)), np.nan if name in WITHOUT_VALUE else 0.0, np.float32)
        top, bottom = max(rows.start, self.part.row), min(rows.stop, self.part.row + self.part.rows)
        left, right = max(columns.start, self.part.column), min(columns.stop, self.part.column + self.part.columns)
        if top < bottom and left < right:
            values = self._values(name, _moved(slice(top, bottom), -self.part.row), _moved(slice(left, right), -self.part.column))
            window_values[top - rows.start : bottom - rows.start, left - columns.start : right - columns.start] = values
        return window_values

    def ledger(self) -> dict[str, np.ndarray]:
        """Mass and energy over time by name, each (time,)."""
        with netcdf.reading(self.path, "group ledger "):
            group = self.file.groups["ledger"]
            return {name: np.asarray(variable[:]) for name, variable in group.variables.items()}

    def _values(self, name: str, rows: slice, columns: slice) -> np.ndarray:
        """Values of a map in a rectangle of what the file holds; NaN where there is none."""
        with netcdf.reading(self.path, f"{name} "):
            values: np.ndarray = np.asarray(self.file[name][rows, columns], np.float32)
        return _without_fill(values, name)


def _without_fill(values: np.ndarray, name: str) -> np.ndarray:
    """The values of a map with NaN in place of fill values."""
    least, fill = VARIABLES[name].valid_min, np.float32(VARIABLES[name].fill or np.nan)
    below = values == fill if least is None else values < least  # fill values among them
    if below.any():
        values[below] = np.nan
    return values


class MembersFile(_MapsFile):
    """The open ``members.nc``, for the block of a ``with`` statement: maps and ledgers of all members from one file.

    While the file is written, ``file`` is its open dataset. Raises StorageError: from all methods, if the file cannot be read.
    """

    def __init__(self, path: str | os.PathLike[str], file: "netCDF4.Dataset | None" = None):
        super().__init__(path, file)
        with netcdf.reading(path):
            self.places = {int(number): place for place, number in enumerate(self.file["realization"][:])}
            self.maps, self.ledgers = self.held(), dict[str, np.ndarray]()
            if LEDGERS in self.file.groups:
                columns = self.file.groups[LEDGERS].variables
                self.ledgers = {name: np.asarray(column[:]) for name, column in columns.items() if name != RECORDS}
                self.ends = np.cumsum(columns[RECORDS][:])

    def member(self, number: int) -> "StackedMember":
        """A member by its number."""
        return StackedMember(self, self.places[number])


@dataclass(frozen=True)
class StackedMember:
    """One member of an open ``members.nc``."""

    stack: MembersFile
    place: int

    def held(self) -> tuple[str, ...]:
        """Names of the maps."""
        return self.stack.maps

    def within(self, name: str, place: tuple[slice, slice]) -> np.ndarray:
        """One map in a rectangle of the raster, float32; NaN where it has no value."""
        with netcdf.reading(self.stack.path, f"{name} "):
            values = np.asarray(self.stack.file[name][self.place, place[0], place[1]], np.float32)
        return _without_fill(values, name)

    def ledger(self) -> dict[str, np.ndarray]:
        """Mass and energy over time by name, each (time,); those that the run of this member kept."""
        if not self.stack.ledgers:
            raise StorageError(f"{self.stack.path}: it holds no ledgers; run `runout hazard` for this site again")
        end = int(self.stack.ends[self.place])
        start = int(self.stack.ends[self.place - 1]) if self.place else 0
        columns = {name: values[start:end] for name, values in self.stack.ledgers.items()}
        return {name: values for name, values in columns.items() if not np.isnan(values).all()}


def _moved(span: slice, by: int) -> slice:
    return slice(span.start + by, span.stop + by)


def read_maps(path: str | os.PathLike[str]) -> "xr.Dataset":
    """Maps of a member on the whole raster. Raises StorageError if there is no such file, or it is not that of a member."""
    with MemberMaps(path) as member:
        if not member.is_part:
            return netcdf.read(path)
        dataset, known = member.grid(), member.known()
        for name in (*MEMBER_MAPS, *(name for name in BED_MAPS if name in member.held())):
            netcdf.add_map(dataset, name, member.layer(name, known))
    return dataset


def member_table(path: Path) -> "pd.DataFrame":
    """Weights, seeds, parameters, status and reasons of the members: all variables whose only dimension is ``realization``."""
    import netCDF4
    import pandas as pd

    with LOCK, netCDF4.Dataset(path) as stack:
        stack.set_auto_mask(False)
        columns = {name: values[:] for name, values in stack.variables.items() if values.dimensions == ("realization",)}
    numbers = columns.pop("realization").astype(int)
    return pd.DataFrame(columns, index=pd.Index(numbers, name="realization"))


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
