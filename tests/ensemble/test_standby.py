"""Worker processes that have started before their work is known compute the members, and none of them is left."""

import os
from functools import partial

import psutil
import pytest

from runout.ensemble import workers
from runout.ensemble import workers as standby_module
from runout.ensemble.member import Member
from runout.ensemble.worker import Worker
from runout.ensemble.workers import Standby, in_workers

GROUPS = [(Member(number, {}, 0, ""),) for number in range(4)]


@pytest.fixture(autouse=True)
def quick_imports(monkeypatch):
    monkeypatch.setattr(standby_module, "IMPORTED", ("json", "a_module_that_is_not_installed"))


def task(group, *, progress, device, folder):
    (folder / f"{os.getpid()}").touch()
    (folder / f"threads {os.environ['NUMBA_NUM_THREADS']}").touch()
    return {}


def computed_by(folder, count, threads, standby):
    """Processes that computed the members, after all have ended."""
    errors = [o.error for o in in_workers(partial(task, folder=folder), GROUPS, count, threads, print, standby=standby)]
    assert errors == [None] * len(GROUPS)
    assert [path.name for path in folder.glob("threads*")] == [f"threads {threads}"]
    return {int(path.name) for path in folder.iterdir() if path.name.isdigit()}


def test_processes_that_wait_compute_the_members(tmp_path):
    with Standby(2, 3) as standby:
        waiting = {worker.process.pid for worker in standby.workers}
        assert computed_by(tmp_path, 2, 3, standby) <= waiting
    assert not any(map(psutil.pid_exists, waiting))


def test_processes_with_other_threads_end_and_others_compute(tmp_path):
    with Standby(2, 3) as standby:
        waiting = {worker.process.pid for worker in standby.workers}
        assert not computed_by(tmp_path, 2, 1, standby) & waiting
        assert standby.workers == []
        assert not any(map(psutil.pid_exists, waiting))


def test_processes_that_nobody_takes_end_with_the_context():
    with Standby(2, 1) as standby:
        waiting = [worker.process.pid for worker in standby.workers]
    assert not any(map(psutil.pid_exists, waiting))


def test_a_system_without_a_further_process_does_without(monkeypatch):
    def refuse(*_):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", refuse)
    with Standby(2, 1) as standby:
        assert standby.take(0, 1) is None


def test_few_processes_wait_where_there_are_many_cores(tmp_path, monkeypatch):
    monkeypatch.setattr(standby_module, "MOST", 1)
    with Standby(2, 1) as standby:
        assert len(standby.workers) == 1
        computed_by(tmp_path, 2, 1, standby)


def test_all_workers_are_started_before_one_is_waited_for(tmp_path, monkeypatch):
    """A worker reads its task when it has started; tasks are larger than what a pipe holds."""
    order, start, assign = [], workers.started, Worker.assign
    monkeypatch.setattr(workers, "started", lambda *of: order.append("start") or start(*of))
    monkeypatch.setattr(Worker, "assign", lambda self, task: order.append("assign") or assign(self, task))
    computed_by(tmp_path, 3, 1, None)
    assert order == ["start"] * 3 + ["assign"] * 3
