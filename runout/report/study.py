"""Reads the results folder for the report."""

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.errors import InputError, StorageError
from runout.forecast.numerical_error import require_error_bars
from runout.hazard.figures import FIGURES, Ledger
from runout.hazard.reach import representative
from runout.io.atomic import read_json
from runout.io.member_maps import MembersFile, member_table
from runout.io.probe_files import SITE_FILES
from runout.report.maps import Basemap
from runout.report.marks import Mark
from runout.report.structures import Loads, read_loads
from runout.report.wording import MINUS, number

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
STARTS = ("release", "inflow_lines", "inflow_areas")  # layers of outlines.gpkg
OBSERVED = ("observed_outline", "thalweg", "gauges")  # layers of outlines.gpkg
SENSITIVITY = "sensitivity/sensitivity.json"  # of `runout sensitivity`
PROBED = ("cross_sections", "probes")
LAYERS = (*STARTS, "obstacles", "structures", "friction_zones", *OBSERVED, *PROBED, "inundation")


@dataclass(frozen=True)
class Study:
    """Content of a report."""

    hazard: "xr.Dataset"  # maps over all members, ``hazard.nc``
    # one row a realization: weight, seed, sampled parameters, status, reason of failure and the figures of
    # :func:`runout.hazard.figures.member_figures`
    members: "pd.DataFrame"
    ledgers: dict[int, Ledger]  # mass and energy over time of the valid members
    basemap: Basemap  # terrain and outlines of the releases
    run: dict[str, Any]  # provenance, ``run.json``
    convergence: Mapping[str, Any] | None = None  # numerical error of the maps, ``convergence.json``; None if it was not computed
    loads: Loads | None = None  # forces on structures, ``structures.nc``; None without structures
    # percentiles of the series at the probes of site.yaml, by their kind; empty if it states none
    probes: "Mapping[str, xr.Dataset]" = field(default_factory=dict)
    # Sobol indices of these members, ``sensitivity/sensitivity.json``; empty without, or if they are of other members
    sensitivity: Mapping[str, Any] = field(default_factory=dict)
    # outlines within which the flow arrives with a probability: features with ``geometry`` and ``probability``
    inundation: list[dict[str, Any]] = field(default_factory=list)
    results: Path = Path()  # the folder that was read

    @property
    def valid(self) -> "pd.DataFrame":
        """Members that were simulated without failure."""
        return self.members[self.members["status"] == "valid"]

    @property
    def is_single(self) -> bool:
        """Whether there is one member alone, so that probabilities and percentiles say nothing."""
        return len(self.members) == 1

    @property
    def threshold(self) -> float:
        """Thickness [m] from which the flow reaches a place in all figures and first maps of the report: the lowest threshold."""
        return float(self.hazard["thickness_threshold"].values.min())


def read_study(results: Path) -> Study:
    """The study of a results folder.

    Raises StorageError if a file of the hazard stage is missing; the message names the file and the command that makes it.
    """
    from runout.io import netcdf

    with netcdf.LOCK:
        hazard = netcdf.read(_required(results, "hazard.nc"))
        table = member_table(_required(results, "members.nc"))
        run = _provenance(_required(results, "run.json"))
        ledgers = _ledgers(results / "members.nc", table)
    drawn = features(_required(results, "outlines.gpkg"), LAYERS)
    basemap = Basemap(
        hazard["x"].values,
        hazard["y"].values,
        hazard["elevation"].values,
        [feature["geometry"] for name in STARTS for feature in drawn[name]],
        [
            *(Mark(feature["geometry"], obstacle_label(feature)) for feature in drawn["obstacles"]),
            *(Mark(feature["geometry"], feature["name"]) for feature in drawn["structures"]),
        ],
        [Mark(feature["geometry"], zone_label(feature)) for feature in drawn["friction_zones"]],
        [Mark(feature["geometry"], feature.get("label", "")) for name in OBSERVED for feature in drawn[name]],
        [Mark(feature["geometry"], feature["name"]) for name in PROBED for feature in drawn[name]],
    )
    error, valid = Path(results) / "convergence.json", table[table["status"] == "valid"]
    return Study(
        hazard,
        table,
        ledgers,
        basemap,
        run,
        require_error_bars(_provenance(error, "verify --convergence"), error) if error.is_file() else None,
        read_loads(Path(results) / "structures.nc", representative(valid)) if len(valid) else None,
        _probes(results),
        _sensitivity(results, valid),
        drawn["inundation"],
        Path(results),
    )


def _sensitivity(results: Path, valid: "pd.DataFrame") -> dict[str, Any]:
    record = read_json(Path(results) / SENSITIVITY)
    return record if set(record.get("members", ())) == set(valid["file"]) and record.get("quantities") else {}


def _probes(results: Path) -> "dict[str, xr.Dataset]":
    """Percentiles of the series at the probes of site.yaml, as the hazard stage wrote them."""
    from runout.io import netcdf

    paths = {group: Path(results) / name for group, name in SITE_FILES.items()}
    return {group: netcdf.read(path) for group, path in paths.items() if path.is_file()}


def _required(results: Path, name: str) -> Path:
    path = Path(results) / name
    if not path.is_file():
        raise StorageError(f"{path}: there is no such file, so there is nothing to report; run `runout hazard` for this site first")
    return path


def _ledgers(path: Path, members: "pd.DataFrame") -> dict[int, Ledger]:
    """Ledgers of the valid members of a table, from ``members.nc``."""
    if missing := [name for name in FIGURES if name not in members]:
        raise StorageError(f"{path}: it has no {missing[0]} of the members; run `runout hazard` for this site again")
    with MembersFile(path) as stack:
        return {number: stack.member(number).ledger() for number in members.index[members["status"] == "valid"]}


def features(path: Path, layers: Collection[str]) -> dict[str, list[dict[str, Any]]]:
    """Attributes and ``geometry`` (shapely, map coordinates) of the features of layers, by layer; none of one that is not there."""
    from runout.io.opening import open_vector

    file = open_vector(path, InputError)
    present = file.layers()
    return {name: file.read(name)[0].to_dict("records") if name in present else [] for name in layers}


def obstacle_label(feature: Mapping[str, Any]) -> str:
    """Label of an obstacle: by how much it raises or lowers the ground."""
    height = float(feature["height_m"])
    return f"{'+' if height > 0 else MINUS}{number(abs(height))} m"


def zone_label(feature: Mapping[str, Any]) -> str:
    """Label of a friction zone: its factor or friction angle."""
    factor = float(feature["factor"]) if feature["factor"] is not None else math.nan
    if math.isfinite(factor):
        return f"friction \u00d7 {number(factor)}"
    own = feature.get("parameters")
    if isinstance(own, str):
        return ", ".join(f"{key.replace('_', ' ')} {number(value)}" for key, value in json.loads(own).items())
    return f"friction {number(float(feature['basal_friction_angle_deg']))}°"


def _provenance(path: Path, command: str = "hazard") -> dict[str, Any]:
    remedy = f"run `runout {command}` for this site again"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as cause:
        raise StorageError(f"{path}: not valid JSON ({cause}); {remedy}") from None
    if not isinstance(content, dict):
        raise StorageError(f"{path}: not what was written there; {remedy}")
    return content
