"""How sure the run-out of a study is: what sampled parameters, the grid and the number of members leave open, and what decides."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.forecast.accuracy import FEWEST_MEASURED, expected_errors
from runout.forecast.numerical_error import measured_errors
from runout.forecast.sampling_error import BAR, median_error
from runout.hazard.order import effective_sample_size, weighted_percentiles
from runout.report import tables
from runout.report.figures import parameter_label
from runout.report.study import Study
from runout.report.wording import percent, quantity

PARAMETERS, GRID, MEMBERS = "the sampled parameters", "the grid", "the number of members"
LEAST_CORRELATION = 0.5  # rank correlation of a parameter with the run-out from which on it is named
FEWEST_RANKED = 8  # members from which on correlations are stated


@dataclass(frozen=True)
class Part:
    """What one source leaves open of the run-out."""

    source: str  # :data:`PARAMETERS`, :data:`GRID` or :data:`MEMBERS`
    share: float | None  # bar that holds 9 of 10 cases, over the median run-out [1]; None where it is not known
    basis: str  # how it is known, or why it is not
    remedy: str  # what reduces it

    def row(self) -> tuple[str, str, str, str]:
        """Source, bar, basis and remedy as text."""
        return self.source, "not known" if self.share is None else f"± {percent(self.share)}", self.basis, self.remedy


def parts(study: Study, settings: Mapping[str, Any]) -> list[Part]:
    """What parameters, grid and number of members leave open of the median run-out; empty if no member has run out."""
    runouts = np.asarray(study.valid["runout_distance"], float) if len(study.valid) else np.empty(0)
    weights = np.asarray(study.valid["weight"], float) if len(study.valid) else np.empty(0)
    if not runouts.size or not np.isfinite(runouts).all() or (median := _median(runouts, weights)) <= 0:
        return []
    mean = np.average(runouts, weights=weights)
    members = effective_sample_size(weights / weights.sum())
    variance = np.average((runouts - mean) ** 2, weights=weights) * members / max(members - 1.0, 1.0)
    spread = math.sqrt(variance) / median if runouts.size > 1 else None
    return [_of_parameters(study, spread), _of_grid(study, settings), _of_members(study, spread, members)]


def statement(sources: list[Part], study: Study) -> str:
    """The first sentence of a report: how uncertain the run-out is, which source decides, and what would reduce it."""
    if not sources:
        return ""
    median = _median(np.asarray(study.valid["runout_distance"], float), np.asarray(study.valid["weight"], float))
    known = sorted((part for part in sources if part.share is not None), key=lambda part: -float(part.share or 0.0))
    if not known:
        return f"The median run-out is {quantity(median, 'm')}; its error is not known: {sources[0].basis}."
    bars = ", ".join(f"± {percent(float(part.share or 0.0))} through {part.source}" for part in known)
    unknown = [part.source for part in sources if part.share is None]
    first = known[0]
    decides = f"{first.source} decide{'' if first.source == PARAMETERS else 's'}"
    what = f"The median run-out of {quantity(median, 'm')} is uncertain by {bars}: {decides}; {first.remedy} would reduce it."
    return what if not unknown else f"{what} The error of {' and of '.join(unknown)} is not known and not in these numbers."


def _median(values: np.ndarray, weights: np.ndarray) -> float:
    return float(weighted_percentiles(values[:, None], weights / weights.sum(), [50.0])[0][0])


def _of_parameters(study: Study, spread: float | None) -> Part:
    """What the sampled parameters leave open: the spread between the members."""
    names = tables.sampled_parameters(study)
    remedy = "better knowledge of friction, volume and material"
    if not names or spread is None:
        why = "no parameter is sampled" if not names else "one member has no spread"
        return Part(PARAMETERS, None, f"{why}; sample friction and volume under ensemble.parameters", remedy)
    by_rank = {name: _rank_correlation(study, name) for name in names} if len(study.valid) >= FEWEST_RANKED else {}
    name, correlation = max(by_rank.items(), key=lambda item: abs(item[1]), default=("", 0.0))
    basis = "spread of the run-out between the members"
    if abs(correlation) >= LEAST_CORRELATION:
        words = parameter_label(name).split(" [")[0]
        return Part(
            PARAMETERS, BAR * spread, f"{basis}; rank correlation with {words} {correlation:.2f}", f"a better known {words}"
        )
    return Part(PARAMETERS, BAR * spread, basis, remedy)


def _rank_correlation(study: Study, name: str) -> float:
    """Spearman's correlation of a sampled parameter with the run-out over the valid members; 0 for constant values."""
    ranks = study.valid[[name, "runout_distance"]].astype(float).rank()
    correlation = float(ranks.corr().iloc[0, 1])
    return 0.0 if math.isnan(correlation) else correlation


def _of_grid(study: Study, settings: Mapping[str, Any]) -> Part:
    """What the grid leaves open: measured on the site, or expected of its cells."""
    remedy = "finer cells (half the size halves it, at 16 times the work)"
    size = float(np.ravel(settings["simulation"]["cell_size"])[0])
    _, measured = measured_errors(study.convergence or {}, size)
    if measured:
        return Part(GRID, measured, "runs on several grids (verify --convergence)", remedy)
    through = tables.cells_through(study, settings)
    if through < FEWEST_MEASURED:
        why = f"{through:.2g} cells through the mean thickness of the release, fewer than {FEWEST_MEASURED:g}"
        return Part(GRID, None, why, "finer cells")
    basis = f"expected of {through:.2g} cells through the mean thickness of the release; no second grid was run"
    return Part(GRID, expected_errors(through)[1], basis, remedy)


def _of_members(study: Study, spread: float | None, members: float) -> Part:
    """What the number of members leaves open of the median."""
    count, remedy = len(study.valid), "more members"
    if spread is None:
        return Part(MEMBERS, None, "one member has no spread", remedy)
    estimator = str(study.hazard["thickness_exceedance_standard_error"].attrs.get("estimator", ""))
    net = "consecutive blocks" in estimator
    basis = f"{count} members" + (" of a Sobol net" if net else ", as of independent members")
    return Part(MEMBERS, median_error(spread, round(members), net=net), basis, remedy)
