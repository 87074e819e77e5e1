"""Quantities that runout maps: each file of this folder is one, and no other file lists them.

A quantity makes the maps of members, the products over the members, the settings and the report. Its formula takes a column of the
flow: thickness [m], speed [m/s] and density [kg/m3]. The time of arrival has a map of its own and no formula. Quantities of an
erodible bed have maps only where members have one.
"""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

DEPOSIT = "deposit"
ERODED, CHANGE, SHARE = "eroded_depth", "elevation_change", "bed_share"  # maps at the end of a run with an erodible bed
MET = "met_at_one_time"  # map of a member: bit k where the flow reached all thresholds of its joint condition k at one time
INFLOW_MAP = "inflow_thickness"  # of the products of a site with inflows
ARRIVAL, FIRST_ARRIVAL, ARRIVAL_PERCENTILE = "arrival_time", "first_arrival_time", "arrival_time_percentile"
UNTIL_ARRIVAL = (ARRIVAL, FIRST_ARRIVAL, ARRIVAL_PERCENTILE)  # maps that hold no value, not 0, where no flow arrives
CHANGE_PERCENTILE = "elevation_change_percentile"
WITHOUT_VALUE = (ARRIVAL, SHARE)  # maps of a member that hold no value, not 0, beyond its flow or its deposit


@dataclass(frozen=True)
class MapQuantity:
    """A quantity of a flow that has a map per member, and maps over the members."""

    name: str  # start of the names of thresholds and probabilities, as in `speed_thresholds`
    units: str  # UDUNITS unit
    words: str  # name in sentences, such as "flow speed"
    described: str  # name with the definition, for legends
    # value of a column from its thickness [m], speed [m/s] and density [kg/m3], in the subset of Python of :mod:`runout.physics`;
    # the map of a member holds its largest value over time. None: the thickness at the end of the run
    formula: Callable[[Any, Any, Any], Any] | None
    thresholds: tuple[float, ...]  # default thresholds of exceedance, ascending
    stem: str = ""  # name in the maps themselves; default: `name`
    symbol: str = ""  # label of a colour bar
    colours: str = "plasma_r"  # colour map of matplotlib, light for small values
    # lower edges of classes above 0 that all maps of it have, in `units`; empty: classes follow from thresholds and values
    classes: tuple[float, ...] = ()
    meanings: tuple[str, ...] = ()  # what the flow does from each class on, for legends
    logarithmic: bool = False  # logarithmic colours in the report, where it has no classes
    least_threshold: float = 0.0  # smallest threshold that is accepted, against wrong units; 0: any positive one
    hint: str = ""  # remedy for thresholds that are too small
    has_mean: bool = False  # whether the products have its mean over the members
    remark: str = ""  # sentence for the caption of its map
    place: int = 10  # order among the quantities of files and pages; those of one place follow by name
    # whether it is one of an erodible bed: then it has no formula, and its maps exist where members have a bed
    of_bed: bool = False
    # map of a member with values of both signs, of which the quantity is one part; it has no percentiles then. Default: a map of
    # its own
    part_of: str = ""
    sign: int = 1  # sign of that part, -1 or 1; its values count as positive

    def __post_init__(self) -> None:
        object.__setattr__(self, "stem", self.stem or self.name)
        object.__setattr__(self, "symbol", self.symbol or self.words)

    @property
    def extreme(self) -> str:
        """What thresholds are compared with, in words."""
        return f"maximum {self.words}" if self.formula else self.words

    @property
    def member_map(self) -> str:
        """Name of the map of a member."""
        return self.part_of or (f"max_{self.stem}" if self.formula else self.stem)

    @property
    def percentile(self) -> str:
        """Name of the percentiles over the members; empty if there are none."""
        return "" if self.part_of else f"{self.stem}_percentile"

    @property
    def peak(self) -> str:
        """Name of the largest value of any member."""
        return f"peak_{self.stem}"

    @property
    def mean(self) -> str:
        """Name of the mean over the members; empty if there is none."""
        return f"mean_{self.stem}" if self.has_mean else ""

    @property
    def deviation(self) -> str:
        """Name of the standard deviation over the members; empty if there is no mean."""
        return f"{self.stem}_deviation" if self.has_mean else ""

    @property
    def standard_error(self) -> str:
        """Name of the sampling error of the mean; empty if there is no mean."""
        return f"{self.stem}_standard_error" if self.has_mean else ""

    @property
    def means(self) -> tuple[str, ...]:
        """Names of the mean, its standard deviation and its sampling error; empty if there are none."""
        return (self.mean, self.deviation, self.standard_error) if self.has_mean else ()

    @property
    def numerical_error(self) -> str:
        """Name of the numerical error of the mean, known from a second grid; empty if there is no mean."""
        return f"{self.stem}_numerical_error" if self.has_mean else ""

    @property
    def annual_exceedance(self) -> str:
        """Name of the annual rate at which the thresholds are reached."""
        return f"{self.name}_annual_exceedance"

    @property
    def at_return_period(self) -> str:
        """Name of the value at return periods; empty if there is none."""
        return f"{self.stem}_at_return_period" if self.formula else ""

    @property
    def difference(self) -> str:
        """Name of the difference of the maps of two products."""
        return f"{self.stem}_difference"

    @property
    def threshold(self) -> str:
        """Name of the dimension of the thresholds."""
        return f"{self.name}_threshold"

    @property
    def setting(self) -> str:
        """Key of the thresholds in site.yaml."""
        return f"{self.name}_thresholds"

    @property
    def joint_threshold(self) -> str:
        """Name of the thresholds in joint conditions."""
        return f"joint_{self.name}_threshold"

    def exceedance(self, kind: str) -> str:
        """Name of the maps of exceedance: "probability", "standard_error" or "rms_error"."""
        return f"{self.name}_exceedance_{kind}"


_FILES = [importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__)]
ALL_QUANTITIES: dict[str, MapQuantity] = {q.name: q for q in sorted((f.QUANTITY for f in _FILES), key=lambda q: (q.place, q.name))}
QUANTITIES = {name: q for name, q in ALL_QUANTITIES.items() if not q.of_bed}  # of every flow
BED_QUANTITIES = {name: q for name, q in ALL_QUANTITIES.items() if q.of_bed}


def peak_quantities() -> list[MapQuantity]:
    """Quantities whose largest value over time is mapped; thickness is the first."""
    return [q for q in QUANTITIES.values() if q.formula]


def member_map_names() -> tuple[str, ...]:
    """Names of the maps of a member: peaks, arrival, and the deposit."""
    return (*(q.member_map for q in peak_quantities()), ARRIVAL, QUANTITIES[DEPOSIT].member_map)


def bed_map_names() -> tuple[str, ...]:
    """Names of the maps that members with an erodible bed have besides."""
    return ERODED, CHANGE, SHARE


def quantity_of(variable: str) -> MapQuantity | None:
    """The quantity whose values a map shows, None for probabilities, times and the ground."""
    shown = {name: q for q in ALL_QUANTITIES.values() for name in (q.percentile, q.peak, q.mean, q.at_return_period) if name}
    return (shown | {q.member_map: q for q in ALL_QUANTITIES.values() if not q.part_of}).get(variable)
