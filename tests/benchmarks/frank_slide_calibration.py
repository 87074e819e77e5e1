"""Calibration of the friction of Frank Slide by two runs of SHALTOP, whose friction angles are known.

    .venv/bin/python -m tests.benchmarks.frank_slide_calibration --out DIR

The observations are the outline of 1 m and the last deposit of a run of SHALTOP. `runout calibrate` samples the basal friction
angle from 10 to 25 degrees on cells of 40 m, and takes off the error of the grid by pairs. The script writes
`calibration_frank_slide.json`.
"""

import argparse
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout import cli
from runout.io.vector import outline
from runout.studies.validation_cases import frank_slide

ROOT = Path(__file__).parents[2]
RECORD = "calibration_frank_slide.json"
ANGLES = (15, 20)  # of the runs of SHALTOP [deg]
OPTIONS = ("--fine-pairs", "8")
CHANGES = {  # of the site of Frank Slide
    "  members: 8\n": "  members: 32\n",
    "low: 10, high: 20": "low: 10, high: 25",
    "cell_size: 20 ": "cell_size: 40 ",
    "end_time: 150 ": "end_time: 100 ",
    "  stop_when_at_rest: true\n": "",
}
OBSERVATIONS = """
observations:
  outline: {polygons: inputs/outline.gpkg}
  deposit: {raster: inputs/deposit.tif}
"""


def write_site(folder: Path, angle: int) -> Path:
    """Site whose observations are those of the run of SHALTOP with a friction angle [deg]."""
    import geopandas
    import rasterio

    slide = frank_slide.read()
    frames = slide.shaltop(angle)
    parts = outline(frames.max(axis=0) >= 1.0, slide.terrain)
    (folder / "inputs").mkdir(parents=True)
    west, _, _, north = slide.terrain.extent
    shape = dict(zip(("height", "width"), slide.terrain.shape, strict=True))
    place = rasterio.transform.from_origin(west, north, *slide.terrain.cell_size)
    with rasterio.open(folder / "inputs" / "deposit.tif", "w", "GTiff", count=1, dtype="float32", transform=place, **shape) as file:
        file.write(frames[-1].astype(np.float32), 1)
    largest = max(parts.geoms, key=lambda part: part.area)
    geopandas.GeoDataFrame(geometry=[largest]).to_file(folder / "inputs" / "outline.gpkg")
    text = (ROOT / "sites" / "frank_slide" / "site.yaml").read_text(encoding="utf-8")
    for old, new in CHANGES.items():
        assert old in text, f"the site of Frank Slide has no {old!r}"
        text = text.replace(old, new)
    (folder / "site.yaml").write_text(text + OBSERVATIONS, encoding="utf-8")
    return folder


def record_of(results: dict[str, Any], commit: str) -> dict[str, Any]:
    """Record from the content of ``calibration.json`` by angle [deg]."""
    names = ("members", "choices", "observations", "left_out_of_the_likelihood", "parameters", "grid_error")
    return {
        "runout": runout.__version__,
        "commit": commit,
        "command": "python -m tests.benchmarks.frank_slide_calibration",
        "angles": {angle: {name: one[name] for name in names if name in one} for angle, one in results.items()},
    }


def main() -> None:
    """Make the sites, calibrate them, and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    out, results = parser.parse_args().out, {}
    for angle in ANGLES:
        site = write_site(out / f"shaltop_{angle}", angle)
        code = cli.main(["calibrate", str(site), *OPTIONS])
        assert code == 0, f"runout calibrate ended with {code}"
        content = (site / "results" / "calibration" / "calibration.json").read_text(encoding="utf-8")
        results[str(angle)] = json.loads(content)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    record = record_of(results, commit.stdout.strip())
    (out / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
