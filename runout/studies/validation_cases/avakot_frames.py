"""Mass of avaKot over the ground: in flight, and how loose it is where it is thick."""

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from runout.model.terrain import Terrain
from runout.scores import Grid, slope_normal_thickness, values_at
from runout.simulation.result import Result

LIFTED = 5.0  # height over the ground [m] from which mass counts as in flight


def lifted(result: Result, slope: np.ndarray) -> float:
    """Largest share of the particles more than :data:`LIFTED` over the ground, normal to it, over all snapshots."""
    frames = (heights(result.terrain, slope, frame)[1] for frame in result.particle_frames)
    return max(float((height > LIFTED).mean()) for height in frames)


def looseness(result: Result, slope: np.ndarray, thick: float) -> list[float]:
    """Mean height of the mass over half its thickness [1], where it is more than ``thick`` [m], for each snapshot that has such."""
    found = []
    maps = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values)
    for vertical, frame in zip(maps, result.particle_frames, strict=True):
        place, height = heights(result.terrain, slope, frame)
        thickness = values_at(Grid.of(result.terrain), slope_normal_thickness(vertical, np.nan_to_num(slope)), *place)
        there = thickness > thick
        if there.any():
            found.append(float(2 * height[there].mean() / thickness[there].mean()))
    return found


def heights(terrain: Terrain, slope: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place in plan (2, n) and height over the ground (n,) [m], normal to it, of the particles (m, 4) that have not left."""
    x, y, z = terrain.frame.to_map(np.asarray(frame[np.isfinite(frame[:, 0]), :3], np.float64)).T
    ground = np.stack([terrain.elevation, np.cos(np.nan_to_num(slope))], axis=-1)[::-1]
    elevation, cosine = RegularGridInterpolator((terrain.northing[::-1], terrain.easting), ground)((y, x)).T
    return np.array([x, y]), (z - elevation) * cosine
