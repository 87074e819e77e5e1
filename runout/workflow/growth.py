"""Size of an ensemble with a tolerance: a Sobol net doubles until the sampling error of its maps is small enough."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.config.hazard import stated_conditions
from runout.ensemble.design import member_table, nets_of
from runout.ensemble.member import plan_members
from runout.ensemble.run import EnsembleReport, run_ensemble
from runout.hazard.exceedance import aggregate, stated_thresholds
from runout.hazard.sampling import Estimator
from runout.io import source_code
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.model.limits import SMALLEST_NET

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member

LOGGER = logging.getLogger(__name__)
RECORD = "sampling.json"
Run = Callable[[range | None], EnsembleReport]


@dataclass(frozen=True)
class Size:
    """A size that was measured."""

    members: int  # of the net
    error: float  # largest ``*_exceedance_rms_error`` over all thresholds [1]
    reason: str = ""  # why it is the error of independent members; empty where it is that of the net

    @classmethod
    def read(cls, members: int, stored: Any, key: str) -> "Size | None":
        """Size from a JSON record; None if the record is not valid, or of another key."""
        if not isinstance(stored, Mapping) or stored.get("key") != key:
            return None
        error, reason = stored.get("error"), stored.get("reason")
        return cls(members, float(error), reason) if isinstance(error, int | float) and isinstance(reason, str) else None

    def __str__(self) -> str:
        return f"{self.error:.2g} with {self.members}" + (f" (as of independent members: {self.reason})" if self.reason else "")


@dataclass(frozen=True)
class Growth:
    """State of an ensemble with a tolerance."""

    tolerance: float  # largest error that is accepted [1]
    most: int  # largest number of members
    sizes: tuple[Size, ...] = ()  # measured sizes, each twice the one before; only the last one may meet the tolerance

    @property
    def reached(self) -> bool:
        """Whether the last size meets the tolerance."""
        return bool(self.sizes) and self.sizes[-1].error <= self.tolerance

    @property
    def finished(self) -> bool:
        """Whether the ensemble grows no more."""
        return self.reached or (bool(self.sizes) and self.sizes[-1].members >= self.most)

    @property
    def members(self) -> int:
        """Members that are needed now: those of the final size, or of the next one that is to be measured."""
        last = self.sizes[-1].members if self.sizes else SMALLEST_NET // 2
        return last if self.finished else 2 * last

    def extended(self, size: Size) -> "Growth":
        """The growth with one more measured size."""
        return replace(self, sizes=(*self.sizes, size))

    def statement(self) -> str:
        """What was asked, what was reached, and why the ensemble stopped, or what comes next."""
        asked = f"sampling error of at most {self.tolerance:g} asked for, with at most {self.most} members"
        found = "; found " + ", ".join(map(str, self.sizes)) if self.sizes else ""
        if self.reached:
            return f"{asked}{found}: it is reached"
        return f"{asked}{found}: " + ("it is not reached, all members are used" if self.finished else f"{self.members} come next")


def asked(site: "Site") -> Growth | None:
    """Growth of the ensemble of a site before any size is measured; None without a tolerance."""
    ensemble = site.settings.ensemble
    tolerance = getattr(ensemble, "tolerance", None)
    return None if tolerance is None else Growth(tolerance, ensemble.members)


def known_growth(growth: Growth, site: "Site", results: Path, members: "Sequence[Member]", failed: Iterable[int]) -> Growth:
    """Growth as far as the record of a results folder has it for these members, failures and thresholds.

    Parameters
    ----------
    growth : Growth
        That of :func:`asked`.
    site : Site
        The site.
    results : Path
        The results folder.
    members : sequence of Member
        All members of the largest net.
    failed : iterable of int
        Members that failed.
    """
    stored, without = read_json(Path(results) / RECORD), sorted(failed)
    while not growth.finished:
        size = Size.read(growth.members, stored.get(str(growth.members)), _key(site, members[: growth.members], without))
        if size is None:
            break
        growth = growth.extended(size)
    return growth


def grow(site: "Site", results: Path, run: Run | None = None) -> EnsembleReport:
    """Report of an ensemble that is doubled until its growth is finished; without a tolerance of one that is run as a whole.

    Every size is measured when its members have run, and recorded, so that a run that was killed goes on from there. Members of
    smaller sizes are those of the larger ones and are not run again.

    Parameters
    ----------
    site : Site
    results : Path
        The results folder.
    run : callable, optional
        Runs the members of a range, all if it is None. Default: :func:`runout.ensemble.run.run_ensemble`.
    """
    run = run or (lambda part: run_ensemble(site, results, part=part))
    start = asked(site)
    if start is None:
        return run(None)
    growth, report, members = start, run(range(SMALLEST_NET)), plan_members(site)
    while not growth.finished and report.valid:
        if report.members < growth.members:
            report = report.joined(run(range(report.members, growth.members)))
        known = known_growth(start, site, results, members, report.failed).sizes[len(growth.sizes) :]
        growth = growth.extended(known[0] if known else _record(site, results, members[: growth.members], report))
        LOGGER.info("%s", growth.statement())
    return replace(report, growth=growth.statement())


def _record(site: "Site", results: Path, members: "Sequence[Member]", report: EnsembleReport) -> Size:
    """A size whose members have run, after entering it into the record."""
    path, key = Path(results) / RECORD, _key(site, members, sorted(report.failed))
    size = measured(site, results, members, report.valid)
    write_json({**read_json(path), str(size.members): {"key": key, "error": size.error, "reason": size.reason}}, path)
    return size


def measured(site: "Site", results: Path, members: "Sequence[Member]", valid: Iterable[int]) -> Size:
    """Size of an ensemble with the sampling error of the maps over its valid members."""
    having = set(valid)
    files = [member.file(results) for member in members if member.number in having]
    ensemble, count = site.settings.ensemble, len(members)
    estimator = Estimator.of(member_table(ensemble, count), files, nets_of(ensemble, count))
    thresholds, joint = _asked(site)
    maps = aggregate(files, [1.0] * len(files), thresholds, [50.0], joint=joint, estimator=estimator)
    errors = [float(maps[name].max()) for name in maps.data_vars if str(name).endswith("_exceedance_rms_error")]
    return Size(len(members), max(errors), estimator.reason)


def _key(site: "Site", members: "Sequence[Member]", failed: Sequence[int]) -> str:
    """Checksum of what the error of a size depends on."""
    without = [number for number in failed if number < len(members)]
    return checksum([source_code.checksums().products, [member.key for member in members], without, _asked(site)])


def _asked(site: "Site") -> tuple[dict[str, list[float]], list[dict[str, float]]]:
    """Thresholds and joint conditions of a site, whose probabilities have a sampling error."""
    return stated_thresholds(site.settings.hazard), stated_conditions(site.settings.hazard)
