"""Ground, peaks, arrival and deposit along a line, of one member or as percentiles over the members of an ensemble."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.order import normalised
from runout.hazard.probe_series import PERCENTILES, percentiles_of
from runout.io.grid import crs_as_variable, grid_dataset
from runout.io.member_maps import MemberMaps
from runout.io.probe_files import PERCENTILE, place_coordinates
from runout.model.probes import CrossSection, cell_of, ground_at
from runout.model.terrain import Terrain
from runout.quantities import ARRIVAL
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

DISTANCE = "distance"
ROUND_OFF = 1e-9  # of summed weights
PIECES = 2  # values along the shorter side of a cell, at least


@dataclass(frozen=True)
class ProfileLine:
    """Places along a line."""

    name: str
    distance: np.ndarray  # (n,): length along the line [m], from its first vertex to its last
    places: np.ndarray  # (n, 2): map coordinates [m]
    cells: tuple[np.ndarray, np.ndarray]  # row and column of the raster
    ground: np.ndarray  # (n,): elevation [m], bilinear between the cell centres; NaN beside cells without elevation
    bed: np.ndarray  # (n,): the same without the mass that is excavated; flow and deposit lie on it

    @classmethod
    def of(cls, line: CrossSection, terrain: Terrain, excavated: np.ndarray) -> "ProfileLine":
        """Places on a line, half a cell apart or closer, its vertices among them; ``excavated`` (rows, columns) [m]."""
        vertices = np.array(line.vertices)
        middles, _, lengths = line.samples(min(terrain.cell_size) / PIECES)
        ends = np.cumsum(lengths)
        at_vertices = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(vertices, axis=0).T))])
        distance = np.concatenate([ends - 0.5 * lengths, at_vertices])
        order = np.argsort(distance, kind="stable")
        places = np.concatenate([middles, vertices])[order]
        row, column = cell_of(terrain, places)
        rows, columns = terrain.shape
        cells = row.clip(0, rows - 1), column.clip(0, columns - 1)
        dug = replace(terrain, elevation=terrain.elevation - excavated)
        return cls(line.name, distance[order], places, cells, ground_at(terrain, places), ground_at(dug, places))

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the raster around the line."""
        row, column = self.cells
        return slice(int(row.min()), int(row.max()) + 1), slice(int(column.min()), int(column.max()) + 1)

    def read(self, member: MemberMaps, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Values (n,) of the cells under the line, of the maps of a member."""
        rows, columns = self.window
        at = self.cells[0] - rows.start, self.cells[1] - columns.start
        return {name: member.within(name, (rows, columns))[at] for name in names}


def member_profiles(path: Path, lines: Sequence[CrossSection], terrain: Terrain, excavated: np.ndarray) -> "list[xr.Dataset]":
    """A profile along each line, of the member in a file; ``excavated`` (rows, columns) [m] is what its releases take away."""
    profile_lines = [ProfileLine.of(line, terrain, excavated) for line in lines]
    along = _values([path], profile_lines, terrain)
    return [_dataset(line, terrain, values) for line, (values,) in zip(profile_lines, along, strict=True)]


def ensemble_profiles(
    files: Sequence[Path],
    weights: Sequence[float] | np.ndarray,
    lines: Sequence[CrossSection],
    terrain: Terrain,
    excavated: np.ndarray,
    percentiles: Sequence[float] = PERCENTILES,
) -> "list[xr.Dataset]":
    """Percentiles over the members along each line, from their maps cell by cell; the files are read once.

    A percentile is that of each place for itself: the smallest value at which the summed weight reaches it. Members that do not
    arrive count as infinity in the arrival time. ``excavated`` (rows, columns) [m] is what releases with a volume factor of 1 take
    away. No member has a profile of percentiles: the attribute ``median_front`` is the position in ``files`` of the member whose
    front along the line is the median.
    """
    profile_lines, profiles = [ProfileLine.of(line, terrain, excavated) for line in lines], []
    shares = normalised(weights, len(files))
    for line, members in zip(profile_lines, _values(files, profile_lines, terrain), strict=True):
        values = {}
        for name in members[0]:
            stacked = np.stack([member[name] for member in members])
            values[name] = percentiles_of(stacked, shares, percentiles)
        arrived = np.stack([m[ARRIVAL] for m in members]) >= 0.0
        values["arrival_probability"] = (arrived * shares[:, None]).sum(axis=0).clip(0.0, 1.0)
        of_all = {"members": len(files), "median_front": _median_front(line, members, shares)}
        profiles.append(_dataset(line, terrain, values, percentiles).assign_attrs(of_all))
    return profiles


def _median_front(line: ProfileLine, members: Sequence[Mapping[str, np.ndarray]], weights: np.ndarray) -> int:
    """Position of the member whose farthest place along a line with an arrival is the weighted median of all."""
    fronts = np.array([line.distance[member[ARRIVAL] >= 0.0].max(initial=-1.0) for member in members])
    order = np.argsort(fronts, kind="stable")
    return int(order[np.searchsorted(np.cumsum(weights[order]), 0.5 - ROUND_OFF)])


def _values(files: Sequence[Path], lines: list[ProfileLine], terrain: Terrain) -> list[list[dict[str, np.ndarray]]]:
    """Values along each line of each member."""
    by_line: list[list[dict[str, np.ndarray]]] = [[] for _ in lines]
    grid = grid_dataset(terrain)
    for path in files:
        with MemberMaps(path) as member:
            member.require_grid(grid, terrain.source)
            for line, by_member in zip(lines, by_line, strict=True):
                by_member.append(line.read(member, member.held()))
    return by_line


def _dataset(
    line: ProfileLine, terrain: Terrain, values: Mapping[str, np.ndarray], percentiles: Sequence[float] = ()
) -> "xr.Dataset":
    """Values along a line; unknown where the ground has no elevation."""
    import xarray as xr

    coordinates = {DISTANCE: (DISTANCE, line.distance), **place_coordinates(line.places, DISTANCE, terrain)}
    if len(percentiles):
        coordinates[PERCENTILE] = (PERCENTILE, np.array(percentiles, float))
    dataset = crs_as_variable(xr.Dataset(coords=coordinates, attrs={"line": line.name}))
    known = np.isfinite(terrain.elevation[line.cells])
    for name, along_line in {"ground_elevation": line.ground, "bed_elevation": line.bed, **values}.items():
        variable = VARIABLES[name]
        dims = (PERCENTILE, DISTANCE)[2 - along_line.ndim :]
        dataset[name] = (dims, np.where(known, along_line, np.nan).astype(variable.dtype), variable.attributes())
        dataset[name].encoding |= {"coordinates": "x y"} | ({"grid_mapping": "crs"} if "crs" in dataset else {})
        if PERCENTILE in dims:
            dataset[name].attrs["long_name"] = f"percentile over the members of the {variable.long_name}"
    return dataset


def profile_table(dataset: "xr.Dataset") -> "pd.DataFrame":
    """A row for each place: distance, coordinates, and a column for each quantity (and percentile) with its unit."""
    import pandas as pd

    columns = {f"{name} [m]": dataset[name].values for name in (DISTANCE, "x", "y")}
    for name, variable in dataset.drop_vars("crs", errors="ignore").data_vars.items():
        units = VARIABLES[str(name)].units
        if PERCENTILE in variable.dims:
            columns |= {f"{name} p{q:g} [{units}]": variable.sel(percentile=q).values for q in dataset[PERCENTILE].values}
        else:
            columns[f"{name} [{units}]"] = variable.values
    return pd.DataFrame(columns)
