"""Coverage of the two likelihoods of an outline on lobes of known friction and volume, by a cheap stand-in for the simulation.

    python -m tests.benchmarks.outline_likelihood --out DIR [--events 20] [--error 10]

A lobe is an ellipse whose length follows from friction and volume by an energy line, and whose width from the volume. Its boundary
waves by a random distance: 5 m in the members, ``--error`` in what is observed; cells are 20 m. Each event has another truth. The
script prints, for area with run-out and for the boundary in parts with run-out, how often the interval of 90 % holds the truth
and by how much the mean misses it, and writes `outline_likelihood.json`.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from runout.calibration.emulator import Emulator, one_thread, varies
from runout.calibration.observed_scalars import Measure, kind_of, observed_scalars
from runout.calibration.posterior import Likelihood
from runout.calibration.prior import Prior
from runout.config.distributions import Uniform
from runout.ensemble.design import sobol_points
from runout.model.terrain import Terrain
from runout.scores.flow import Flow
from runout.scores.grid import Grid, outline_shares
from runout.scores.observations import Observations

RECORD = "outline_likelihood.json"
CELL, ROWS, COLUMNS = 20.0, 40, 90
MEMBERS, DESIGNS, POINTS = 32, 2, 4096
PRIOR = Prior(
    {
        "friction": Uniform(distribution="uniform", low=12.0, high=24.0),
        "factor": Uniform(distribution="uniform", low=0.5, high=1.5),
    }
)
TERRAIN = Terrain.from_array(np.tile(np.linspace(500.0, 5.0, COLUMNS), (ROWS, 1)), CELL)
GRID = Grid.of(TERRAIN)
RELEASED = np.zeros((ROWS, COLUMNS))
RELEASED[18:22, 6:12] = 5.0
LIKELIHOODS = {"area": False, "boundary": True}


def lobe(values: np.ndarray, seed: list[int], wave: float) -> shapely.Polygon:
    """Outline of the flow with friction [deg] and volume factor; its boundary waves by a standard deviation ``wave`` [m]."""
    random, angles = np.random.default_rng(seed), np.linspace(0.0, 2.0 * np.pi, 181)[:-1]
    friction, factor = values
    length = 320.0 * factor**0.2 / np.tan(np.radians(friction))
    width = 90.0 * factor**0.4 * (friction / 18.0) ** 0.3
    waves = [random.standard_normal() * np.cos(k * angles + random.uniform(0.0, 2.0 * np.pi)) for k in range(5)]
    moved = wave * np.sum(waves, axis=0) / np.sqrt(3.0)
    across, up = (length / 2 + moved) * np.cos(angles), (width + moved) * np.sin(angles)
    return shapely.Polygon(np.column_stack([140.0 + length / 2 + across, 400.0 + up])).buffer(0)


def flow_of(outline: shapely.Polygon) -> Flow:
    """Maps of a flow that is 1 m thick inside an outline."""
    thickness = (outline_shares(outline, GRID) >= 0.5).astype(float)
    return Flow(GRID, {"thickness": thickness, "deposit": thickness})


def likelihood(seen: shapely.Polygon, points: np.ndarray, flows: list[Flow], boundary: bool) -> Likelihood:
    """Likelihood of an observed outline from members at points (members, 2), with the scalars that a calibration counts."""
    measure = Measure.of(Observations(GRID, outline=seen), TERRAIN, RELEASED, 0.5, boundary)
    modelled, chosen, emulators = [measure.of_member(one, RELEASED) for one in flows], [], []
    for scalar in observed_scalars(measure.of_event(), CELL):
        values = np.array([row[scalar.name] for row in modelled])
        emulator = Emulator.fit(points, values) if varies(values) else None
        if emulator is not None and emulator.q2 >= kind_of(scalar.name).least_q2:
            chosen.append(scalar)
            emulators.append(emulator)
    observed, errors = (np.array([getattr(one, part) for one in chosen]) for part in ("value", "error"))
    return Likelihood(PRIOR, tuple(emulators), observed, errors)


def posterior(of: Likelihood) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, 5 and 95 % (2,) of the parameters, by weights of points of a Sobol net: exact, unlike a chain of some length."""
    points = sobol_points(POINTS, 2, 5)
    with one_thread():
        density = of.log_density(points)
    weights, values = np.exp(density - density.max()), PRIOR.values(points)
    weights /= weights.sum()
    order = np.argsort(values, axis=0)
    below = np.cumsum(weights[order], axis=0)
    low, high = (np.array([values[order[np.searchsorted(below[:, k], q), k], k] for k in range(2)]) for q in (0.05, 0.95))
    return weights @ values, low, high


def main() -> None:
    """Calibrate all events with both likelihoods, print and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--events", type=int, default=20)
    parser.add_argument("--error", type=float, default=10.0, help="of the observed boundary [m]")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    designs = []
    for design in range(DESIGNS):
        points = sobol_points(MEMBERS, 2, design)
        designs.append((points, [flow_of(lobe(v, [design, k], 5.0)) for k, v in enumerate(PRIOR.values(points))]))
    rows: dict[str, Any] = {name: {"errors": [], "covered": [], "width": []} for name in LIKELIHOODS}
    for event in range(a.events):
        truth = PRIOR.values(np.random.default_rng([event, 2]).uniform(0.1, 0.9, (1, 2)))[0]
        seen = lobe(truth, [event, 3], a.error)
        for name, boundary in LIKELIHOODS.items():
            mean, low, high = posterior(likelihood(seen, *designs[event % DESIGNS], boundary))
            rows[name]["errors"].append((mean - truth).tolist())
            rows[name]["covered"].append(((low <= truth) & (truth <= high)).tolist())
            rows[name]["width"].append((high - low).tolist())
    record: dict[str, Any] = {"events": a.events, "error": a.error, "cell": CELL, "members": MEMBERS}
    for name, one in rows.items():
        misses, widths = (np.array(one[key]) for key in ("errors", "width"))
        record[name] = {
            "covered": np.sum(one["covered"], axis=0).tolist(),
            "rms_error": np.sqrt(np.square(misses).mean(axis=0)).tolist(),
            "width_90": widths.mean(axis=0).tolist(),
        }
        print(f"{name}: {record[name]}, friction [deg] and volume factor, {a.events} events")
    (a.out / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
