"""Triangles and values of the surfaces of a scene, as plain arrays."""

from dataclasses import dataclass

import numpy as np

from runout.quantities import QUANTITIES
from runout.view.scene import FlowScene

COLOURED = {"thickness": QUANTITIES["thickness"], "speed": QUANTITIES["speed"]}  # what the flow may be coloured by
PLAIN_UNITS = {"m": "m", "m s-1": "m/s"}  # the font of VTK has no superscript minus
TOP_PERCENTILE = 97.0


@dataclass(frozen=True)
class Scale:
    """Colours of a quantity: label with unit, name of the colour map, value of the last colour, number of labels."""

    label: str
    colours: str
    top: float
    labels: int


def scale_of(scene: FlowScene, colour: str, top: float = 0.0) -> Scale:
    """One scale for all frames; its top is a round number above nearly all values, or ``top``. The label has larger values."""
    from matplotlib.ticker import MaxNLocator

    quantity = COLOURED[colour]
    covered = np.nan_to_num(scene.thickness) >= scene.least_thickness
    values = np.nan_to_num(getattr(scene, colour))[covered]
    largest = float(values.max(initial=0.0))
    if not top:
        top = float(np.percentile(values, TOP_PERCENTILE)) if values.size else 0.0
    ticks = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, top if top > 0 else 1.0)
    label = f"{quantity.symbol} [{PLAIN_UNITS[quantity.units]}]"
    beyond = f"\nlargest {largest:.3g}" if largest > ticks[-1] else ""
    return Scale(label + beyond, quantity.colours, float(ticks[-1]), len(ticks))


def quads(cells: np.ndarray) -> np.ndarray:
    """Corners (n, 4) of the faces between four cell centres, for the faces (rows - 1, columns - 1) that are chosen."""
    rows, columns = cells.shape[0] + 1, cells.shape[1] + 1
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = (number[1:, :-1], number[1:, 1:], number[:-1, 1:], number[:-1, :-1])
    return np.stack([corner[cells] for corner in corners], axis=-1)


def known_faces(scene: FlowScene) -> np.ndarray:
    """Faces whose four corners have an elevation, (rows - 1, columns - 1) of bool."""
    return np.asarray(_corners(np.isfinite(scene.ground)).all(axis=0))


def flow_faces(scene: FlowScene, frame: int) -> np.ndarray:
    """Known faces of which at least one corner is covered by the flow."""
    return known_faces(scene) & np.asarray(_corners(covered(scene, frame)).any(axis=0))


def covered(scene: FlowScene, frame: int) -> np.ndarray:
    """Cells with a flow of at least the least thickness that is drawn."""
    mask: np.ndarray = np.nan_to_num(scene.thickness[frame]) >= scene.least_thickness
    return mask


def flow_points(scene: FlowScene, frame: int) -> np.ndarray:
    """Local positions (rows, columns, 3) [m] of the free surface; what it lies on where there is no flow."""
    points = scene.points()
    points[..., 2] += np.where(covered(scene, frame), np.nan_to_num(scene.thickness[frame]), 0.0)
    if scene.lift is not None:
        points[..., 2] += scene.lift[frame]
    return points


def flow_values(scene: FlowScene, frame: int, colour: str) -> np.ndarray:
    """Values (rows, columns) of a quantity; cells around the flow have the largest value beside them, against seams at its rim."""
    wet = covered(scene, frame)
    values = np.where(wet, np.nan_to_num(getattr(scene, colour)[frame]), 0.0)
    around = np.pad(values, 1)
    rows, columns = values.shape
    beside = [around[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.where(wet, values, np.max(beside, axis=0))


def particle_values(scene: FlowScene, frame: int, colour: str) -> tuple[np.ndarray, np.ndarray]:
    """Local positions (n, 3) [m] of the particles of a frame, and their speed [m/s] or the thickness [m] of the flow there."""
    assert scene.particles is not None
    present = scene.particles[frame][np.isfinite(scene.particles[frame]).all(axis=1)]
    points = scene.local(present[:, :3])
    if colour == "speed":
        return points, present[:, 3]
    dx, dy = scene.cell_size
    rows, columns = scene.ground.shape
    column = np.clip(np.rint(points[:, 0] / dx).astype(int), 0, columns - 1)
    row = np.clip(rows - 1 - np.rint(points[:, 1] / dy).astype(int), 0, rows - 1)
    return points, np.nan_to_num(scene.thickness[frame])[row, column]


def _corners(cells: np.ndarray) -> np.ndarray:
    """Values at the four corners of the faces, (4, rows - 1, columns - 1)."""
    return np.stack([cells[1:, :-1], cells[1:, 1:], cells[:-1, 1:], cells[:-1, :-1]])
