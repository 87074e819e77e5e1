"""Members on SLURM jobs that a run submits, secures and cancels; the commands of SLURM are replaced by local ones."""

import os

import pytest
from dask_cluster import HERE, ROOT
from ensemble_fakes import simulate, site
from fake_slurm import install

from runout.ensemble.cluster import Cluster
from runout.ensemble.run import run_ensemble
from runout.errors import ClusterError, ConfigError

pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Folder of the commands of SLURM, which are on PATH."""
    folder = install(tmp_path / "slurm")
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(ROOT), os.environ.get("PYTHONPATH", "")]))
    return folder


def test_jobs_compute_the_members_over_encrypted_connections_and_are_cancelled(tmp_path, slurm):
    import dask

    place = site(tmp_path)
    with dask.config.set({"jobqueue.slurm.cores": 1, "jobqueue.slurm.memory": "1GB", "jobqueue.slurm.walltime": "01:00:00"}):
        report = run_ensemble(place, tmp_path / "results", cluster=Cluster(slurm=2), simulate=simulate)
    assert (report.done, report.failed) == (tuple(range(8)), {})
    scripts = [path.read_text() for path in slurm.glob("job-*.sh")]
    assert len(scripts) == 2
    assert all("#SBATCH -n 1" in script and "tls://" in script and "-t 01:00:00" in script for script in scripts)
    assert len(list(slurm.glob("cancelled-*"))) == 2
    assert [path.name for path in (tmp_path / "results").iterdir() if "cluster" in path.name] == []


def test_settings_that_are_missing_are_named(tmp_path, slurm):
    with pytest.raises(ConfigError, match=r"--slurm: .*; state jobqueue.slurm.cores, memory and walltime"):
        run_ensemble(site(tmp_path), tmp_path / "results", cluster=Cluster(slurm=1), simulate=simulate)


def test_a_machine_without_slurm_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ClusterError, match="no command sbatch on this machine; start it on a login node"):
        run_ensemble(site(tmp_path), tmp_path / "results", cluster=Cluster(slurm=1), simulate=simulate)
