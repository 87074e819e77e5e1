"""Cascades 2021 with a wet mass on an erodible bed: members chosen by half of the reaches and judged by the other half.

A member is a draw of friction, pore pressures by blocks, drainage, bed and bulking, from ranges that no observation of this event
has narrowed, and an arrangement of the blocks. Wider ranges add the depth of the bed and the saturation, which sets the ratio to
which the pressure relaxes. landlab's MassWastingRunout is drawn and chosen likewise.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import runout
from runout.scores import Grid, resampled
from runout.studies.validation_cases.cascades_2021 import BED, DENSITY, END, Event, compared, read
from runout.studies.validation_cases.case import on_all_processors

CELL_SIZE = 5.0  # [m]
MEMBERS, WIDER_MEMBERS, AUTOMATA, ARRANGEMENTS = 256, 64, 128, 8
LAW_MEMBERS = 8  # of each other law of erosion
SEED, WIDER_SEED, LAW_SEED = 2021, 48, 7  # of the draws
SEVERAL = 8  # members whose mean is judged beside the best one
HALVES = ([0, 2, 4], [1, 3, 5])  # reaches by number, from north to south
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
WIDER_RANGES = RANGES | {
    "bed_depth": (0.6, 2.0),  # [m]
    "saturation": (0.0, 1.0),
    "basal_friction_deg": (20.0, 32.0),
    "bed_ratio": (0.2, 0.8),
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
    """Numbers, scores and volumes of a job."""
    event = _event()
    change, entrained = _flow(event, job) if job.model == "runout" else (_automaton(event, job), 0.0)
    return {"numbers": dict(job.numbers), "seed": job.seed, "entrained_volume": entrained} | compared(event, change)


def _flow(event: Event, job: Job) -> tuple[np.ndarray, float]:
    """Change of the ground (rows, columns) [m] by a run, and what it took from the bed [m3]."""
    numbers = job.numbers
    high = min(numbers["least_ratio"] + numbers["ratio_span"], 0.95)
    ratio = {"low": numbers["least_ratio"], "high": high, "block": numbers["block"]}
    decay_time, saturation = math.exp(numbers["log_decay_time"]), numbers.get("saturation", 0.0)
    pressure = runout.PorePressure(ratio=ratio, decay_time=decay_time, saturation=saturation)
    release = event.wet_release(pressure)
    result = runout.simulate(
        event.terrain,
        release,
        runout.DruckerPrager(density=DENSITY, friction_angle=32.0),
        basal_friction_angle=numbers["basal_friction_deg"],
        bed=runout.Bed(numbers.get("bed_depth", BED), _erosion(numbers), pore_pressure_ratio=numbers["bed_ratio"]),
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


def by_halves(rows: Sequence[Mapping[str, Any]], observed: Sequence[float]) -> list[dict[str, Any]]:
    """For each half of the reaches the member that is best on it, and its errors [m3] on both halves.

    ``error_of_several`` is that of the mean volumes of the :data:`SEVERAL` best members, ``fitted_several`` the largest error of
    each of these on the half that chose them, ``least_several`` and ``most_several`` their errors on the other half.
    """
    volumes = np.array([row["reach_volumes"] for row in rows])
    errors, chosen = np.abs(volumes - np.asarray(observed)), []
    for fitted, judged in (HALVES, HALVES[::-1]):
        order = errors[:, fitted].sum(axis=1).argsort(kind="stable")
        best, several = int(order[0]), order[:SEVERAL]
        on_fitted, on_judged = (errors[np.ix_(several, half)].sum(axis=1) for half in (fitted, judged))
        kept = "numbers", "csi", "agreement", "erosion_volume", "deposition_volume", "reach_volumes"
        chosen.append(
            {
                "fitted": list(fitted),
                "error_fitted": float(errors[best, fitted].sum()),
                "error": float(errors[best, judged].sum()),
                "error_of_several": float(np.abs(volumes[several].mean(axis=0) - observed)[list(judged)].sum()),
                "fitted_several": float(on_fitted.max()),
                "least_several": float(on_judged.min()),
                "most_several": float(on_judged.max()),
                "least": float(errors[:, judged].sum(axis=1).min()),
            }
            | {key: rows[best][key] for key in kept}
        )
    return chosen


def measure(full: bool) -> dict[str, Any]:
    """All members of both models, the choices by halves, and the spread by the pore pressure of the bed; in CI one member."""
    event = read()
    observed = compared(event, event.observed)["reach_volumes"]
    if not full:
        row = done(Job("runout", wet({}), 0))
        return {"members": [row], "lines": [f"  one member: CSI {row['csi']:.2f}, reach error {row['reach_error']:.0f} m3"]}
    members = on_all_processors(done, drawn("runout", RANGES, MEMBERS))
    wider = on_all_processors(done, drawn("runout", WIDER_RANGES, WIDER_MEMBERS, WIDER_SEED))
    jobs = [job for ranges in LAW_RANGES.values() for job in drawn("runout", ranges, LAW_MEMBERS, LAW_SEED)]
    laws = on_all_processors(done, jobs)
    automata = on_all_processors(done, drawn("landlab", AUTOMATON_RANGES, AUTOMATA))
    of_bed = [Job("runout", wet({"bed_ratio": ratio}), seed) for ratio in BED_RATIOS for seed in range(ARRANGEMENTS)]
    rows = on_all_processors(done, of_bed)
    spread = []
    for number, ratio in enumerate(BED_RATIOS):
        part = rows[number * ARRANGEMENTS : (number + 1) * ARRANGEMENTS]
        keys = "entrained_volume", "erosion_volume", "reach_error", "csi"
        spread.append({"bed_ratio": ratio} | {key: np.percentile([r[key] for r in part], (0, 50, 100)).tolist() for key in keys})
    results = {
        "observed": compared(event, event.observed),
        "runout": _summary(members) | {"halves": by_halves(members, observed)},
        "wider": _summary(wider) | {"halves": by_halves(wider, observed)},
        "laws": _summary(laws) | {"halves": by_halves(laws, observed)},
        "landlab": _summary(automata) | {"halves": by_halves(automata, observed)},
        "bed_ratios": spread,
    }
    return results | {"lines": _lines(results)}


def _lines(results: Mapping[str, Any]) -> list[str]:
    rows = [(model, half) for model in ("runout", "wider", "laws", "landlab") for half in results[model]["halves"]]
    told = "  {}, fitted on reaches {}: error there {:.0f} m3, on the others {:.0f} m3"
    return [told.format(model, half["fitted"], half["error_fitted"], half["error"]) for model, half in rows]


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Percentiles 0, 5, 50, 95 and 100 of scores and volumes over members, and their count."""
    keys = "csi", "agreement", "reach_error", "erosion_volume", "deposition_volume"
    table = {key: np.percentile([row[key] for row in rows], (0, 5, 50, 95, 100)).tolist() for key in keys}
    return {"count": len(rows), **table}
