"""Overhangs of a terrain as bodies: columns of cells between underside and top."""

import math
from os import PathLike

import numpy as np

from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.structures.facades import mesh_facades
from runout.structures.solid import Solid
from runout.terrain.mesh import Overhangs, overhangs_on


def read_overhangs(path: str | PathLike[str], terrain: Terrain, friction_angle_deg: float | None = None) -> list[Solid]:
    """Bodies of what overhangs a terrain in the mesh that it was made of.

    ``friction_angle_deg`` is that of the rock; by default it is that of the ground under the mass. Raises DemError if the file
    cannot be used, or the terrain was not made of a mesh.
    """
    friction = math.nan
    if friction_angle_deg is not None:
        friction = math.tan(math.radians(checked("basal_friction_angle", friction_angle_deg, place=str(path))))
    return overhang_bodies(overhangs_on(path, terrain), terrain, friction)


def overhang_bodies(overhangs: Overhangs, terrain: Terrain, friction: float) -> list[Solid]:
    """A body for each group of cells that touch; its corners have the mean elevation of its cells there.

    ``friction`` is the Coulomb coefficient of the rock [1]; NaN: that of the ground under the mass.
    """
    from scipy.ndimage import label

    bodies = []
    layer = _layers(overhangs, terrain.shape)
    for number in np.unique(layer):
        chosen = np.flatnonzero(layer == number)
        cells = np.zeros(terrain.shape, bool)
        cells[overhangs.row[chosen], overhangs.column[chosen]] = True
        group, count = label(cells)
        own = group[overhangs.row[chosen], overhangs.column[chosen]]
        bodies += [_body(overhangs, chosen[own == k], terrain, friction) for k in range(1, count + 1)]
    return bodies


def _layers(overhangs: Overhangs, shape: tuple[int, int]) -> np.ndarray:
    """Number of the overhangs below each one in its cell (n,)."""
    cell = overhangs.row * shape[1] + overhangs.column
    order = np.lexsort([overhangs.bottom, cell])
    first = np.concatenate([[True], np.diff(cell[order]) != 0]) if len(cell) else np.zeros(0, bool)
    place = np.arange(len(cell))
    layer = np.empty(len(cell), int)
    layer[order] = place - np.maximum.accumulate(np.where(first, place, 0))
    return layer


def _body(overhangs: Overhangs, chosen: np.ndarray, terrain: Terrain, friction: float) -> Solid:
    """The body of some cells that touch."""
    rows = terrain.shape[0]
    row, column = rows - 1 - overhangs.row[chosen], overhangs.column[chosen]  # from the south
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])  # counterclockwise: east, north
    node = (column[:, None] + corner[:, 0]) * (rows + 1) + row[:, None] + corner[:, 1]
    used, at = np.unique(node, return_inverse=True)
    at, n = at.reshape(-1, 4), len(used)
    share = np.bincount(at.ravel(), minlength=n)
    bottom, top = (
        np.bincount(at.ravel(), np.repeat(z[chosen], 4), n) / share for z in (overhangs.bottom, overhangs.top)
    )  # fmt: skip
    plan = np.column_stack([used // (rows + 1) * terrain.cell_size[0], used % (rows + 1) * terrain.cell_size[1]])
    vertices = np.concatenate([np.column_stack([plan, bottom]), np.column_stack([plan, top])])
    upper = np.concatenate([at[:, [0, 1, 2]], at[:, [0, 2, 3]]])
    sides = np.concatenate([at[:, [k, (k + 1) % 4]] for k in range(4)])
    seen = {tuple(pair) for pair in sides.tolist()}
    rim = np.array([pair for pair in sides.tolist() if (pair[1], pair[0]) not in seen])
    a, b = rim.T
    faces = np.concatenate([upper + n, upper[:, ::-1], np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])])
    facade, facades = mesh_facades(vertices, faces)
    place = f"{terrain.source}: overhang of {len(chosen)} cells"
    return Solid("overhang", vertices, faces, facade, facades, friction, place, clearance=0.0)
