"""Reads and writes NetCDF: CF-1.11, north up for GIS, with metadata from the table of variables.

Global attributes are those of ACDD 1.3; unknown ones are left out.
"""

import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__
from runout.errors import StorageError
from runout.io.atomic import storage_error, whole_file
from runout.io.grid import crs_as_variable, extent_attributes, grid_dataset
from runout.io.map_layers import CHUNK, add_layers, put
from runout.model.terrain import Terrain
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

LOCK = threading.RLock()  # the netCDF library is not thread-safe, even for different files
MAP_DIMS = ("y", "x")
CONVENTIONS = "CF-1.11, ACDD-1.3"
STANDARD_NAMES = "CF Standard Name Table v93"
_NAMES = {  # keys of `metadata` in site.yaml -> attributes
    "author": "creator_name",
    "email": "creator_email",
    "url": "creator_url",
    "institution": "institution",
    "project": "project",
    "purpose": "purpose",
    "license": "license",
    "references": "references",
    "acknowledgement": "acknowledgement",
}


def map_dataset(
    terrain: Terrain, maps: Mapping[str, np.ndarray], *, title: str, attrs: Mapping[str, Any] | None = None
) -> "xr.Dataset":
    """Maps on the cells of a terrain with coordinates, coordinate system and descriptions.

    Parameters
    ----------
    terrain : Terrain
        Its cells become ``x`` (ascending) and ``y`` (descending: north up), its CRS the variable ``crs``.
    maps : mapping of str to ndarray (rows, columns)
        Values by the names of :data:`runout.variables.VARIABLES`, row 0 in the north; NaN for missing values.
    title : str
        Title of the file.
    attrs : mapping, optional
        Further global attributes; they override the standard ones.

    Raises
    ------
    ValueError
        If a map has another shape than the terrain, or its name is not in the table.
    """
    dataset = grid_dataset(terrain)
    dataset.attrs = global_attributes(terrain, title) | dict(attrs or {})
    for name, values in maps.items():
        add_map(dataset, name, values)
    return dataset


def add_map(dataset: "xr.Dataset", name: str, values: np.ndarray, dims: tuple[str, ...] = ()) -> None:
    """Add values (\\*dims, rows, columns) to a dataset of :func:`map_dataset` under a name of the table."""
    if name not in VARIABLES:
        raise ValueError(f"{name!r} is not in runout/variables.py; add it there, with its unit")
    variable = VARIABLES[name]
    array = np.asarray(values).astype(variable.dtype, copy=False)
    rows_columns = (dataset.sizes["y"], dataset.sizes["x"])
    if array.shape[-2:] != rows_columns or array.ndim != len(dims) + 2:
        raise ValueError(f"{name} has shape {array.shape}; the terrain has {rows_columns[0]} rows and {rows_columns[1]} columns")
    dataset[name] = ((*dims, *MAP_DIMS), array, variable.attributes())
    if "crs" in dataset:
        dataset[name].encoding["grid_mapping"] = "crs"


def global_attributes(terrain: Terrain, title: str) -> dict[str, Any]:
    """Global attributes of every file (CF and ACDD); unknown ones are left out."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return {
        "Conventions": CONVENTIONS,
        "title": title,
        "summary": "Runout of a gravitational mass movement, simulated with a three-dimensional material point method",
        "source": f"runout {__version__}, material point method",
        "comment": "thicknesses are vertical; y descends from north to south",
        "keywords": "landslide, runout, hazard",
        "standard_name_vocabulary": STANDARD_NAMES,
        "cdm_data_type": "Grid",
        "date_created": now,
        "date_modified": now,
        "date_metadata_modified": now,
        "history": f"{now} written by runout {__version__}",
    } | (extent_attributes(terrain) | vertical_attributes(terrain))


def write(dataset: "xr.Dataset", path: str | os.PathLike[str], *, groups: "Mapping[str, xr.Dataset] | None" = None) -> Path:
    """Write a dataset completely or not at all; returns the path. Safe to call from several threads.

    Units, names, types, fill values and ranges come from :data:`runout.variables.VARIABLES`; attributes that a
    variable already has are kept. Maps are compressed in chunks of 256 x 256 cells.

    Parameters
    ----------
    groups : mapping of str to xarray.Dataset, optional
        Further datasets, each in a group of that name.

    Raises
    ------
    StorageError
        If the disk is full or the folder cannot be written; an older file stays as it is.
    """
    with LOCK, whole_file(path) as temporary:
        try:
            _write_maps(_write_without_maps(_encoded(dataset), temporary), temporary)
            for group, content in (groups or {}).items():
                _store(_encoded(content), temporary, mode="a", group=group)
        except RuntimeError as cause:  # error of the netCDF library, also on a full disk
            raise storage_error(path, cause) from cause
    return Path(path)


def _write_without_maps(encoded: "xr.Dataset", path: Path) -> "dict[str, xr.DataArray]":
    """Write all that has other dimensions than maps; returns the maps."""
    maps = {str(name): array for name, array in encoded.data_vars.items() if _is_layered(array)}
    _store(encoded.drop_vars(list(maps)), path, mode="w")
    return maps


def _store(encoded: "xr.Dataset", path: Path, **choices: str) -> None:
    """Write a dataset, as its ``to_netcdf`` does; that asks for a cluster, which imports all of ``distributed`` if it is there."""
    from xarray.backends import NetCDF4DataStore

    file = NetCDF4DataStore.open(path, format="NETCDF4", lock=LOCK, **choices)
    try:
        encoded.dump_to_store(file)
    finally:
        file.close()


def _is_layered(array: "xr.DataArray") -> bool:
    return array.dims[-2:] == MAP_DIMS and array.name in VARIABLES and VARIABLES[str(array.name)].fill is not None


def _write_maps(maps: "Mapping[str, xr.DataArray]", path: Path) -> None:
    """Add maps to a file that has their coordinates."""
    import netCDF4

    with netCDF4.Dataset(path, "a") as file:
        for name, array in maps.items():
            dims = tuple(map(str, array.dims[:-2]))
            attributes = dict(array.attrs)
            if "grid_mapping" in array.encoding:
                attributes["grid_mapping"] = array.encoding["grid_mapping"]
            layers = add_layers(file, name, attributes, dims)
            for index in np.ndindex(array.shape[:-2]):
                put(layers, array.values[index], index)


def read(path: str | os.PathLike[str], group: str | None = None, names: Sequence[str] = ()) -> "xr.Dataset":
    """Dataset of a file or of one of its groups, loaded; missing values are NaN, times are numbers.

    With ``names`` it holds nothing but these variables and their coordinates.

    Raises StorageError if there is no such file, group or variable, or it is not NetCDF.
    """
    import xarray as xr

    with reading(path, f"group {group} " if group else ""):
        with xr.open_dataset(path, group=group, engine="netcdf4", decode_coords="all", decode_times=False) as file:
            dataset = (file[list(names)] if names else file).load()
        return crs_as_variable(dataset)


def read_attributes(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Global attributes of a file. Raises StorageError if there is no such file, or it is not NetCDF."""
    import netCDF4

    with reading(path), netCDF4.Dataset(path) as file:
        return {name: file.getncattr(name) for name in file.ncattrs()}


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Context in which the netCDF library writes to a file; its errors, also that of a full disk, become a StorageError."""
    try:
        yield
    except RuntimeError as cause:
        raise storage_error(path, cause) from cause


@contextmanager
def reading(path: str | os.PathLike[str], part: str = "") -> Iterator[None]:
    """Context that holds the lock of the netCDF library and converts its errors into a StorageError."""
    try:
        with LOCK:
            yield
    except (OSError, IndexError, KeyError, RuntimeError) as cause:
        raise StorageError(f"{path}: {part}cannot be read ({cause}); remove the file and run again") from cause


def _encoded(dataset: "xr.Dataset") -> "xr.Dataset":
    dataset = crs_as_variable(dataset.copy())
    for name in dataset.variables:
        _describe(dataset[name], str(name))
    for name in dataset.data_vars:
        _encode_map(dataset[name], "crs" in dataset)
    return dataset


def _describe(array: "xr.DataArray", name: str) -> None:
    """Set attributes, type and missing value of the variables that are in the table."""
    array.encoding.setdefault("_FillValue", None)
    if name not in VARIABLES:
        return
    variable = VARIABLES[name]
    array.attrs = variable.attributes() | array.attrs
    if variable.dtype == "str":
        return
    always_there = name in array.dims or array.ndim == 0
    array.encoding |= {"dtype": variable.dtype, "_FillValue": None if always_there else variable.fill}
    for bound in ("valid_min", "valid_max"):
        value = getattr(variable, bound)
        if value is not None:
            array.attrs[bound] = np.dtype(variable.dtype).type(value)


def _encode_map(array: "xr.DataArray", has_crs: bool) -> None:
    encoding = array.encoding
    encoding["coordinates"] = encoding.get("coordinates")
    if array.ndim == 0 or array.dtype.kind not in "fiu":
        return
    is_map = array.dims[-2:] == MAP_DIMS
    leading = (1,) * (array.ndim - 2) if is_map else ()
    sizes = array.shape[len(leading) :]
    encoding |= {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": leading + tuple(max(1, min(CHUNK, n)) for n in sizes)}
    if is_map and has_crs:
        array.attrs.pop("grid_mapping", None)
        encoding["grid_mapping"] = "crs"


def study_attributes(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Attributes of author and purpose, from the block ``metadata`` of a site.yaml."""
    attributes = {attribute: str(metadata[key]) for key, attribute in _NAMES.items() if metadata.get(key)}
    if "creator_name" in attributes:
        attributes["creator_type"] = "person"
        attributes |= {"creator_institution": attributes["institution"]} if "institution" in attributes else {}
    elif "institution" in attributes:
        attributes |= {"creator_name": attributes["institution"], "creator_type": "institution"}
    return attributes


def vertical_attributes(terrain: Terrain) -> dict[str, Any]:
    """Range of the known elevations [m]."""
    return {
        "geospatial_vertical_min": float(np.nanmin(terrain.elevation)),
        "geospatial_vertical_max": float(np.nanmax(terrain.elevation)),
        "geospatial_vertical_units": "m",
        "geospatial_vertical_positive": "up",
    }
