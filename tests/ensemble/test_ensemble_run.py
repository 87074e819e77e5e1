"""Running an ensemble: nothing is lost, nothing is run twice, no bad member ends it."""

import itertools
import json
import logging
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from ensemble_fakes import calls, simulate, simulate_on, simulate_step_by_step, site, started, wait_until
from netCDF4 import Dataset

from runout import log
from runout.ensemble import workers
from runout.ensemble.member import Member, plan_members, stored_key
from runout.ensemble.run import run_ensemble
from runout.ensemble.status import standings
from runout.ensemble.work import dealt, longest_first
from runout.ensemble.written import Written, remove_unused, unused_files
from runout.errors import ConfigError, DiskFullError, InputError, StorageError
from runout.io.lock import exclusive
from runout.io.source_code import Checksums

ANGLE = "basal_friction_angle_deg"


@pytest.fixture
def two_cores(monkeypatch):
    monkeypatch.setattr(workers, "core_count", lambda: 2)


def run(place, **choices):
    return run_ensemble(place, place.folder / "results", **{"workers": 1, "simulate": simulate, **choices})


def angles(place, numbers):
    plan = plan_members(place)
    return sorted(plan[i].parameters[ANGLE] for i in numbers)


def attributes(place, number):
    with Dataset(plan_members(place)[number].file(place.folder / "results")) as file:
        return {name: file.getncattr(name) for name in file.ncattrs()}


def files(place):
    return sorted(p.name for p in (place.folder / "results" / "members").iterdir() if p.name != ".lock")


def expected_files(*places):
    return sorted({f"{member.key[:16]}.nc" for place in places for member in plan_members(place)})


def test_every_member_gets_a_file_that_says_what_it_is(tmp_path):
    place = site(tmp_path)
    report = run(place)
    assert report.done == tuple(range(8))
    assert files(place) == expected_files(place)
    for member in plan_members(place):
        stored = attributes(place, member.number)
        assert (stored["member_key"], stored["seed"]) == (member.key, member.seed)
        assert json.loads(stored["parameters"]) == member.parameters
        with Dataset(member.file(tmp_path / "results")) as file:
            assert (file["max_speed"][:] == member.parameters[ANGLE]).all()


@pytest.mark.parametrize("at_once", [1, 2])
def test_a_redirected_log_names_the_member_of_each_warning_and_its_file_each_that_ends(tmp_path, two_cores, capsys, at_once):
    place = site(tmp_path, faults={2.0: "warning", 5.0: "warning", 6.0: "material"})
    log.to_terminal(0)
    with log.to_file(tmp_path / "run.log"):
        report = run(place, workers=at_once)
    told = capsys.readouterr().err.splitlines()
    plan = plan_members(place)
    number_of = {member.parameters[ANGLE]: member.number for member in plan}
    warned = [line for line in told if "cells through a depth" in line]
    assert {line.split(": ")[1] for line in warned} == {f"member {number_of[angle]}" for angle in (2.0, 5.0)}
    assert not [line for line in told if " done " in line]
    assert sum(f"member {number_of[6.0]} failed: density is -3" in line for line in told) == 1
    lines = [json.loads(line) for line in (tmp_path / "run.log").read_text().splitlines()]
    ended = [re.fullmatch(r"member (\d) \((\w+)\) done in [\d.]+ s, (\d) of 8", one["message"]) for one in lines]
    assert {(int(one[1]), one[2]) for one in ended if one} == {(number, plan[number].name) for number in report.done}
    assert {one["member"] for one in lines if "cells through a depth" in one["message"]} == {number_of[2.0], number_of[5.0]}


def test_second_run_runs_nothing(tmp_path):
    place = site(tmp_path)
    run(place)
    again = run(place)
    assert (again.done, again.skipped, again.failed) == ((), tuple(range(8)), {})
    assert calls(place) == list(range(8))
    assert str(again) == "8 members: 0 simulated, 8 already there, 0 failed"


def test_more_members_run_only_the_new_ones(tmp_path):
    run(site(tmp_path, members=4))
    report = run(site(tmp_path, members=8))
    assert (report.skipped, report.done) == ((0, 1, 2, 3), (4, 5, 6, 7))


def test_fewer_members_keep_the_files_of_the_others_but_do_not_count_them(tmp_path):
    run(site(tmp_path, members=8))
    fewer = site(tmp_path, members=4)
    assert run(fewer).skipped == (0, 1, 2, 3)
    assert [standing.state for standing in standings(fewer, tmp_path / "results")] == ["done"] * 4
    assert len(files(fewer)) == 8


def test_changed_value_reruns_only_the_members_that_have_it(tmp_path):
    place = site(tmp_path)
    run(place)
    values = [0.0, 1.0, 2.0, 33.0, 4.0, 5.0, 6.0, 7.0]
    other = SimpleNamespace(distribution="discrete", values=values, frequencies=[0.125] * 8)
    changed = site(tmp_path, parameters={ANGLE: other})
    report = run(changed)
    assert angles(changed, report.done) == [33.0]
    assert calls(place) == [0, 1, 2, 3, 4, 5, 6, 7, 33]


@pytest.mark.parametrize("change", ["setting", "input", "seed", "sources"])
def test_change_that_matters_to_all_reruns_all(tmp_path, monkeypatch, change):
    run(site(tmp_path, members=2))
    if change == "input":
        (tmp_path / "dem.txt").write_text("1 2 4")
    if change == "sources":
        monkeypatch.setattr("runout.io.source_code.checksums", lambda: Checksums("other", "other"))
    place = site(tmp_path, members=2, **{"setting": {"cell_size": 10.0}, "seed": {"seed": 2}}.get(change, {}))
    assert all(one.reason == "not run yet with these inputs and settings" for one in standings(place, tmp_path / "results"))
    assert run(place).done == (0, 1)


def test_members_that_a_killed_run_replaced_are_kept(tmp_path, monkeypatch):
    run(site(tmp_path))
    changed = site(tmp_path, cell_size=10.0)
    with monkeypatch.context() as killed:
        killed.setattr(Written, "note", lambda *_: None)
        killed.setattr(Written, "save", once(Written.save))
        run(changed)
    again = run(changed)
    assert (again.done, again.skipped) == ((), tuple(range(8)))


def once(function):
    """The function at its first call, nothing later."""
    calls = []
    return lambda *arguments: None if calls else calls.append(function(*arguments))


def test_change_of_the_title_reruns_nothing(tmp_path):
    run(site(tmp_path))
    assert run(site(tmp_path, title="another title")).done == ()


def test_file_that_is_no_netcdf_is_not_taken_for_a_result(tmp_path):
    place = site(tmp_path, members=2)
    run(place)
    plan_members(place)[1].file(tmp_path / "results").write_bytes(b"CDF garbage")
    assert run(place).done == (1,)


def test_failed_members_are_recorded_with_their_reason_and_the_others_run(tmp_path):
    place = site(tmp_path, faults={2.0: "material", 5.0: "bug"})
    report = run(place)
    assert angles(place, report.done) == [0, 1, 3, 4, 6, 7]
    assert angles(place, report.failed) == [2, 5]
    bad, bug = sorted(report.failed, key=lambda i: plan_members(place)[i].parameters[ANGLE])
    assert report.failed[bad] == "density is -3 kg m-3; it must lie above 0 kg m-3"
    record = json.loads(plan_members(place)[bad].failure_file(tmp_path / "results").read_text())
    assert (record["type"], record["key"], record["traceback"]) == ("MaterialError", plan_members(place)[bad].key, "")
    assert record["parameters"] == {ANGLE: 2.0}
    record = json.loads(plan_members(place)[bug].failure_file(tmp_path / "results").read_text())
    assert record["type"] == "KeyError"
    assert "_bug" in record["traceback"]
    assert "please report" in report.failed[bug]


def test_failure_that_lasts_is_not_tried_again_and_one_of_the_machine_is(tmp_path):
    place = site(tmp_path, faults={2.0: "material", 5.0: "storage"})
    first = run(place)
    again = run(place)
    assert again.failed == first.failed
    assert calls(place) == [0, 1, 2, 3, 4, 5, 5, 6, 7]
    run(place, retry_failed=True)
    assert calls(place) == [0, 1, 2, 2, 3, 4, 5, 5, 5, 6, 7]


def test_member_that_succeeds_later_loses_its_record_of_failure(tmp_path):
    run(site(tmp_path, faults={5.0: "storage"}))
    healed = site(tmp_path)
    assert len(run(healed).done) == 1
    assert files(healed) == expected_files(healed)


def test_failing_member_has_no_file_though_it_had_one_with_other_settings(tmp_path):
    place = site(tmp_path)
    run(place)
    changed = site(tmp_path, cell_size=10.0, faults={5.0: "material"})
    (number,) = run(changed).failed
    member = plan_members(changed)[number]
    assert not member.file(tmp_path / "results").exists()
    assert set(files(changed)) == {*expected_files(place, changed), f"{member.key[:16]}.failed.json"} - {f"{member.key[:16]}.nc"}


def test_a_setting_that_is_changed_and_changed_back_simulates_nothing(tmp_path):
    place, other = site(tmp_path, members=4), site(tmp_path, members=4, cell_size=10.0)
    assert len(run(place).done) == len(run(other).done) == 4
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "results" / "members").glob("*.nc")}
    for again in (place, other, place):
        assert run(again).done == ()
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert files(place) == expected_files(place, other)
    assert len(before) == 8


def test_a_distribution_that_is_changed_and_changed_back_shares_equal_members(tmp_path):
    place = site(tmp_path)
    run(place)
    other = SimpleNamespace(distribution="discrete", values=[0.0, 1.0, 2.0, 33.0, 4.0, 5.0, 6.0, 7.0], frequencies=[0.125] * 8)
    changed = site(tmp_path, parameters={ANGLE: other})
    assert (len(run(changed).done), len(run(changed).skipped), len(run(place).skipped)) == (1, 8, 8)
    assert len(files(place)) == 9


def test_a_failure_of_other_settings_does_not_count_and_comes_back_with_them(tmp_path):
    broken, healed = site(tmp_path, faults={5.0: "material"}, cell_size=10.0), site(tmp_path)
    first = run(broken)
    assert run(healed).failed == {}
    assert run(broken).failed == first.failed
    assert calls(broken).count(5.0) == 2


def test_files_of_other_settings_are_counted_and_removed_on_demand_only(tmp_path):
    place, other = site(tmp_path, members=4), site(tmp_path, members=4, cell_size=10.0, faults={5.0: "material", 1.0: "material"})
    results, kept = tmp_path / "results", tmp_path / "results" / "members"
    run(place)
    run(other)
    for name in ("my notes.nc", "0003.nc", "0003.failed.json", f"{'a' * 16}.checkpoint.npz"):
        (kept / name).write_bytes(b"12345")
    unused = unused_files(results, plan_members(place))
    assert {path.name for path in unused} == {path.name for path in kept.iterdir()} - {
        *expected_files(place),
        ".lock",
        "my notes.nc",
    }
    assert len(unused) == 4 + 3
    size = sum(path.stat().st_size for path in unused)
    assert remove_unused(results, plan_members(place)) == (7, size)
    assert files(place) == sorted([*expected_files(place), "my notes.nc"])
    assert remove_unused(results, plan_members(place)) == (0, 0)
    assert sorted(json.loads((results / "checksums.json").read_text())) == expected_files(place)
    assert run(place).done == ()


def test_no_file_is_removed_while_a_run_works(tmp_path):
    place = site(tmp_path, members=1)
    run(place)
    with exclusive(tmp_path / "results" / "members"), pytest.raises(StorageError, match="another run"):
        remove_unused(tmp_path / "results", [])
    assert remove_unused(tmp_path / "nothing", []) == (0, 0)


def test_interrupt_ends_the_run_and_it_resumes(tmp_path):
    broken = site(tmp_path, faults={5.0: "interrupt"})
    with pytest.raises(KeyboardInterrupt):
        run(broken)
    finished = len(files(broken))
    assert 0 < finished < 8
    report = run(site(tmp_path))
    assert (len(report.skipped), len(report.done), report.failed) == (finished, 8 - finished, {})


@pytest.mark.parametrize("number", [1, 2])
def test_a_full_disk_ends_the_run_before_more_is_simulated_in_vain(tmp_path, two_cores, number):
    with pytest.raises(DiskFullError, match="the disk is full"):
        run(site(tmp_path, faults={float(v): "full" for v in range(8)}, pause=0.1), workers=number)
    assert len(calls(site(tmp_path))) <= 2
    assert not list((tmp_path / "results" / "members").glob("*.json"))
    assert len(run(site(tmp_path)).done) == 8


def test_progress_tells_how_far_the_run_is_and_what_is_left(tmp_path):
    run(site(tmp_path, members=2))
    seen = []
    run(site(tmp_path, members=6, faults={5.0: "material"}, pause=0.02), progress=seen.append)
    assert [p.finished for p in seen] == [2, 3, 4, 5, 6]
    assert {p.of for p in seen} == {6}
    assert seen[0].remaining is None
    assert seen[2].remaining == pytest.approx(seen[2].seconds / 2 * 2)
    assert seen[-1].remaining == 0.0
    assert seen[-1].fraction == 1.0
    assert all(a.seconds <= b.seconds for a, b in itertools.pairwise(seen))


def test_members_under_way_count_before_the_first_one_is_finished(tmp_path):
    seen = []
    run(site(tmp_path, members=2, pause=0.2), progress=seen.append, simulate=simulate_step_by_step)
    first = [p for p in seen if p.finished == 0]
    assert [p.under_way for p in first] == pytest.approx([k / 10 for k in range(11)])
    assert [p.fraction for p in first] == pytest.approx([k / 20 for k in range(11)])
    assert first[0].remaining is None
    assert all(p.remaining == pytest.approx(p.seconds * (2 - p.under_way) / p.under_way) for p in first[3:])
    assert (seen[-1].finished, seen[-1].under_way, seen[-1].remaining) == (2, 0.0, 0.0)


def test_workers_tell_how_far_their_members_are(tmp_path, two_cores):
    seen = []
    run(site(tmp_path, members=2, pause=2.0), progress=seen.append, simulate=simulate_step_by_step, workers=2)
    early = [p for p in seen if p.finished == 0]
    assert early[0].remaining is None
    assert 0.2 < max(p.under_way for p in early) <= 2.0
    told = [p for p in early if p.under_way > 0.25]
    assert all(p.remaining == pytest.approx(p.seconds * (2 - p.under_way) / p.under_way) for p in told)
    assert [p.finished for p in seen][-1] == 2


def test_status_lists_members_done_failed_and_left(tmp_path):
    run(site(tmp_path, members=4, faults={float(v): "material" for v in range(4)}))
    found = standings(site(tmp_path, members=8), tmp_path / "results")
    assert [(standing.state, standing.reason) for standing in found[4:]] == [("left", "not run yet")] * 4
    for standing in found[:4]:
        bad = standing.member.parameters[ANGLE] < 4
        assert standing.state == ("failed" if bad else "done")
        assert standing.reason.startswith("density is -3") == bad


def test_missing_input_is_refused_by_name(tmp_path):
    place = site(tmp_path)
    (tmp_path / "dem.txt").unlink()
    with pytest.raises(InputError, match=r"dem\.txt"):
        run(place)


def test_second_run_at_the_same_time_is_refused(tmp_path):
    place = site(tmp_path, members=1)
    refused = []

    def start_another(progress):
        if progress.finished == 0:
            with started(tmp_path, 0.0) as other:
                refused.append(other.communicate(timeout=60)[0])

    assert run(place, progress=start_another).done == (0,)
    (text,) = refused
    assert "StorageError" in text
    assert "another run is working there" in text
    assert len(calls(place)) == 1


def test_results_that_cannot_be_written_are_refused(tmp_path):
    place = site(tmp_path)
    (tmp_path / "results").write_text("a file in the way")
    with pytest.raises(ConfigError, match="results: is a file; name a folder"):
        run(place)


def test_more_workers_than_cores_are_not_started(two_cores, caplog):
    with caplog.at_level(logging.WARNING):
        assert workers.worker_count(5, 1) == 2
    assert "5 workers of 1 threads need more than the 2 cores" in caplog.text
    assert workers.worker_count(None, 1) == 2
    assert workers.worker_count(None, 2) == workers.worker_count(None, 8) == 1
    with pytest.raises(ConfigError, match="workers is 0"):
        workers.worker_count(0, 1)


@pytest.mark.parametrize(
    ("members", "stated", "expected"),
    [
        (32, {}, (8, 1)),
        (8, {}, (8, 1)),
        (3, {}, (3, 2)),
        (1, {}, (1, 8)),
        (32, {"workers": 2}, (2, 4)),
        (32, {"threads": 4}, (2, 4)),
        (1, {"threads": 3}, (1, 3)),
        (32, {"workers": 1}, (1, 8)),
    ],
)
def test_members_share_all_cores(monkeypatch, members, stated, expected):
    monkeypatch.setattr(workers, "core_count", lambda: 8)
    share = workers.share_of("cpu", members, **stated)
    assert (share.workers, share.threads) == expected
    assert share.in_process == (stated.get("workers") == 1)
    assert share.workers * share.threads <= 8


def test_a_single_large_member_gets_all_cores(tmp_path, two_cores):
    place = site(tmp_path, members=1)
    run(place, workers=None)
    assert attributes(place, 0)["threads"] == 2
    assert attributes(place, 0)["numba_threads"] == "2"


def test_the_longest_members_start_first():
    def member(number, volume, angle):
        return Member(number, {"release_volume_factor": volume, ANGLE: angle}, 0, "")

    members = [member(0, 1.0, 20.0), member(1, 2.0, 30.0), member(2, 2.0, 15.0), member(3, 0.5, 10.0)]
    assert [m.number for m in longest_first(members)] == [2, 1, 0, 3]


def test_members_on_all_gpus_are_spread_one_process_a_gpu(tmp_path, two_cores, monkeypatch):
    monkeypatch.setattr("runout.backends.protocol._cuda_devices", lambda: ("cuda:0", "cuda:1"))
    place = site(tmp_path, members=4, device="cuda", pause=0.5)
    assert run(place, workers=None, simulate=simulate_on).done == (0, 1, 2, 3)
    where = [(attributes(place, i)["pid"], attributes(place, i)["device"]) for i in range(4)]
    assert len(set(where)) == 2
    assert {device for _, device in where} == {"cuda:0", "cuda:1"}


def test_groups_of_gpus_release_about_the_same_volume_whatever_the_order_of_the_members():
    """Interleaved, the first group would have four times the work of the second."""
    members = [Member(n, {"release_volume_factor": 2.0 if n % 2 == 0 else 0.5}, n, "") for n in range(20)]
    groups = dealt(members, 2)
    assert [sum(m.parameters["release_volume_factor"] for m in group) for group in groups] == [12.5, 12.5]
    assert sorted(m.number for group in groups for m in group) == list(range(20))
    assert all([m.number for m in group] == sorted(m.number for m in group) for group in groups)
    alike = dealt([Member(n, {}, n, "") for n in range(3)], 5)
    assert [len(group) for group in alike] == [1, 1, 1]


def test_members_on_one_gpu_run_in_one_process(tmp_path, two_cores, monkeypatch):
    monkeypatch.setattr("runout.backends.protocol._cuda_devices", lambda: ("cuda:0", "cuda:1"))
    place = site(tmp_path, members=2, device="cuda:1")
    run(place, workers=None, simulate=simulate_on)
    assert {(attributes(place, i)["pid"], attributes(place, i)["device"]) for i in range(2)} == {(os.getpid(), "cuda:1")}


def test_run_survives_workers_that_die_of_memory_or_at_once(tmp_path, two_cores, monkeypatch, capfd):
    monkeypatch.setattr(workers, "MEMORY_SHARE", 1.4e9 / workers.memory_bytes())  # 700 MB for each of two
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    before = dict(os.environ)
    place = site(tmp_path, faults={1.0: "exit", 3.0: "memory", 5.0: "material", 6.0: "bug"}, pause=0.1)
    seen = []
    report = run(place, workers=2, progress=seen.append)
    assert angles(place, report.done) == [0, 2, 4, 7]
    assert angles(place, report.failed) == [1, 3, 5, 6]
    assert calls(place) == [0, 1, 1, 2, 3, 3, 4, 5, 6, 7]  # a death is tried once more, nothing else
    reasons = {plan_members(place)[i].parameters[ANGLE]: reason for i, reason in report.failed.items()}
    for angle in (1.0, 3.0):
        assert "its process died twice" in reasons[angle]
        assert "0.7 GiB" in reasons[angle]
    assert "KeyError" in reasons[6.0]
    assert [p.finished for p in seen] == list(range(9))
    assert {attributes(place, i)["numba_threads"] for i in report.done} == {"1"}
    assert os.getpid() not in {attributes(place, i)["pid"] for i in report.done}
    assert dict(os.environ) == before
    assert capfd.readouterr().err == ""
    healed = run(site(tmp_path))
    assert angles(place, healed.done) == [1, 3, 6]  # not the one that would fail again


def process_group(leader):
    listing = subprocess.run(["ps", "-eo", "pid,pgid,stat"], capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in listing.splitlines()[1:]]
    return [pid for pid, group, state in rows if int(group) == leader and not state.startswith("Z")]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_run_killed_half_way_finishes_only_what_is_left(tmp_path):
    process = started(tmp_path, 0.6)
    members = tmp_path / "results" / "members"
    wait_until(lambda: len(list(members.glob("*.nc"))) >= 3)
    process.kill()
    process.wait()
    wait_until(lambda: not process_group(process.pid))  # workers end with it
    finished = {m.number for m in plan_members(site(tmp_path)) if m.file(tmp_path / "results").exists()}
    assert 3 <= len(finished) < 8
    stale = members / ".0123456789abcdef.nc.abc.part"
    stale.mkdir()
    (stale / "0123456789abcdef.nc").write_bytes(b"half a file")
    place = site(tmp_path)
    report = run(place)
    assert set(report.skipped) == finished
    assert set(report.done) == set(range(8)) - finished
    assert files(place) == expected_files(place)
    assert all(stored_key(m.file(tmp_path / "results")) == m.key for m in plan_members(place))


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_run_interrupted_from_the_keyboard_ends_soon_and_resumes(tmp_path):
    process = started(tmp_path, 1.0)
    members = tmp_path / "results" / "members"
    wait_until(lambda: list(members.glob("*.nc")))
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    output, _ = process.communicate(timeout=30)
    assert "KeyboardInterrupt" in output
    wait_until(lambda: not process_group(process.pid))
    finished = {m.number for m in plan_members(site(tmp_path)) if m.file(tmp_path / "results").exists()}
    assert 1 <= len(finished) < 8
    assert not list(members.glob("*.failed.json"))
    assert set(run(site(tmp_path)).skipped) == finished


def test_a_resumed_run_does_not_search_the_folder_for_each_member(tmp_path, monkeypatch):
    place = site(tmp_path)
    run(place)
    searches, glob, iterdir = [], Path.glob, Path.iterdir
    monkeypatch.setattr(Path, "glob", lambda folder, pattern: searches.append(pattern) or glob(folder, pattern))
    monkeypatch.setattr(Path, "iterdir", lambda folder: searches.append(folder) or iterdir(folder))
    plan_members(place)[3].failure_file(tmp_path / "results").write_text("{}")
    assert run(place).skipped == tuple(range(8))
    assert len(searches) == 1
    assert files(place) == expected_files(place)
