"""Each recipe of CONTRIBUTING.md as it stands there: its file is added to a copy of the package, and no other file changes."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
import xarray as xr
from ramp_site import CELL, NORTH, SITE, WEST, write_raster, write_site

ROOT = Path(__file__).parents[2]
TESTS = [ROOT / "tests" / name for name in ("workflow", "hazard")]

RECIPES = dict(re.findall(r"`(runout/[\w/]+\.py)`:\n\n```python\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(), re.S))
MUD = (ROOT / "tests" / "laws" / "quadratic_flow.py").read_text()
DRAG = (ROOT / "tests" / "laws" / "drag_by_load.py").read_text()
QUICK = SITE.replace("members: 4", "members: 2").replace("end_time: 20", "end_time: 1, backend: reference")


def package_with(folder, path, text=None):
    """Folder with a copy of the package that has one more file: that of a recipe, unless its text is given."""
    shutil.copytree(ROOT / "runout", folder / "runout", copy_function=os.symlink)
    assert not (folder / path).exists()
    (folder / path).write_text(RECIPES[path] if text is None else text)
    return folder


def python(package, *command):
    """What a fresh interpreter prints that knows only the copy."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [package, *TESTS]))}
    command = [sys.executable, *map(str, command)]
    done = subprocess.run(command, cwd=package, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def froude(tmp_path_factory, kernels_of_a_site):
    """Package with the quantity of the recipe, and the site ``ramp`` after a run with it."""
    package = package_with(tmp_path_factory.mktemp("quantity"), "runout/quantities/froude_number.py")
    text = SITE.replace("members: 4", "members: 2").replace("percentiles:", "froude_number_thresholds: [1.5], percentiles:")
    site = write_site(package / "ramp", text + "probes:\n  points: inputs/point.geojson\n")
    point = {"type": "Point", "coordinates": [WEST + 150.0, NORTH - 125.0]}
    features = [{"type": "Feature", "properties": {"name": "slope"}, "geometry": point}]
    system = {"type": "name", "properties": {"name": "EPSG:32632"}}
    content = {"type": "FeatureCollection", "crs": system, "features": features}
    (site / "inputs" / "point.geojson").write_text(json.dumps(content))
    python(package, "-m", "runout", "run", site, "--workers", 1)
    return package, site


def test_a_quantity_has_the_largest_value_of_its_formula_in_the_maps_of_members(froude):
    """Where the flow is fastest it is at most as thick as ever, and at least as thick as the threshold of arrival."""
    _, site = froude
    with xr.open_dataset(site / "results" / "members.nc") as members:
        number, speed, depth = (members[f"max_{name}"].values for name in ("froude_number", "speed", "flow_thickness"))
    moving = speed > 1.0
    assert moving.any()
    assert (number[moving] >= 0.999 * speed[moving] / np.sqrt(9.81 * depth[moving])).all()
    assert (number[moving] <= 1.001 * speed[moving].max() / np.sqrt(9.81 * 0.1)).all()


def test_a_quantity_has_settings_maps_over_the_members_rasters_probes_and_a_page(froude):
    _, site = froude
    results = site / "results"
    assert json.loads((results / "run.json").read_text())["configuration"]["hazard"]["froude_number_thresholds"] == [1.5]
    with xr.open_dataset(results / "hazard.nc") as hazard:
        assert hazard["froude_number_exceedance_probability"].sel(froude_number_threshold=1.5).max() == 1.0
        assert hazard["peak_froude_number"].attrs["units"] == "1"
        largest = float(hazard["peak_froude_number"].max())
    for stem in ("froude_number_exceedance_probability_over_1.5", "froude_number_percentile_50", "peak_froude_number"):
        assert list((results / "maps").rglob(f"{stem}.qml"))
    with rasterio.open(results / "maps" / "peak_froude_number.tif") as raster:
        assert raster.read(1).max() == pytest.approx(largest, rel=1e-6)
    assert (results / "report.html").read_text().count("Froude number") >= 1
    (series,) = (results / "probes").glob("*.nc")
    with xr.open_dataset(series) as probes:
        assert "froude_number" in " ".join(map(str, probes.variables))


def test_a_quantity_is_compared(froude, tmp_path):
    package, site = froude
    members = sorted((site / "results" / "members").glob("*.nc"))
    python(package, "-m", "runout", "--out", tmp_path, "compare", *members, "--quantity", "froude_number", "--threshold", "1")
    scores = json.loads((tmp_path / "comparison.json").read_text())["scores"]
    assert {score["of"] for score in scores} == {"froude_number of 1 1", "froude_number, whole map"}
    assert (tmp_path / "froude_number_difference.tif").is_file()


def test_a_score_is_made_of_every_comparison_of_maps(tmp_path):
    package = package_with(tmp_path, "runout/scores/measures/correlation.py")
    maps = np.random.default_rng(1).random((2, 8, 9))
    for name, values in zip(("a_speed.tif", "b_speed.tif"), maps, strict=True):
        write_raster(tmp_path / name, values)
    out = tmp_path / "out"
    assert "correlation" in python(package, "-m", "runout", "--out", out, "compare", "a_speed.tif", "b_speed.tif")
    scores = json.loads((out / "comparison.json").read_text())["scores"]
    (found,) = [score["value"] for score in scores if score["name"] == "correlation"]
    assert found == pytest.approx(np.corrcoef(maps[0].ravel(), maps[1].ravel())[0, 1], rel=1e-5)
    assert "Pearson correlation of the cells that both know" in (out / "comparison.html").read_text()


def test_a_command_is_listed_explained_and_run(tmp_path):
    package = package_with(tmp_path, "runout/commands/volume.py")
    site = write_site(tmp_path / "ramp")
    assert " volume " in python(package, "-m", "runout", "--help")
    assert "Print the volume of each release of a site." in python(package, "-m", "runout", "volume", "--help")
    assert python(package, "-m", "runout", "volume", site).splitlines()[-1] == f"slab: {36 * 8.0 * CELL**2:.6g} m3"
    assert not (site / "results").exists()


def test_a_format_of_the_maps_is_written_with_the_products(tmp_path):
    package = package_with(tmp_path, "runout/hazard/writers/ascii_grids.py")
    code = (
        "import sys; from pathlib import Path; from synthetic_ensemble import write_all; write_all(Path(sys.argv[1]), 'EPSG:32616')"
    )
    python(package, "-c", code, tmp_path / "made")
    (results,) = (tmp_path / "made").rglob("results")
    products = {record["name"] for record in json.loads((results / "run.json").read_text())["products"]}
    assert {"hazard.nc", "outlines.gpkg", "maps/peak_speed.tif", "ascii/peak_speed.asc"} <= products
    with rasterio.open(results / "ascii" / "peak_speed.asc") as grid, xr.open_dataset(results / "hazard.nc") as hazard:
        assert grid.read(1, masked=True).filled(np.nan) == pytest.approx(hazard["peak_speed"].values, rel=1e-5, nan_ok=True)
        assert grid.transform[2] == pytest.approx(float(hazard["x"][0]) - 0.5 * grid.transform[0])


@pytest.mark.parametrize(
    ("path", "text", "name", "before", "block"),
    [
        (
            "runout/materials/quadratic_flow.py", MUD, "QuadraticFlow", "friction_angle_deg: 30}",
            "law: quadratic_flow, yield_stress: 500, viscosity: 50}",
        ),
        (
            "runout/friction/drag_by_load.py", DRAG, "DragByLoad", "basal_friction_angle_deg: 20\n",
            "basal_friction: {law: drag_by_load, friction: 0.3, drag: 0.01}\n",
        ),
    ],
    ids=["material", "friction"],
)  # fmt: skip
def test_a_law_is_public_has_settings_and_runs(tmp_path, path, text, name, before, block):
    package = package_with(tmp_path, path, text)
    sampled = "    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"
    own = "    yield_stress: {distribution: uniform, low: 300, high: 900}\n"
    own = own if "mud" in text.lower() else "    basal_drag: {distribution: uniform, low: 0.01, high: 0.1}\n"
    site = write_site(tmp_path / "ramp", QUICK.replace(before, block).replace(sampled, own))
    code = (
        f"import sys, runout; from runout.cli import main; print(runout.{name}.law, {name!r} in runout.__all__)\n"
        "sys.exit(main(['check', sys.argv[1]]) or main(['ensemble', sys.argv[1], '--workers', '1']))"
    )
    assert python(package, "-c", code, site).splitlines()[0] == f"{Path(path).stem} True"
    speeds = []
    for file in (site / "results" / "members").glob("*.nc"):
        with xr.open_dataset(file) as member:
            speeds.append(float(member["max_speed"].max()))
    assert len(set(speeds)) == 2
    assert all(1.0 < speed < 10.0 for speed in speeds)


def test_a_format_of_structures_is_read_placed_and_checked(tmp_path):
    package = package_with(tmp_path, "runout/structures/readers/piers.py")
    site = write_site(tmp_path / "ramp", SITE + "structures:\n  - {file: inputs/piers.csv, name: pier}\n")
    easting, northing = WEST + 405.0, NORTH - 105.0
    (site / "inputs" / "piers.csv").write_text(f"easting,northing,radius,height\n{easting},{northing},12,6\n")
    code = (
        "import sys; from runout.cli import main; from runout.config.site import read_site\n"
        "from runout.structures.readers.meshes import volume\n"
        "site = read_site(sys.argv[1]); (body,) = site.files.bodies().solids\n"
        "print(body.name, volume(body.vertices, body.faces), *body.box.ravel())\n"
        "sys.exit(main(['check', sys.argv[1]]))"
    )
    name, *numbers = python(package, "-c", code, site).splitlines()[0].split()
    volume, west, south, bottom, east, north, top = map(float, numbers)
    assert name == "pier"
    assert volume == pytest.approx(math.pi * 12.0**2 * 9.0, rel=0.02)
    assert (0.5 * (west + east), 0.5 * (south + north)) == pytest.approx((405.0, 24 * CELL - 105.0))
    assert (bottom, top) == pytest.approx((-3.0, 6.0), abs=1e-6)
    (site / "site.yaml").write_text((site / "site.yaml").read_text().replace("name: pier", "name: pier, units: m"))
    with pytest.raises(AssertionError, match="units: has no meaning with piers"):
        python(package, "-m", "runout", "check", site)
