"""Starts to compile the kernels of a site's members before anything is read."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runout.backends.protocol import Compilation
    from runout.config.site import Site
    from runout.model.basal_friction import BasalFriction
    from runout.model.materials import Material

SEVERAL = 2  # materials of a run with several releases


@dataclass(frozen=True)
class _Kernels:
    """What the kernels of a site's members on the CPU depend on.

    How many releases the polygons make is not known before they are read. If the guess is wrong, one kernel is compiled later.
    """

    materials: "tuple[Material, ...]"
    frictions: "tuple[BasalFriction, ...]"
    zones: bool
    structures: bool
    wet: bool
    choices: dict[str, Any]  # of the scheme

    @classmethod
    def of(cls, site: "Site") -> "_Kernels | None":
        """Those of a site; None for other backends."""
        stated, terrain = site.settings.simulation, site.settings.terrain
        if stated.backend != "scan" or stated.device != "cpu":
            return None
        from runout.config.release_laws import laws_of, several_laws
        from runout.config.site_files import may_hold_bodies
        from runout.model.numerics import Scheme
        from runout.model.scene import STANDARD_GRAVITY

        masses: list[Any] = [*site.settings.release, *(site.settings.inflow or [])]
        laws = list(laws_of(site.settings).values())[: None if several_laws(site.settings) else SEVERAL]
        materials = [law.example.chosen(1.0, 1.0, STANDARD_GRAVITY) for law, _ in laws]
        return cls(
            tuple(materials),
            tuple(friction.example for _, friction in laws),
            bool(terrain.friction_zones or terrain.friction_rasters),
            may_hold_bodies(site.settings),
            any(mass.pore_pressure for mass in masses),
            Scheme.of(stated.model_dump()).of_kernels(),
        )

    @property
    def key(self) -> list[Any]:
        """Plain values for :mod:`runout.forecast.engine_notes`."""
        from runout.forecast import engine_notes

        laws = [
            engine_notes.laws_of({"material": m, "basal_friction": f}) for m, f in zip(self.materials, self.frictions, strict=True)
        ]
        distinct = sorted(set(map(tuple, laws)))
        return [distinct, len(self.materials) > 1, self.zones, self.structures, self.wet, self.choices]

    def noted(self, times: int = 1) -> bool:
        """Whether they are known to be compiled; ``times`` is that of :func:`runout.forecast.engine_notes.known`."""
        from runout.forecast import engine_notes

        mark = engine_notes.known("kernels", self.key, times)
        return bool(mark) and Path(mark).exists()

    def note(self, mark: Path) -> None:
        """Note the file that marks them as compiled."""
        from runout.forecast import engine_notes

        engine_notes.note("kernels", self.key, str(mark))


def compile_ahead(site: "Site") -> "Compilation | None":
    """Compilation for the members of a site on the CPU; None for other backends, and if the kernels are known to be there."""
    from runout.backends.protocol import start_compilation

    kernels = _Kernels.of(site)
    if kernels is None or kernels.noted():
        return None
    return start_compilation(
        kernels.materials, kernels.frictions, kernels.choices, zones=kernels.zones, structures=kernels.structures, wet=kernels.wet,
        marked=kernels.note,
    )  # fmt: skip


def kernels_noted(site: "Site") -> bool:
    """Whether a command of the last month has compiled the kernels of the members of a site."""
    from runout.forecast.engine_notes import MONTH

    kernels = _Kernels.of(site)
    return kernels is not None and kernels.noted(MONTH)
