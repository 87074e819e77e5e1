"""Moves particles of a release that start over ground without elevation to the nearest cell with elevation."""

import numpy as np

from runout.model.particles import Particles
from runout.model.scene import Scene

WITHIN = 1e-3  # distance from the edge of a raster cell, as a share of its size


def onto_known_ground(particles: Particles, scene: Scene) -> Particles:
    """The particles; those whose grid column extends beyond the domain are moved to the nearest cell of the domain.

    Grid columns and raster cells have different edges. Heights above the ground are kept.
    """
    spacing = np.array(scene.spacing)
    place = particles.position(spacing)
    out = ~scene.holds(place[:, 0], place[:, 1])
    if not out.any() or scene.surface is None:
        return particles
    from_here = place[out]
    to_there = np.column_stack([_nearest(scene, from_here[:, 0], from_here[:, 1]), from_here[:, 2]])
    surface = scene.surface
    to_there[:, 2] += surface.elevation(*to_there.T[:2]) - surface.elevation(*from_here.T[:2])
    moved = Particles.at(to_there, spacing)
    particles.node[out], particles.offset[out] = moved.node, moved.offset
    return particles


def _nearest(scene: Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Positions (n, 2) [m] in the known raster cells nearest to the cells of given positions."""
    from scipy import ndimage

    raster = scene.raster
    unknown = np.zeros((raster.columns, raster.rows), bool) if scene.unknown is None else scene.unknown
    cell = np.array(raster.cell_size)
    index = np.clip(np.floor(np.stack([x, y]) / cell[:, None]).astype(np.int64), 0, np.array(unknown.shape)[:, None] - 1)
    if unknown.any():
        known = ndimage.distance_transform_edt(unknown, sampling=cell, return_distances=False, return_indices=True)
        index = known[:, index[0], index[1]]
    low, high = (index + WITHIN) * cell[:, None], (index + 1 - WITHIN) * cell[:, None]
    return np.clip(np.stack([x, y]), low, high).T  # type: ignore[no-any-return]
