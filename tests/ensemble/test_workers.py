"""Worker processes: nobody else reaches them, they end with their parent, and their errors come home."""

import logging
import os
import signal
import sys
import time
from contextlib import suppress
from functools import partial

import psutil
import pytest
from ensemble_fakes import started, wait_until

from runout.ensemble import worker, workers
from runout.ensemble.member import Member
from runout.ensemble.workers import in_workers
from runout.errors import ConfigError, DeviceError, Problem

GROUPS = [(Member(number, {}, 0, ""),) for number in range(4)]
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


class Unportable(Exception):
    """An error that cannot be made anew from its message, as some of libraries cannot."""

    def __init__(self, where, why):
        super().__init__(f"{where}: {why}")


def task(group, *, progress, device, folder, pause=0.0):
    (member,) = group
    (folder / f"{os.getpid()}").touch()
    time.sleep(pause)
    if member.number == 1:
        raise Unportable("member 1", "cannot travel")
    if member.number == 2:
        raise ConfigError([Problem("site.yaml", 5, "terrain", "unknown key")])
    progress(member.number, 1.0)
    return {}


def outcomes(folder, **choices):
    run = in_workers(partial(task, folder=folder, **choices), GROUPS, 2, 1, lambda number, fraction: None)
    return {outcome.member.number: outcome.error for outcome in run}


def test_errors_come_home_with_their_traceback_those_that_cannot_travel_too(tmp_path):
    errors = outcomes(tmp_path)
    assert errors[0] is errors[3] is None
    assert str(errors[1]) == "Unportable: member 1: cannot travel"
    assert isinstance(errors[2], ConfigError)
    assert errors[2].problems[0].line == 5
    assert all("in task" in errors[number].__notes__[0] for number in (1, 2))
    assert len(list(tmp_path.iterdir())) == 2
    assert not any(psutil.pid_exists(int(path.name)) for path in tmp_path.iterdir())


def end_at_once(*_):
    raise SystemExit(3)


def test_workers_that_cannot_start_end_the_run_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "_work", end_at_once)
    with pytest.raises(DeviceError, match="exit code 3 while it started; run again with --workers 1"):
        outcomes(tmp_path)


def test_a_system_without_a_further_process_is_named(tmp_path, monkeypatch):
    def refuse(*_):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", refuse)
    with pytest.raises(DeviceError, match=r"no worker process can be started \(Resource temporarily unavailable\)"):
        outcomes(tmp_path)


def test_cores_and_memory_of_a_container_count(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "CGROUP", tmp_path)
    monkeypatch.setattr(psutil.Process, "cpu_affinity", lambda _: list(range(8)), raising=False)
    assert workers.core_count() == 8
    (tmp_path / "cpu.max").write_text("max 100000\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert workers.core_count() == 8
    assert workers.memory_bytes() == psutil.virtual_memory().total
    (tmp_path / "cpu.max").write_text("250000 100000\n")
    (tmp_path / "memory.max").write_text("1000000\n")
    assert workers.core_count() == 2
    assert workers.memory_bytes() == 1_000_000


@pytest.fixture
def running(tmp_path):
    """A running ensemble and its worker processes, each of which simulates a member."""
    process = started(tmp_path, 20.0)
    wait_until(lambda: len(list((tmp_path / "calls").iterdir())) == 2)
    children = psutil.Process(process.pid).children(recursive=True)
    workers = [child for child in children if "resource_tracker" not in " ".join(child.cmdline())]
    assert len(workers) == 2
    yield process, workers
    for one in (process, *workers):
        with suppress(psutil.NoSuchProcess):
            one.kill()
    process.communicate()


@posix
def test_nobody_can_connect_to_a_running_ensemble(running):
    """No process listens on a port or has a socket with a name, so there is nothing to present a wrong secret to."""
    process, workers = running
    for one in (psutil.Process(process.pid), *workers):
        assert one.net_connections(kind="inet") == []
        assert [connection.laddr for connection in one.net_connections(kind="unix") if connection.laddr] == []


@posix
@pytest.mark.parametrize("death", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_workers_end_with_the_process_that_started_them(running, death):
    process, workers = running
    process.send_signal(death)
    process.wait(60)
    assert psutil.wait_procs(workers, timeout=30)[1] == []


@posix
def test_an_interrupt_of_all_processes_is_said_by_one(running):
    process, workers = running
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    output, _ = process.communicate(timeout=60)
    assert output.count("Traceback") == output.count("KeyboardInterrupt") == 1
    assert psutil.wait_procs(workers, timeout=30)[1] == []


def test_a_worker_says_nothing_on_the_terminal(tmp_path, capfd):
    logging.getLogger("runout").warning("only here")
    capfd.readouterr()
    outcomes(tmp_path)
    assert capfd.readouterr().err == ""
