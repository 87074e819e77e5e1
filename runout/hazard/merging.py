"""Merged maps of several sites: largest values, probability and annual rate that any source reaches, and each source as a layer.

The members of different sites are not those of one ensemble. Sources count as independent: the probability that any of them reaches
a threshold, if all of them happen, is 1 - prod(1 - P_k); the annual rates of their scenarios add up. Classes of intensity and
levels of danger follow from the summed rates of the classes, by the return periods and the matrix of the scheme.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from runout.errors import ConfigError, InputError, StorageError
from runout.hazard.danger import INTENSITY, RATE, UNKNOWN, from_rates, scheme_record, with_classes
from runout.io import netcdf, source_code
from runout.io.atomic import read_json, write_json
from runout.io.fingerprint import Fingerprint, fingerprints
from runout.io.geotiff import write_cog
from runout.io.provenance import checksum, sha256
from runout.model.terrain import Terrain
from runout.quantities import ALL_QUANTITIES, FIRST_ARRIVAL

if TYPE_CHECKING:
    import xarray as xr

LOGGER = logging.getLogger("runout.merging")
MERGED, MAPS, RECORD = "merged.nc", "maps", "merged.json"
PROBABILITY, BY_SOURCE, MAIN, COUNT = "inundation_probability", "source_probability", "main_source", "sources_reached"
NEEDED = ("elevation", PROBABILITY, FIRST_ARRIVAL)  # maps of every product
SAME_LATTICE = 1e-3  # of a cell, by which the cells of two sites may differ
INDEPENDENT = "1 - product of 1 - P of the sources, which count as independent, if each of them happens"
SUM = "sum of the annual rates of the sources"
OF_SUM = "from the sum of the annual rates of the classes"


@dataclass(frozen=True)
class Grid:
    """Cells of the merged maps: west and north edge [m], size of a cell [m], rows and columns, and coordinate system (WKT)."""

    west: float
    north: float
    cell: tuple[float, float]
    shape: tuple[int, int]
    crs: str | None

    @classmethod
    def of(cls, maps: "xr.Dataset") -> "Grid":
        """Grid of the hazard maps of a site."""
        x, y = maps["x"].values, maps["y"].values
        dx, dy = float(x[-1] - x[0]) / (len(x) - 1), float(y[0] - y[-1]) / (len(y) - 1)
        crs = str(maps["crs"].attrs["crs_wkt"]) if "crs" in maps.variables else None
        return cls(float(x[0]) - dx / 2, float(y[0]) + dy / 2, (dx, dy), (len(y), len(x)), crs)

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """West, south, east and north [m]."""
        return self.west, self.north - self.shape[0] * self.cell[1], self.west + self.shape[1] * self.cell[0], self.north

    @classmethod
    def around(cls, grids: Sequence["Grid"]) -> "Grid":
        """Grid of the finest cells among some, which covers all of them."""
        finest = min(grids, key=lambda grid: grid.cell[0] * grid.cell[1])
        (dx, dy), edges = finest.cell, np.array([grid.edges for grid in grids])
        west = finest.west + dx * np.floor((edges[:, 0].min() - finest.west) / dx + SAME_LATTICE)
        north = finest.north + dy * np.ceil((edges[:, 3].max() - finest.north) / dy - SAME_LATTICE)
        columns = int(np.ceil((edges[:, 2].max() - west) / dx - SAME_LATTICE))
        rows = int(np.ceil((north - edges[:, 1].min()) / dy - SAME_LATTICE))
        return cls(float(west), float(north), finest.cell, (rows, columns), finest.crs)

    def offset(self, other: "Grid") -> tuple[int, int] | None:
        """Row and column of the first cell of another grid of the same cells; None if its cells are others."""
        (dx, dy), place = self.cell, ((self.north - other.north) / self.cell[1], (other.west - self.west) / self.cell[0])
        alike = abs(other.cell[0] / dx - 1.0) * other.shape[1] < SAME_LATTICE
        alike &= abs(other.cell[1] / dy - 1.0) * other.shape[0] < SAME_LATTICE
        row, column = (round(one) for one in place)
        return (row, column) if alike and max(abs(place[0] - row), abs(place[1] - column)) < SAME_LATTICE else None

    def nearest(self, other: "Grid") -> tuple[slice, slice, np.ndarray, np.ndarray]:
        """Rows and columns of this grid whose centres lie in another one, and the rows and columns of the other one there."""
        x = self.west + (np.arange(self.shape[1]) + 0.5) * self.cell[0]
        y = self.north - (np.arange(self.shape[0]) + 0.5) * self.cell[1]
        columns, rows = (
            np.floor((x - other.west) / other.cell[0]).astype(int),
            np.floor((other.north - y) / other.cell[1]).astype(int),
        )
        inside = [np.flatnonzero((at >= 0) & (at < size)) for at, size in ((rows, other.shape[0]), (columns, other.shape[1]))]
        spans = [slice(int(at[0]), int(at[-1]) + 1) if at.size else slice(0, 0) for at in inside]
        return spans[0], spans[1], rows[spans[0]], columns[spans[1]]

    def placed(self, other: "Grid") -> tuple[tuple[slice, slice], Callable[[np.ndarray], np.ndarray]]:
        """Rows and columns that another grid covers, and what takes its values (..., rows, columns) to them."""
        offset = self.offset(other)
        if offset is not None:
            return (
                slice(offset[0], offset[0] + other.shape[0]),
                slice(offset[1], offset[1] + other.shape[1]),
            ), lambda values: values
        *spans, rows, columns = self.nearest(other)
        return (spans[0], spans[1]), lambda values: values[..., rows[:, None], columns]


def write_merged(products: Sequence[Path], folder: Path, title: str = "Several sites") -> list[Path]:
    """Paths of ``merged.nc`` and of a GeoTIFF of each map, after merging hazard maps of several sites.

    Files that an earlier call made of the same content are kept.

    Parameters
    ----------
    products : sequence of Path
        Files ``hazard.nc``. The finest cells among them are those of the merged maps. A site whose cells lie elsewhere is brought
        to them by the nearest cell, and the file says so.
    folder : Path
        Where the files go.

    Raises
    ------
    ConfigError
        If the coordinate systems, the thresholds or the schemes of the sites differ.
    StorageError
        If a file cannot be read or written.
    """
    sources = _named(products)
    key = checksum([source_code.checksums().products, title, [[name, sha256(path)] for name, path in sources.items()]])
    if unchanged := _unchanged(folder, key):
        LOGGER.info("nothing to do: %s is up to date", folder / MERGED)
        return unchanged
    (folder / RECORD).unlink(missing_ok=True)
    grids = {name: Grid.of(read_product(path, NEEDED)) for name, path in sources.items()}
    _require_one_system(grids, sources)
    grid = Grid.around(list(grids.values()))
    resampled = [name for name, one in grids.items() if grid.offset(one) is None]
    sentence = f"brought to cells of {grid.cell[0]:g} x {grid.cell[1]:g} m by the nearest cell: {', '.join(resampled)}"
    if resampled:
        LOGGER.warning("%s", sentence)
    merged = _merged(sources, grid, title)
    merged.attrs |= {"changes_of_inputs": sentence} if resampled else {}
    paths = [*_write(merged, sources, grid, folder), *_write_rasters(merged, folder / MAPS)]
    files = {path.relative_to(folder).as_posix(): one.stored() for path, one in fingerprints(paths).items()}
    write_json({"key": key, "files": files}, folder / RECORD)
    return paths


def _unchanged(folder: Path, key: str) -> list[Path]:
    """Files of an earlier call with the same key, if all are as it wrote them; else none."""
    stored = read_json(folder / RECORD)
    files = stored.get("files") if stored.get("key") == key else None
    if not isinstance(files, Mapping):
        return []
    entries = {folder / name: Fingerprint.read(entry) for name, entry in files.items()}
    return list(entries) if all(entry and not entry.fault(path) for path, entry in entries.items()) else []


def product_of(path: Path) -> Path:
    """The hazard.nc of a site, of its results, or the file itself."""
    if path.is_file() and path.suffix == ".nc":
        return path
    folder = path.parent if path.is_file() else path
    return next((one for one in (folder / "hazard.nc", folder / "results" / "hazard.nc") if one.is_file()), folder / "hazard.nc")


def read_product(path: Path, names: Sequence[str] = ()) -> "xr.Dataset":
    """Hazard maps of a file, all or some; InputError if there is no file, StorageError if it holds no hazard maps."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; `runout run` makes it")
    other = StorageError(f"{path}: holds no hazard maps of a site; name the hazard.nc of its results")
    try:
        maps = netcdf.read(path, names=names)
    except StorageError as error:
        raise (other if isinstance(error.__cause__, KeyError) else error) from error.__cause__
    if not all(name in maps and maps[name].dims == netcdf.MAP_DIMS and min(maps[name].shape) > 1 for name in NEEDED):
        raise other
    return maps


def _named(products: Sequence[Path]) -> dict[str, Path]:
    """Products by the name of their site; names that occur again get a number."""
    products_by_name: dict[str, Path] = {}
    for path in products:
        if not path.is_file():
            raise InputError(f"{path}: no such file; `runout run` makes it")
        name = str(netcdf.read_attributes(path).get("site", path.parent.name))
        number = sum(one == name or one.startswith(f"{name} (") for one in products_by_name)
        products_by_name[f"{name} ({number + 1})" if number else name] = path
    if len(products_by_name) < 2:
        LOGGER.info("one site only: the merged maps are its own")
    return products_by_name


def _require_one_system(grids: Mapping[str, Grid], sources: Mapping[str, Path]) -> None:
    """Raise ConfigError unless all sites have one coordinate system."""
    from pyproj import CRS

    first, *others = grids
    for name in others:
        a, b = grids[first].crs, grids[name].crs
        if a != b and (a is None or b is None or CRS(a) != CRS(b)):
            systems = (f"{sources[one]}: {CRS(wkt).name if wkt else 'local coordinates'}" for one, wkt in ((first, a), (name, b)))
            raise ConfigError(f"the coordinate systems differ: {'; '.join(systems)}; give all sites elevations in one system")


class Plan(NamedTuple):
    """How a map is merged: what joins two values, the value of a source that does not arrive, and words."""

    join: Callable[[np.ndarray, np.ndarray], np.ndarray]
    absent: float
    words: str


def _any(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Probability of any of two independent events."""
    return 1.0 - (1.0 - a) * (1.0 - b)


def _plans(maps: "xr.Dataset") -> Iterator[tuple[str, Plan]]:
    """Name of each map that is merged, and how."""
    for quantity in ALL_QUANTITIES.values():
        if quantity.peak in maps:
            yield quantity.peak, Plan(np.maximum, 0.0, "largest of the sources")
        if quantity.exceedance("probability") in maps:
            yield quantity.exceedance("probability"), Plan(_any, 0.0, INDEPENDENT)
        if quantity.annual_exceedance in maps:
            yield quantity.annual_exceedance, Plan(np.add, 0.0, SUM)
    if RATE in maps:
        yield RATE, Plan(np.add, 0.0, SUM)
    yield PROBABILITY, Plan(_any, 0.0, INDEPENDENT)
    yield FIRST_ARRIVAL, Plan(np.fmin, np.nan, "earliest of the sources")


class _Joined:
    """The maps while sources are joined, on the merged grid.

    Attributes
    ----------
    plans : dict of str to Plan
        Maps that all sources so far have.
    values : dict of str to ndarray
        Values (..., rows, columns) of each.
    left_out : set of str
        Maps that only some sources have.
    """

    def __init__(self, grid: Grid, first: "xr.Dataset"):
        self.grid, self.plans = grid, dict(_plans(first))
        self.values = {name: np.full((*first[name].shape[:-2], *grid.shape), plan.absent) for name, plan in self.plans.items()}
        self.left_out: set[str] = set()
        self.elevation, self.largest = np.full(grid.shape, np.nan), np.zeros(grid.shape)
        self.main, self.count = np.zeros(grid.shape, np.int16), np.zeros(grid.shape, np.int16)

    def take(self, number: int, maps: "xr.Dataset") -> None:
        """Join the maps of a source."""
        place, to_grid = self.grid.placed(Grid.of(maps))
        for name in sorted((self.plans.keys() ^ dict(_plans(maps)).keys()) - self.left_out):
            LOGGER.warning("not all sites have %s, which is left out", name)
            self.left_out.add(name)
            self.plans.pop(name, None)
        ground, probability = to_grid(maps["elevation"].values), np.nan_to_num(to_grid(maps[PROBABILITY].values))
        self.elevation[place] = np.where(np.isnan(self.elevation[place]), ground, self.elevation[place])
        self.main[place] = np.where(probability > self.largest[place], number, self.main[place])
        self.largest[place] = np.maximum(self.largest[place], probability)
        self.count[place] += (probability > 0).astype(np.int16)
        for name, plan in self.plans.items():
            values = to_grid(maps[name].values.astype(np.float64))
            target = self.values[name][..., place[0], place[1]]
            target[...] = plan.join(target, values if np.isnan(plan.absent) else np.nan_to_num(values))

    def maps(self) -> Iterator[tuple[str, np.ndarray, str]]:
        """Name, values and words of each map; NaN where no site has an elevation."""
        for name, plan in self.plans.items():
            yield name, np.where(np.isfinite(self.elevation), self.values[name], np.nan), plan.words
        yield MAIN, self.main, ""
        yield COUNT, self.count, ""


def _merged(sources: Mapping[str, Path], grid: Grid, title: str) -> "xr.Dataset":
    """Merged maps on a grid; NaN where no site has a value."""
    paths = list(sources.values())
    first = read_product(paths[0])
    joined, remarks = _Joined(grid, first), dict[str, None]()
    for number, path in enumerate(paths, 1):
        maps = read_product(path)
        remarks |= dict.fromkeys((scheme_record(maps) or {}).get("remarks", ()))
        _require_thresholds(first, maps, path)
        _require_scheme(first, maps, path)
        joined.take(number, maps)
    dataset = _dataset(grid, joined.elevation, sources, title)
    for name, values, words in joined.maps():
        dims = tuple(map(str, first[name].dims[:-2])) if name in first else ()
        dataset = dataset.assign_coords({dim: first[dim] for dim in dims if dim not in dataset.coords})
        netcdf.add_map(dataset, name, values, dims)
        dataset[name].attrs |= {"comment": f"over the sources: {words}"} if words else {}
    record = scheme_record(first)
    return _with_danger(dataset, record | {"remarks": list(remarks)}) if record and RATE in dataset else dataset


def _with_danger(dataset: "xr.Dataset", record: Mapping[str, Any]) -> "xr.Dataset":
    """The merged maps with classes and levels of danger by the record of a scheme, from the annual rates of the classes."""
    rates = dataset[RATE].copy()
    unknown = ~np.isfinite(rates.values).all(axis=0)
    dataset = with_classes(dataset, record)
    dataset[RATE] = rates
    for name, values in from_rates(np.nan_to_num(rates.values), record).items():
        dataset[name].values[...] = np.where(unknown, UNKNOWN, values)
        dataset[name].attrs["comment"] = f"over the sources: {OF_SUM}"
    return dataset


def _require_scheme(first: "xr.Dataset", other: "xr.Dataset", path: Path) -> None:
    """Raise ConfigError if two sites have danger classes of different schemes; remarks on the comparison may differ."""
    one, two = ({**(scheme_record(maps) or {}), "remarks": None} for maps in (first, other))
    if one != two and INTENSITY in first and INTENSITY in other:
        titles = f"{two.get('title')!r}, that of the first site {one.get('title')!r}"
        raise ConfigError(f"{path}: its scheme of danger classes is {titles}; state the same scheme, unchanged, in all sites")


def _require_thresholds(first: "xr.Dataset", other: "xr.Dataset", path: Path) -> None:
    """Raise ConfigError if two sites have other thresholds of a quantity."""
    for quantity in ALL_QUANTITIES.values():
        name = quantity.threshold
        if name in first.coords and name in other.coords and not np.array_equal(first[name].values, other[name].values):
            a, b = (", ".join(f"{one:g}" for one in maps[name].values) for maps in (first, other))
            raise ConfigError(f"{path}: its {quantity.setting} are {b}, those of the first site {a}; state the same in all sites")


def _dataset(grid: Grid, elevation: np.ndarray, sources: Mapping[str, Path], title: str) -> "xr.Dataset":
    terrain = Terrain(elevation, grid.cell, grid.west, grid.edges[1], grid.crs, source="merged sites")
    dataset = netcdf.map_dataset(terrain, {"elevation": elevation}, title=f"{title}: merged hazard maps")
    dataset.attrs |= {
        "summary": f"Hazard maps of {len(sources)} sources, each of which has an ensemble of its own. "
        "Probabilities are conditional on the release of every source; the sources count as independent.",
    }
    numbers = np.arange(1, len(sources) + 1, dtype=np.int32)
    return dataset.assign_coords(source=numbers, source_name=("source", np.array(list(sources), dtype=object)))


def _write(merged: "xr.Dataset", sources: Mapping[str, Path], grid: Grid, folder: Path) -> list[Path]:
    """Write ``merged.nc`` and a GeoTIFF of the probability of each source.

    The probabilities are read and written one by one, so that memory does not grow with the sources.
    """
    import netCDF4

    from runout.io.atomic import whole_file
    from runout.io.map_layers import add_layers, put
    from runout.variables import VARIABLES

    folder.mkdir(parents=True, exist_ok=True)
    paths, one = [path := folder / MERGED], merged[[PROBABILITY, *(["crs"] if "crs" in merged.variables else [])]].copy(deep=True)
    with netcdf.LOCK, whole_file(path) as temporary:
        netcdf.write(merged, temporary)
        with netcdf.writing(path), netCDF4.Dataset(temporary, "a") as file:
            mapped = {"grid_mapping": "crs"} if "crs" in file.variables else {}
            attributes = VARIABLES[BY_SOURCE].attributes() | mapped | {"coordinates": "source_name"}
            layers = add_layers(file, BY_SOURCE, attributes, ("source",))
            for number, (name, source) in enumerate(sources.items()):
                one[PROBABILITY].values[...] = _probability(source, grid)
                put(layers, one[PROBABILITY].values, (number,))
                paths.append(write_cog(one, PROBABILITY, folder / MAPS / "sources" / f"{name}.tif"))
    return paths


def _probability(path: Path, grid: Grid) -> np.ndarray:
    """Probability of inundation (rows, columns) by a source; 0 beyond its site."""
    maps = netcdf.read(path, names=("elevation", PROBABILITY))  # the others were read before
    place, take = grid.placed(Grid.of(maps))
    values = np.zeros(grid.shape, np.float32)
    values[place] = np.nan_to_num(take(maps[PROBABILITY].values))
    return values


def _write_rasters(merged: "xr.Dataset", folder: Path) -> list[Path]:
    """A GeoTIFF of each merged map, at each threshold."""
    paths = []
    for name in map(str, merged.data_vars):
        dims = merged[name].dims if name not in ("crs", "elevation") else ()
        if dims[-2:] != netcdf.MAP_DIMS:
            continue
        for index in np.ndindex(merged[name].shape[:-2]):
            chosen = {str(dim): float(merged[dim].values[k]) for dim, k in zip(dims[:-2], index, strict=True)}
            stem = "_over_".join([name, *(f"{value:g}" for value in chosen.values())])
            paths.append(write_cog(merged, name, folder / f"{stem}.tif", **chosen))
    return paths
