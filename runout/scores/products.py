"""Reads what is compared: results of a site, members, rasters, outlines and points."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import numpy as np

from runout.errors import ObservationError
from runout.forecast.numerical_error import read_convergence
from runout.io import netcdf
from runout.io.boundary import exists
from runout.io.member_maps import read_maps
from runout.io.opening import open_netcdf
from runout.quantities import ARRIVAL_PERCENTILE
from runout.scores.error_bars import ErrorBars
from runout.scores.flow import OF_ENSEMBLE, OF_MEMBER, Flow, percentile_of
from runout.scores.grid import Grid
from runout.scores.points import arrival_or_never
from runout.scores.raster_quantity import raster_quantity
from runout.scores.read import Nodata, read_map

if TYPE_CHECKING:
    import xarray as xr

VECTORS = (".gpkg", ".shp", ".geojson", ".json", ".fgb", ".gdb")


@dataclass(frozen=True)
class Reading:
    """How products are read.

    Attributes
    ----------
    quantity : str or None
        What a raster shows, a name of :data:`runout.scores.flow.UNITS`; by default what its name or unit says.
    probability : float
        Outline of an ensemble.
    nodata : Nodata
        What cells of a raster without a value mean.
    """

    quantity: str | None = None
    probability: float = 0.5
    nodata: Nodata = Nodata.UNKNOWN


@dataclass(frozen=True)
class Product:
    """One of two things that are compared.

    Attributes
    ----------
    path : Path
    kind : str
        "ensemble", "member", "raster" or "vector".
    flow : Flow or None
        Its maps; None of a vector file, which is read on the grid of the other product.
    thresholds : tuple of float
        Thicknesses [m] that the site states.
    elevation, release : ndarray (rows, columns) or None
        Ground and thickness of the release [m] on the grid, where a site holds them.
    bars : ErrorBars
        Numerical errors of the site.
    changes : tuple of str
        What was changed on the way in.
    """

    path: Path
    kind: str
    flow: Flow | None = None
    thresholds: tuple[float, ...] = ()
    elevation: np.ndarray | None = None
    release: np.ndarray | None = None
    bars: ErrorBars = field(default_factory=lambda: ErrorBars({}))
    changes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name for tables and maps: the last parts of the path."""
        last = [part for part in self.path.absolute().parts if part not in ("results", "hazard.nc", "members", "simulations")]
        return "/".join(last[-2:]) if self.kind == "member" else Path(last[-1]).stem

    @property
    def is_of_runout(self) -> bool:
        """Whether its thickness is vertical for certain."""
        return self.kind in ("ensemble", "member")


def read_product(path: Path, reading: Reading) -> Product:
    """What a path holds: a site or results folder, ``hazard.nc``, the file of a member or of :func:`runout.simulate`, or a raster.

    Raises
    ------
    ObservationError
        If it is none of these, or cannot be read.
    """
    if not exists(path):
        raise ObservationError(f"{path}: no such file or folder; name results, hazard.nc, a member, a raster, an outline or points")
    if path.is_dir() and path.suffix.lower() not in VECTORS:
        return _of_folder(path, reading)
    if path.suffix.lower() in VECTORS:
        return Product(path, "vector")
    if path.suffix.lower() in (".nc", ".nc4"):
        return _of_netcdf(path, reading)
    return _of_raster(path, reading)


def _of_raster(path: Path, reading: Reading) -> Product:
    quantity, said = (reading.quantity, ()) if reading.quantity else raster_quantity(path)
    values, grid, changes = read_map(path, reading.nodata, quantity=quantity)
    flow = Flow(grid, {quantity: values}, probability=reading.probability)
    return Product(path, "raster", flow, changes=(*said, *changes))


def _of_folder(path: Path, reading: Reading) -> Product:
    for place in (path / "hazard.nc", path / "results" / "hazard.nc", path / "screen.nc"):
        if place.is_file():
            return _of_netcdf(place, reading)
    if (path / "hdr.adf").is_file():  # an ESRI grid is a folder
        return _of_raster(path, reading)
    remedy = f"run `runout run {quote(str(path))}` first, or name the file that is compared"
    raise ObservationError(f"{path}: holds no hazard.nc; {remedy}")


def _of_netcdf(path: Path, reading: Reading) -> Product:
    with open_netcdf(path, ObservationError) as file:
        names = set(map(str, file.variables))
        places = {name: file.variables[name].dims for name in names}
    if places.get("thickness_exceedance_probability", ())[1:] == netcdf.MAP_DIMS:
        return _of_ensemble(path, netcdf.read(path), reading)
    if places.get("max_flow_thickness") == netcdf.MAP_DIMS:
        return _of_member(path, read_maps(path))
    held = ", ".join(sorted(names)[:6]) or "nothing"
    raise ObservationError(
        f"{path}: is neither hazard.nc nor a member of runout (it holds {held}); write its map as a GeoTIFF: "
        f"gdal_translate NETCDF:{path.name}:VARIABLE map.tif"
    )


def _of_ensemble(path: Path, hazard: "xr.Dataset", reading: Reading) -> Product:
    percentile = percentile_of(reading.probability, hazard["percentile"].values, str(path))
    maps = {q: hazard[name].sel(percentile=percentile).values for q, name in OF_ENSEMBLE.items() if name in hazard}
    if ARRIVAL_PERCENTILE in hazard and reading.probability == 0.5:
        maps["arrival"] = arrival_or_never(hazard[ARRIVAL_PERCENTILE].sel(percentile=percentile).values, maps["thickness"])
    levels = hazard["thickness_threshold"].values.tolist()
    exceedance = hazard["thickness_exceedance_probability"].values
    flow = Flow(
        Grid.of_dataset(hazard, str(path)),
        {name: values.astype(np.float64) for name, values in maps.items()},
        {("thickness", level): values for level, values in zip(levels, exceedance, strict=True)},
        reading.probability,
        is_percentile=True,
    )
    elevation, release = hazard["elevation"].values, hazard["release_thickness"].values
    return Product(path, "ensemble", flow, tuple(levels), elevation, release, _bars(path.parent))


def member_product(path: Path, member: "xr.Dataset") -> Product:
    """Maps of a member as a product, without the ground of its site."""
    maps = {q: member[name].values.astype(np.float64) for q, name in OF_MEMBER.items() if name in member}
    if "arrival" in maps:
        maps["arrival"] = arrival_or_never(maps["arrival"], maps["thickness"])
    return Product(path, "member", Flow(Grid.of_dataset(member, str(path)), maps))


def _of_member(path: Path, member: "xr.Dataset") -> Product:
    found = member_product(path, member)
    assert found.flow is not None
    results = path.absolute().parent.parent if path.absolute().parent.name in ("members", "simulations") else path.parent
    if not (results / "terrain.nc").is_file() or not (results / "release.nc").is_file():
        return found
    terrain, release = netcdf.read(results / "terrain.nc"), netcdf.read(results / "release.nc")
    if not Grid.of_dataset(terrain, "terrain.nc").same_cells(found.flow.grid):
        return found
    return replace(found, elevation=terrain["elevation"].values, release=release["release_thickness"].values, bars=_bars(results))


def _bars(results: Path) -> ErrorBars:
    return ErrorBars(read_convergence(results))
