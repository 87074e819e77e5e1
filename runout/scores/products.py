"""Reads what is compared: results of a site, members, rasters, outlines and points."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ObservationError
from runout.forecast.numerical_error import read_convergence
from runout.io import netcdf
from runout.io.boundary import exists
from runout.io.member_maps import read_maps
from runout.io.opening import open_netcdf, open_raster
from runout.io.polygons import read_frame
from runout.io.units import OTHER_UNITS, factor_to, is_stated
from runout.model.terrain import Terrain
from runout.quantities import ARRIVAL_PERCENTILE, QUANTITIES
from runout.scores.error_bars import ErrorBars
from runout.scores.flow import IN_FILES, OF_BED_ENSEMBLE, OF_BED_MEMBER, OF_ENSEMBLE, OF_MEMBER, TITLES, Flow, percentile_of
from runout.scores.grid import Grid
from runout.scores.points import POINT_UNITS, Gauges, arrival_or_never
from runout.scores.read import Nodata, observation_errors, read_gauges, read_map, read_outline

if TYPE_CHECKING:
    import xarray as xr

VECTORS = (".gpkg", ".shp", ".geojson", ".json", ".fgb", ".gdb")
NAMED = {name: name for name in (*QUANTITIES, "arrival", *OF_BED_MEMBER) if name != "thickness"}  # by words of the names of files
NAMED |= {"deposits": "deposit", "deposition": "deposit", "velocity": "speed", "dod": "change"}
THICK = {"thickness", "depth", "flow"}  # a flow's, unless another word is there
OTHER = {"probability", "exceedance", "error", "difference"}  # maps of which no score is made


@dataclass(frozen=True)
class Reading:
    """How products are read."""

    # what a raster shows, a name of :data:`runout.scores.flow.UNITS`; by default what its name or unit says
    quantity: str | None = None
    probability: float = 0.5  # outline of an ensemble
    nodata: Nodata = Nodata.UNKNOWN  # what cells of a raster without a value mean


@dataclass(frozen=True)
class Product:
    """One of two things that are compared."""

    path: Path
    kind: str  # "ensemble", "member", "raster" or "vector"
    flow: Flow | None = None  # its maps; None of a vector file, which is read on the grid of the other product
    thresholds: tuple[float, ...] = ()  # thicknesses [m] that the site states
    # elevation, release (rows, columns): ground and thickness of the release [m] on the grid, where a site holds them
    elevation: np.ndarray | None = None
    release: np.ndarray | None = None
    bars: ErrorBars = field(default_factory=lambda: ErrorBars({}))  # numerical errors of the site
    changes: tuple[str, ...] = ()  # what was changed on the way in

    @property
    def name(self) -> str:
        """Name for tables and maps: the last parts of the path."""
        last = [part for part in self.path.absolute().parts if part not in ("results", "hazard.nc", "members", "simulations")]
        return "/".join(last[-2:]) if self.kind == "member" else Path(last[-1]).stem

    @property
    def is_of_runout(self) -> bool:
        """Whether its thickness is vertical for certain."""
        return self.kind in ("ensemble", "member")


@dataclass(frozen=True)
class VectorContent:
    """An outline (shapely, map coordinates) or gauges, and what was changed on the way in."""

    outline: Any = None
    gauges: Gauges | None = None
    changes: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """ "outline" or "points"."""
        return "outline" if self.gauges is None else "points"


def read_product(path: Path, reading: Reading) -> Product:
    """What a path holds: a site or results folder, ``hazard.nc``, the file of a member or of :func:`runout.simulate`, or a raster.

    Raises ObservationError if it is none of these, or cannot be read.
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


def raster_quantity(path: Path) -> tuple[str, tuple[str, ...]]:
    """Name in :data:`runout.scores.flow.UNITS` of what a raster shows, and a sentence where neither name nor unit says it.

    Raises ObservationError if its name says several quantities, or a map of which no score is made.
    """
    words = set(re.split(r"[^a-z]+", path.stem.lower()))
    named = {quantity for name, quantity in NAMED.items() if words.issuperset(name.split("_"))}
    if len(named) > 1 or words & OTHER:
        shown = " and ".join(sorted(named if len(named) > 1 else words & OTHER))
        raise ObservationError(f"{path}: its name says {shown}; state what it shows with --quantity")
    quantity = next(iter(named), "thickness" if words & THICK else _by_unit(path))
    if quantity is not None:
        return quantity, ()
    note = f"{path}: taken as {TITLES['thickness']}, since neither name nor unit says what it shows; --quantity states it."
    return "thickness", (note,)


def _by_unit(path: Path) -> str | None:
    """The one quantity that has the unit of a raster; None without a unit, or if several have it."""
    with open_raster(path, ObservationError) as file:
        unit = file.units[0] if file.units else None
    fitting = [name for name, si in IN_FILES.items() if si in OTHER_UNITS and is_stated(unit) and factor_to(si, unit)]
    return fitting[0] if len(fitting) == 1 else None


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
    variables = ", ".join(sorted(names)[:6]) or "nothing"
    raise ObservationError(
        f"{path}: is neither hazard.nc nor a member of runout (it holds {variables}); write its map as a GeoTIFF: "
        f"gdal_translate NETCDF:{path.name}:VARIABLE map.tif"
    )


def _of_ensemble(path: Path, hazard: "xr.Dataset", reading: Reading) -> Product:
    percentile = percentile_of(reading.probability, hazard["percentile"].values, str(path))
    maps = {
        q: hazard[name].sel(percentile=percentile).values for q, name in (OF_ENSEMBLE | OF_BED_ENSEMBLE).items() if name in hazard
    }
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
    maps = {q: member[name].values.astype(np.float64) for q, name in (OF_MEMBER | OF_BED_MEMBER).items() if name in member}
    if "arrival" in maps:
        maps["arrival"] = arrival_or_never(maps["arrival"], maps["thickness"])
    return Product(path, "member", Flow(Grid.of_dataset(member, str(path)), maps))


def _of_member(path: Path, member: "xr.Dataset") -> Product:
    product = member_product(path, member)
    assert product.flow is not None
    results = path.absolute().parent.parent if path.absolute().parent.name in ("members", "simulations") else path.parent
    if not (results / "terrain.nc").is_file() or not (results / "release.nc").is_file():
        return product
    terrain, release = netcdf.read(results / "terrain.nc"), netcdf.read(results / "release.nc")
    if not Grid.of_dataset(terrain, "terrain.nc").same_cells(product.flow.grid):
        return product
    return replace(product, elevation=terrain["elevation"].values, release=release["release_thickness"].values, bars=_bars(results))


def _bars(results: Path) -> ErrorBars:
    return ErrorBars(read_convergence(results))


def read_vector(path: Path, terrain: Terrain, layer: str | None = None) -> VectorContent:
    """Outline of the polygons of a file, or its points with the attributes that are named as quantities.

    Raises ObservationError if it holds lines, several kinds of geometries, or points without such attributes.
    """
    with observation_errors():
        frame, _ = read_frame(path, layer, "observation")
    kinds = {str(geometry.geom_type).removeprefix("Multi") for geometry in frame.geometry if geometry is not None}
    if kinds == {"Polygon"}:
        outline, changes = read_outline(path, terrain, layer)
        return VectorContent(outline, None, changes)
    if kinds != {"Point"}:
        geometries = " and ".join(sorted(kinds)) or "no geometries"
        remedy = "a thalweg goes to --thalweg" if kinds == {"LineString"} else "write one kind into a file"
        raise ObservationError(f"{path}: holds {geometries}; an outline is polygons, gauges are points, {remedy}")
    named = {name: name for name in POINT_UNITS if name in frame.columns}
    if not named:
        have = ", ".join(map(str, frame.columns.drop(frame.geometry.name))) or "none"
        raise ObservationError(f"{path}: its points have none of the attributes {', '.join(POINT_UNITS)}; they have: {have}")
    gauges, changes = read_gauges(path, terrain, named, layer)
    return VectorContent(None, gauges, changes)
