"""A site and a simulation that take no time, for tests of the ensemble; picklable, since they travel to workers."""

import logging
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from runout.errors import DiskFullError, InputError, MaterialError, StorageError
from runout.io.provenance import sha256

# ensemble members sample each of these values exactly once (see test_ensemble_design)
EIGHT = SimpleNamespace(distribution="discrete", values=[float(v) for v in range(8)], frequencies=[0.125] * 8)


@dataclass(frozen=True)
class FakeSite:
    """What the ensemble asks of a site; ``faults`` maps a basal friction angle to what goes wrong there."""

    folder: Path
    members: int = 8
    seed: int = 1
    parameters: dict[str, Any] = field(default_factory=lambda: {"basal_friction_angle_deg": EIGHT})
    cell_size: float = 20.0
    title: str = "first title"
    faults: dict[float, str] = field(default_factory=dict)
    pause: float = 0.0
    name: str = "fake"
    device: str = "cpu"

    @property
    def settings(self):
        ensemble = SimpleNamespace(members=self.members, seed=self.seed, parameters=self.parameters)
        return SimpleNamespace(ensemble=ensemble, simulation=SimpleNamespace(device=self.device))

    def inputs(self):
        return [self.folder / "dem.txt"]

    @property
    def files(self):
        return SimpleNamespace(checksums=self.checksums)

    def checksums(self):
        try:
            return [sha256(path) for path in self.inputs()]
        except OSError as error:
            raise InputError(str(error)) from error

    def resolved(self):
        return {
            "name": self.name,
            "title": self.title,
            "simulation": {"cell_size": self.cell_size},
            "ensemble": {"members": self.members},
            "hazard": {"thickness_thresholds": [0.1]},
        }

    def computed(self):
        return self.resolved()

    def member_arguments(self, sample):
        angle = sample.get("basal_friction_angle_deg", 20.0)
        return {
            "basal_friction_angle": angle,
            "cell_size": self.cell_size,
            "fault": self.faults.get(angle, ""),
            "pause": self.pause,
            "calls": self.folder / "calls",
            "seed": 0,
        }


class FakeResult:
    def __init__(self, value, threads):
        self.value, self.threads, self.device = value, threads, "cpu"

    def to_netcdf(self, path, attrs=None):
        import xarray as xr

        environment = {"numba_threads": os.environ.get("NUMBA_NUM_THREADS", "unset"), "pid": os.getpid()}
        environment |= {"threads": self.threads, "device": self.device}
        xr.Dataset({"max_speed": (("y", "x"), np.full((3, 4), self.value))}, attrs={**environment, **attrs}).to_netcdf(path)


def simulate(*, basal_friction_angle, cell_size, fault, pause, calls, seed, threads):
    """A result with the friction angle as its speed, after leaving a trace of the call."""
    (calls / f"{basal_friction_angle:g}-{seed}-{time.time_ns()}-{os.getppid()}").touch()
    time.sleep(pause)
    if fault:
        FAULTS[fault]()
    return FakeResult(basal_friction_angle, threads)


def simulate_step_by_step(*, progress, pause, **arguments):
    """The same, in ten steps that tell how far it is."""
    for done in range(10):
        time.sleep(pause / 10)
        progress((done + 1) / 10)
    return simulate(pause=0.0, **arguments)


def simulate_on(*, device, pause, **arguments):
    """The same, on a device that the result names."""
    time.sleep(pause)
    result = simulate(pause=0.0, **arguments)
    result.device = device
    return result


def _warn():
    logging.getLogger("runout.simulation.single").warning("0.4 cells through a depth of %.3g m", time.time() % 100)


def _material():
    raise MaterialError("density is -3 kg m-3; it must lie above 0 kg m-3")


def _storage():
    raise StorageError("members: the disk is full")


def _full():
    raise DiskFullError("0003.nc: the disk is full")


def _bug():
    return {}["no such key"]


def _exit():
    os._exit(7)


def _kill_parent():
    os.kill(os.getppid(), signal.SIGKILL)
    os._exit(7)


def _memory():
    hoard = np.ones(200_000_000)  # 1.6 GB
    time.sleep(30)
    return hoard


def _interrupt():
    raise KeyboardInterrupt


FAULTS = {
    "material": _material,
    "warning": _warn,
    "storage": _storage,
    "full": _full,
    "bug": _bug,
    "exit": _exit,
    "kill_parent": _kill_parent,
    "memory": _memory,
    "interrupt": _interrupt,
}


def site(folder, **choices):
    """A fake site in a folder."""
    folder = Path(folder)
    (folder / "calls").mkdir(exist_ok=True)
    dem = folder / "dem.txt"
    if not dem.exists():
        dem.write_text("1 2 3")
    return FakeSite(folder, **choices)


def calls(site):
    """Friction angles of all simulations that were started, sorted."""
    return sorted(float(p.name.split("-")[0]) for p in (site.folder / "calls").iterdir())


def parents(site):
    """Numbers of the processes whose child processes have started simulations."""
    return [int(p.name.split("-")[3]) for p in (site.folder / "calls").iterdir()]


def started(folder, pause, *part):
    """:func:`main` in a process and a session of its own; ``part`` is the first and the end of a range of members."""
    site(folder)
    here = Path(__file__).parent
    return subprocess.Popen(
        [sys.executable, "-c", "import ensemble_fakes; ensemble_fakes.main()", str(folder), str(pause), *map(str, part)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(here), str(here.parent.parent)])},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def wait_until(condition, seconds=60):
    """Wait for something that another process does."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened in time"
        time.sleep(0.05)


def main():
    """Run a slow ensemble of two workers; started as a process of its own, to be killed."""
    from runout.ensemble import workers
    from runout.ensemble.run import run_ensemble

    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored when the tests themselves run in the background of a shell
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored when they run under nohup
    workers.core_count = lambda: 2
    folder, pause = Path(sys.argv[1]), float(sys.argv[2])
    part = range(*map(int, sys.argv[3:])) if sys.argv[3:] else None
    workers = 2 if part is None else 1
    run_ensemble(site(folder, pause=pause), folder / "results", workers=workers, simulate=simulate, part=part)
