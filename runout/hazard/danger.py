"""Classes of intensity at return periods and levels of danger, after a scheme (:mod:`runout.config.scheme`).

Each member has a class in each cell: the strongest of which it meets a criterion. At a return period T a cell has the strongest class
that is reached at an annual rate of 1/T or more. Its level of danger is the highest that the matrix has for these classes.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.scheme import CHECKED, Scheme, read_scheme
from runout.hazard.frequency import Frequencies, at_return_period, require_frequencies
from runout.io import netcdf

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site
    from runout.hazard.members import Ensemble

INTENSITY, LEVEL, PERIOD = "intensity_class", "danger_level", "class_return_period"
UNKNOWN = 255


@dataclass(frozen=True)
class DangerClasses:
    """Classes and levels of the cells.

    Attributes
    ----------
    scheme : Scheme
    rate : ndarray (members,)
        Annual rate of each member [1/a].
    arrival_threshold : float
        Thickness from which the flow reaches a cell [m]: the lowest threshold of inundation.
    """

    scheme: Scheme
    rate: np.ndarray
    arrival_threshold: float

    @classmethod
    def of(cls, site: "Site", ensemble: "Ensemble") -> "DangerClasses | None":
        """Classes of a site; None if it states no scheme.

        Raises
        ------
        ConfigError
            If the scheme cannot be read, or the members have no annual rates.
        """
        settings = site.settings.hazard
        if not settings.scheme:
            return None
        scheme = read_scheme(settings.scheme, site.folder)
        frequencies = Frequencies.of(ensemble.table, ensemble.files)
        require_frequencies(frequencies, [f"hazard.scheme {settings.scheme}"])
        assert frequencies
        return cls(scheme, frequencies.rate, min(settings.thickness_thresholds))

    @property
    def quantities(self) -> list[str]:
        """Names of the quantities that decide; the thickness is the first."""
        of_scheme = [name for one in self.scheme.classes for criterion in one.when for name in _maps_of(criterion)]
        return list(dict.fromkeys(["thickness", *of_scheme]))

    def classes(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Class of each member in each cell: 0 where it meets no criterion, else the place of the class from 1 on.

        ``values`` are maps by the names of the quantities, all of one shape; a quantity without a map counts as 0.
        """
        classes = np.zeros(values["thickness"].shape, np.uint8)
        for number, one in enumerate(self.scheme.classes, 1):
            for criterion in one.when:
                classes[self._met(criterion, values)] = number
        return classes

    def _met(self, criterion: Any, values: Mapping[str, np.ndarray]) -> np.ndarray:
        if criterion.house_strength:
            return _breaks_house(values["pressure"], values["thickness"], criterion.house_strength)
        met = np.ones(values["thickness"].shape, bool)
        for name, least in ({"thickness": self.arrival_threshold} if criterion.reached else criterion.mapped).items():
            met &= values[name] >= np.float32(least) if name in values else False
        return met

    def at_periods(self, classes: np.ndarray, members: np.ndarray | slice = slice(None)) -> dict[str, np.ndarray]:
        """Maps by name from the classes (members, ...): class at each return period (periods, ...), and level of danger (...).

        ``members`` are the places of the rows of ``classes`` among the rates; the others have the class 0.
        """
        rate, values = self.rate[members], classes.astype(np.float32)
        at_each = [np.nan_to_num(at_return_period(values, rate, years)).astype(np.uint8) for years in self.scheme.years]
        maps = {INTENSITY: np.stack(at_each)}
        if self.scheme.matrix:
            maps[LEVEL] = self._level(maps[INTENSITY], (classes[rate > 0] > 0).any(axis=0))
        return maps

    def _level(self, intensity: np.ndarray, ever: np.ndarray) -> np.ndarray:
        """Highest level of the matrix for the classes (periods, ...); the one beyond where the cell is ``ever`` reached."""
        level = np.zeros(ever.shape, np.uint8)
        for period, at_period in enumerate(intensity):
            cells = [0, *(self.scheme.level_number(one.name, period) for one in self.scheme.classes)]
            level = np.maximum(level, np.array(cells, np.uint8)[at_period])
        if self.scheme.beyond:
            names = [one.name for one in self.scheme.levels]
            level[(level == 0) & ever] = names.index(self.scheme.beyond) + 1
        return level

    def tile(self, values: Mapping[str, np.ndarray], members: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        """Name and values (..., cells) of each map from values (cells, members)."""
        yield from self.at_periods(self.classes(values).T, members).items()

    def add_to(self, dataset: "xr.Dataset") -> "xr.Dataset":
        """The dataset with maps of class 0, and level 0 if there is a matrix, their meanings, colours and sources."""
        shape, scheme = (dataset.sizes["y"], dataset.sizes["x"]), self.scheme
        dataset = dataset.assign_coords({PERIOD: np.array(scheme.years, np.float64)})
        netcdf.add_map(dataset, INTENSITY, np.zeros((len(scheme.years), *shape), np.uint8), (PERIOD,))
        dataset[INTENSITY].attrs |= flags("not reached", scheme.classes)
        if scheme.matrix:
            netcdf.add_map(dataset, LEVEL, np.zeros(shape, np.uint8))
            dataset[LEVEL].attrs |= flags("not in danger", scheme.levels)
            dataset[LEVEL].attrs["flag_colours"] = " ".join(level.colour for level in scheme.levels)
        for name in (INTENSITY, LEVEL) if scheme.matrix else (INTENSITY,):
            dataset[name].attrs["scheme"] = f"{scheme.title}; {scheme.source.title}; {scheme.source.edition}; {scheme.source.address}"
            dataset[name].attrs["does_not_say"] = " ".join(scheme.does_not_say)
        return dataset


def _maps_of(criterion: Any) -> Sequence[str]:
    return ("pressure", "thickness") if criterion.house_strength else tuple(criterion.mapped)


def _breaks_house(pressure: np.ndarray, thickness: np.ndarray, strength: Any) -> np.ndarray:
    """Where a pressure [Pa] exceeds the strength of a house; never too small an area, though the maxima are of different times.

    Up to half of the height the strength falls with the thickness, and above it the least one counts: so the strength at the
    largest thickness is at most that at the time of the largest pressure.
    """
    height = np.minimum(thickness, np.float32(0.5 * strength.height)).astype(np.float64)
    return (pressure > 0) & (pressure * height * (strength.height - height) >= strength.force)


def flags(nothing: str, entries: Sequence[Any]) -> dict[str, Any]:
    """Attributes of a map of classes or levels: values, meanings as CF writes them, and how each was checked."""
    names = [nothing, *(one.name for one in entries)]
    return {
        "flag_values": np.arange(len(names), dtype=np.uint8),
        "flag_meanings": " ".join(re.sub(r"[^A-Za-z0-9_.+-]+", "_", name) for name in names),
        "checked": "; ".join(f"{one.name}: {one.checked}" for one in entries),
    }


def legend(scheme: Scheme) -> list[tuple[int, str, str, str]]:
    """Number, name, colour and sentence with the state of checking of each level, the highest first."""
    return [
        (number, level.name, level.colour, f"{level.consequence} ({CHECKED[level.checked]})")
        for number, level in reversed(list(enumerate(scheme.levels, 1)))
    ]
