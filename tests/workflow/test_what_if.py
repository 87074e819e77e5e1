"""A run with settings of the command line, beside that of site.yaml: `runout run SITE --set KEY=VALUE --out DIR`."""

import json
import re

import numpy as np
import xarray as xr
from ramp_site import write_site

from runout import cli
from runout.errors import ExitCode

FIXED = ["basal_friction_angle_deg=25", "ensemble.parameters.basal_friction_angle_deg=", "ensemble.members=1"]


def test_products_lie_in_their_own_folder_and_can_be_compared(finished_site, tmp_path, capsys):
    folder, _ = finished_site
    before, out = (folder / "results" / "hazard.nc").read_bytes(), tmp_path / "results_25"
    assert cli.main(["-q", "run", str(folder), "--workers", "1", "--set", *FIXED, "--out", str(out)]) == ExitCode.OK
    assert (folder / "results" / "hazard.nc").read_bytes() == before
    record = json.loads((out / "run.json").read_text())
    assert record["set_by_command"] == FIXED
    assert record["configuration"]["basal_friction_angle_deg"] == 25
    with xr.open_dataset(out / "members.nc") as members:
        assert members.sizes["realization"] == 1
    assert "basal_friction_angle_deg=25" in (out / "report.html").read_text()
    capsys.readouterr()
    assert cli.main(["-q", "compare", str(folder / "results"), str(out), "--threshold", "1"]) == ExitCode.OK
    csi = float(re.search(r"flow of 1 m: CSI ([\d.]+)", capsys.readouterr().out)[1])
    with xr.open_dataset(folder / "results" / "hazard.nc") as usual, xr.open_dataset(out / "hazard.nc") as steep:
        one, other = ((m["inundation_probability"].values >= 0.5) for m in (usual, steep))
        reach = [np.flatnonzero(m["peak_flow_thickness"].values.max(axis=0) > 0.1).max() for m in (usual, steep)]
    assert one.sum() > 0
    assert other.sum() > 0
    assert 0 < csi < 1
    assert reach[1] < reach[0]  # 25 degrees stop the mass before 12 to 22 degrees do


def test_a_second_call_resumes_and_one_of_site_yaml_sees_other_settings(tmp_path, capsys):
    folder, out = write_site(tmp_path / "ramp"), tmp_path / "out"
    call = ["-q", "run", str(folder), "--workers", "1", "--out", str(out), "--set", *FIXED, "simulation.end_time=2"]
    assert cli.main(call) == ExitCode.OK
    kept = {path: path.stat().st_mtime_ns for path in out.rglob("*.nc")}
    assert cli.main(call) == ExitCode.OK
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.nc")} == kept
    capsys.readouterr()
    changes = ["--set", *FIXED, "simulation.end_time=2"]
    assert cli.main(["status", str(folder), "--out", str(out), *changes]) == ExitCode.OK
    assert "1 members done, 0 members failed, 0 members left" in capsys.readouterr().out


def test_settings_of_the_command_line_need_a_folder_of_their_own(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp")
    assert cli.main(["-q", "run", str(folder), "--set", "simulation.cell_size=20"]) == ExitCode.CONFIGURATION
    assert "--set is given without --out" in capsys.readouterr().err
    assert not (folder / "results" / "members").exists()


def test_check_uses_and_refuses_the_settings_of_the_command_line(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp")
    assert cli.main(["check", str(folder), "--set", "simulation.cell_size=8"]) == ExitCode.OK
    assert "cells of 8 m" in capsys.readouterr().out
    assert cli.main(["check", str(folder), "--set", "simulation.cell_size=8 m"]) == ExitCode.CONFIGURATION
    assert "--set: simulation.cell_size" in capsys.readouterr().out
