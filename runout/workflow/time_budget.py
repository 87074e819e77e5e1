"""Cells and number of members of a run that fit into a time: those whose numerical and sampling errors are least together.

Both errors are bars of the run-out, as shares of it, that hold 9 of 10 cases. The error of the grid is the measured one of the
site (``convergence.json``) or the expected one of its cells (:mod:`runout.forecast.accuracy`), of first order in the cell size.
The error by the number of members follows from the spread between their run-outs (:mod:`runout.forecast.sampling_error`). The
spread is forecast by points that slide in place of the mass, and for the volume by geometric similarity.
"""

import logging
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.schema import LARGEST_NET
from runout.ensemble.design import Design
from runout.errors import BudgetError, CapacityError, ConfigError
from runout.forecast.accuracy import FEWEST_MEASURED, Preset, expected_errors
from runout.forecast.numerical_error import measured_errors, read_convergence, require_error_bars
from runout.forecast.sampling_error import median_error
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.log import duration
from runout.model.limits import SMALLEST_NET
from runout.workflow.check_stiffness import VOLUME, member_stiffness
from runout.workflow.flow_forecast import flows_of
from runout.workflow.plan import forecast

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.workflow.plan import CostOf

LOGGER = logging.getLogger(__name__)
RECORD = "budget.json"
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
FINER = math.sqrt(2.0)  # cells through the release of one choice over those of the choice before
MOST_CELLS = 16.0  # cells through the release of the finest choice
SMALL = 0.25  # sampling error over the numerical one below which more members gain less than 3 % of both together
CHOSEN = ("simulation.cell_size", "ensemble.members")


@dataclass(frozen=True)
class Choice:
    """Cells and members that fit into a time."""

    cell_size: tuple[float, float, float]  # grid spacing east, north, up [m]
    through: float  # cells through the mean thickness of the release
    members: int
    seconds: float  # forecast time of the members on this machine [s]
    # numerical, sampling: error bars of the run-out [1]; they hold 9 of 10 cases
    numerical: float
    sampling: float

    @property
    def error(self) -> float:
        """Both errors together [1]; they are independent."""
        return math.hypot(self.numerical, self.sampling)

    @property
    def cells(self) -> str:
        """The spacing as site.yaml states it."""
        same = len(set(self.cell_size)) == 1
        return f"{self.cell_size[0]:g}" if same else f"[{', '.join(f'{size:g}' for size in self.cell_size)}]"


def seconds_of(text: str) -> float:
    """Seconds of a duration such as 90s, 30min or 2h.

    Raises ConfigError if it is none, or not positive.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h)\s*", text)
    if not match or float(match[1]) == 0:
        raise ConfigError(f"--budget: {text!r} is no duration; write a number with s, min or h, such as 90s, 30min or 2h")
    return float(match[1]) * UNITS[match[2]]


@dataclass(frozen=True)
class TimeBudget:
    """A site and the time that a run of it may take."""

    site: "Site"
    seconds: float  # time [s]
    results: Path  # results folder, which may hold ``convergence.json``
    workers: int | None = None  # members at the same time, as of :func:`runout.workflow.plan.forecast`
    cost_of: "CostOf | None" = None  # cost of a step, as of that function

    @classmethod
    def of(cls, site: "Site", text: str, results: Path, changes: Sequence[str] = (), **how: Any) -> "TimeBudget":
        """The budget that an option states; ConfigError if ``changes`` of the command line state what it chooses."""
        for change in changes:
            key = change.partition("=")[0].strip()
            if key in CHOSEN:
                raise ConfigError(f"--budget chooses {key}; remove --set {change}, or --budget")
        limit, hours = seconds_of(text), site.settings.budget.hours if site.settings.budget else None
        return cls(site, limit if hours is None else min(limit, 3600.0 * hours), results, **how)

    def choices(self) -> list[Choice]:
        """The largest number of members that fits, and is of use, for each cell size, coarsest first.

        Raises BudgetError if not even the coarsest cells fit; the message states what does.
        """
        choices: list[Choice] = []
        cells, spread = FEWEST_MEASURED, self.spread()
        while cells <= MOST_CELLS:
            try:
                choice = self._largest(cells, spread)
            except (BudgetError, CapacityError) as error:
                if not choices:
                    raise
                LOGGER.debug("%s", error)
                break
            choices.append(choice)
            cells *= FINER
        return choices

    def coarsened(self) -> Choice:
        """Cells of the site if its members fit on them, else the finest coarser ones that fit and whose error is known.

        Raises BudgetError if not even the coarsest cells whose error is known fit; the message states what does.
        """
        own = self.of_size(self.site_size())
        if own.seconds <= self.seconds or own.through <= FEWEST_MEASURED:
            return own
        return next((one for one in reversed(self.choices()) if one.cell_size[0] >= own.cell_size[0]), own)

    def site_size(self) -> tuple[float, float, float]:
        """Grid spacing of the site east, north, up [m]."""
        from runout.config.member_arguments import grid_spacing

        return grid_spacing(self.site.settings, self.site.data().masses)

    def of_size(self, size: tuple[float, float, float]) -> Choice:
        """The members of the site on cells of a size; the numerical error is NaN where it is not known."""
        masses = self.site.data().masses
        through = sum(m.volume for m in masses) / sum(m.area for m in masses) / size[2]
        error = self.numerical_error(size, through) if through >= FEWEST_MEASURED else math.nan
        return Choice(size, through, self._fewest, self._time(size, self._fewest), error, 0.0)

    def require_time(self, site: "Site", left: Sequence[int]) -> None:
        """Raise BudgetError if the members ``left`` of the site with chosen cells do not fit."""
        needed = forecast(site, left, workers=self.workers, cost_of=self.cost_of).seconds
        if needed > self.seconds:
            raise self._too_short(len(left), f"{replace(self, site=site).site_size()[0]:g} m", needed)

    def _largest(self, cells: float, spread: float) -> Choice:
        """The choice of the most members that fit with so many cells through the release."""
        size, through = self._size(cells)
        numerical, fewest = self.numerical_error(size, through), self._fewest
        needed = self._time(size, fewest)
        if needed > self.seconds:
            raise self._too_short(fewest, f"{size[0]:g} m, the coarsest whose error is known,", needed)
        members, most = fewest, self._most(numerical, spread)
        while members < most and 2.0 * needed <= self.seconds:  # the time grows no faster than the number of members
            larger = min(most, members * 2 ** int(math.log2(self.seconds / needed)))
            time = self._time(size, larger)
            if time > self.seconds:
                break
            members, needed = larger, time
        return Choice(size, through, members, needed, numerical, self.sampling_error(spread, members))

    def _too_short(self, members: int, cells: str, needed: float) -> BudgetError:
        what = f"{members} members" if members > 1 else "a member"
        fits = f"{math.ceil(needed / 60.0)}min" if needed > UNITS["min"] else f"{math.ceil(needed)}s"
        return BudgetError(
            f"the time of {duration(self.seconds)} is too short: {what} on cells of {cells} need about "
            f"{duration(needed)}; --budget {fits} fits, or fewer values, a shorter end_time, or fewer particles_per_cell"
        )

    def _most(self, numerical: float, spread: float) -> int:
        """Members beyond which the errors together hardly become smaller."""
        members = self._fewest
        while self._sampled and members < LARGEST_NET and median_error(spread, members) > SMALL * numerical:
            members *= 2
        return members

    @property
    def _sampled(self) -> bool:
        """Whether the number of members is free: parameters are sampled, and no scenarios or table state the members."""
        ensemble = self.site.settings.ensemble
        return bool(ensemble.parameters) and not (ensemble.scenarios or ensemble.table)

    @property
    def _fewest(self) -> int:
        """Members of the smallest net; those of the site where their number is not free."""
        return SMALLEST_NET if self._sampled else len(Design.of(self.site.settings.ensemble).seeds)

    def _size(self, cells: float) -> tuple[tuple[float, float, float], float]:
        """Spacing [m] with so many cells through the mean thickness of the release, of the shape of the site's cells, and cells."""
        masses = self.site.data().masses
        depth = sum(m.volume for m in masses) / sum(m.area for m in masses)
        east, north, up = self.site_size()
        height = Preset(cells).cell_size(depth, min(m.area for m in masses) / (max(east, north) / up) ** 2)
        return (height * east / up, height * north / up, height), depth / height

    def _time(self, size: tuple[float, float, float], members: int) -> float:
        """Forecast time [s] of members on cells of a size."""
        return forecast(self.changed(size, members), range(members), workers=self.workers, cost_of=self.cost_of).seconds

    def changed(self, size: tuple[float, float, float], members: int) -> "Site":
        """The site with other cells and another number of members."""
        ensemble = self.site.settings.ensemble
        if self._sampled:
            ensemble = ensemble.model_copy(update={"members": members, "tolerance": None})
        cells = size if len(set(size)) > 1 else size[:1]
        return self.site.with_settings(simulation=self.site.settings.simulation.with_cell_size(cells), ensemble=ensemble)

    def numerical_error(self, size: tuple[float, float, float], through: float) -> float:
        """Error bar of the run-out by the grid [1]: measured on this site, else expected of its cells."""
        measured = read_convergence(self.results)
        if measured:
            require_error_bars(measured, self.results / "convergence.json")
        return measured_errors(measured, size[0])[1] or expected_errors(through)[1]

    def sampling_error(self, spread: float, members: int) -> float:
        """Error bar of the run-out by the number of members [1]; 0 where no parameter is sampled."""
        return median_error(spread, members) if self._sampled else 0.0

    def spread(self) -> float:
        """Standard deviation of the run-out between members over its mean [1], forecast for the smallest net.

        Points slide in place of the mass; the run-out grows with the volume like V^(1/3), as masses of one shape
        do. Other parameters of the material do not count.
        """
        from runout.ensemble.member import plan_members

        if not self._sampled:
            return 0.0
        site = self.changed(self._size(FEWEST_MEASURED)[0], SMALLEST_NET)
        samples, data = [m.parameters for m in plan_members(site)], site.data()
        fastest = max(one.flow_speed for one in member_stiffness(site, data.masses, data.friction_zones, samples))
        volumes = np.cbrt([sample.get(VOLUME, 1.0) for sample in samples])
        alike = [{**sample, VOLUME: 1.0} if VOLUME in sample else sample for sample in samples]
        paths = np.array([flow.path for flow in flows_of([site.member_arguments(sample) for sample in alike], fastest)])
        return float(math.hypot(*(np.std(x, ddof=1) / np.mean(x) for x in (paths, volumes))))

    def settings(self, choice: Choice) -> tuple[str, ...]:
        """Settings of the command line (``--set``) that make a choice."""
        stated = self.site.stated()
        changes = [f"{CHOSEN[0]}={choice.cells}"] + ([f"{CHOSEN[1]}={choice.members}"] if self._sampled else [])
        changes += ["ensemble.tolerance="] if "tolerance" in stated.get("ensemble", {}) else []
        return tuple(changes)

    def chosen(self) -> tuple[str, ...]:
        """Settings of the best choice. A results folder keeps it, so that a run that goes on has the same cells and members."""
        key = checksum([self.seconds, self.site.stated()])
        stored = read_json(self.results / RECORD)
        if stored.get("key") == key:
            LOGGER.info("budget of %s: %s, as before", duration(self.seconds), ", ".join(stored["settings"]))
            return tuple(stored["settings"])
        choices = self.choices()
        for line in self.lines(choices):
            LOGGER.info("%s", line)
        settings = self.settings(best(choices))
        write_json({"key": key, "settings": list(settings)}, self.results / RECORD)
        return settings

    def lines(self, choices: Sequence[Choice]) -> Iterator[str]:
        """The choices as a table, the one that is taken, and why."""
        taken = best(choices)
        yield f"budget    {duration(self.seconds)} for the members; errors of the run-out that hold 9 of 10 cases:"
        yield "          cells [m]    through  members  time         grid     members  together"
        for one in choices:
            sampling = f"{100 * one.sampling:5.2g} %" if one.sampling else "      -"
            mark = "<- taken" if one is taken else ""
            yield (
                f"          {one.cells:<12} {one.through:<8.2g} {one.members:<8d} {duration(one.seconds):<12} "
                f"{100 * one.numerical:5.2g} %  {sampling}  {100 * one.error:5.2g} %  {mark}"
            ).rstrip()
        yield f"          {self._reason(taken, choices)}"

    def _reason(self, taken: Choice, choices: Sequence[Choice]) -> str:
        """Why a choice is taken, and what its errors do not hold."""
        finer = "finer cells do not fit" if taken is choices[-1] else "finer cells leave too few members"
        if not self._sampled:
            return f"cells of {taken.cells} m: {finer}; the site states its members, or samples no parameter: their number stays"
        if not taken.sampling:
            return f"cells of {taken.cells} m: {finer}; the spread by the sampled parameters cannot be forecast"
        return f"cells of {taken.cells} m and {taken.members} members leave the least error together; {finer}"


def best(choices: Sequence[Choice]) -> Choice:
    """The choice of the least error; of several with that the finest."""
    return min(reversed(choices), key=lambda one: one.error)
