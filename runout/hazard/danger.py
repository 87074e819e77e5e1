"""Classes of intensity at return periods and levels of danger, after a scheme (:mod:`runout.config.scheme`).

Each member has a class in each cell: the strongest of which it meets a criterion. At a return period T a cell has the strongest
class that is reached at an annual rate of 1/T or more. Its level of danger is the highest that the matrix has for these classes.
Rates of several sources add up before that (:mod:`runout.hazard.merging`).
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.scheme import DangerScheme, read_scheme
from runout.errors import ConfigError
from runout.hazard.frequency import Frequencies, annual_exceedance
from runout.io import netcdf
from runout.model.joint_conditions import Key, maps_of, meets
from runout.palettes import palette_of

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site

INTENSITY, LEVEL, PERIOD = "intensity_class", "danger_level", "class_return_period"
RATE, CLASS = "class_annual_exceedance", "class_number"
UNKNOWN = 255
SINGLE = 1e-6  # relative rounding of rates that files keep in single precision: three rates of 1/300 reach 1/100


@dataclass(frozen=True)
class DangerClasses:
    """Classes and levels of the cells."""

    scheme: DangerScheme
    rate: np.ndarray  # annual rate [1/a] of each member (members,)
    arrival_threshold: float  # thickness from which the flow reaches a cell [m]: the lowest threshold of inundation
    has_bed: bool = False  # whether the members have an erodible bed
    # bits of the conditions that all members record at one time (:mod:`runout.model.joint_conditions`)
    places: Mapping[Key, int] = field(default_factory=dict)

    @classmethod
    def of(cls, site: "Site", frequencies: Frequencies | None) -> "DangerClasses | None":
        """Classes of a site; None if it states no scheme.

        Raises ConfigError if the scheme cannot be read, or the members have no annual rates.
        """
        settings = site.settings.hazard
        if not settings.scheme:
            return None
        scheme = read_scheme(settings.scheme, site.folder)
        if frequencies is None:
            raise ConfigError(
                f"hazard.scheme {settings.scheme}: the members have no annual rates, and the fraction of an ensemble is not an "
                "annual probability; state ensemble.scenarios with return_period or annual_rate"
            )
        return cls(scheme, frequencies.rate, min(settings.thickness_thresholds), bool(getattr(site.settings, "bed", None)))

    @property
    def quantities(self) -> list[str]:
        """Names of the quantities that decide; the thickness is the first."""
        of_scheme = [name for one in self.scheme.classes for criterion in one.when for name in maps_of(criterion.condition)]
        return list(dict.fromkeys(["thickness", *of_scheme]))

    def classes(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Class of each member in each cell: 0 where it meets no criterion, else the place of the class from 1 on.

        ``values`` are maps by the names of the quantities, all of one shape; a quantity without a map counts as 0. Conditions with
        ``places`` need the map of these.
        """
        classes = np.zeros(values["thickness"].shape, np.uint8)
        for number, one in enumerate(self.scheme.classes, 1):
            for criterion in one.when:
                classes[self._met(criterion, values)] = number
        return classes

    def _met(self, criterion: Any, values: Mapping[str, np.ndarray]) -> np.ndarray:
        return meets({"thickness": self.arrival_threshold} if criterion.reached else criterion.condition, values, self.places)

    def at_periods(self, classes: np.ndarray, members: np.ndarray | slice = slice(None)) -> dict[str, np.ndarray]:
        """Maps by name from the classes (members, ...): class at each return period (periods, ...), and level of danger (...).

        ``members`` are the places of the rows of ``classes`` among the rates; the others have the class 0.
        """
        rate = self.rate[members]
        rates = np.stack([annual_exceedance(classes, k, rate) for k in range(1, len(self.scheme.classes) + 1)])
        return {RATE: rates, **from_rates(rates, self._record)}

    @cached_property
    def _record(self) -> dict[str, Any]:
        return self.record()

    def tile(self, values: Mapping[str, np.ndarray], members: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        """Name and values (..., cells) of each map from values (cells, members)."""
        yield from self.at_periods(self.classes(values).T, members).items()

    def record(self) -> dict[str, Any]:
        """What a reader has to know of the maps: classes and levels with colours and state of checking, matrix, source, limits."""
        scheme = self.scheme
        periods = scheme.return_periods or scheme.risk
        colours = palette_of(INTENSITY).hexadecimal(len(scheme.classes))
        return scheme.model_dump(include={"title", "process", "does_not_say", "source", "beyond", "matrix", "risk"}) | {
            "return_periods": {"years": scheme.years, "checked": periods.checked if periods else ""},
            "remarks": scheme.remarks(self.has_bed, self.places),
            "classes": [
                _entry(number, one.name, colour, one.checked, "; ".join(filter(None, (" or ".join(map(str, one.when)), one.note))))
                for number, (one, colour) in enumerate(zip(scheme.classes, colours, strict=True), 1)
            ],
            "levels": [
                _entry(number, one.name, one.colour, one.checked, one.consequence) for number, one in enumerate(scheme.levels, 1)
            ],
        }

    def add_to(self, dataset: "xr.Dataset") -> "xr.Dataset":
        """The dataset with maps of class 0, and level 0 if there is a matrix, with the meanings of their numbers."""
        return with_classes(dataset, self.record())


def from_rates(rates: np.ndarray, record: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Class at each return period (periods, ...) and level of danger (...), by the names of their maps.

    Parameters
    ----------
    rates : ndarray (classes, ...)
        Annual rate [1/a] at which each class or a stronger one is reached.
    record : mapping
        Of the scheme, see :meth:`DangerClasses.record`. The level is that of its matrix, the highest of all return periods; the one
        beyond where the cell is reached more rarely.
    """
    intensity = np.stack([
        (rates >= (1.0 - SINGLE) / years).sum(axis=0).astype(np.uint8) for years in record["return_periods"]["years"]
    ])  # fmt: skip
    if not record["matrix"]:
        return {INTENSITY: intensity}
    number = {"": 0} | {one["name"]: one["number"] for one in record["levels"]}
    level, rows = np.zeros(rates.shape[1:], np.uint8), record["matrix"]["rows"]
    for period, at_period in enumerate(intensity):
        cells = [0, *(number[rows[one["name"]][period]] for one in record["classes"])]
        level = np.maximum(level, np.array(cells, np.uint8)[at_period])
    level[(level == 0) & (rates[0] > 0)] = number[record["beyond"] or ""]
    return {INTENSITY: intensity, LEVEL: level}


def with_classes(dataset: "xr.Dataset", record: Mapping[str, Any]) -> "xr.Dataset":
    """The dataset with rates and maps of class 0, and level 0 if there is a matrix, with the meanings of their numbers."""
    shape, years = (dataset.sizes["y"], dataset.sizes["x"]), record["return_periods"]["years"]
    numbers = np.array([one["number"] for one in record["classes"]], np.int32)
    dataset = dataset.assign_coords({PERIOD: np.array(years, np.float64), CLASS: numbers})
    netcdf.add_map(dataset, RATE, np.zeros((len(numbers), *shape), np.float32), (CLASS,))
    netcdf.add_map(dataset, INTENSITY, np.zeros((len(years), *shape), np.uint8), (PERIOD,))
    dataset[INTENSITY].attrs |= _flags("not reached", record["classes"])
    if record["matrix"]:
        netcdf.add_map(dataset, LEVEL, np.zeros(shape, np.uint8))
        dataset[LEVEL].attrs |= _flags("not in danger", record["levels"])
    for name in (INTENSITY, LEVEL) if record["matrix"] else (INTENSITY,):
        dataset[name].attrs |= {"scheme": record["title"], "scheme_record": json.dumps(record)}
    return dataset


def _entry(number: int, name: str, colour: str, checked: str, text: str) -> dict[str, Any]:
    return {"number": number, "name": name, "colour": colour, "checked": checked, "text": text}


def _flags(nothing: str, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Attributes of a map of classes or levels: values, meanings as CF writes them, and how each was checked."""
    names = [nothing, *(entry["name"] for entry in entries)]
    return {
        "flag_values": np.arange(len(names), dtype=np.uint8),
        "flag_meanings": " ".join(re.sub(r"[^A-Za-z0-9_.+-]+", "_", name) for name in names),
        "checked": "; ".join(f"{entry['name']}: {entry['checked']}" for entry in entries),
    }


def scheme_record(hazard: "xr.Dataset") -> dict[str, Any] | None:
    """The record of :meth:`DangerClasses.record` in hazard maps; None if they have no classes."""
    return json.loads(hazard[INTENSITY].attrs["scheme_record"]) if INTENSITY in hazard else None


def entries_of(hazard: "xr.Dataset", name: str) -> list[dict[str, Any]]:
    """Entries of the record with the meanings of the numbers of a map, the lowest first."""
    record = scheme_record(hazard)
    return record["levels" if name == LEVEL else "classes"] if record else []


def label(entry: Mapping[str, Any]) -> str:
    """Words of a class or level for a legend, with the state of checking."""
    return f"{entry['name']} (checked: {entry['checked']})"
