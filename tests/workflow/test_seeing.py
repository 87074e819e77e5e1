"""One member in three dimensions: frames that exist or are made, films, stills of the report, and what they cost."""

import os
import re
import subprocess
import sys

import netCDF4
import numpy as np
import pytest
import xarray as xr
from PIL import Image
from ramp_site import CELL, SITE, member_file, write_site

import runout
from runout import cli
from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.errors import ConfigError, ExitCode, RenderError
from runout.simulation.run import Run
from runout.view import process
from runout.workflow import hazard_map, seeing, single_member
from runout.workflow.study import Study

KEEPING = SITE.replace("end_time: 20", "end_time: 20, snapshots: 5").replace("members: 4", "members: 1")


@pytest.fixture(scope="module")
def keeping_site(tmp_path_factory):
    """A site whose members keep snapshots, after its run."""
    folder = write_site(tmp_path_factory.mktemp("keeping") / "ramp", KEEPING + "report: {stills: worst}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "RENDERER", "import os; os.abort()")
        outcome = hazard_map.run(folder, workers=1)
    return folder, outcome


@pytest.mark.usefixtures("drawable")
def test_a_member_without_frames_is_simulated_apart_from_the_ensemble(finished_site, tmp_path, monkeypatch):
    folder, _ = finished_site
    before = {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*")}
    command = ["animate", str(folder), "--member", "1", "--frames", "4", "--show", "particles", "--out", str(tmp_path / "out")]
    assert cli.main([*command, "--vtk", str(tmp_path / "vtk")]) == ExitCode.OK
    assert {path: path.stat().st_mtime_ns for path in (folder / "results").rglob("*")} == before
    assert (tmp_path / "out" / "simulations" / "0001.nc").is_file()
    assert sorted(p.name for p in (tmp_path / "vtk").iterdir() if p.suffix == ".pvd") == ["flow.pvd", "maps.pvd", "particles.pvd"]

    monkeypatch.setattr(single_member, "run", lambda *_, **__: pytest.fail("simulated again"))
    scene = seeing.scene_of(folder, tmp_path / "out", seeing.Choices(member=1, frames=3))
    assert list(scene.times) == pytest.approx([0.0, 20 / 39 * 20, 20.0], abs=1e-6)  # of 40 snapshots, whatever was asked first
    volume = np.nansum(scene.thickness[0]) * CELL**2
    assert volume == pytest.approx(8.0 * 60 * 60, rel=0.01)
    assert scene.particles.shape[2] == 4
    assert (scene.particles[-1, :, 0].mean() - scene.particles[0, :, 0].mean()) > 100
    assert scene.particles[0, :, 2].mean() > scene.particles[-1, :, 2].mean()


def test_a_member_of_an_ensemble_that_keeps_snapshots_needs_no_simulation(keeping_site, monkeypatch):
    folder, _ = keeping_site
    monkeypatch.setattr(single_member, "run", lambda *_, **__: pytest.fail("simulated again"))
    scene = seeing.scene_of(folder, None, seeing.Choices())
    assert list(scene.times) == [0.0, 5.0, 10.0, 15.0, 20.0]
    with xr.open_dataset(member_file(folder, 0), group="snapshots") as kept:
        assert kept.sizes["y"] <= 24
        total = float(kept["flow_thickness"][2].sum())
    assert scene.thickness[2].sum() == pytest.approx(total, rel=1e-5)


def test_stills_that_cannot_be_drawn_leave_a_sentence_and_a_whole_report(keeping_site):
    folder, outcome = keeping_site
    assert outcome.exit_code is ExitCode.OK
    text = (folder / "results" / "report.html").read_text()
    missing = re.search(r"Pictures are missing\. ([^<]*)", text)[1]
    assert "need" in missing
    assert missing.endswith("`runout report --force` tries again")
    assert 'id="provenance"' in text


def test_snapshots_cost_nothing_unless_they_are_asked_for(finished_site, monkeypatch):
    folder, _ = finished_site
    site = read_site(folder)
    member = plan_members(site)[0]
    with netCDF4.Dataset(member_file(folder, 0)) as plain:
        assert not {"snapshots", "snapshot_particles"} & set(plain.groups)
    calls = []
    monkeypatch.setattr(Run, "_frame", lambda *_: calls.append("frame"))
    monkeypatch.setattr("runout.simulation.observers.ParticleSample.take", lambda *_: calls.append("particles"))
    arguments = site.member_arguments(member.parameters)
    assert "snapshot_times" not in arguments
    result = runout.simulate(**{**arguments, "end_time": 1.0, "threads": 1})
    assert (calls, result.snapshots, result.particle_frames) == ([], [], [])


def test_settings_of_pictures_change_no_member_unless_snapshots_are_kept(finished_site, tmp_path):
    folder, _ = finished_site
    keys = [member.key for member in plan_members(read_site(folder))]
    stills = write_site(tmp_path / "stills", SITE + "report: {stills: all}\n")
    kept = write_site(tmp_path / "kept", SITE.replace("end_time: 20", "end_time: 20, snapshots: 5"))
    assert [member.key for member in plan_members(read_site(stills))] == keys
    assert not set(keys) & {member.key for member in plan_members(read_site(kept))}


def test_a_report_without_stills_loads_nothing_of_3d():
    code = "import sys, runout.workflow.hazard_map, runout.cli; print({'pyvista', 'vtkmodules'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    assert done.stdout.strip() == "set()"


def test_a_window_needs_a_display(finished_site, monkeypatch):
    folder, _ = finished_site
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RenderError, match="runout animate"):
        seeing.view(folder, None, seeing.Choices())


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"frames": 0}, "frames is 0"),
        ({"colour": "heat"}, "thickness, speed"),
        ({"show": "fog"}, "surface, particles"),
        ({"size": (10, 720)}, "64 to 7680 pixels"),
        ({"camera": "above"}, "135,30"),
        ({"member": 99}, "members 0 to 3"),
    ],
)
def test_choices_that_cannot_be_are_refused_before_anything_is_simulated(finished_site, choices, words, monkeypatch):
    monkeypatch.setattr(single_member, "run", lambda *_, **__: pytest.fail("simulated"))
    with pytest.raises(ConfigError, match=re.escape(words)):
        seeing.scene_of(finished_site[0], None, seeing.Choices(**choices))


@pytest.mark.usefixtures("drawable")
def test_stills_show_the_longest_runout_or_every_member_alike(finished_site, monkeypatch):
    from runout.report.study import read_study
    from runout.workflow.stills import member_stills

    looks = []

    def make(task, scene, look, folder):
        looks.append((scene, look))
        (folder / "renderer.txt").write_text("a pencil")
        Image.new("RGB", (8, 8), "red").save(folder / "frame_0000.png")
        return [folder / "frame_0000.png", folder / "renderer.txt"]

    monkeypatch.setattr(process, "make", make)
    folder, _ = finished_site
    study, valid = Study.open(folder), read_study(folder / "results").valid
    longest = valid["runout_distance"].idxmax()
    worst, every = (member_stills(study, valid, chosen) for chosen in ("worst", "all"))
    distance = valid["runout_distance"].max()
    assert [still["title"] for still in worst["pictures"]] == [f"Member {longest}, runout {distance:.0f} m, the longest"]
    assert (len(every["pictures"]), every["drawn_by"], every["failure"]) == (4, "a pencil", "")
    assert every["pictures"][0]["image"].startswith("data:image/webp;base64,")
    assert len({str(look) for _, look in looks[1:]}) == 1  # same colours and direction
    assert looks[0][0].thickness.max() > 5
    assert looks[0][0].thickness.shape[0] == 1
