"""Starts to compile the kernels of a site's members before anything is read."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runout.backends.protocol import Compilation
    from runout.config.site import Site

SEVERAL = 2  # materials of a run with several releases


def compile_ahead(site: "Site") -> "Compilation | None":
    """Compilation for the members of a site that run on the CPU; None for other backends, and if the kernels are known to be there.

    How many releases the polygons make is not known yet. If the guess is wrong, one kernel is compiled later.
    """
    stated = site.settings.simulation
    if stated.backend != "scan" or stated.device != "cpu":
        return None
    from runout import engine_notes
    from runout.backends.protocol import start_compilation
    from runout.model.scene import STANDARD_GRAVITY

    material = site.material().chosen(1.0, 1.0, STANDARD_GRAVITY)
    count = SEVERAL if len(site.settings.release) > 1 else 1
    choices: dict[str, Any] = {"transfer": stated.transfer, "f_bar": stated.f_bar, "sleep_speed": stated.sleep_speed}
    zones = bool(site.settings.terrain.friction_zones or site.settings.terrain.friction_rasters)
    built, friction = site.structures.possible, site.friction.law.example
    laws = engine_notes.laws_of({"material": material, "basal_friction": friction})
    of = [*laws, count, stated.precision, zones, built, choices]
    mark = engine_notes.known("kernels", of)
    if mark and Path(mark).exists():
        return None

    def marked(file: Path) -> None:
        engine_notes.note("kernels", of, str(file))

    more: dict[str, Any] = {"zones": zones, "choices": choices, "structures": built, "marked": marked}
    return start_compilation((material,) * count, friction, stated.precision, **more)
