"""Many releases of a valley in one command: time, what a second call repeats, and the merged maps against the single ones.

    python -m tests.benchmarks.valley_releases --out DIR [--releases 100] [--members 16] [--cells 10] [--device cuda:0]
        [--stop-after 600]

The valley is made: 12 x 6 km in cells of 10 m, a floor that falls by 3 %, flanks of 25 to 40 degrees with gullies. The releases are
slabs of 60 to 120 m on both flanks, each a polygon of one GeoPackage with an annual rate. ``runout regional`` runs all. With
--stop-after the command is killed after so many seconds and started again, and members that were finished must stay as they are.
A third call must compute nothing. DIR/valley_releases.json is the record.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

CELL, LENGTH, WIDTH, CRS = 10.0, 12_000.0, 6_000.0, "EPSG:32632"
WEST, SOUTH = 600_000.0, 5_100_000.0
NAME = "valley_releases.json"
SITE = """\
name: valley
title: Made valley with {releases} releases
terrain: {{dem: inputs/dem.tif}}
release:
  - {{name: slab, polygons: inputs/releases.gpkg, thickness: thickness, placement: on_surface}}
material: {{law: drucker_prager, density: 1900, poisson_ratio: 0.3, friction_angle_deg: 34, cohesion: 0}}
basal_friction_angle_deg: 20
simulation: {{cell_size: {cells}, end_time: {end_time}, stop_when_at_rest: true}}
ensemble:
  members: {members}
  seed: 1
  parameters:
    basal_friction_angle_deg: {{distribution: uniform, low: 16, high: 24}}
    release_volume_factor: {{distribution: uniform, low: 0.5, high: 1.5}}
hazard: {{thickness_thresholds: [0.2, 1], speed_thresholds: [1, 5]}}
"""


def elevations() -> np.ndarray:
    """Elevations (rows, columns) [m] of the valley, north up."""
    y, x = (np.arange(size / CELL) * CELL for size in (WIDTH, LENGTH))
    x, y = np.meshgrid(x, y[::-1] - WIDTH / 2)
    across = np.abs(y + 150.0 * np.sin(x / 1500.0))
    flank = np.maximum(across - 250.0, 0.0)
    gully = 12.0 * np.cos(x / 90.0) * np.clip(flank / 400.0, 0.0, 1.0)
    return 1500.0 - 0.03 * x + 0.75 * flank - 1.0e-4 * flank**2 + 1.5e-4 * across**1.5 + gully  # type: ignore[no-any-return]


def make_site(folder: Path, releases: int, members: int, cells: float, end_time: float) -> Path:
    """Folder of the site, with its raster and the polygons of its releases."""
    import geopandas as gpd
    import rasterio
    import shapely
    from rasterio.transform import from_origin

    inputs = folder / "inputs"
    if (folder / "site.yaml").is_file():
        return folder
    inputs.mkdir(parents=True, exist_ok=True)
    ground, rng = elevations().astype(np.float32), np.random.default_rng(7)
    shape = {"driver": "GTiff", "height": ground.shape[0], "width": ground.shape[1], "count": 1, "dtype": "float32", "crs": CRS}
    with rasterio.open(inputs / "dem.tif", "w", transform=from_origin(WEST, SOUTH + WIDTH, CELL, CELL), **shape) as raster:
        raster.write(ground, 1)
    along = WEST + np.linspace(0.08, 0.92, releases) * LENGTH
    side = np.where(np.arange(releases) % 2, 1.0, -1.0) * rng.uniform(900.0, 1600.0, releases)
    centres, radii = shapely.points(along, SOUTH + WIDTH / 2 + side), rng.uniform(30.0, 60.0, releases)
    columns = {
        "name": [f"r{k:03d}" for k in range(1, releases + 1)],
        "thickness": rng.uniform(2.0, 4.0, releases).round(2),
        "rate": (1.0 / rng.choice([30.0, 100.0, 300.0], releases)).round(6),
    }
    gpd.GeoDataFrame(columns, geometry=shapely.buffer(centres, radii), crs=CRS).to_file(inputs / "releases.gpkg")
    (folder / "site.yaml").write_text(SITE.format(releases=releases, members=members, cells=cells, end_time=end_time))
    return folder


def call(site: Path, device: str, workers: int | None, stop_after: float | None = None) -> dict[str, Any]:
    """Wall time [s] and exit code of ``runout regional``; the code is None if it was killed."""
    started, number = time.perf_counter(), ["--workers", str(workers)] if workers else []
    command = [sys.executable, "-m", "runout", "regional", str(site), "--annual-rate", "rate", "--device", device, *number]
    with (site / "regional.log").open("a") as log:
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            code: int | None = process.wait(stop_after)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            code = None
    return {"seconds": round(time.perf_counter() - started, 1), "exit": code, "members": len(members_of(site))}


def members_of(site: Path) -> dict[str, int]:
    """Time of change of the file of each finished member."""
    return {str(path): path.stat().st_mtime_ns for path in (site / "regional").glob("sources/*/results/members/*.nc")}


def merged_differences(site: Path) -> dict[str, float]:
    """Largest difference of the merged maps from those of the single sites, put together here by coordinates."""
    import xarray as xr

    with xr.open_dataset(site / "regional" / "merged.nc") as file:
        merged = file.load()
    x, y = merged["x"].values, merged["y"].values
    stay, peak = np.ones((len(y), len(x))), np.zeros((len(y), len(x)))
    rate = np.zeros((merged.sizes["thickness_threshold"], len(y), len(x)))
    for path in sorted((site / "regional").glob("sources/*/results/hazard.nc")):
        with xr.open_dataset(path) as one:
            rows, columns = np.searchsorted(-y, -one["y"].values - 0.5), np.searchsorted(x, one["x"].values - 0.5)
            place = np.ix_(rows, columns)
            stay[place] *= 1.0 - one["inundation_probability"].fillna(0.0).values
            peak[place] = np.maximum(peak[place], one["peak_flow_thickness"].fillna(0.0).values)
            rate[(slice(None), *place)] += one["thickness_annual_exceedance"].fillna(0.0).values
    pairs = {"inundation_probability": 1.0 - stay, "peak_flow_thickness": peak, "thickness_annual_exceedance": rate}
    return {name: float(np.abs(merged[name].fillna(0.0).values - own).max()) for name, own in pairs.items()}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Make the valley, run it, run it again, and write the record."""
    from runout.io.atomic import write_json
    from runout.studies.work_precision import machine, versions

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--releases", type=int, default=100)
    parser.add_argument("--members", type=int, default=16, help="of each release")
    parser.add_argument("--cells", type=float, default=10.0, help="grid spacing [m]")
    parser.add_argument("--end-time", type=float, default=120.0, help="[s]")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--stop-after", type=float, help="seconds after which the first call is killed")
    chosen = parser.parse_args(arguments)
    site = make_site(chosen.out / "valley", chosen.releases, chosen.members, chosen.cells, chosen.end_time)
    calls, finished_before = [], members_of(site)
    if chosen.stop_after:
        calls.append({"call": "killed", **call(site, chosen.device, chosen.workers, chosen.stop_after)})
        finished_before = members_of(site)
    calls.append({"call": "whole", **call(site, chosen.device, chosen.workers)})
    repeated = [path for path, time_of_change in finished_before.items() if members_of(site).get(path) != time_of_change]
    before = members_of(site)
    calls.append({"call": "again", **call(site, chosen.device, chosen.workers)})
    record = {"machine": machine(), "versions": versions(), "device": chosen.device, "releases": chosen.releases}
    record |= {"members": chosen.members, "cells": chosen.cells, "calls": calls, "finished_members_repeated": len(repeated)}
    record |= {"members_changed_by_the_last_call": sum(members_of(site)[path] != old for path, old in before.items())}
    record["merged_minus_single"] = merged_differences(site)
    write_json(record, chosen.out / NAME)
    print(json.dumps({key: value for key, value in record.items() if key not in ("machine", "versions")}, indent=1))
    return record


if __name__ == "__main__":
    main()
