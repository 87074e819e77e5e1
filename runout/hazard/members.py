"""Which members of an ensemble are valid, and their maps stacked into one file."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.parameter_variables import parameter_variable
from runout.ensemble.member import failure_file, members_folder
from runout.errors import StorageError
from runout.hazard.figures import WITHOUT_LEDGER, member_figures
from runout.hazard.frequency import Frequencies, shares
from runout.hazard.reach import Reach
from runout.io import netcdf
from runout.io.atomic import read_json, whole_file
from runout.io.grid import grid_dataset
from runout.io.map_layers import add_layers, put, whole_chunks
from runout.io.member_maps import BED_MAPS, LEDGERS, MEMBER_MAPS, RECORDS, MemberMaps, MembersFile
from runout.model.joint_conditions import ATTRIBUTE
from runout.model.terrain import Terrain
from runout.quantities import CHANGE, MET
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import netCDF4
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True)
class Ensemble:
    """Planned members of an ensemble, with the files of the valid ones and the reasons of the failed ones."""

    table: "pd.DataFrame"  # one row a planned member, indexed by its number: sampled parameters, ``weight``, ``seed`` and ``file``
    files: Mapping[int, Path]  # files of the valid members
    failed: Mapping[int, str]  # reasons of the failed ones
    growth: str = ""  # how an ensemble with a tolerance found its size; empty for others

    @classmethod
    def of(cls, results: Path, table: "pd.DataFrame", states: Mapping[int, str] | None = None) -> "Ensemble":
        """The members of a results folder, whose files the column ``file`` of the table names.

        ``states`` says of each member "done", "failed" or "left"; a file of a member that is not done does not count. Without it
        the files decide. Reasons come from ``*.failed.json``.

        Raises ValueError if the table names no files.
        """
        if "file" not in table:
            raise ValueError("the table of members names no files; make it with runout.ensemble.member.planned_table")
        paths = {int(m): members_folder(results) / name for m, name in table["file"].items()}
        reasons = {m: _stated_reason(failure_file(path)) for m, path in paths.items()}
        if states is None:
            states = {m: "done" if reason is None else "failed" for m, reason in reasons.items()}
        files = {m: path for m, path in paths.items() if states.get(m) == "done"}
        failed = {m: reason or "no reason is stated" for m, reason in reasons.items() if states.get(m) == "failed"}
        return cls(table, {m: path for m, path in files.items() if path.is_file()}, failed)

    @property
    def missing(self) -> list[int]:
        """Members that have not run."""
        return [int(m) for m in self.table.index if m not in self.files and m not in self.failed]

    @property
    def weights(self) -> np.ndarray:
        """Weights of the valid members, of sum 1; valid members of a scenario take over the weights of its others."""
        if "scenario" in self.table:
            scaled = shares(self.table, "weight", self.files)
            return scaled / scaled.sum()
        w = self.table.loc[list(self.files), "weight"].to_numpy(np.float64)
        return w / w.sum()

    @property
    def frequencies(self) -> Frequencies | None:
        """Annual rates of the valid members; None for an ensemble without rates."""
        return Frequencies.of(self.table, self.files)

    def statement(self) -> str:
        """How many members the maps rest on, and why others do not count."""
        text = f"{len(self.files)} of {len(self.table)} members are valid"
        if self.failed:
            text += f"; {len(self.failed)} failed: " + "; ".join(f"member {m}: {reason}" for m, reason in self.failed.items())
        if self.missing:
            text += f"; {len(self.missing)} have not run: {', '.join(map(str, self.missing))}"
        to = "the weight of each scenario" if "scenario" in self.table else "a sum of 1"
        text += f"; the weights of the valid members are scaled to {to}" if self.failed or self.missing else ""
        return f"{text}; {self.growth}" if self.growth else text

    def counts(self) -> dict[str, int]:
        """Numbers of planned, valid, failed and missing members by the names of the products."""
        return {
            "members_planned": len(self.table),
            "members_valid": len(self.files),
            "members_failed": len(self.failed),
            "members_missing": len(self.missing),
        }


class MembersWriter:
    """``members.nc`` while it is written: maps and ledger of each valid member, then figures of all.

    Parameters
    ----------
    ensemble : Ensemble
    path : path
        Final name of the file, for messages.
    terrain : Terrain
        Raster of all members.
    file : netCDF4.Dataset
        Open for writing, with the table of members.
    """

    def __init__(self, ensemble: Ensemble, path: str | os.PathLike[str], terrain: Terrain, file: "netCDF4.Dataset"):
        self._ensemble, self._path, self._shape, self._file = ensemble, path, terrain.shape, file
        places = {int(member): place for place, member in enumerate(ensemble.table.index)}
        self._places = {member: places[member] for member in ensemble.files}
        self._known = None if np.isfinite(terrain.elevation).all() else np.isfinite(terrain.elevation)
        self._layers = {name: _add_layers(file, name) for name in MEMBER_MAPS}
        self._ledgers: dict[int, dict[str, np.ndarray]] = {}
        for place in set(places.values()) - set(self._places.values()):
            for one in self._layers.values():
                put(one, np.broadcast_to(np.float32(np.nan), self._shape), (place,))

    def copy(self, number: int, member: MemberMaps) -> None:
        """Copy the part of each map that the open file of a valid member holds, and keep its ledger."""
        if member.shape != self._shape:
            raise StorageError(f"{member.path}: its grid is not that of the other members; remove it and run again")
        if "ledger" in member.file.groups:
            self._ledgers[number] = member.ledger()
        rows, columns = member.part.slices if self._known is None else (slice(0, size) for size in self._shape)
        place = whole_chunks(rows, self._shape[0]), whole_chunks(columns, self._shape[1])
        with netcdf.writing(self._path):
            names = (*MEMBER_MAPS, *_maps_of_some(self._file, self._layers, member))
        for name in names:
            cells = member.within(name, place) if self._known is None else member.layer(name, self._known)
            with netcdf.writing(self._path):
                put(self._layers[name], cells, (self._places[number],), (place[0].start, place[1].start))

    def add_figures(self, hazard: "xr.Dataset", inflow: float) -> "pd.DataFrame":
        """Put in :data:`~runout.hazard.figures.FIGURES` of the valid members, and return them by number of the member.

        ``inflow`` [m3] is the volume of all inflows without factors.
        """
        import pandas as pd

        reach, least = Reach.of(hazard), float(hazard["thickness_threshold"].values.min())
        table, figures = self._ensemble.table, dict[int, dict[str, float]]()
        factors = table["discharge_factor"].fillna(1.0) if "discharge_factor" in table else pd.Series(1.0, index=table.index)
        stack = MembersFile(self._path, self._file)
        for number in self._ensemble.files:
            ledger = self._ledgers.get(number, WITHOUT_LEDGER)
            figures[number] = member_figures(stack.member(number), ledger, reach, least, inflow * factors[number])
        of_valid = pd.DataFrame.from_dict(figures, orient="index")
        for name, values in of_valid.reindex(table.index).items():
            with netcdf.writing(self._path):
                column = self._file.createVariable(str(name), np.float64, ("realization",))
                column.setncatts(VARIABLES[str(name)].attributes())
                column[:] = values.to_numpy()
        return of_valid

    def add_ledgers(self) -> None:
        """Put in the ledgers of all members."""
        with netcdf.writing(self._path):
            put_ledgers(self._file, {self._places[number]: ledger for number, ledger in self._ledgers.items()})


@contextmanager
def members_file(
    ensemble: Ensemble, path: str | os.PathLike[str], terrain: Terrain, attrs: Mapping[str, Any]
) -> Iterator[MembersWriter]:
    """Block that writes every planned member as one realization, with the table of parameters; the file is whole or absent.

    Members that failed or have not run hold no values.

    Raises StorageError if a member's file cannot be read, the disk is full, or the folder cannot be written.
    """
    import netCDF4

    skeleton = member_table(ensemble, terrain).assign_attrs(attrs)
    with netcdf.LOCK, whole_file(path) as temporary:
        netcdf.write(skeleton, temporary)
        with netcdf.writing(path):
            file = netCDF4.Dataset(temporary, "a")
        try:
            with netcdf.writing(path):
                writer = MembersWriter(ensemble, path, terrain, file)
            yield writer
            writer.add_ledgers()
        finally:
            with netcdf.writing(path):
                file.close()


def put_ledgers(file: "netCDF4.Dataset", ledgers: Mapping[int, Mapping[str, np.ndarray]]) -> None:
    """Write ledgers by the place of their member to an open ``members.nc``, one behind another: a contiguous ragged array of CF."""
    group, count = file.createGroup(LEDGERS), len(file.dimensions["realization"])
    lengths = np.array([len(ledgers[place]["time"]) if place in ledgers else 0 for place in range(count)], np.int32)
    group.createDimension("record", int(lengths.sum()))
    records = group.createVariable(RECORDS, np.int32, ("realization",))
    records.setncatts({"sample_dimension": "record", "long_name": "number of records of the ledger of a member"})
    records[:] = lengths
    for name in dict.fromkeys(name for ledger in ledgers.values() for name in ledger):
        column = group.createVariable(name, np.float64, ("record",), fill_value=np.nan, zlib=True, complevel=1, shuffle=True)
        column.setncatts(VARIABLES[name].attributes() if name in VARIABLES else {})
        parts = [ledgers[place].get(name, np.full(lengths[place], np.nan)) for place in sorted(ledgers)]
        column[:] = np.concatenate(parts) if lengths.sum() else np.empty(0)


def member_table(ensemble: Ensemble, terrain: Terrain) -> "xr.Dataset":
    """Sampled parameters, weight, seed, status and reason of failure over ``realization``, on the raster."""

    dataset = grid_dataset(terrain)
    dataset = dataset.assign_coords(realization=ensemble.table.index.to_numpy(np.int32))
    for column in ensemble.table.columns:
        dataset[column] = ("realization", ensemble.table[column].to_numpy(), parameter_variable(str(column)).attributes())
    states = ["valid" if m in ensemble.files else "failed" if m in ensemble.failed else "missing" for m in ensemble.table.index]
    dataset["status"] = ("realization", np.array(states, dtype=object))
    reasons = [ensemble.failed.get(m, "") for m in ensemble.table.index]
    dataset["failure_reason"] = ("realization", np.array(reasons, dtype=object))
    return dataset


def _maps_of_some(file: "netCDF4.Dataset", layers: dict[str, "netCDF4.Variable"], member: MemberMaps) -> list[str]:
    """Maps of a member that not all members have; ``layers`` gets those that are new.

    The record of joint conditions is one of them if the member recorded the conditions that the first one did; otherwise its bits
    have another meaning.
    """
    names = [name for name in (*BED_MAPS, MET) if name in member.file.variables]
    layers |= {name: _add_layers(file, name) for name in names if name not in layers}
    if MET in names:
        conditions = str(member.attributes[ATTRIBUTE])
        if ATTRIBUTE not in file.ncattrs():
            file.setncattr(ATTRIBUTE, conditions)
        if file.getncattr(ATTRIBUTE) != conditions:
            names.remove(MET)
    return names


def _add_layers(file: "netCDF4.Dataset", name: str) -> "netCDF4.Variable":
    least = {} if name == CHANGE else {"valid_min": np.float32(0.0)}
    attributes = VARIABLES[name].attributes() | least
    mapped = {"grid_mapping": "crs"} if "crs" in file.variables else {}
    return add_layers(file, name, attributes | mapped, ("realization",))


def _stated_reason(path: Path) -> str | None:
    return str(read_json(path).get("reason", "")) if path.is_file() else None
