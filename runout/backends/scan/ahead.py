"""Compiles the kernels of a run in other processes while this one reads and checks its inputs."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from runout.backends.compile import cache_root
from runout.backends.scan.kernels import sources_of
from runout.backends.scan.precompile import ensure_compiled
from runout.backends.scan.warm_up import WET, side_wall, small_slope
from runout.model.basal_friction import BasalFriction
from runout.model.materials import Material
from runout.model.scene import Scene

LOOK_SECONDS = 1.0  # between two looks at what is compiled; each goes through the folder of the cache
KERNELS = 34  # that a run calls without several substeps


class CompilingAhead:
    """Compilation that goes on beside this process. Without it, or where it fails, the kernels are compiled when a run loads them.

    Parameters
    ----------
    materials : tuple of Material
        One for each release; their laws count, not their numbers.
    frictions : tuple of BasalFriction
        Likewise.
    choices : dict
        Those of :meth:`runout.model.numerics.Scheme.of_kernels`.
    zones : bool
        Whether the run has friction zones.
    structures, wet : bool
        Whether the run has structures, and pore pressure.
    marked : callable, optional
        Called with the file that marks the kernels as compiled, when it is there.
    """

    def __init__(
        self, materials: tuple[Material, ...], frictions: tuple[BasalFriction, ...], choices: dict[str, Any], *, zones: bool,
        structures: bool = False, wet: bool = False, marked: Callable[[Path], None] | None = None,
    ):  # fmt: skip
        slope = small_slope(materials, frictions, choices["precision"])[0]
        more: dict[str, Any] = {
            "friction_zones": slope.friction_zones if zones else None,
            "structures": side_wall() if structures else None,
        }
        more["pore_pressure"] = (WET,) * len(materials) if wet else ()
        scene = replace(slope, **more, **choices)
        self.before = _stored()
        self.thread = threading.Thread(target=_compile, args=(scene, sources_of(scene), marked), daemon=True)
        self.thread.start()

    @property
    def is_running(self) -> bool:
        """Whether something is left to compile."""
        return self.thread.is_alive()

    def wait(self, progress: Callable[[float], None]) -> None:
        """Wait for the end; ``progress`` is called with the finished fraction, 0 to 1."""
        while self.thread.is_alive():
            progress(min((_stored() - self.before) / KERNELS, 0.99))
            self.thread.join(LOOK_SECONDS)
        progress(1.0)


def _compile(scene: Scene, sources: tuple[ModuleType, ...], marked: Callable[[Path], None] | None) -> None:
    mark = ensure_compiled(scene, sources)
    if mark and marked:
        marked(mark)


def _stored() -> int:
    """Number of kernels in the cache, of all laws and versions."""
    return sum(1 for _ in cache_root().rglob("*.nbc"))
