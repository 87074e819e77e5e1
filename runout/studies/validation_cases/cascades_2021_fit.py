"""Cascades 2021 with a wet mass on an erodible bed: members chosen by half of the reaches and judged by the other half.

A member is a draw of friction, pore pressures by blocks, drainage, bed and bulking, from ranges that no observation of this event
has narrowed, and an arrangement of the blocks. Each law of erosion has members of its own. They are chosen by four criteria, which
use more and more of what the half of the reaches shows. landlab's MassWastingRunout is drawn and chosen likewise.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import runout
from runout.scores import Grid, Reaches, resampled
from runout.studies.validation_cases.cascades_2021 import BED, COMPARED, DENSITY, END, Event, compared, read
from runout.studies.validation_cases.case import on_all_processors

CELL_SIZE = 5.0  # [m]
MEMBERS, LAW_MEMBERS, AUTOMATA, ARRANGEMENTS = 256, 64, 128, 8  # law members: of each other law of erosion
SEED, LAW_SEED = 2021, 7  # of the draws
SEVERAL = 8  # members whose mean is judged beside the best one
HALVES = ([0, 2, 4], [1, 3, 5])  # reaches by number, from north to south
AIMED = {"csi": 0.5, "agreement": 0.85}  # scores of a member [1]
DEPOSITS = [2, 3, 5]  # reaches where the survey shows deposits
BED_RATIOS = (0.0, 0.3, 0.5, 0.65, 0.8)  # pore pressure ratios of the bed [1]
RANGES = {
    "basal_friction_deg": (20.0, 28.0),
    "least_ratio": (0.0, 0.6),
    "ratio_span": (0.0, 0.6),
    "block": (10.0, 40.0),  # [m]
    "log_decay_time": (math.log(20.0), math.log(300.0)),  # [s]
    "bed_ratio": (0.2, 0.7),
    "depth_per_stress": (0.5e-4, 2.0e-4),  # [m/Pa]
    "bulking": (0.8, 1.1),
}
_WITHOUT_LAW = {name: ends for name, ends in RANGES.items() if name != "depth_per_stress"}
LAW_RANGES = {
    "growth": _WITHOUT_LAW | {"log_growth_rate": (math.log(3.0e-4), math.log(3.0e-3))},  # [1/m]
    "energy": _WITHOUT_LAW | {"log_specific_energy": (math.log(1.0e3), math.log(2.0e4))},  # [J/kg]
}
AUTOMATON_RANGES = {
    "critical_slope": (0.08, 0.25),
    "threshold_flux": (0.3, 1.5),
    "erosion_coefficient": (0.015, 0.06),
    "erodible_thickness": (0.6, 2.0),
}


@dataclass(frozen=True)
class Job:
    """One run: of `runout` or `landlab`, with its numbers and the seed of its arrangement."""

    model: str
    numbers: Mapping[str, float]
    seed: int


def drawn(model: str, ranges: Mapping[str, tuple[float, float]], count: int, seed: int = SEED) -> list[Job]:
    """Jobs of a scrambled Sobol sequence over ranges."""
    from scipy.stats import qmc

    low, high = np.array(list(ranges.values())).T
    points = qmc.scale(qmc.Sobol(len(ranges), rng=seed).random(count), low, high)
    return [Job(model, dict(zip(ranges, map(float, point), strict=True)), number) for number, point in enumerate(points)]


def wet(numbers: Mapping[str, float]) -> dict[str, float]:
    """Numbers of a run in the middle of the ranges, with some of its own."""
    return {name: 0.5 * (low + high) for name, (low, high) in RANGES.items()} | dict(numbers)


@cache
def _event() -> Event:
    return read()


def done(job: Job) -> dict[str, Any]:
    """Numbers, scores, volumes and change of the ground (rows, columns) [m] of a job."""
    event = _event()
    change, entrained = _flow(event, job) if job.model == "runout" else (_automaton(event, job), 0.0)
    row = {"numbers": dict(job.numbers), "seed": job.seed, "entrained_volume": entrained, "change": change}
    return row | compared(event, change)


def _flow(event: Event, job: Job) -> tuple[np.ndarray, float]:
    """Change of the ground (rows, columns) [m] by a run, and what it took from the bed [m3]."""
    numbers = job.numbers
    high = min(numbers["least_ratio"] + numbers["ratio_span"], 0.95)
    ratio = {"low": numbers["least_ratio"], "high": high, "block": numbers["block"]}
    release = event.wet_release(runout.PorePressure(ratio=ratio, decay_time=math.exp(numbers["log_decay_time"])))
    result = runout.simulate(
        event.terrain,
        release,
        runout.DruckerPrager(density=DENSITY, friction_angle=32.0),
        basal_friction_angle=numbers["basal_friction_deg"],
        bed=runout.Bed(BED, _erosion(numbers), pore_pressure_ratio=numbers["bed_ratio"]),
        bulking=numbers["bulking"],
        cell_size=CELL_SIZE,
        end_time=END,
        seed=job.seed,
        threads=1,
    )
    entrained = float(result.ledger["entrained_mass"][-1]) / DENSITY
    return np.nan_to_num(result.maps["elevation_change"].values), entrained


def _erosion(numbers: Mapping[str, float]) -> runout.Erosion:
    """The law of erosion that the numbers of a job belong to."""
    if "log_growth_rate" in numbers:
        return runout.GrowthErosion(growth_rate=math.exp(numbers["log_growth_rate"]))
    if "log_specific_energy" in numbers:
        return runout.EnergyErosion(specific_energy=math.exp(numbers["log_specific_energy"]))
    return runout.RammsErosion(depth_per_stress=numbers["depth_per_stress"])


def _automaton(event: Event, job: Job) -> np.ndarray:
    """Change of the ground (rows, columns) [m] by landlab's MassWastingRunout."""
    from runout.slopes.choices import MassWasting
    from runout.slopes.mass_wasting import mass_wasting

    baseline = mass_wasting(event.terrain, [event.release], MassWasting(**job.numbers))
    return np.nan_to_num(resampled(baseline.change, Grid.of(baseline.terrain), Grid.of(event.terrain)))


def mismatches(event: Event, changes: np.ndarray, half: Sequence[int]) -> dict[str, np.ndarray]:
    """Mismatch (members,) of changes of the ground (members, rows, columns) [m] in the reaches of a half, by each criterion.

    ``net`` sums the absolute errors of the net volumes [m3], ``gross`` those of the volumes lowered and raised [m3]. ``map`` is the
    root of the mean squared error of changes averaged over 3 x 3 cells [m]: the channel is one to two cells wide. ``areas`` is
    ``gross`` over the observed volumes lowered and raised, and 1 - CSI of the changed areas [1].
    """
    from scipy.ndimage import uniform_filter

    reaches = event.reaches
    within = np.isin(reaches.number, half)
    observed = np.where(within, event.observed, 0.0)  # a criterion must not see the other half
    of_members, of_event = (_volumes(reaches, maps)[:, :, half] for maps in (changes, observed[None]))
    net, lowered, raised = np.abs(of_members - of_event).sum(axis=2)
    smooth, goal = (
        uniform_filter(np.where(within, maps, 0.0), (0, 3, 3), mode="constant")[:, within] for maps in (changes, observed[None])
    )
    modelled, seen = (np.abs(maps[:, within]) >= COMPARED for maps in (changes, observed[None]))
    csi = (modelled & seen).sum(axis=1) / (modelled | seen).sum(axis=1)
    return {
        "net": net,
        "gross": lowered + raised,
        "map": np.sqrt(((smooth - goal) ** 2).mean(axis=1)),
        "areas": (lowered + raised) / np.abs(of_event[1:]).sum() + 1.0 - csi,
    }


def _volumes(reaches: Reaches, changes: np.ndarray) -> np.ndarray:
    """Volumes (3, members, reaches) [m3] of changes (members, rows, columns) [m]: net, lowered and raised."""
    parts = (changes, np.minimum(changes, 0.0), np.maximum(changes, 0.0))
    return np.array([[reaches.volumes(change) for change in part] for part in parts])


def by_halves(event: Event, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """For each criterion and half of the reaches the member that is best on it, and its errors of net volumes [m3] on both halves.

    ``error_of_several`` is that of the mean change of the :data:`SEVERAL` best members, ``csi_of_several`` and
    ``agreement_of_several`` its scores, ``least_several`` and ``most_several`` the errors of each. ``rank_correlation`` is that of
    the criterion on the half with the error on the other one over all members.
    """
    from scipy.stats import spearmanr

    changes, chosen = np.array([row["change"] for row in rows]), []
    for fitted, judged in (HALVES, HALVES[::-1]):
        errors = mismatches(event, changes, judged)["net"]
        for criterion, values in (on_fitted := mismatches(event, changes, fitted)).items():
            order = values.argsort(kind="stable")
            best, several = int(order[0]), order[:SEVERAL]
            mean = changes[several].mean(axis=0)
            scores = compared(event, mean)
            kept = "numbers", "csi", "agreement", "erosion_volume", "deposition_volume", "reach_volumes"
            chosen.append(
                {
                    "criterion": criterion,
                    "fitted": list(fitted),
                    "error_fitted": float(on_fitted["net"][best]),
                    "error": float(errors[best]),
                    "error_of_several": float(mismatches(event, mean[None], judged)["net"][0]),
                    "csi_of_several": scores["csi"],
                    "agreement_of_several": scores["agreement"],
                    "least_several": float(errors[several].min()),
                    "most_several": float(errors[several].max()),
                    "least": float(errors.min()),
                    "rank_correlation": float(spearmanr(values, errors).statistic) if len(rows) > 2 else None,
                }
                | {key: rows[best][key] for key in kept}
            )
    return chosen


def of_all(event: Event, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Scores of the mean change of all members, which no half has chosen, and its errors of net volumes [m3] on both halves.

    ``with_deposits`` counts the members that leave at least half of the observed deposit in each of the :data:`DEPOSITS`.
    """
    changes = np.array([row["change"] for row in rows])
    mean = changes.mean(axis=0)
    raised, observed = (_volumes(event.reaches, maps)[2][:, DEPOSITS] for maps in (changes, event.observed[None]))
    return {
        "errors": [float(mismatches(event, mean[None], half)["net"][0]) for half in HALVES],
        "with_deposits": int((raised >= 0.5 * observed).all(axis=1).sum()),
    } | compared(event, mean)


def measure(full: bool) -> dict[str, Any]:
    """All members of both models, the choices by halves, and the spread by the pore pressure of the bed; in CI one member."""
    event = read()
    if not full:
        row = done(Job("runout", wet({}), 0))
        del row["change"]
        return {"members": [row], "lines": [f"  one member: CSI {row['csi']:.2f}, reach error {row['reach_error']:.0f} m3"]}
    jobs = {"runout": drawn("runout", RANGES, MEMBERS)}
    jobs |= {law: drawn("runout", ranges, LAW_MEMBERS, LAW_SEED) for law, ranges in LAW_RANGES.items()}
    jobs["landlab"] = drawn("landlab", AUTOMATON_RANGES, AUTOMATA)
    results: dict[str, Any] = {"observed": compared(event, event.observed)}
    for model, drawn_jobs in jobs.items():
        rows = on_all_processors(done, drawn_jobs)
        results[model] = _summary(rows) | {"halves": by_halves(event, rows), "mean": of_all(event, rows)}
    results["bed_ratios"] = _by_bed_ratio()
    return results | {"lines": _lines(results)}


def _by_bed_ratio() -> list[dict[str, Any]]:
    """Least, median and largest values over arrangements of the blocks, for each pore pressure ratio of the bed."""
    of_bed = [Job("runout", wet({"bed_ratio": ratio}), seed) for ratio in BED_RATIOS for seed in range(ARRANGEMENTS)]
    rows, spread = on_all_processors(done, of_bed), []
    for number, ratio in enumerate(BED_RATIOS):
        part = rows[number * ARRANGEMENTS : (number + 1) * ARRANGEMENTS]
        keys = "entrained_volume", "erosion_volume", "reach_error", "csi"
        spread.append({"bed_ratio": ratio} | {key: np.percentile([r[key] for r in part], (0, 50, 100)).tolist() for key in keys})
    return spread


def _lines(results: Mapping[str, Any]) -> list[str]:
    rows = [(model, half) for model in ("runout", *LAW_RANGES, "landlab") for half in results[model]["halves"]]
    told = "  {}, fitted on reaches {} by {}: error there {:.0f} m3, on the others {:.0f} m3"
    return [told.format(model, half["fitted"], half["criterion"], half["error_fitted"], half["error"]) for model, half in rows]


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Percentiles 0, 5, 50, 95 and 100 of scores and volumes over members; how many they are, and have both scores aimed at."""
    keys = "csi", "agreement", "reach_error", "erosion_volume", "deposition_volume"
    table = {key: np.percentile([row[key] for row in rows], (0, 5, 50, 95, 100)).tolist() for key in keys}
    return {"count": len(rows), "with_both_scores": sum(map(has_both_scores, rows)), **table}


def has_both_scores(row: Mapping[str, Any]) -> bool:
    """Whether a member has the scores that were aimed at."""
    return all(row[key] >= least for key, least in AIMED.items())
