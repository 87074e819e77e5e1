"""Connects to a dask cluster: one that runs already, or one whose workers are jobs of SLURM.

Client, scheduler and workers of dask execute what they receive. Connections are therefore encrypted, and both ends show a
certificate; any other connection is refused unless it is asked for.
"""

import logging
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.errors import ClusterError, ConfigError
from runout.processes.interrupt import at_end
from runout.processes.without_dask import show_dask

if TYPE_CHECKING:
    from distributed import Client

LOGGER = logging.getLogger(__name__)
CONNECT_SECONDS = 30.0  # [s]
INSTALL = "install it: pip install 'runout[{}]'"


@dataclass(frozen=True)
class Cluster:
    """Where members are computed. Without an address and without jobs that is this machine."""

    scheduler: str | None = None
    """Scheduler of a dask cluster that runs already, such as tls://host:8786."""
    tls_ca: Path | None = None
    """Certificate of the authority of that cluster [default: dask's configuration]."""
    tls_cert: Path | None = None
    """Certificate of this client."""
    tls_key: Path | None = None
    """Key of this client."""
    allow_unencrypted: bool = False
    """Accept tcp://: everyone who reaches the scheduler can then run programs as you."""
    slurm: int | None = None
    """Number of SLURM jobs to start as workers; dask's configuration states cores, memory and walltime."""

    def __post_init__(self) -> None:
        certificates = {"--tls-ca": self.tls_ca, "--tls-cert": self.tls_cert, "--tls-key": self.tls_key}
        stated = {name: path for name, path in certificates.items() if path is not None}
        missing = [name for name in certificates if name not in stated]
        if self.scheduler is not None and self.slurm is not None:
            raise ConfigError("--scheduler and --slurm are two clusters; state one of them")
        if self.slurm is not None and self.slurm < 1:
            raise ConfigError(f"--slurm is {self.slurm}; at least 1 job is needed")
        if self.scheduler is None and (stated or self.allow_unencrypted):
            raise ConfigError(f"{next(iter(stated), '--allow-unencrypted')} needs --scheduler, such as tls://host:8786")
        if stated and missing:
            raise ConfigError(f"{' and '.join(stated)} without {' and '.join(missing)}; state all three")
        if stated and str(self.scheduler).startswith("tcp://"):
            raise ConfigError(f"--scheduler {self.scheduler}: certificates are for tls:// only; state the address with tls://")
        for name, path in stated.items():
            if not path.is_file():
                raise ConfigError(f"{name}: there is no file {path}")
        if self.scheduler is not None:
            self._require_safe(self.scheduler)

    def _require_safe(self, address: str) -> None:
        scheme, _, place = address.rpartition("://")
        if scheme not in ("tls", "tcp") or not place.rpartition(":")[2].isdigit():
            raise ConfigError(f"--scheduler {address}: this is no address of a scheduler; state tls://host:port")
        if scheme == "tcp" and not self.allow_unencrypted:
            raise ConfigError(
                f"--scheduler {address}: everyone who reaches this scheduler can run programs as you; start the cluster with "
                "certificates and state tls://, or accept it with --allow-unencrypted"
            )

    def __bool__(self) -> bool:
        return self.scheduler is not None or self.slurm is not None

    @contextmanager
    def connect(self, folder: Path) -> "Iterator[tuple[Client, Callable[[], object]]]":
        """Context with a client of the cluster, and a function that replaces lost workers.

        Parameters
        ----------
        folder : Path
            Folder that the workers share, for certificates of SLURM jobs.

        Raises
        ------
        ClusterError
            If a library is not installed, or no scheduler answers.
        """
        show_dask()
        _require_library("distributed", "cluster")
        import distributed  # noqa: F401 - it sets up its loggers

        _calm_dask()
        if self.slurm is None:
            with _client(str(self.scheduler), self._security()) as client:
                yield client, lambda: None
            return
        with _slurm_jobs(self.slurm, folder) as jobs, _client(jobs.scheduler_address, jobs.security) as client:
            yield client, lambda: jobs.scale(jobs=self.slurm)

    def _security(self) -> Any:
        """Certificates, stated or of dask's configuration; None for a connection without."""
        from distributed import Security

        if str(self.scheduler).startswith("tcp://"):
            return None
        stated = {"tls_ca_file": self.tls_ca, "tls_client_cert": self.tls_cert, "tls_client_key": self.tls_key}
        security = Security(require_encryption=True, **{name: str(path) for name, path in stated.items() if path})
        if any(getattr(security, name) is None for name in stated):
            raise ConfigError(
                f"--scheduler {self.scheduler}: no certificates; state --tls-ca, --tls-cert and --tls-key, or set "
                "distributed.comm.tls in dask's configuration"
            )
        return security


class _ToLogFile(logging.Handler):
    """Passes the messages of dask to the logger of warnings: they go to the log file, and to the terminal with -v."""

    def emit(self, record: logging.LogRecord) -> None:
        """Pass on one message."""
        logging.getLogger("py.warnings").handle(record)


def _calm_dask() -> None:
    """Keep the messages of dask off the terminal; errors that end a run are raised as well."""
    for name in ("distributed", "distributed.client", "tornado", "tornado.application"):
        logging.getLogger(name).handlers[:] = [_ToLogFile()]


def _require_library(name: str, extra: str) -> None:
    from importlib.util import find_spec

    if find_spec(name) is None:
        raise ClusterError(f"{name} is not installed; {INSTALL.format(extra)}")


@contextmanager
def _client(address: str, security: Any) -> "Iterator[Client]":
    from distributed import Client

    try:
        client = Client(address, security=security, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as cause:  # ValueError: the address cannot be read
        raise ClusterError(f"{address}: no scheduler answers there, or it does not accept the certificates ({cause})") from cause
    with client:
        yield client


@contextmanager
def _slurm_jobs(number: int, folder: Path) -> Iterator[Any]:
    """Context of SLURM jobs that are workers of a scheduler in this process; they are cancelled at the end."""
    _require_library("dask_jobqueue", "slurm")
    from dask_jobqueue import SLURMCluster

    if shutil.which("sbatch") is None:
        raise ClusterError("--slurm: there is no command sbatch on this machine; start it on a login node of the cluster")
    try:  # no page that shows the state to everyone
        jobs = SLURMCluster(security=_new_certificates(folder), scheduler_options={"dashboard": False})
    except ValueError as cause:
        reason = str(cause).splitlines()[0].rstrip(":")
        raise ConfigError(f"--slurm: {reason}; state jobqueue.slurm.cores, memory and walltime in dask's configuration") from cause
    with jobs, at_end(lambda: _cancel(jobs)):
        jobs.scale(jobs=number)
        LOGGER.info("%d SLURM jobs are submitted", number)
        yield jobs


def _new_certificates(folder: Path) -> Any:
    """Certificates for one run, in files that only this user can read."""
    from distributed import Security

    made, files = Security.temporary(), {}
    for name in ("tls_ca_file", "tls_client_cert", "tls_client_key"):
        files[name] = str(folder / name)
        with open(os.open(files[name], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(getattr(made, name))
    roles = {name.replace("client", role): path for name, path in files.items() for role in ("client", "scheduler", "worker")}
    return Security(require_encryption=True, **roles)


def _cancel(jobs: Any) -> None:
    """Cancel jobs in a process that ends at once."""
    ids = [str(job.job_id) for job in jobs.workers.values() if getattr(job, "job_id", None)]
    if ids:
        subprocess.run(["scancel", *ids], check=False)
