"""An ensemble with a tolerance doubles until its sampling error is reached or its members are used up, killed or not."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from ramp_site import SITE, write_site

import runout
from runout import cli
from runout.ensemble.run import run_ensemble
from runout.errors import ExitCode, StabilityError
from runout.workflow import growth, hazard_map
from runout.workflow.growth import Growth, Size
from runout.workflow.study import STAGES, Study

MAPS = STAGES[:-1]  # a report takes time
SHORT = SITE.replace("end_time: 20", "end_time: 2").replace("cell_size: 10", "cell_size: 20").replace("low: 12", "low: 2")
SHORT = SHORT.replace("percentiles:", "momentum_flux_thresholds: [], deposit_thresholds: [], percentiles:")


def text(tolerance, members=32):
    return SHORT.replace("members: 4", f"members: {members}\n  tolerance: {tolerance:.10f}")


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """A site whose tolerance is not reached with all of its 32 members, after a run."""
    folder = write_site(tmp_path_factory.mktemp("growth") / "ramp", text(1e-6))
    hazard_map.run(folder, stages=MAPS, workers=1)
    return folder


@pytest.fixture
def site(grown, tmp_path):
    """A copy of that site."""
    return Path(shutil.copytree(grown, tmp_path / "ramp"))


@pytest.fixture(scope="module")
def results():
    """Results of members by angle and seed: all tests here have the same members, and each is simulated once."""
    return {}


@pytest.fixture
def simulated(monkeypatch, results):
    """Friction angles of the members that are simulated."""
    found, simulate = [], runout.simulate

    def counted(**arguments):
        found.append(arguments["basal_friction_angle"])
        member = found[-1], arguments["seed"]
        if member not in results:
            results[member] = simulate(**arguments)
        return results[member]

    monkeypatch.setattr(runout, "simulate", counted)
    return found


def set_tolerance(site, tolerance, **choices):
    (site / "site.yaml").write_text(text(tolerance, **choices))


def run(site, stages=MAPS):
    return hazard_map.run(site, stages=stages, workers=1)


def errors(site):
    """Errors of the sizes in the record, in their order."""
    record = json.loads((site / "results" / "sampling.json").read_text())
    return [record[size]["error"] for size in sorted(record, key=int)]


def maps(site):
    with xr.open_dataset(site / "results" / "hazard.nc") as content:
        return content.load()


def said(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_an_ensemble_that_does_not_reach_its_tolerance_uses_all_members_and_says_so(site, capsys, simulated):
    first, second = errors(site)
    assert 0 < second < first
    hazard = maps(site)
    assert int(hazard["members_planned"]) == int(hazard["members_valid"]) == 32
    names = [name for name in hazard if name.endswith("_exceedance_rms_error")]
    assert max(float(hazard[name].max()) for name in names) == pytest.approx(second)
    assert cli.main(["status", str(site)]) == ExitCode.OK
    expected = (
        f"sampling error of at most 1e-06 asked for, with at most 32 members; found {first:.2g} with 16, {second:.2g} with 32: "
        "it is not reached, all members are used"
    )
    assert expected in said(capsys)
    assert json.loads((site / "results" / "run.json").read_text())["ensemble"]["growth"] == expected
    assert expected in hazard.attrs["ensemble"]
    assert run(site).done == ()
    assert simulated == []


def test_its_maps_are_those_of_as_many_members_without_a_tolerance(site, simulated):
    before = maps(site)
    (site / "site.yaml").write_text(SHORT.replace("members: 4", "members: 32"))
    assert run(site).done == ("hazard",)
    assert simulated == []
    xr.testing.assert_equal(maps(site), before)
    assert "growth" not in json.loads((site / "results" / "run.json").read_text())["ensemble"]


def test_a_tolerance_that_is_reached_ends_the_growth_early(tmp_path, simulated, capsys):
    folder = write_site(tmp_path / "ramp", text(0.2, members=1024))
    assert cli.main(["check", str(folder)]) == ExitCode.OK
    checked = said(capsys)
    assert "sampling error of at most 0.2 asked for, with at most 1024 members: 16 come next" in checked
    assert "members 1024 to simulate" in checked, "the forecast, and the budget, are for all that may be needed"
    assert Study.open(folder).left == list(range(16))
    simulated.clear()
    assert run(folder, STAGES).done == STAGES
    assert len(simulated) == 16
    assert int(maps(folder)["members_planned"]) == 16
    page = (folder / "results" / "report.html").read_text(encoding="utf-8")
    assert f"with at most 1024 members; found {errors(folder)[0]:.2g} with 16: it is reached" in page
    assert run(folder, STAGES).done == ()
    assert cli.main(["status", str(folder)]) == ExitCode.OK
    assert "16 members done, 0 members failed, 0 members left" in said(capsys)


def test_a_tolerance_that_changes_simulates_what_is_missing_only(tmp_path, grown, simulated):
    first, second = errors(grown)
    folder = write_site(tmp_path / "ramp", text(1.01 * first))
    run(folder)
    assert len(simulated) == 16
    set_tolerance(folder, 1.01 * second)
    assert run(folder).done == ("ensemble", "hazard")
    assert len(simulated) == 32
    xr.testing.assert_equal(maps(folder), maps(grown))
    set_tolerance(folder, 1.01 * first)
    assert run(folder).done == ("hazard",)
    assert int(maps(folder)["members_planned"]) == 16
    assert len(simulated) == 32
    assert Study.open(folder).unused == [], "they belong to the net that the settings allow"


def test_members_of_a_fixed_size_are_those_of_a_growing_one(tmp_path, grown, simulated):
    folder = write_site(tmp_path / "ramp", SHORT.replace("members: 4", "members: 16"))
    run(folder)
    set_tolerance(folder, 1e-6)
    assert run(folder).done == ("ensemble", "hazard")
    assert len(simulated) == 32
    xr.testing.assert_equal(maps(folder), maps(grown))


KILLER = (
    "import os, signal, sys\nreplace, count = os.replace, iter(range(1, 10000))\n"
    "def die(old, new):\n"
    "    if {condition}: os.kill(os.getpid(), signal.SIGKILL)\n"
    "    replace(old, new)\n"
    "os.replace = die\n"
    "from runout.cli import main\nmain(['ensemble', sys.argv[1], '--workers', '1'])"
)
IN_THE_SECOND_SIZE = "os.path.basename(os.path.dirname(new)) == 'members' and str(new).endswith('.nc') and next(count) == 20"
BEFORE_THE_FIRST_SIZE_IS_RECORDED = "str(new).endswith('sampling.json')"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(("condition", "finished"), [(IN_THE_SECOND_SIZE, 19), (BEFORE_THE_FIRST_SIZE_IS_RECORDED, 16)])
def test_a_growth_that_is_killed_ends_like_an_undisturbed_one(tmp_path, grown, simulated, capsys, condition, finished):
    folder = write_site(tmp_path / "ramp", text(1e-6))
    dead = subprocess.run([sys.executable, "-c", KILLER.format(condition=condition), str(folder)], check=False, capture_output=True)
    assert dead.returncode == -signal.SIGKILL, dead.stderr
    assert len(list((folder / "results" / "members").glob("*.nc"))) == finished
    assert cli.main(["status", str(folder)]) == ExitCode.OK
    assert f"{32 if finished > 16 else 16} come next" in said(capsys)
    assert run(folder).done == ("terrain", "release", "ensemble", "hazard")
    assert len(simulated) == 32 - finished
    assert errors(folder) == errors(grown)
    xr.testing.assert_equal(maps(folder), maps(grown))


@pytest.mark.parametrize("content", ["", "[]", '{"16": 3, "32": {"key": 1}}', '{"16": {"error": "small"}}'])
def test_a_damaged_record_is_made_again_without_a_simulation(site, grown, simulated, content):
    (site / "results" / "sampling.json").write_text(content)
    assert "16 members is not known yet" in Study.open(site).why_stale(hazard_map.PLAN[2])
    assert run(site).done == ("ensemble",)
    assert errors(site) == errors(grown)
    assert simulated == []


def test_other_thresholds_are_measured_anew(site, simulated):
    before = errors(site)
    changed = text(1e-6).replace("thickness_thresholds: [0.1, 1]", "thickness_thresholds: [0.3, 2]")
    (site / "site.yaml").write_text(changed)
    assert run(site).done == ("ensemble", "hazard")
    assert errors(site) != before
    assert simulated == []


def test_a_failed_member_leaves_the_error_of_independent_members_and_says_so(tmp_path, monkeypatch, capsys):
    simulate = runout.simulate

    def fragile(**arguments):
        if 2.0 <= arguments["basal_friction_angle"] < 3.0:
            raise StabilityError("a particle moved 3 cells in a step; use a smaller cfl")
        return simulate(**arguments)

    monkeypatch.setattr(runout, "simulate", fragile)
    folder = write_site(tmp_path / "ramp", text(0.2))
    assert run(folder).exit_code == ExitCode.PARTIAL_ENSEMBLE
    assert cli.main(["status", str(folder)]) == ExitCode.PARTIAL_ENSEMBLE
    assert "with 16 (as of independent members: 15 of 16 members are valid): it is reached" in said(capsys)
    assert "independent members: 15 of 16" in maps(folder)["thickness_exceedance_standard_error"].attrs["estimator"]


def test_without_a_valid_member_nothing_grows(tmp_path, monkeypatch):
    def broken(**_):
        raise StabilityError("a particle moved 3 cells in a step; use a smaller cfl")

    monkeypatch.setattr(runout, "simulate", broken)
    folder = write_site(tmp_path / "ramp", text(0.01))
    place, results = runout.read_site(folder), folder / "results"
    report = growth.grow(place, results, lambda part: run_ensemble(place, results, workers=1, part=part))
    assert (report.valid, len(report.failed)) == ((), 16)
    assert "16 come next" in report.growth


def test_ranges_of_an_array_run_members_that_the_growth_uses(tmp_path, simulated):
    folder = write_site(tmp_path / "ramp", text(1e-6))
    assert cli.main(["ensemble", str(folder), "--members", "10:32", "--workers", "1"]) == ExitCode.OK
    assert len(simulated) == 22
    assert run(folder).exit_code == ExitCode.OK
    assert len(simulated) == 32


def test_sizes_double_from_sixteen_until_tolerance_or_most():
    start = Growth(0.03, 128)
    assert (start.members, start.finished, start.reached) == (16, False, False)
    seen = [start]
    for error in (0.1, 0.06, 0.04, 0.031):
        seen.append(seen[-1].extended(Size(seen[-1].members, error)))
    assert [one.members for one in seen] == [16, 32, 64, 128, 128]
    assert (seen[-1].finished, seen[-1].reached) == (True, False)
    reached = seen[1].extended(Size(32, 0.03))
    assert (reached.members, reached.finished, reached.reached) == (32, True, True)
    assert np.isclose(reached.sizes[-1].error, 0.03)
