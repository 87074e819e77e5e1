"""What earlier commands of a user found out about the kernels on this machine, kept in the cache folder.

A note saves a command the import of numba and the steps that it would time. A measured time counts for a day, and for a forecast
that compiles nothing for a month. Each note is a file, named by all that its value depends on: machine, versions, sources of
backends and formulas, laws, settings. A note that cannot be read or written counts as absent.
"""

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from runout import __version__
from runout.errors import StorageError
from runout.io.atomic import read_json, write_json
from runout.io.provenance import checksum
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS
from runout.model.laws import LAWS
from runout.model.numerics import Scheme
from runout.processes.caches import compiled_code

if TYPE_CHECKING:
    from runout.model.basal_friction import BasalFriction

DAY, SHORT = 86_400.0, 600.0  # [s] that a note counts, and one from a measurement that other work disturbed
MONTH = 30  # times as long: how long notes are kept, and count where that is better than none
COMPILERS = ("numpy", "numba", "llvmlite", "warp-lang")
SOURCES = ("backends", "physics", "model")  # packages whose change changes the kernels
OF_ENGINE = ("backend", "device")
OF_SCENE = ("cell_size", "particles_per_cell")


class StepCost(NamedTuple):
    """Seconds of one core, or of a GPU: of a step, and of a particle in it."""

    step: float
    particle: float

    def seconds(self, steps: float, particle_steps: float) -> float:
        """Time [s] of a run."""
        return steps * self.step + particle_steps * self.particle


def known(name: str, of: Any, times: int = 1) -> Any:
    """Value noted under a name for ``of``, plain values that it depends on; None if there is none that still counts.

    Notes count so many ``times`` as long as is stated in them.
    """
    noted = read_json(_file(name, of))
    age, lasting = (time.time() - noted.get("time", 0.0), noted.get("lasting", 0.0)) if noted else (0.0, 0.0)
    return noted.get("value") if 0.0 <= age < times * lasting else None


def note(name: str, of: Any, value: Any, lasting: float = DAY) -> None:
    """Note a value of plain types that counts for so long [s]; nothing happens if the cache cannot be written."""
    with suppress(StorageError, OSError):
        write_json({"time": time.time(), "lasting": lasting, "value": value}, _file(name, of))
        for file in _folder().glob("*.json"):
            if file.stat().st_mtime < time.time() - MONTH * DAY:
                file.unlink(missing_ok=True)


def remembered(name: str, of: Any, make: Callable[[], Any]) -> Any:
    """The value noted for ``of`` in the last month, or else what ``make`` returns, which is noted."""
    value = known(name, of, MONTH)
    if value is None:
        value = make()
        note(name, of, value)
    return value


def _file(name: str, of: Any) -> Path:
    return _folder() / f"{name}-{checksum([_machine(), of])[:24]}.json"


def _folder() -> Path:
    return compiled_code().folder / "notes"


@cache
def _machine() -> str:
    """Checksum of machine, versions and sources."""
    package = Path(__file__).parents[1]
    files = [path for part in SOURCES for path in sorted((package / part).rglob("*.py"))]
    stamps = [(str(path), status.st_mtime_ns, status.st_size) for path in files for status in [os.stat(path)]]
    host = platform.node(), platform.machine(), platform.python_version(), os.cpu_count()
    return checksum([__version__, host, [_version(name) for name in COMPILERS], stamps])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def laws_of(arguments: Mapping[str, Any]) -> list[str]:
    """Checksums of the laws of a run with these arguments of :func:`runout.simulate`: those of the run, and of releases."""
    release = arguments.get("release", ())
    own = [r for r in (release if isinstance(release, Sequence) else [release]) if r.material or r.basal_friction]
    of_run = [LAWS.find(arguments["material"].law).fingerprint, friction_fingerprint(arguments.get("basal_friction"))]
    of_releases = {LAWS.find(r.material.law).fingerprint for r in own if r.material}
    of_releases |= {friction_fingerprint(r.basal_friction) for r in own if r.basal_friction}
    return [*of_run, *sorted(of_releases - set(of_run))]


def friction_fingerprint(basal: "BasalFriction | None") -> str:
    """Checksum of the law of a friction, by default of that of an angle alone."""
    return FRICTIONS.find(basal.law if basal else DEFAULT_FRICTION).fingerprint


def noted_step_cost(arguments: Mapping[str, Any], times: int = 1) -> StepCost | None:
    """Cost of a step as members of the same scene took, else as a small layer took; None if neither has been noted.

    ``arguments`` are those of :func:`runout.simulate`, ``times`` that of :func:`known`.
    """
    noted = known("members", _of_scene(arguments), times) or known("layer", _of_kernels(arguments), times)
    return StepCost(*noted) if noted else None


def note_layer(arguments: Mapping[str, Any], cost: StepCost, *, undisturbed: bool = True) -> None:
    """Note the cost of a step of a small layer for all scenes with these kernels."""
    note("layer", _of_kernels(arguments), list(cost), DAY if undisturbed else SHORT)


def note_member(arguments: Mapping[str, Any], seconds: float, steps: float, particle_steps: float) -> None:
    """Note the cost of a step of a member with these arguments from its processor time [s], if it is the smallest of the day.

    The ratio of its two parts is that of the layer; without a note on the layer nothing is noted.
    """
    layer, noted = known("layer", _of_kernels(arguments)), known("members", _of_scene(arguments))
    if not layer or not steps:
        return
    if noted is None or seconds < StepCost(*noted).seconds(steps, particle_steps):
        ratio = seconds / StepCost(*layer).seconds(steps, particle_steps)
        note("members", _of_scene(arguments), [ratio * part for part in layer])


def _of_kernels(arguments: Mapping[str, Any]) -> list[Any]:
    choices, zones = Scheme.of(arguments).of_kernels(), bool(arguments.get("friction_zones"))
    return [*laws_of(arguments), *map(arguments.get, OF_ENGINE), choices, zones]


def _of_scene(arguments: Mapping[str, Any]) -> list[Any]:
    terrain = arguments["terrain"]
    of = [arguments.get(name) for name in OF_SCENE]
    return [*_of_kernels(arguments), *of, str(terrain.source), terrain.shape, bool(arguments.get("structures"))]
