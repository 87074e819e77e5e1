"""`runout run` refuses what `runout check` refuses, with the same words and before anything is made."""

from types import SimpleNamespace

import pytest
from ramp_site import SITE, ramp, slab, write_raster, write_site

from runout import cli
from runout.config.site import read_site
from runout.ensemble import workers
from runout.errors import CapacityError, ExitCode
from runout.workflow import plan

SECOND = SITE.replace("material:", "  - {name: second, raster: inputs/second.tif, placement: on_surface}\nmaterial:")


def hole_under_the_release():
    elevation = ramp()
    elevation[12, 7] = -9999.0
    return elevation


BAD = {
    "keys": {"text": SITE.replace("end_time", "end_tiem").replace("ensemble:", "budgt: 3\nensemble:")},
    "keys and data": {"text": SITE.replace("end_time", "end_tiem"), "thickness": -slab()},
    "overlap": {"text": SECOND},
    "overlap and negative thickness": {"text": SECOND, "thickness": -slab()},
    "hole under the release": {"elevation": hole_under_the_release()},
    "cells larger than the release": {"text": SITE.replace("cell_size: 10", "cell_size: 200")},
}


@pytest.mark.parametrize("case", BAD)
def test_run_refuses_what_check_refuses(tmp_path, capsys, case):
    folder = write_site(tmp_path / "ramp", **BAD[case])
    write_raster(folder / "inputs" / "second.tif", slab())
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["check", str(folder)]) == ExitCode.CONFIGURATION
    problems = [line.removeprefix("problem ") for line in capsys.readouterr().out.splitlines() if line.startswith("problem ")]
    assert cli.main(["run", str(folder)]) == ExitCode.CONFIGURATION
    said = capsys.readouterr().err
    assert problems
    assert [problem for problem in problems if problem not in said] == []
    assert {path.name for path in tmp_path.rglob("*")} - {path.name for path in before} <= {"results", "run.log"}


def test_run_refuses_a_site_that_does_not_fit_into_memory_as_check_does(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(plan, "available_bytes", lambda: 2e8)
    folder = write_site(tmp_path / "ramp")
    assert cli.main(["check", str(folder)]) == ExitCode.OVER_BUDGET
    said = capsys.readouterr().out
    assert "of memory, 0.2 GB are available; use larger cells" in said
    assert cli.main(["run", str(folder)]) == ExitCode.OVER_BUDGET
    assert "0.2 GB are available; use larger cells" in capsys.readouterr().err
    assert not list(folder.glob("results/members/*.nc"))


def test_check_and_run_refuse_particles_that_a_card_cannot_address(tmp_path, capsys, monkeypatch):
    """The numbers of a card with room for 100; nothing is asked of a card."""
    from runout.backends.hash import limits

    monkeypatch.setattr(limits, "LARGEST_INDEX", 4 * 100)
    monkeypatch.setattr("runout.backends.protocol._cuda_devices", lambda: ("cuda:0",))
    monkeypatch.setattr(plan, "engine_for", lambda arguments: SimpleNamespace(device=SimpleNamespace(is_cuda=True)))
    folder = write_site(tmp_path / "ramp", SITE.replace("simulation: {", "simulation: {backend: hash, device: cuda, "))
    assert cli.main(["check", str(folder)]) == ExitCode.OVER_BUDGET
    refused = "particles has more than the 100 that hash can address in float32; use a cell_size"
    assert refused in " ".join(capsys.readouterr().out.split())
    assert cli.main(["run", str(folder)]) == ExitCode.OVER_BUDGET
    assert refused in " ".join(capsys.readouterr().err.split())
    assert not list(folder.glob("results/members/*.nc"))


def test_no_more_members_run_at_the_same_time_than_memory_holds(tmp_path, monkeypatch):
    site = read_site(write_site(tmp_path / "ramp"))
    member = plan.member_bytes(site, range(4))
    monkeypatch.setattr(workers, "core_count", lambda: 8)
    monkeypatch.setattr(plan, "available_bytes", lambda: 2.5 * member)
    assert plan.require_budget(site, range(4)) == 2
    assert plan.require_budget(site, range(2)) is None
    assert plan.require_budget(site, range(4), workers=2) == 2
    with pytest.raises(CapacityError, match=r"4 members at a time need about .* GB of memory"):
        plan.require_budget(site, range(4), workers=4)
    monkeypatch.setattr(plan, "available_bytes", lambda: 10.0 * member)
    assert plan.require_budget(site, range(4)) is None


def test_a_stage_that_needs_no_release_is_not_refused_for_one(tmp_path):
    folder = write_site(tmp_path / "ramp", SECOND)
    write_raster(folder / "inputs" / "second.tif", slab())
    assert cli.main(["terrain", str(folder)]) == ExitCode.OK
    assert cli.main(["ensemble", str(folder)]) == ExitCode.CONFIGURATION
