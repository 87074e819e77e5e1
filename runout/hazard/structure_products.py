"""Products for sites with structures: structures.nc, and the layers ``structures`` and ``facades`` of outlines.gpkg."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.site_files import may_hold_bodies
from runout.hazard.facades import FacadeRecords, facade_dataset, overtopping, write_facades
from runout.hazard.members import Ensemble
from runout.io.netcdf import study_attributes
from runout.model.terrain import Terrain

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site
    from runout.structures.solid import Solid

FILE = "structures.nc"
LAYERS = {"structures": "MultiPolygon", "facades": "MultiLineString"}


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
