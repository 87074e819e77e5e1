"""Jobs that run ranges of one ensemble in one folder: each does its members, and none harms another."""

import pytest
from ensemble_fakes import calls, simulate, site, started, wait_until

from runout.ensemble.member import plan_members, stored_key
from runout.ensemble.run import run_ensemble
from runout.ensemble.status import State, standings
from runout.ensemble.written import Written
from runout.errors import StorageError
from runout.io.lock import exclusive, shared


def run(place, part=None, simulate=simulate, **choices):
    return run_ensemble(place, place.folder / "results", workers=1, simulate=simulate, part=part, **choices)


def files(place):
    return sorted(path.name for path in (place.folder / "results" / "members").iterdir() if path.name != ".lock")


def names(place):
    return [member.file(place.folder).name for member in plan_members(place)]


def test_a_part_writes_its_members_only(tmp_path):
    place = site(tmp_path)
    report = run(place, range(2, 4))
    assert (report.done, report.failed) == ((2, 3), {})
    assert files(place) == sorted(names(place)[2:4])


def test_parts_together_are_the_ensemble(tmp_path):
    place = site(tmp_path)
    for part in (range(4, 8), range(4)):
        run(place, part)
    record = Written(tmp_path / "results")
    assert all(record.has(member.file(tmp_path / "results")) for member in plan_members(place))
    report = run(place)
    assert (report.done, report.skipped) == ((), tuple(range(8)))
    assert len(calls(place)) == 8


def test_jobs_at_the_same_time_do_no_harm_on_the_same_members_too(tmp_path):
    place = site(tmp_path)
    jobs = [started(tmp_path, 0.2, *part) for part in ((0, 4), (0, 4), (2, 8))]
    output = [job.communicate(timeout=100)[0] for job in jobs]
    assert [job.returncode for job in jobs] == [0, 0, 0], output
    assert files(place) == sorted(names(place))
    simulated = len(calls(place))
    assert all(stored_key(member.file(tmp_path / "results")) == member.key for member in plan_members(place))
    assert run(place).skipped == tuple(range(8))
    assert len(calls(place)) == simulated


def test_a_whole_run_and_a_part_exclude_each_other(tmp_path):
    place = site(tmp_path)
    job = started(tmp_path, 1.0, 0, 2)
    wait_until(lambda: calls(place))
    with pytest.raises(StorageError, match="another run is working there"):
        run(place)
    assert job.wait(60) == 0
    with exclusive(tmp_path / "results" / "members"), pytest.raises(StorageError, match="another run is working there"):
        run(place, range(4))


def test_a_shared_lock_is_open_to_many(tmp_path):
    folder, refused = tmp_path / "folder", pytest.raises(StorageError, match="another run")
    with shared(folder), shared(folder), refused, exclusive(folder):
        pass
    with exclusive(tmp_path / "folder"):
        pass


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="file"), shared(tmp_path / "file"):
        pass


def test_records_of_jobs_keep_the_notes_of_others(tmp_path):
    place = site(tmp_path)
    run(place)
    one, other = Written(tmp_path / "results"), Written(tmp_path / "results")
    paths = [member.file(tmp_path / "results") for member in plan_members(place)]
    one.withdraw(paths[:1])
    other.withdraw(paths[1:2])
    one.note(paths[0], "first")
    one.save()
    other.forget(paths[2])
    other.save()
    entries = Written(tmp_path / "results").entries
    assert set(entries) == {names(place)[0], *names(place)[3:]}
    assert entries[names(place)[0]][0] == "first"


def finished_elsewhere(**arguments):
    """A simulation that fails after another job has finished the same member."""
    place = site(arguments["calls"].parent)
    run(place, range(1))
    raise MemoryError("no memory is left")


def test_a_member_that_another_job_has_finished_does_not_count_as_failed(tmp_path):
    place = site(tmp_path)
    report = run(place, range(1), simulate=finished_elsewhere)
    assert (report.done, report.failed) == ((0,), {})
    assert standings(place, tmp_path / "results")[0].state is State.DONE


def test_a_part_keeps_files_that_others_are_writing(tmp_path):
    place = site(tmp_path)
    other = tmp_path / "results" / "members" / ".0005.nc.x.part"
    other.mkdir(parents=True)
    run(place, range(2))
    assert other.exists()
    run(place)
    assert not other.exists()
