"""Cloud-optimised GeoTIFFs of single maps."""

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.io.atomic import storage_error, whole_file
from runout.variables import FILL_BY_DTYPE, VARIABLES

if TYPE_CHECKING:
    import xarray as xr
    from rasterio.crs import CRS
    from rasterio.transform import Affine

_CREATION = {"driver": "COG", "compress": "DEFLATE", "predictor": "YES", "blocksize": 256, "bigtiff": "IF_SAFER"}
_CARRIED = (
    "title",
    "source",
    "date_created",
    "creator_name",
    "institution",
    "project",
    "license",
    "ensemble",
    "configuration_sha256",
    "vertical_datum",
)
_OF_CLASSES = ("flag_meanings", "scheme", "checked")  # attributes of a map of classes
_AVERAGED = ("elevation", "ground_slope")  # overviews are means; at the edge of a flow a mean would mislead


def write_cog(dataset: "xr.Dataset", name: str, path: str | os.PathLike[str], **selection: float) -> Path:
    """Write one map of a dataset as a cloud-optimised GeoTIFF, north up; returns the path.

    Values are in the printed unit (:attr:`runout.variables.Variable.printed`): pressure in kPa. Overviews hold values of single
    cells, those of the ground means. The metadata of the band state minimum, maximum, mean and standard deviation.

    Parameters
    ----------
    dataset : xarray.Dataset
        As :func:`runout.io.netcdf.map_dataset` makes it.
    name : str
        Name of the map.
    selection : float
        For a map with more dimensions the coordinate to take, for example ``thickness_threshold=0.5``.

    Raises
    ------
    StorageError
        If the disk is full or the folder cannot be written; an older file stays as it is.
    """
    layer = dataset[name].sel(selection) if selection else dataset[name]
    with whole_file(path) as temporary:
        temporary.write_bytes(_encoded(layer, raster_crs(dataset), _tags(dataset, layer, selection)))
    return Path(path)


def raster_crs(dataset: "xr.Dataset") -> "CRS | None":
    """Coordinate reference system of a dataset; None for a local one."""
    return _crs(dataset["crs"].attrs["crs_wkt"]) if "crs" in dataset.variables else None


@cache
def _crs(wkt: str) -> "CRS":
    """System of a text. It takes a millisecond, and a dataset has many maps."""
    from rasterio.crs import CRS

    return CRS.from_wkt(wkt)


def raster_transform(dataset: "xr.Dataset") -> "Affine":
    """Affine transform from column and row to map coordinates [m], taken from the cell centres."""
    from rasterio.transform import Affine

    x, y = dataset["x"].values, dataset["y"].values
    dx, dy = (x[-1] - x[0]) / (x.size - 1), (y[-1] - y[0]) / (y.size - 1)
    return Affine(dx, 0.0, x[0] - dx / 2, 0.0, dy, y[0] - dy / 2)


def _encoded(layer: "xr.DataArray", crs: "CRS | None", tags: dict[str, Any]) -> bytes:
    """Bytes of the file. They are made in memory because GDAL only logs a full disk when it closes a file."""
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile

    name = str(layer.name)
    variable = VARIABLES[name]
    dtype, fill = variable.dtype, FILL_BY_DTYPE[variable.dtype]
    assert fill is not None  # every map has one
    divisor = variable.printed[1]
    values = layer.values if divisor == 1.0 else layer.values / np.float32(divisor)
    cells = np.where(np.isnan(values), fill, values).astype(dtype)
    shape = {"height": cells.shape[0], "width": cells.shape[1], "count": 1, "dtype": dtype, "nodata": fill}
    shape |= {"overview_resampling": "AVERAGE" if name in _AVERAGED else "NEAREST"}
    try:
        with MemoryFile() as memory:
            with memory.open(**_CREATION, **shape, crs=crs, transform=raster_transform(layer.to_dataset())) as raster:
                raster.write(cells, 1)
                raster.set_band_description(1, tags["long_name"])
                raster.set_band_unit(1, tags["units"])
                raster.update_tags(**tags)
                raster.update_tags(1, **statistics(cells[cells != fill], cells.size))
            return bytes(memory.getbuffer())
    except RasterioError as cause:
        raise storage_error(str(layer.name), cause) from cause


def statistics(known: np.ndarray, cells: int) -> dict[str, str]:
    """Statistics of the known values (n,) of ``cells`` with the keys of GDAL; empty if no value is known."""
    if known.size == 0:
        return {}
    tags = {"MINIMUM": known.min(), "MAXIMUM": known.max(), "MEAN": known.mean(dtype=np.float64)}
    tags |= {"STDDEV": known.std(dtype=np.float64), "VALID_PERCENT": 100.0 * known.size / cells}
    return {f"STATISTICS_{name}": f"{float(value):.14g}" for name, value in tags.items()}


def _tags(dataset: "xr.Dataset", layer: "xr.DataArray", selection: dict[str, float]) -> dict[str, Any]:
    variable = VARIABLES[str(layer.name)]
    tags = {key: dataset.attrs[key] for key in _CARRIED if key in dataset.attrs}
    tags |= {key: layer.attrs[key] for key in _OF_CLASSES if key in layer.attrs}
    chosen = {dim: _printed(dim, value) for dim, value in selection.items()}
    chosen |= {str(name): str(text.item()) for name, text in layer.coords.items() if text.ndim == 0 and text.dtype.kind in "OU"}
    described = variable.attributes() | {"units": variable.printed[0]}
    return {"TIFFTAG_IMAGEDESCRIPTION": variable.long_name} | described | chosen | tags


def _printed(name: str, value: float) -> str:
    units, divisor = VARIABLES[name].printed
    return f"{value / divisor:g}" + (f" {units}" if units != "1" else "")
