"""A whole run on other machines gives the products of a run on this one."""

import re
import shutil
import sys
import threading
from pathlib import Path

import numpy as np
import psutil
import xarray as xr

from runout.cli import main
from runout.ensemble.cluster import Cluster
from runout.errors import ExitCode
from runout.workflow import hazard_map

sys.path.append(str(Path(__file__).parents[1] / "ensemble"))
from dask_cluster import cluster, end
from ensemble_fakes import wait_until


def require_same(one, other):
    """All variables of the products and of the members are equal, to the bit."""
    members = [f"members/{path.name}" for path in sorted((one / "members").glob("*.nc"))]
    assert len(members) == 4
    for name in ("hazard.nc", "members.nc", *members):
        with xr.open_dataset(one / name) as first, xr.open_dataset(other / name) as second:
            assert set(first.variables) == set(second.variables)
            for variable in first.variables:
                assert np.array_equal(first[variable].values, second[variable].values, equal_nan=first[variable].dtype.kind == "f")


def test_a_cluster_of_two_processes_of_which_one_is_killed_gives_identical_products(finished_site, tmp_path, caplog):
    local, _ = finished_site
    folder, out = tmp_path / "ramp", tmp_path / "out"
    shutil.copytree(local, folder, ignore=shutil.ignore_patterns("results"))
    with cluster(tmp_path / "dask") as dask:
        workers = [dask.worker(1, "--no-nanny") for _ in range(2)]
        here = Cluster(dask.address, **dask.tls)
        with here.connect(tmp_path) as (client, _):
            client.wait_for_workers(2, timeout=60)  # one alone may finish all members before the other is there

        def kill_one():
            wait_until(psutil.Process(workers[0].pid).children)  # started for its first member
            end(workers[0])

        threading.Thread(target=kill_one).start()
        outcome = hazard_map.run(folder, out, cluster=here)
        assert workers[0].poll() is not None
    assert "lost 1 workers of the cluster, 1 are left" in caplog.text
    assert re.search(r"the worker of member \d died", caplog.text)
    assert outcome.failed == {}
    require_same(local / "results", out)
    assert hazard_map.run(folder, out).done == ()


def test_jobs_of_an_array_make_the_members_and_a_run_makes_the_products(finished_site, tmp_path):
    local, _ = finished_site
    folder, out = tmp_path / "ramp", tmp_path / "out"
    shutil.copytree(local, folder, ignore=shutil.ignore_patterns("results"))
    assert main(["ensemble", str(folder), "--out", str(out), "--members", "0:6"]) == ExitCode.CONFIGURATION
    for part in ("2:4", "0:2"):
        assert main(["ensemble", str(folder), "--out", str(out), "--members", part, "--workers", "1"]) == ExitCode.OK
    assert not (out / "stages.json").exists()
    outcome = hazard_map.run(folder, out, workers=1)
    assert "ensemble" not in outcome.done
    require_same(local / "results", out)
