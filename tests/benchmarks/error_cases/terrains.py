"""Flows on real terrain and on that of ISeeSnow that the error study runs: sites of the repository with one friction each."""

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from runout import log
from runout.config.fetch import DATA_FOLDER
from runout.materials.drucker_prager import DruckerPrager
from runout.model.release import Release
from runout.terrain.prepare import steepness
from runout.terrain.read import read_terrain
from tests.benchmarks.recorded_sites import with_vertical_edges

LOGGER = logging.getLogger("runout.work_precision")
SITES = Path(__file__).parents[3] / "sites"
SITE, FINE_SITE = "jacksboro", "frank_slide"
FLOW_TIME, BASAL_ANGLE = 60.0, 15.0  # [s], [deg]
SNOW = 200.0  # density [kg/m3] of snow; without cohesion a run does not depend on it
COULOMB_ONLY = 0.4  # friction coefficient of the case of that name


@dataclass(frozen=True)
class Flow:
    """One flow.

    Attributes
    ----------
    site : str
        Site of the repository; empty for CoulombOnly of ISeeSnow.
    angle : float
        Basal friction angle [deg].
    rasters : str
        Folder below RUNOUT_DATA that holds its rasters; empty where none are needed.
    """

    site: str
    angle: float = BASAL_ANGLE
    rasters: str = ""

    def arguments(self) -> dict[str, Any]:
        """Arguments of ``runout.simulate`` but for grid, friction and time."""
        with log.muted():
            return (
                with_vertical_edges(SITES / self.site).member_arguments()
                if self.site
                else coulomb_only(data_folder() / self.rasters)
            )


FLOWS = {
    SITE: Flow(SITE),
    FINE_SITE: Flow(FINE_SITE, rasters="frank_slide_1903"),
    "jacksboro_25": Flow(SITE, 25.0),
    "frank_slide_20": Flow(FINE_SITE, 20.0, "frank_slide_1903"),
    "coulomb_only": Flow("", float(np.degrees(np.arctan(COULOMB_ONLY))), "iseesnow/CoulombOnly"),
}


def at_hand(site: str) -> bool:
    """Whether the rasters of a site are available; logs a warning if not."""
    needed = FLOWS[site].rasters if site else ""
    if not needed or (data_folder() / needed).is_dir():
        return True
    LOGGER.warning("%s is left out: %s names no folder with its rasters", site, DATA_FOLDER)
    return False


def data_folder() -> Path:
    """Folder of public rasters that RUNOUT_DATA names; one that does not exist where it names none."""
    return Path(os.environ.get(DATA_FOLDER) or os.devnull)


@cache
def site_arguments(site: str = SITE) -> Mapping[str, Any]:
    """Arguments of ``runout.simulate`` for one of :data:`FLOWS`, up to 60 s; the run chooses the stiffness."""
    chosen = {"basal_friction_angle": FLOWS[site].angle, "end_time": FLOW_TIME, "stop": False, "threads": 1}
    return {**FLOWS[site].arguments(), **chosen}


def coulomb_only(folder: Path) -> dict[str, Any]:
    """The case CoulombOnly of the comparison ISeeSnow: 1.5 m of snow, measured across the slope, on a parabola.

    Heuser et al. 2025, EGUsphere-2025-6053; friction alone.
    """
    terrain = read_terrain(folder / "DEM_CoulombOnly.tif")
    across = read_terrain(folder / "release1HSField5m.tif").elevation
    vertical = across * np.sqrt(1.0 + steepness(terrain.elevation, terrain.cell_size) ** 2)
    release = Release.from_array(np.where(across > 0, vertical, 0.0), terrain, placement="on_surface")
    return {"terrain": terrain, "release": [release], "material": DruckerPrager(density=SNOW, friction_angle=34.0)}
