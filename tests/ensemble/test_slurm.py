"""Members on SLURM jobs that a run submits, secures and cancels; the commands of SLURM are replaced by local ones."""

import os
import re
import signal
import subprocess
import threading

import pytest
from dask_cluster import HERE, ROOT
from ensemble_fakes import calls, simulate, site, wait_until
from fake_slurm import install
from ruamel.yaml import YAML

from runout.ensemble.cluster import Cluster
from runout.ensemble.run import run_ensemble
from runout.errors import ClusterError, ConfigError

pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")


def example(language):
    """The example in this language of the guide to other machines."""
    guide = (ROOT / "docs" / "guide" / "machines.md").read_text(encoding="utf-8")
    return re.search(rf"^```{language}\n(.*?)^```", guide, re.S | re.M)[1]


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Folder of the commands of SLURM, which are on PATH."""
    folder = install(tmp_path / "slurm")
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(ROOT), os.environ.get("PYTHONPATH", "")]))
    return folder


def test_jobs_compute_the_members_over_encrypted_connections_and_are_cancelled(tmp_path, slurm):
    import dask

    place, stated = site(tmp_path), YAML(typ="safe").load(example("yaml"))["jobqueue"]["slurm"]
    with dask.config.set({f"jobqueue.slurm.{name}": value for name, value in {**stated, "cores": 1}.items()}):
        report = run_ensemble(place, tmp_path / "results", cluster=Cluster(slurm=2), simulate=simulate)
    assert (report.done, report.failed) == (tuple(range(8)), {})
    scripts = [path.read_text() for path in slurm.glob("job-*.sh")]
    assert len(scripts) == 2
    assert all(
        "#SBATCH -n 1" in script and "tls://" in script and "-t 12:00:00" in script and "--mem=60G" in script for script in scripts
    )
    assert len(list(slurm.glob("cancelled-*"))) == 2
    assert [path.name for path in (tmp_path / "results").iterdir() if "cluster" in path.name] == []


def test_a_job_that_ends_is_submitted_again(tmp_path, slurm):
    import dask

    place = site(tmp_path, pause=1.0)
    stated = {"jobqueue.slurm.cores": 1, "jobqueue.slurm.memory": "1GB", "distributed.deploy.lost-worker-timeout": "100ms"}

    def end_job():
        wait_until(lambda: calls(place))
        (number,) = (path.name.split("-")[1] for path in slurm.glob("submitted-*"))
        os.killpg(int(number), signal.SIGKILL)

    threading.Thread(target=end_job).start()
    with dask.config.set(stated):
        report = run_ensemble(place, tmp_path / "results", cluster=Cluster(slurm=1), simulate=simulate, part=range(2))
    assert (report.done, report.failed) == ((0, 1), {})
    assert len(list(slurm.glob("job-*.sh"))) == 2


def test_settings_that_are_missing_are_named(tmp_path, slurm):
    with pytest.raises(ConfigError, match=r"--slurm: .*; state jobqueue.slurm.cores, memory and walltime"):
        run_ensemble(site(tmp_path), tmp_path / "results", cluster=Cluster(slurm=1), simulate=simulate)


def test_a_machine_without_slurm_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ClusterError, match="no command sbatch on this machine; start it on a login node"):
        run_ensemble(site(tmp_path), tmp_path / "results", cluster=Cluster(slurm=1), simulate=simulate)


def test_the_job_array_of_the_guide_divides_the_members(tmp_path):
    script = 'runout() { echo "$@"; }\n' + example("bash")
    said = subprocess.run(["bash", "-c", script], env={"SLURM_ARRAY_TASK_ID": "3"}, capture_output=True, text=True, check=True)
    assert said.stdout == "ensemble SITE --members 300:400\n"
