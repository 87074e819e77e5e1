"""The whole study on a small slope: from a DEM to a hazard map, once, resumed, and with members that fail."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr
from ramp_site import CELL, NORTH, SITE, WEST, member_file, ramp, slab, write_site

import runout
from runout import cli
from runout.errors import ConfigError, ExitCode, StabilityError
from runout.workflow import hazard_map, single_member
from runout.workflow.study import STAGES

PRODUCTS = ("terrain.nc", "release.nc", "hazard.nc", "members.nc", "outlines.gpkg", "run.json", "report.html", "run.log")


def test_a_run_makes_every_product(finished_site):
    folder, outcome = finished_site
    assert outcome.done == STAGES
    assert outcome.exit_code == ExitCode.OK
    assert [name for name in PRODUCTS if not (folder / "results" / name).stat().st_size] == []
    assert set((folder / "results" / "members").glob("*.nc")) == {member_file(folder, number) for number in range(4)}
    with xr.open_dataset(folder / "results" / "members.nc") as table:
        assert table["file"].values.tolist() == [member_file(folder, number).name for number in range(4)]
    assert list((folder / "results" / "maps").glob("*.tif"))


def test_what_the_grid_resolves_is_in_the_record_of_the_run_and_on_the_page(finished_site):
    folder, _ = finished_site
    found = json.loads((folder / "results" / "run.json").read_text())["resolution"]
    with xr.open_dataset(member_file(folder, 0), group="ledger") as ledger:
        assert 0 < found["cells_through_depth"] <= ledger.attrs["cells_through_depth"] < 1.0
        assert found["shear_decay_time"] == pytest.approx(ledger.attrs["shear_decay_time"], rel=0.5)
    page = (folder / "results" / "report.html").read_text(encoding="utf-8")
    assert "cells through its depth; there the scheme acts like a viscosity of" in page


def test_maps_lie_where_the_slab_slid(finished_site):
    folder, _ = finished_site
    with xr.open_dataset(folder / "results" / "hazard.nc", decode_coords="all") as maps:
        probability = maps["inundation_probability"].fillna(0).to_numpy()
        assert float(maps.x[0]) == WEST + CELL / 2
        assert float(maps.y[0]) == NORTH - CELL / 2
    inside = slab() > 0
    assert probability[inside].mean() > 0.9
    assert probability[:, :3].max() == 0  # nothing runs uphill
    below = probability[:, 14:22]  # on the slope, below the slab
    assert below[10:14].min() == 1
    assert probability.max() <= 1


def test_terrain_and_release_come_home_unmoved(finished_site):
    folder, _ = finished_site
    with xr.open_dataset(folder / "results" / "terrain.nc") as maps:
        np.testing.assert_allclose(maps["elevation"], ramp(), atol=1e-4)
    with xr.open_dataset(folder / "results" / "release.nc") as maps:
        np.testing.assert_allclose(maps["release_thickness"], slab(), atol=1e-6)


def test_the_second_run_does_nothing_and_says_so(finished_site, capsys):
    folder, _ = finished_site
    before = {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*") if path.suffix != ".log"}
    assert cli.main(["run", str(folder)]) == ExitCode.OK
    assert "nothing to do" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_log_file_tells_the_stages_in_their_order(finished_site):
    folder, _ = finished_site
    lines = [json.loads(line) for line in (folder / "results" / "run.log").read_text().splitlines()]
    assert [line["stage"] for line in lines if "stage" in line] == list(STAGES)


def test_status_counts_members_and_stages(finished_site, capsys):
    folder, _ = finished_site
    assert cli.main(["status", str(folder)]) == ExitCode.OK
    said = capsys.readouterr().out
    assert "4 members done, 0 members failed, 0 members left" in said
    assert said.count("nothing: it is up to date") == len(STAGES)


def test_one_member_alone_keeps_snapshots_and_equals_the_ensembles(finished_site, tmp_path):
    folder, _ = finished_site
    file = single_member.run(folder, tmp_path, member=3, snapshots=3)
    assert file == tmp_path / "simulations" / "0003.nc"
    with xr.open_dataset(file, group="snapshots") as snapshots, xr.open_dataset(member_file(folder, 3)) as member:
        assert snapshots.sizes["time"] >= 1
        volume = float(snapshots["flow_thickness"][0].sum()) * CELL**2
        assert volume == pytest.approx(slab().sum() * CELL**2, rel=1e-3)
        with xr.open_dataset(file) as alone:
            assert alone.attrs["parameters"] == member.attrs["parameters"]
            np.testing.assert_allclose(alone["deposit_thickness"].sum(), member["deposit_thickness"].sum(), rtol=1e-3)


def test_a_cell_size_of_the_command_line_is_recorded_and_touches_no_member(finished_site, tmp_path):
    folder, _ = finished_site
    results = folder / "results"
    before = {path: path.stat().st_mtime_ns for path in results.rglob("*") if path.is_file() and path.name != "run.log"}
    assert cli.main(["simulate", str(folder), "--member", "1", "--snapshots", "0", "--cell-size", "20"]) == ExitCode.OK
    file = results / "simulations" / "0001_cell_size_20.nc"
    with xr.open_dataset(file) as coarse, xr.open_dataset(member_file(folder, 1)) as member:
        assert json.loads(coarse.attrs["overrides"]) == {"simulation.cell_size": [20.0]}
        assert "no member of the ensemble" in coarse.attrs["summary"]
        assert json.loads(coarse.attrs["configuration"])["simulation"]["cell_size"] == 20.0
        assert coarse.attrs["command"]
        assert json.loads(coarse.attrs["inputs"])[0]["name"] == "inputs/dem.tif"
        assert coarse.attrs["parameters"] == member.attrs["parameters"]
        assert "member_key" not in coarse.attrs
        assert coarse.attrs["particles"] < 0.5 * member.attrs["particles"]
    after = {path: path.stat().st_mtime_ns for path in results.rglob("*") if path.is_file() and path.name != "run.log"}
    assert {path for path in after if after[path] != before.get(path)} <= {file, results / "inputs.json"}
    assert cli.main(["status", str(folder)]) == ExitCode.OK
    file.unlink()


@pytest.mark.parametrize(("given", "said"), [(["-3"], "cell_size is -3 m"), (["5", "5"], "give one number in m or (dx, dy, dz)")])
def test_a_cell_size_of_the_command_line_that_makes_no_sense_is_refused(finished_site, capsys, given, said):
    assert cli.main(["simulate", str(finished_site[0]), "--cell-size", *given]) == ExitCode.CONFIGURATION
    assert said in capsys.readouterr().err


def test_the_log_holds_the_work_of_every_member_over_time(finished_site):
    folder, _ = finished_site
    lines = [json.loads(line) for line in (folder / "results" / "run.log").read_text().splitlines()]
    work = {line["member"]: line["work"] for line in lines if "work" in line}
    assert set(work) >= {0, 1, 2, 3}
    with xr.open_dataset(member_file(folder, 2), group="ledger") as ledger:
        assert work[2]["time"][0] == 0.0
        assert work[2]["time"][-1] == pytest.approx(float(ledger["time"][-1]))
        assert max(work[2]["active_blocks"]) <= int(ledger["active_blocks"].max())
        assert work[2]["memory"][-1] == int(ledger["memory"][-1]) > 1e5
        assert ledger["memory"].attrs["units"] == "byte"
        assert work[2]["active_nodes"][0] == 64 * work[2]["active_blocks"][0]
        assert 2 < len(work[2]["sparsity"]) <= 21


def test_a_member_that_does_not_exist_is_refused(finished_site, capsys):
    folder, _ = finished_site
    with pytest.raises(ConfigError, match="members 0 to 3"):
        single_member.run(folder, member=4)
    assert cli.main(["simulate", str(folder), "--member", "-1"]) == ExitCode.CONFIGURATION
    assert "members 0 to 3" in capsys.readouterr().err


def command(*arguments):
    program = "import sys; from runout.cli import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", program, *map(str, arguments)]


def test_a_killed_run_goes_on_with_what_is_left(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE.replace("end_time: 20", "end_time: 40"))
    results = folder / "results"
    run = subprocess.Popen(command("run", folder, "--workers", 1), stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240
    while not list(results.glob("members/[0-9a-f]*.nc")) and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()
    finished = {path: path.stat().st_mtime_ns for path in results.glob("members/[0-9a-f]*.nc")}
    assert 1 <= len(finished) < 4
    assert not (results / "hazard.nc").exists()
    assert hazard_map.run(folder, workers=1).done == ("ensemble", "hazard", "report")
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    assert len(list(results.glob("members/[0-9a-f]*.nc"))) == 4
    assert list(results.rglob("*.part")) == []


def test_a_member_that_fails_ends_nothing(tmp_path, monkeypatch):
    simulate = runout.simulate

    def fragile(**arguments):
        if arguments["basal_friction_angle"] < 15:
            raise StabilityError("a particle moved 3 cells in a step; use a smaller cfl")
        return simulate(**arguments)

    monkeypatch.setattr(runout, "simulate", fragile)
    folder = write_site(tmp_path / "ramp")
    outcome = hazard_map.run(folder, workers=1)
    assert outcome.exit_code == ExitCode.PARTIAL_ENSEMBLE
    assert 1 <= len(outcome.failed) < 4
    assert set(outcome.failed.values()) == {"a particle moved 3 cells in a step; use a smaller cfl"}
    assert "smaller cfl" in (folder / "results" / "report.html").read_text()
    again = hazard_map.run(folder, workers=1)
    assert again.done == ()
    assert again.failed == outcome.failed
