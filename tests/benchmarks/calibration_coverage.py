"""Coverage of the intervals of ``runout calibrate`` by simulated events whose parameters are known.

    python -m tests.benchmarks.calibration_coverage --out DIR [--events 20] [--members 64] [--draws 25] [--chains 2]

A slab of about 40 000 m3 leaves a gully of 32 degrees and runs out on a plain, in cells of 20 m. The ensemble samples friction,
internal friction and volume by a Sobol net. Each event is one more run with parameters drawn from the same distributions and a seed
of its own; its outline and its deposit are the observations, read from files as those of any site. Two cases:

- drawn: each observed scalar has an error drawn from the normal distribution that its standard error states, ``--draws`` times an
  event. Intervals are those of weights of a Sobol net; the chain of the command is compared with them for ``--chains`` events.
- exact: the observed scalars are those of the run, so that the intervals, which hold the standard errors, are too wide by design.

The script prints how often the interval of 90 % of each parameter holds the truth, and writes `calibration_coverage.json`.
Finished runs are not run again.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.calibration.emulator import one_thread
from runout.calibration.posterior import Likelihood, sampled_posterior
from runout.config.site import read_site
from runout.ensemble.design import Design, sobol_points
from runout.ensemble.member import plan_members
from runout.ensemble.run import run_ensemble
from runout.workflow.calibration import CalibrationChoices, Event
from runout.workflow.study import Study

RECORD, SITE_FILE = "calibration_coverage.json", "site.yaml"
CELL, ROWS, COLUMNS, WEST, NORTH, CRS = 20.0, 36, 80, 600_000.0, 5_100_000.0, "EPSG:32632"
FIRST_SEED, POINTS, INTERVAL = 10_000, 8192, (0.05, 0.95)
THRESHOLD = 0.2  # of the outline [m]
SITE = """\
name: coverage
terrain: {{dem: {inputs}/dem.tif}}
release:
  - {{name: slab, raster: {inputs}/thickness.tif, placement: on_surface}}
material: {{law: drucker_prager, density: 1900, poisson_ratio: 0.3, friction_angle_deg: 34, cohesion: 0}}
basal_friction_angle_deg: 18
simulation: {{cell_size: 20, end_time: 150, stop_when_at_rest: true}}
ensemble:
  members: {members}
  seed: 3
  parameters:
    basal_friction_angle_deg: {{distribution: uniform, low: 12, high: 26}}
    friction_angle_deg: {{distribution: uniform, low: 28, high: 42}}
    release_volume_factor: {{distribution: uniform, low: 0.5, high: 1.5}}
hazard: {{thickness_thresholds: [{threshold}]}}
"""
OBSERVATIONS = "observations: {outline: {polygons: outline.gpkg, shows: flow}, deposit: {raster: deposit.tif}}\n"


def write_raster(path: Path, values: np.ndarray) -> None:
    """Write values (rows, columns) as a GeoTIFF."""
    import rasterio
    from rasterio.transform import from_origin

    shape: dict[str, Any] = {"driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", crs=CRS, transform=from_origin(WEST, NORTH, CELL, CELL), **shape) as raster:
        raster.write(values.astype(np.float32), 1)


def make_site(folder: Path, members: int) -> Path:
    """Folder of the site of the ensemble, after writing its rasters."""
    if (folder / SITE_FILE).is_file():
        return folder
    (folder / "inputs").mkdir(parents=True)
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * CELL, (np.arange(ROWS) + 0.5 - ROWS / 2) * CELL)
    fall = np.maximum(700.0 - x, 0.0)
    ground = 100.0 + 0.62 * fall - 0.02 * x + 6.0e-4 * y**2 * np.clip(fall / 200.0, 0.15, 1.0)
    slab = 6.0 * np.maximum(1.0 - ((x - 160.0) / 90.0) ** 2 - (y / 80.0) ** 2, 0.0)
    write_raster(folder / "inputs" / "dem.tif", ground)
    write_raster(folder / "inputs" / "thickness.tif", slab)
    (folder / SITE_FILE).write_text(SITE.format(inputs="inputs", members=members, threshold=THRESHOLD))
    return folder


def truths(site: Path, events: int, workers: int | None) -> tuple[dict[str, list[float]], list[Path]]:
    """Parameters (events,) of the events by name, and the files of their runs."""
    read = read_site(site)
    distributions = read.settings.ensemble.parameters
    draws = np.random.default_rng(20).uniform(size=(events, len(distributions)))
    values = {name: (one.low + draws[:, k] * (one.high - one.low)).tolist() for k, (name, one) in enumerate(distributions.items())}
    design = Design(values, [FIRST_SEED + k for k in range(events)])
    run_ensemble(read, site / "events", workers=workers, design=design)
    return values, [member.file(site / "events") for member in plan_members(read, design)]


def event_site(site: Path, number: int, file: Path, members: int) -> Path:
    """Folder of the site with the outline and the deposit of a run as observations."""
    import geopandas
    import xarray as xr

    from runout.io.vector import outline

    folder = site / "sites" / f"{number:02d}"
    folder.mkdir(parents=True, exist_ok=True)
    with xr.open_dataset(file) as maps:
        thickness, deposit = maps["max_flow_thickness"].values, maps["deposit_thickness"].values
    reached = outline(np.nan_to_num(thickness) >= THRESHOLD, read_site(site).terrain())
    geopandas.GeoDataFrame(geometry=[reached], crs=CRS).to_file(folder / "outline.gpkg")
    write_raster(folder / "deposit.tif", np.nan_to_num(deposit))
    text = SITE.format(inputs="../../inputs", members=members, threshold=THRESHOLD)
    (folder / SITE_FILE).write_text(text + OBSERVATIONS)
    return folder


def intervals(likelihood: Likelihood, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, 5 and 95 % (draws, parameters) of the cube for observed values (draws, scalars), by weights of a Sobol net."""
    points = sobol_points(POINTS, len(likelihood.prior.names), 5)
    with one_thread():
        mean, covariance = likelihood.predicted(points)
        lower = np.linalg.cholesky(covariance + np.diag(np.square(likelihood.errors)))
        scaled = np.linalg.solve(lower[None], (observed[:, None] - mean)[..., None])[..., 0]  # draws, points, scalars
    densities = -0.5 * np.square(scaled).sum(axis=2) - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
    order, rows = np.argsort(points, axis=0), []
    for density in densities:
        weights = np.exp(density - density.max())
        weights /= weights.sum()
        below = np.cumsum(weights[order], axis=0)
        edges = [[points[order[np.searchsorted(below[:, k], q), k], k] for k in range(points.shape[1])] for q in INTERVAL]
        rows.append([weights @ points, *edges])
    centre, low, high = np.moveaxis(np.array(rows), 1, 0)
    return centre, low, high


def calibrated(event: Event, truth: np.ndarray, number: int, draws: int, chain: bool) -> dict[str, Any]:
    """Whether the intervals of an event hold its truth (parameters,) in the cube, by case.

    ``chain``: also compare the intervals of the chain of the command.
    """
    likelihood, scalars = event.likelihood()
    errors = np.random.default_rng([number, 7]).standard_normal((draws, len(scalars))) * likelihood.errors
    drawn = likelihood.observed + errors
    mean, low, high = intervals(likelihood, np.vstack([likelihood.observed, drawn]))
    inside = (low <= truth) & (truth <= high)
    row: dict[str, Any] = {}
    if chain:
        ends = np.quantile(sampled_posterior(replace(likelihood, observed=drawn[0])).points, INTERVAL, axis=0)
        row["chain_minus_net"] = (ends - np.stack([low[1], high[1]])).tolist()
    return row | {
        "scalars": [one.name for one in scalars],
        "left_out": dict(event.left_out),
        "drawn": inside[1:].tolist(),
        "exact": inside[0].tolist(),
        "width": (high - low)[1:].mean(axis=0).tolist(),
        "misses": (mean - truth)[1:].tolist(),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ensemble and events, calibrate each event, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--events", type=int, default=20)
    parser.add_argument("--members", type=int, default=64)
    parser.add_argument("--draws", type=int, default=25, help="of the errors of the observed scalars of an event")
    parser.add_argument("--chains", type=int, default=2)
    parser.add_argument("--workers", type=int)
    chosen = parser.parse_args(arguments)
    site = make_site(chosen.out / "site", chosen.members)
    values, files = truths(site, chosen.events, chosen.workers)
    rows = []
    for number, file in enumerate(files):
        folder = event_site(site, number, file, chosen.members)
        event = Event.of(read_site(folder), CalibrationChoices())
        event.run_ensemble(Study.open(folder, site / "results"), workers=chosen.workers)
        truth = event.prior.coordinates(np.array([[values[name][number] for name in event.prior.names]]))[0]
        rows.append(calibrated(event, truth, number, chosen.draws, number < chosen.chains))
        print(number, rows[-1]["scalars"], rows[-1]["drawn"][0], np.mean(rows[-1]["drawn"], axis=0).round(2), flush=True)
        write_record(chosen.out / RECORD, rows, {"members": chosen.members, "draws": chosen.draws, "truths": values})
    print((chosen.out / RECORD).read_text(encoding="utf-8")[:2000])


def write_record(path: Path, rows: Sequence[Mapping[str, Any]], setting: Mapping[str, Any]) -> None:
    """Write the record of the events that are calibrated so far, so that a run that is cut off leaves what it has."""
    from runout.studies.work_precision import machine, versions

    record = {"machine": machine(), "versions": versions(), "command": "python -m tests.benchmarks.calibration_coverage"}
    record |= {"cell": CELL, "events": len(rows), "parameters": list(setting["truths"]), **setting}
    record |= {
        "covered_of_first_draws": np.sum([row["drawn"][0] for row in rows], axis=0).tolist(),
        "covered_of_drawn": np.mean([row["drawn"] for row in rows], axis=(0, 1)).round(3).tolist(),
        "covered_of_exact": np.sum([row["exact"] for row in rows], axis=0).tolist(),
        "width_over_prior_90": (np.mean([row["width"] for row in rows], axis=0) / 0.9).round(3).tolist(),
        "calibrations": list(rows),
    }
    path.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
