"""Members on a dask cluster: whatever its workers do, each member ends once, as on this machine."""

import os
import platform
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from dask_cluster import certificates, cluster, end
from ensemble_fakes import calls, parents, simulate, simulate_step_by_step, site, wait_until

from runout import __version__
from runout.ensemble import cluster_worker, fleet
from runout.ensemble.cluster import Cluster
from runout.ensemble.cluster_worker import Needs
from runout.ensemble.dispatch import Died
from runout.ensemble.fleet import Order
from runout.ensemble.member import plan_members, stored_key
from runout.ensemble.run import run_ensemble
from runout.ensemble.work import Work
from runout.ensemble.worker import Done
from runout.ensemble.workers import Capacity, Share, pack
from runout.errors import ClusterError

CLIENT = """\
import sys
from ensemble_fakes import simulate, site
from runout.ensemble.cluster import Cluster
from runout.ensemble.run import run_ensemble
from pathlib import Path
folder, address, ca, key = sys.argv[1:]
where = Cluster(address, Path(ca), Path(ca), Path(key))
run_ensemble(site(folder, pause=60.0), Path(folder) / "results", cluster=where, simulate=simulate)
"""


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    with cluster(tmp_path_factory.mktemp("dask")) as made:
        yield made


@pytest.fixture
def dask(scheduler):
    """A scheduler without workers."""
    yield scheduler
    for process in scheduler.running[1:]:
        end(process)


def run(place, dask, **choices):
    where = Cluster(dask.address, **dask.tls)
    return run_ensemble(place, place.folder / "results", cluster=where, **{"simulate": simulate, **choices})


def test_members_run_on_workers_and_tell_how_far_they_are(tmp_path, dask):
    dask.worker(2, "--no-nanny")
    place, told = site(tmp_path, members=4, pause=1.0), []
    report = run(place, dask, progress=told.append, simulate=simulate_step_by_step)
    assert (report.done, report.failed) == ((0, 1, 2, 3), {})
    assert all(stored_key(member.file(tmp_path / "results")) == member.key for member in plan_members(place))
    assert any(state.under_way > 0 for state in told)
    assert sorted(path.name for path in (tmp_path / "results").iterdir() if path.name[0] != ".") == ["checksums.json", "members"]
    assert run(place, dask).skipped == (0, 1, 2, 3)


def test_a_lost_worker_costs_one_run_of_its_member(tmp_path, dask):
    place, lost = site(tmp_path, members=4, pause=2.0), dask.worker(1, "--no-nanny")
    dask.worker(1, "--no-nanny")

    def lose():
        wait_until(lambda: lost.pid in parents(place))
        end(lost)

    threading.Thread(target=lose).start()
    report = run(place, dask)
    assert (report.done, report.failed) == (tuple(range(4)), {})
    assert len(calls(place)) == 5


@pytest.mark.parametrize("fault", ["exit", "kill_parent"])
def test_a_member_that_kills_its_worker_twice_fails_and_the_others_go_on(tmp_path, dask, fault):
    for _ in range(2):
        dask.worker(1)
    place = site(tmp_path, faults={3.0: fault})
    report = run(place, dask)
    (failed,) = report.failed
    assert plan_members(place)[failed].parameters == {"basal_friction_angle_deg": 3.0}
    assert "died twice" in report.failed[failed]
    assert len(report.done) == 7
    assert calls(place).count(3.0) == 2


def refused(place, dask, reason, **choices):
    with pytest.raises(ClusterError, match=f"no worker of the cluster can compute members: tls://.* {reason}"):
        run(place, dask, **choices)


def test_workers_that_cannot_take_part_are_named_with_the_reason(tmp_path, dask, monkeypatch):
    place = site(tmp_path)
    strange = tmp_path / "elsewhere" / "runout"
    strange.mkdir(parents=True)
    (strange / "__init__.py").write_text("__version__ = '0.0.1'")
    worker = dask.worker(1, "--no-nanny", path=[strange.parent])
    refused(place, dask, "cannot run runout .*; install it there")
    end(worker)
    dask.worker(1, "--no-nanny")
    with monkeypatch.context() as patch:
        patch.setattr(fleet, "__version__", "99.9")
        refused(place, dask, "has runout .*, here it is 99.9; install the same version")
    with monkeypatch.context() as patch:
        patch.setattr(fleet.platform, "python_version_tuple", lambda: ("2", "7", "18"))
        refused(place, dask, "has Python 3.*, here it is 2.7; use the same version")
    with monkeypatch.context() as patch:
        patch.setattr(fleet, "Needs", lambda *needs: replace(Needs(*needs), mark=Path("/nowhere")))
        refused(place, dask, "does not see .*members; the folder must be shared under the same path")
    refused(place, dask, r"has .* GB of memory, a member needs about 1e\+06 GB", member_bytes=1e15)
    assert calls(place) == []
    assert run(place, dask).done == tuple(range(8))


def test_a_client_with_another_certificate_is_refused(tmp_path, dask, monkeypatch):
    monkeypatch.setattr("runout.ensemble.cluster.CONNECT_SECONDS", 2.0)
    where = Cluster(dask.address, **certificates(tmp_path, "stranger"))
    with pytest.raises(ClusterError, match="no scheduler answers there, or it does not accept the certificates"):
        run_ensemble(site(tmp_path), tmp_path / "results", cluster=where, simulate=simulate)


def test_members_end_with_a_client_that_is_killed(tmp_path, dask):
    worker = dask.worker(2, "--no-nanny")
    command = [sys.executable, "-c", CLIENT, str(tmp_path), dask.address, str(dask.tls["tls_ca"]), str(dask.tls["tls_key"])]
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parent.parent), os.environ.get("PYTHONPATH", "")])
    place = site(tmp_path)
    client = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path})
    wait_until(lambda: len(calls(place)) == 2, 120)
    members = [one for one in psutil.Process(worker.pid).children() if "spawn_main" in " ".join(one.cmdline())]
    client.send_signal(signal.SIGKILL)  # they may end at once, so they are listed before
    client.wait()
    assert len(members) == 2
    assert psutil.wait_procs(members, timeout=60)[1] == []


def test_processes_of_a_run_that_is_idle_end_and_start_again(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster_worker, "IDLE_SECONDS", 0.5)
    place = site(tmp_path)
    (tmp_path / "results" / "members").mkdir(parents=True)
    work = Work(place, tuple(plan_members(place)), tmp_path / "results", simulate)
    share = Share(1, 1)
    pool = cluster_worker.Pool(work.task(share), share, 10**9)
    for member in work.members[:2]:
        assert pool.compute((member,), lambda said: None, lambda: True) == Done()
        assert pool.forces
        wait_until(lambda: not pool.forces)
    assert pool.compute((work.members[2],), lambda said: None, lambda: False) == Died("it was no longer wanted")
    assert not pool.forces
    assert len(list((tmp_path / "results" / "members").iterdir())) == 2


CAPACITY = Capacity(cores=8, memory=20 * 10**9)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({"members": 32}, (8, 1)),
        ({"members": 3}, (3, 2)),
        ({"members": 32, "member_bytes": 4e9}, (4, 2)),
        ({"members": 32, "member_bytes": 17e9}, (1, 8)),
        ({"members": 32, "workers": 6, "member_bytes": 8e9}, (2, 4)),
        ({"members": 32, "threads": 4, "member_bytes": 1e9}, (2, 4)),
        ({"members": 32, "threads": 1000}, (1, 8)),
    ],
)
def test_members_are_packed_by_cores_and_memory(stated, expected):
    share = pack(CAPACITY, **stated)
    assert (share.workers, share.threads) == expected


class FakeClient:
    """A client of workers that state these offers and compute nothing."""

    def __init__(self, offers):
        self.offers, self.shares = offers, {}

    def nthreads(self):
        return dict.fromkeys(self.offers, 8)

    def subscribe_topic(self, topic, handler):
        pass

    def run(self, function, *arguments, workers, on_error):
        if function is cluster_worker.state_offer:
            return {address: self.offers[address] for address in workers}
        if function is cluster_worker.open_pool:
            self.shares[workers[0]] = arguments[2]
        return dict.fromkeys(workers)


def offer(gpus=(), memory=64 * 10**9, **fields):
    capacity = Capacity(8, memory, tuple(f"cuda:{number}" for number in range(len(gpus))))
    return replace(cluster_worker.Offer(__version__, platform.python_version(), None, capacity, tuple(gpus)), **fields)


def test_workers_of_one_host_do_not_share_a_gpu(tmp_path):
    both = ["node1/0", "node1/1"]
    client = FakeClient({"a": offer(both), "b": offer(both), "c": offer(["node2/1"]), "d": offer()})
    place = site(tmp_path, device="cuda")
    order = Order(Work(place, tuple(plan_members(place)), tmp_path, simulate))
    one = fleet.Fleet(client, order, Needs("cuda", tmp_path, tmp_path, {}), lambda: None)
    assert {address: share.devices for address, share in client.shares.items()} == {"a": ("cuda:0", "cuda:1"), "c": ("cuda:0",)}
    assert {address: share.workers for address, share in client.shares.items()} == {"a": 2, "c": 1}
    assert one.unfit == dict.fromkeys("bd", "has no GPU, or others use it")


def test_a_gpu_has_the_number_that_its_host_gives_it(monkeypatch):
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    assert cluster_worker.host_number("cuda:1") == "1"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,6")
    assert [cluster_worker.host_number(device) for device in ("cuda:0", "cuda:1")] == ["4", "6"]


def test_a_small_worker_is_left_out_and_a_new_one_joins(tmp_path, caplog):
    client = FakeClient({"a": offer(memory=10**9), "b": offer(memory=10**10)})
    place = site(tmp_path)
    order = Order(Work(place, tuple(plan_members(place)), tmp_path, simulate), member_bytes=2e9)
    one = fleet.Fleet(client, order, Needs("cpu", tmp_path, tmp_path, {}), lambda: None)
    assert {address: (share.workers, share.threads) for address, share in client.shares.items()} == {"b": (4, 2)}
    assert "worker a of the cluster is not used: it has 1 GB of memory, a member needs about 2 GB" in caplog.text
    client.offers["c"] = offer()
    one._look()
    assert set(one.berths) == {"b", "c"}
