"""Calibration of mu and xi of Voellmy's law on avaKot by the run of com1DFA, whose values are known.

    python -m tests.benchmarks.avakot_calibration --out DIR [--device cuda:0] [--cell-size 10] [--levels 14] [--points 16]

The observation is the outline of com1DFA (AvaFrame 2.1, mu 0.155, xi 4000 m/s2, recorded in
`runout/studies/validation_cases/avakot_com1dfa.json`) with the path of the flow as thalweg. `runout calibrate` samples mu and
xi over wide ranges, once with area and run-out of the outline and once with its boundary in parts. The script prints the
posterior of both and writes `calibration_avakot.json`. An outline does not fix both: the record holds their correlation, and the
standard deviation along each principal axis over that of the prior.
"""

import argparse
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout import cli
from runout.studies.validation_cases import avakot

ROOT = Path(__file__).parents[2]
RECORD = "calibration_avakot.json"
OUTLINES = ("area", "boundary")
SITE = """\
name: avakot
title: avaKot by Voellmy's law
terrain:
  dem: inputs/avaKot.asc
  crs: EPSG:31287
release:
  - {{name: relKot, raster: inputs/thickness.tif, placement: on_surface}}
material: {{density: {density}, friction_angle_deg: {angle}}}
basal_friction: {{law: voellmy, mu: 0.2, xi: 3000}}
simulation: {{cell_size: {cell}, particles_per_cell: [2, 2, {levels}], end_time: 100}}
ensemble:
  members: 32
  seed: 1
  parameters:
    basal_mu: {{distribution: uniform, low: 0.05, high: 0.35}}
    basal_xi: {{distribution: uniform, low: 1000, high: 9000}}
hazard: {{thickness_thresholds: [0.1], speed_thresholds: [1], pressure_thresholds: [3000], percentiles: [50]}}
budget: {{hours: 10, memory_gb: 8, disk_gb: 4}}
observations:
  outline: {{polygons: inputs/outline.gpkg}}
  thalweg: {{line: inputs/path_aimec.shp}}
"""


def write_site(folder: Path, cell_size: float, levels: int) -> Path:
    """The site with the outline of com1DFA; ``levels`` of particles in the height of a cell."""
    import geopandas
    import rasterio
    import shapely

    case, inputs = avakot.read(), folder / "inputs"
    inputs.mkdir(parents=True, exist_ok=True)
    source = avakot._folder()
    for path in (source / "avaKot.asc", *(source / "LINES").glob("path_aimec.*")):
        shutil.copy(path, inputs)
    west, _, _, north = case.terrain.extent
    shape = dict(zip(("height", "width"), case.terrain.shape, strict=True))
    place = {"transform": rasterio.transform.from_origin(west, north, *case.terrain.cell_size), "crs": "EPSG:31287"}
    with rasterio.open(inputs / "thickness.tif", "w", "GTiff", count=1, dtype="float32", **place, **shape) as file:
        file.write(case.release.thickness.astype(np.float32), 1)
    outline = shapely.union_all([shapely.Polygon(ring) for ring in case.others["Voellmy"]["outline"]]).buffer(0)
    geopandas.GeoDataFrame(geometry=[outline], crs="EPSG:31287").to_file(inputs / "outline.gpkg")
    text = SITE.format(cell=cell_size, levels=levels, density=avakot.DENSITY, angle=avakot.FRICTION_ANGLE)
    (folder / "site.yaml").write_text(text, encoding="utf-8")
    return folder


def calibrated(site: Path, outline: str, points: int, device: str | None) -> dict[str, Any]:
    """Content of ``calibration.json``."""
    options = ["--outline", outline, "--rounds", "1", "--points", str(points)]
    code = cli.main(["calibrate", str(site), *options, *(() if device is None else ("--device", device))])
    assert code == 0, f"runout calibrate ended with {code}"
    return json.loads((site / "results" / "calibration" / "calibration.json").read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def main() -> None:
    """Make the site, calibrate it with both likelihoods of the outline, print and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--device")
    parser.add_argument("--cell-size", type=float, default=10.0, help="[m]")
    parser.add_argument("--levels", type=int, default=14)
    parser.add_argument("--points", type=int, default=16, help="members of the one round in the posterior")
    a = parser.parse_args()
    site, truth = write_site(a.out / "avakot", a.cell_size, a.levels), avakot.read().others["Voellmy"]["parameters"]
    names = ("members", "choices", "observations", "validation", "left_out_of_the_likelihood", "parameters", "correlation")
    names += ("principal_axes", "statements", "misfits")
    content = {outline: calibrated(site, outline, a.points, a.device) for outline in OUTLINES}
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    record = {
        "runout": runout.__version__,
        "commit": commit.stdout.strip(),
        "command": "python -m tests.benchmarks.avakot_calibration",
        "device": a.device or "cpu",
        "cell_size": a.cell_size,
        "levels": a.levels,
        "com1dfa": truth,
        "outlines": {outline: {name: one[name] for name in names} for outline, one in content.items()},
    }
    print(f"com1DFA: {record['com1dfa']}")
    (a.out / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
