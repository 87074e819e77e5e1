"""Maps in a netCDF file: only chunks that hold anything are stored, so that a file follows the flow and not its raster."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.quantities import UNTIL_ARRIVAL
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import netCDF4

CHUNK = 256
WRITE_CACHE = 8 * CHUNK**2  # bytes of each map; a chunk is written once, and the library would keep 64 MiB


def add_layers(file: "netCDF4.Dataset", name: str, attributes: Mapping[str, Any], dims: tuple[str, ...] = ()) -> "netCDF4.Variable":
    r"""New variable (\*dims, y, x) for maps of that name, by the table of variables; its cells are 0, or missing before an arrival.

    The value that HDF5 returns for chunks that were never written is the one just named. The attribute ``_FillValue``, which marks
    missing values in all netCDF libraries, is another one; the library sets both together, and only a rename parts them.
    """
    variable = VARIABLES[name]
    sizes = [len(file.dimensions[dim]) for dim in ("y", "x")]
    chunks = (*(1 for _ in dims), *(min(CHUNK, size) for size in sizes))
    dtype, missing = np.dtype(variable.dtype), variable.fill
    layers = file.createVariable(
        name, dtype, (*dims, "y", "x"), fill_value=dtype.type(missing if name in UNTIL_ARRIVAL else 0),
        zlib=True, complevel=1, shuffle=True, chunksizes=chunks, chunk_cache=WRITE_CACHE,
    )  # fmt: skip
    layers.set_auto_maskandscale(False)
    if name not in UNTIL_ARRIVAL:
        rename_attribute(layers, "_FillValue", "unwritten")
        layers.setncattr("missing", dtype.type(missing))
        rename_attribute(layers, "missing", "_FillValue")
        layers.delncattr("unwritten")
    layers.setncatts(dict(attributes))
    return layers


def rename_attribute(variable: "netCDF4.Variable", name: str, new_name: str) -> None:
    """Rename an attribute of a variable.

    The names are bytes: netCDF4 1.7.5 frees the old name, if it has to encode it, before the C library reads it, and another thread
    may write to its place meanwhile. The library then finds no such attribute, or another one.
    """
    variable.renameAttribute(name.encode(), new_name.encode())  # type: ignore[arg-type]


def put(layers: "netCDF4.Variable", values: np.ndarray, index: tuple[int, ...] = (), at: tuple[int, int] = (0, 0)) -> None:
    """Write the chunks of a map (rows, columns), NaN where it has no value, that differ from what is read without them.

    ``index``: place along the dimensions before y and x. ``at``: row and column of the first value; multiples of a chunk.
    """
    missing = layers.dtype.type(VARIABLES[layers.name].fill)
    unwritten = missing if layers.name in UNTIL_ARRIVAL else layers.dtype.type(0)
    bits = f"u{layers.dtype.itemsize}"  # by which -0.0 differs from 0.0
    for row in range(0, values.shape[0], CHUNK):
        for column in range(0, values.shape[1], CHUNK):
            cells = values[row : row + CHUNK, column : column + CHUNK]
            if cells.dtype.kind == "f":
                cells = np.where(np.isnan(cells), missing, cells)
            cells = cells.astype(layers.dtype, order="C", copy=False)
            if (cells.view(bits) != unwritten.view(bits)).any():
                top, left = at[0] + row, at[1] + column
                layers[(*index, slice(top, top + cells.shape[0]), slice(left, left + cells.shape[1]))] = cells


def whole_chunks(span: slice, size: int) -> slice:
    """Places along an axis of ``size`` cells from the beginning of the first chunk of ``span`` to the end of its last one."""
    return slice(span.start // CHUNK * CHUNK, min(-(-span.stop // CHUNK) * CHUNK, size))
