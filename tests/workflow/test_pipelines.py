"""The scripts in pipelines/ make what the commands make, and the wheel installs no name but runout."""

import runpy
import tomllib
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from ramp_site import write_site

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "pipelines").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_of_the_pipelines_can_be_read_whole_and_says_how_it_is_run(script):
    found = runpy.run_path(str(script))
    assert f"python pipelines/{script.name}" in found["__doc__"]
    assert len(script.read_text().splitlines()) <= 60


def test_the_script_from_a_site_to_maps_makes_the_maps_of_the_command(finished_site, tmp_path):
    folder, _ = finished_site
    write_site(tmp_path)
    report = runpy.run_path(str(ROOT / "pipelines" / "hazard_map.py"))["main"](tmp_path, tmp_path / "results")
    assert report.stat().st_size > 10_000
    with xr.open_dataset(tmp_path / "results" / "hazard.nc") as made, xr.open_dataset(folder / "results" / "hazard.nc") as known:
        assert set(made.data_vars) == set(known.data_vars)
        for name in known.data_vars:
            np.testing.assert_array_equal(made[name], known[name])


def test_the_script_of_one_member_writes_its_snapshots(tmp_path):
    write_site(tmp_path)
    file = runpy.run_path(str(ROOT / "pipelines" / "single_member.py"))["main"](tmp_path, 0, tmp_path / "member.nc")
    with netCDF4.Dataset(file) as member:
        assert member.groups


def test_the_wheel_installs_no_top_level_name_but_runout():
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert build["packages"] == ["runout"]
