"""Products for sites with structures: structures.nc, and the layers ``structures`` and ``facades`` of outlines.gpkg.

Forces are maxima, percentiles and probabilities over the members for each facade, volumes those that pass a dam.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.site_files import may_hold_bodies
from runout.errors import StorageError
from runout.hazard.members import Ensemble
from runout.hazard.order import weighted_percentiles
from runout.io import netcdf
from runout.io.atomic import whole_file
from runout.io.member_maps import MemberMaps
from runout.io.netcdf import study_attributes
from runout.model.terrain import Terrain
from runout.simulation.structure_forces import AXES, GROUP, SERIES
from runout.variables import FILL, VARIABLES

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site
    from runout.structures.solid import Solid

MAXIMA = ("max_facade_force", "max_facade_moment", "max_facade_pressure", "max_facade_high_pressure")
FACADE = ("structure_name", "facade_name", "facade_area")
FILE = "structures.nc"
LAYERS = {"structures": "MultiPolygon", "facades": "MultiLineString"}


@dataclass
class FacadeRecords:
    """Maxima of each member and facade, gathered from the files of the members."""

    facades: "xr.Dataset | None" = None  # names and areas; None before the first member
    maxima: dict[str, list[np.ndarray]] = field(default_factory=dict)  # arrays (facades,) of the members in their order
    lengths: list[int] = field(default_factory=list)  # records of each member

    def add(self, path: Path) -> None:
        """Add the member of a file.

        Raises StorageError if the file has no forces, or those of other facades.
        """
        series = netcdf.read(path, GROUP)
        facades = series[list(FACADE)]
        if self.facades is not None and not facades.equals(self.facades):
            raise StorageError(f"{path}: its structures are not those of the other members; remove it and run again")
        self.facades = facades
        self.lengths.append(series.sizes["record"])
        for name, values in maxima_of(series).items():
            self.maxima.setdefault(name, []).append(values)


def maxima_of(series: "xr.Dataset") -> dict[str, np.ndarray]:
    """Maxima over time (facades,) of the size of force and moment and of both pressures, and the time of the largest force."""
    size = {what: np.sqrt(sum(series[f"facade_{what}_{axis}"].values ** 2 for axis in AXES)) for what in ("force", "moment")}
    force = size["force"]
    time = np.where(force.max(0) > 0, series["record_time"].values[force.argmax(0)], np.nan)
    pressures = {f"max_{name}": series[name].values.max(0) + 0.0 for name in ("facade_pressure", "facade_high_pressure")}
    sizes = {f"max_facade_{what}": values.max(0) for what, values in size.items()}
    return sizes | pressures | {"time_of_max_facade_force": time}


def facade_dataset(records: FacadeRecords, ensemble: Ensemble, percentiles: Sequence[float], thresholds: Sequence[float]) -> Any:
    """Maxima of the members, and percentiles and exceedance probabilities over them, by facade.

    Parameters
    ----------
    percentiles : sequence of float
        [%]
    thresholds : sequence of float
        Thresholds of the mean pressure on a facade [Pa].
    """
    assert records.facades is not None  # the ensemble has valid members
    dataset, places = records.facades.copy(), [k for k, m in enumerate(ensemble.table.index) if m in ensemble.files]
    dataset = dataset.assign_coords(
        realization=ensemble.table.index.to_numpy(np.int32), percentile=list(map(float, percentiles)),
        pressure_threshold=list(map(float, thresholds)),
    )  # fmt: skip
    for name, rows in records.maxima.items():
        every = np.full((len(ensemble.table), len(rows[0])), np.nan)
        every[places] = rows
        dataset[name] = (("realization", "facade"), every)
        if name in MAXIMA:
            over = weighted_percentiles(np.array(rows), ensemble.weights, percentiles)
            dataset[f"{name[len('max_') :]}_at_percentile"] = (("percentile", "facade"), over)
    pressure = np.array(records.maxima["max_facade_pressure"])
    reached = [ensemble.weights @ (pressure >= threshold) for threshold in thresholds]
    chance = np.array(reached).reshape(len(thresholds), pressure.shape[1])  # there may be no threshold
    dataset["facade_pressure_probability"] = (("facade", "pressure_threshold"), chance.T)
    return dataset


def write_facades(dataset: "xr.Dataset", lengths: Sequence[int], ensemble: Ensemble, path: Path) -> Path:
    """Write ``structures.nc``: a dataset, and the series of every member (realization, record, facade), one after the other."""
    import netCDF4

    places = [k for k, m in enumerate(ensemble.table.index) if m in ensemble.files]
    with netcdf.LOCK, whole_file(path) as temporary:
        netcdf.write(dataset, temporary)
        with netCDF4.Dataset(temporary, "a") as file:
            file.createDimension("record", max(lengths))
            stacks = {name: _stack(file, name, ("realization", "record", "facade")) for name in SERIES}
            times = _stack(file, "record_time", ("realization", "record"))
            for place, member in zip(places, ensemble.files.values(), strict=True):
                series = netcdf.read(member, GROUP)
                times[place, : series.sizes["record"]] = series["record_time"].values
                for name, stack in stacks.items():
                    stack[place, : series.sizes["record"]] = series[name].values
    return path


def _stack(file: Any, name: str, dims: tuple[str, ...]) -> Any:
    """A new variable of the series, missing where a member has no further records."""
    variable = file.createVariable(name, "f4" if len(dims) > 2 else "f8", dims, zlib=True, complevel=1, fill_value=FILL)
    variable.setncatts(VARIABLES[name].attributes())
    return variable


def overtopping(areas: Mapping[str, np.ndarray], ensemble: Ensemble, percentiles: Sequence[float], least: float) -> Any:
    """Volume (realization, area) [m3] that lies in protected areas at the end, its percentiles, and the probability of any.

    Parameters
    ----------
    areas : mapping of str to ndarray (rows, columns)
        Covered area [m2] of each cell of the raster, by the name of the protected area.
    least : float
        Smallest volume that counts as overtopping [m3].
    """
    import xarray as xr

    volumes = np.full((len(ensemble.table), len(areas)), np.nan)
    places = [k for k, m in enumerate(ensemble.table.index) if m in ensemble.files]
    for place, path in zip(places, ensemble.files.values(), strict=True):
        with MemberMaps(path) as member:
            deposit = np.nan_to_num(member.layer("deposit_thickness", None))
        volumes[place] = [float((deposit * area).sum()) for area in areas.values()]
    valid = volumes[places]
    return xr.Dataset(
        {
            "protected_area": ("area", np.array(list(areas), dtype=object)),
            "overtopping_volume": (("realization", "area"), volumes),
            "overtopping_volume_at_percentile": (
                ("percentile", "area"),
                weighted_percentiles(valid, ensemble.weights, percentiles),
            ),
            "overtopping_probability": ("area", ensemble.weights @ (valid >= least)),
        }
    )


@dataclass(frozen=True)
class StructureProducts:
    """What was written for structures; empty for a site without any."""

    paths: tuple[Path, ...] = ()  # files
    # further layers of ``outlines.gpkg``: type of geometry, and rows with ``geometry``
    layers: Mapping[str, tuple[str, list[dict[str, Any]]]] = field(default_factory=dict)
    changes: tuple[str, ...] = ()  # what was changed or assumed of the structures


def write_structures(
    site: "Site", ensemble: Ensemble, terrain: Terrain, attrs: Mapping[str, Any], results: Path
) -> StructureProducts:
    """Write ``structures.nc`` of a site with structures, after an older one was removed.

    Raises StorageError if a member's file has no forces, or the file cannot be written. Raises StructureError or ReleaseError if
    structures or protected areas cannot be used.
    """
    path = results / FILE
    bodies = site.files.bodies() if may_hold_bodies(site.settings) else None
    if bodies is None or not bodies.solids:
        path.unlink(missing_ok=True)
        return StructureProducts()
    settings = site.settings.hazard
    records = FacadeRecords()
    for member in ensemble.files.values():
        records.add(member)
    dataset = facade_dataset(records, ensemble, settings.percentiles, settings.pressure_thresholds)
    areas = site.files.protected_areas()
    if areas:
        least = site.settings.simulation.arrival_threshold * terrain.cell_area
        dataset = dataset.merge(overtopping(areas, ensemble, settings.percentiles, least))
    attributes = {key: value for key, value in attrs.items() if key not in study_attributes({})}
    dataset = dataset.assign_attrs({"Conventions": "CF-1.11", "title": f"{site.name}: forces on structures"} | attributes)
    write_facades(dataset, records.lengths, ensemble, path)
    return StructureProducts((path,), _layers(bodies.solids, dataset, terrain), bodies.changes)


def _layers(solids: "Sequence[Solid]", dataset: "xr.Dataset", terrain: Terrain) -> dict[str, tuple[str, list[dict[str, Any]]]]:
    """Rows of the layers: outlines of structures, and lines of facades, each with its largest values."""
    from runout.structures.solid import facade_lines, footprint

    of_structure, facades = {solid.name: solid for solid in solids}, []
    for k, (owner, name) in enumerate(zip(dataset["structure_name"].values, dataset["facade_name"].values, strict=True)):
        solid = of_structure[str(owner)]
        columns = {"structure": str(owner), "facade": str(name), **_columns(dataset.isel(facade=k))}
        facades.append({**columns, "geometry": facade_lines(solid, solid.facades.index(str(name)), terrain)})
    outlines = [_outline_row(name, solid, facades, footprint(solid, terrain)) for name, solid in of_structure.items()]
    return {"structures": (LAYERS["structures"], outlines), "facades": (LAYERS["facades"], facades)}


def _outline_row(name: str, solid: "Solid", facades: list[dict[str, Any]], geometry: Any) -> dict[str, Any]:
    """A structure with the largest pressures and force of its facades."""
    own = [row for row in facades if row["structure"] == name]
    largest = {f"max_{key}": max((row[f"max_{key}"] for row in own), default=0.0) for key in ("force_n", "pressure_pa")}
    return {"name": name, "top_elevation_m": float(solid.box[1, 2]), **largest, "geometry": geometry}


def _columns(facade: "xr.Dataset") -> dict[str, float]:
    """Columns of a facade: its area, the largest of any member with its time, percentiles and probabilities over the members."""
    quantities = (("force", "n"), ("moment", "nm"), ("pressure", "pa"), ("high_pressure", "pa"))
    columns = {"area_m2": float(facade["facade_area"])}
    for name, unit in quantities:
        columns[f"max_{name}_{unit}"] = float(facade[f"max_facade_{name}"].max())
        over = facade[f"facade_{name}_at_percentile"]
        columns |= {f"{name}_{unit}_p{p:g}": float(v) for p, v in zip(over["percentile"].values, over.values, strict=True)}
    force = facade["max_facade_force"].fillna(-1.0)
    columns["time_of_max_force_s"] = float(facade["time_of_max_facade_force"].values[int(np.argmax(force.values))])
    chance = facade["facade_pressure_probability"]
    reached = zip(chance["pressure_threshold"].values, chance.values, strict=True)
    return columns | {f"probability_of_{threshold:g}_pa": float(p) for threshold, p in reached}
