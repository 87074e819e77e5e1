"""Each write of a run of the ensemble fails in turn; the next run has every member."""

import os
import sys
from concurrent.futures import Future
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "io"))
from ensemble_fakes import simulate, site
from failing_writes import DENIED, FULL, KILLED, NOT_REACHED, fails, number_of_writes

from runout.ensemble.member import _unwritten
from runout.ensemble.run import run_ensemble
from runout.ensemble.status import State, standings
from runout.errors import DiskFullError, StorageError
from runout.io.atomic import storage_error

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="counts in a copy of this process")
MEMBERS = 3


def fresh(folder):
    """Folder with a site without results."""
    folder.mkdir()
    site(folder, members=MEMBERS)
    return folder


def run(folder):
    return run_ensemble(site(folder, members=MEMBERS), folder / "results", workers=1, simulate=simulate)


@pytest.mark.parametrize("fault", [FULL, DENIED, KILLED])
def test_a_run_heals_whichever_write_of_the_one_before_failed(tmp_path, fault):
    counted = fresh(tmp_path / "counted")
    steps = number_of_writes(lambda: run(counted))
    assert steps >= 2 * (MEMBERS + 1)  # a folder and a rename for each member and for the record
    for failing in range(1, steps + 1):
        folder = fresh(tmp_path / f"{failing}")
        said = fails(lambda folder=folder: run(folder), failing, fault, StorageError)
        assert said in (KILLED, NOT_REACHED) or fault == DENIED or ("the disk is full" in said and str(folder) in said)
        report = run(folder)
        assert (report.valid, report.failed) == (tuple(range(MEMBERS)), {}), failing
        assert not list((folder / "results" / "members").glob(".*.part"))
        assert run(folder).done == ()
        states = standings(site(folder, members=MEMBERS), folder / "results")
        assert {one.state for one in states} == {State.DONE}


@pytest.mark.parametrize(
    ("error", "passing"),
    [(storage_error(Path("a.nc"), RuntimeError("NetCDF: Attribute not found")), True), (DiskFullError("the disk is full"), False)],
)
def test_a_file_that_the_library_does_not_write_fails_its_member_alone(error, passing):
    if passing:
        error.__cause__ = RuntimeError("NetCDF: Attribute not found")
    files = [(4, Future()), (7, Future())]
    files[0][1].set_result(None)
    files[1][1].set_exception(error)
    if passing:
        assert _unwritten(files) == {7: error}
        return
    with pytest.raises(DiskFullError):
        _unwritten(files)
