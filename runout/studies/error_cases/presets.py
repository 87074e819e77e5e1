"""Errors of each preset of accuracy on real terrain: distance from a finer run plus the remaining error of that run."""

import logging
from typing import Any

import numpy as np

from runout.accuracy import PRESETS
from runout.config.fetch import DATA_FOLDER
from runout.studies.error_cases.flows import at_preset, distance, runout_of
from runout.studies.error_cases.terrains import FINE_SITE, FLOWS, SITE, data_folder
from runout.studies.grid_index import HIGHEST_ORDER, LOWEST_ORDER, SAFETY

LOGGER = logging.getLogger("runout.work_precision")
PRESET_SITES = (SITE, FINE_SITE)
HALF = 0.5  # cells of the run that errors are measured from over those of the finest preset; the two before differ as much


def left_after(coarse: float, fine: float, ratio: float) -> tuple[float, float | None]:
    """Error left on the finest of three grids, from the distances of the two coarser ones to it in turn, and the order.

    ``coarse`` between the first and the second grid, ``fine`` between the second and the third; ``ratio`` of their cells. Roache's
    safety factor 1.25 where an order between 0.5 and 3 is seen; else the error is taken as large as the last distance.
    """
    order = float(np.log(coarse / fine) / np.log(ratio)) if coarse > 0 and fine > 0 else None
    if order is None or not LOWEST_ORDER <= order <= HIGHEST_ORDER:
        return fine, None
    return SAFETY * fine / (ratio**order - 1), order


def measured_presets(coarser: float = 1.0) -> list[dict[str, Any]]:
    """Each preset on each site with its work, its time and its errors.

    Errors: distance from the finest with half its cells plus what that has left. ``coarser`` makes the cells of all larger, for a
    small study.
    """
    return [row for site in PRESET_SITES if at_hand(site) for row in presets_on(site, coarser)]


def at_hand(site: str) -> bool:
    """Whether the rasters of a site are available; logs a warning if not."""
    needed = FLOWS[site].rasters if site else ""
    if not needed or (data_folder() / needed).is_dir():
        return True
    LOGGER.warning("%s is left out: %s names no folder with its rasters", site, DATA_FOLDER)
    return False


def presets_on(site: str, coarser: float = 1.0) -> list[dict[str, Any]]:
    """:func:`measured_presets` on one site."""
    runs = {name: at_preset(name, coarser, site) for name in PRESETS}
    finest = at_preset(list(PRESETS)[-1], HALF * coarser, site)[0]
    results = [run[0] for run in runs.values()]
    ratio = results[2].spacing[2] / finest.spacing[2]
    fronts, front_there = [runout_of(result, site) for result in results], runout_of(finest, site)
    map_left, map_order = left_after(distance(results[1], results[2]), distance(results[2], finest), ratio)
    front_left, front_order = left_after(abs(fronts[1] - fronts[2]), abs(fronts[2] - front_there), ratio)
    middle = results[1].n_particles * results[1].steps
    return [
        {
            "site": site,
            "name": name,
            "cell_size": list(result.spacing),
            "particles": result.n_particles,
            "steps": result.steps,
            "particle_steps": result.n_particles * result.steps / middle,
            "seconds": seconds,
            "runout": front,
            "map_error": distance(result, finest) + map_left,
            "runout_error": (abs(front - front_there) + front_left) / front_there,
            "map_order": map_order,
            "runout_order": front_order,
        }
        for (name, (result, seconds, _)), front in zip(runs.items(), fronts, strict=True)
    ]
