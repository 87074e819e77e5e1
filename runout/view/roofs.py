"""Flow on structures: maps of thickness do not say whether it runs over a roof or below it, particles do."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runout.view.scene import FlowScene

Span = tuple[np.ndarray, np.ndarray, bool]  # lowest and highest elevation (rows, columns) of a structure [m]; whether it hangs


def on_structures(scene: FlowScene, spans: Sequence[Span]) -> FlowScene:
    """The scene with the flow on the tops of structures where its particles lie there.

    Parameters
    ----------
    spans : sequence of Span
        Of the structures at the cells of the scene: NaN where they are not.
    """
    if not spans or scene.particles is None:
        return scene
    lift = np.zeros(scene.thickness.shape, np.float32)
    mean = [_mean_elevation(scene, frame) for frame in range(len(scene.times))]
    for low, high, hangs in spans:
        carried = 0.5 * (low + high) if hangs else high
        for frame, elevation in enumerate(mean):
            above = np.nan_to_num(elevation, nan=-np.inf) > np.nan_to_num(carried, nan=np.inf)
            if above.any():
                roof = _beside(above) & np.isfinite(high)
                lift[frame][roof] = np.maximum(lift[frame][roof], (high - scene.ground)[roof])
    return replace(scene, lift=lift)


def _mean_elevation(scene: FlowScene, frame: int) -> np.ndarray:
    """Mean elevation (rows, columns) [m] of the particles of a frame; NaN where there is none."""
    assert scene.particles is not None
    present = scene.particles[frame][np.isfinite(scene.particles[frame]).all(axis=1)]
    (rows, columns), (dx, dy) = scene.ground.shape, scene.cell_size
    points = scene.local(present[:, :3])
    column, row = np.rint(points[:, 0] / dx).astype(int), rows - 1 - np.rint(points[:, 1] / dy).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = row[inside] * columns + column[inside]
    count = np.bincount(cell, minlength=rows * columns)
    total = np.bincount(cell, points[inside, 2], rows * columns)
    return np.divide(total, count, out=np.full(rows * columns, np.nan), where=count > 0).reshape(rows, columns)


def _beside(mask: np.ndarray) -> np.ndarray:
    """The cells of a mask and those around them."""
    around = np.pad(mask, 1)
    rows, columns = mask.shape
    return np.any([around[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)  # type: ignore[no-any-return]
