"""Cells without elevation: an open edge, where what comes in leaves the run and is booked as escaped mass.

Where a formula needs some number there and no physics will use it, they get a value from the known cells.
"""

import numpy as np

from runout.model.terrain import Terrain

SHOWN = 4  # places named in a message


def filled(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Elevation (rows, columns) [m] with unknown cells given the value of the nearest known one."""
    unknown = np.isnan(elevation)
    return elevation[_nearest(unknown, cell_size)] if unknown.any() else np.array(elevation)


def continued(elevation: np.ndarray, cell_size: tuple[float, float], reach: float) -> np.ndarray:
    """Elevation (rows, columns) [m] with the slope of the known cells continued into the unknown ones.

    Point reflection at the nearest known cell, as beyond the rim of the raster: planes stay planes up to ``reach`` [m] from the
    known cells, so that an open edge neither dams nor drains the flow before it. Farther out the value stays constant.
    """
    unknown = np.isnan(elevation)
    if not unknown.any():
        return elevation
    nearest = _nearest(unknown, cell_size)
    z = elevation[nearest]
    here = np.stack(np.nonzero(unknown))
    edge = np.stack([axis[unknown] for axis in nearest])
    steps = edge - here
    length = np.hypot(steps[0] * cell_size[1], steps[1] * cell_size[0])
    mirrored = edge + np.rint(steps * np.minimum(1.0, reach / length)).astype(np.int64)
    inside = [np.clip(index, 0, count - 1) for index, count in zip(mirrored, elevation.shape, strict=True)]
    beyond = 2.0 * z[tuple(edge)] - z[tuple(inside)]
    z[unknown] = beyond
    return z  # type: ignore[no-any-return]


def _nearest(unknown: np.ndarray, cell_size: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column (rows, columns) of the known cell that is nearest to each cell."""
    from scipy import ndimage

    sampling = (cell_size[1], cell_size[0])
    row, column = ndimage.distance_transform_edt(unknown, sampling=sampling, return_distances=False, return_indices=True)
    return row, column


def unknown_cells(terrain: Terrain) -> np.ndarray | None:
    """Cells without elevation (columns, rows), first index east, second north; None if every cell has one."""
    unknown = np.isnan(terrain.elevation)
    return np.ascontiguousarray(unknown[::-1].T) if unknown.any() else None


def note(terrain: Terrain) -> list[str]:
    """How many cells have no elevation, and what that means, in a sentence; none where every cell has one."""
    unknown = int(np.isnan(terrain.elevation).sum())
    share = f"{unknown} of {terrain.elevation.size} cells have no elevation"
    return [f"{terrain.source}: {share}; they are an open edge, mass that enters them is booked as escaped"] if unknown else []


def open_cells(terrain: Terrain, reach: np.ndarray) -> np.ndarray:
    """Cells without elevation (rows, columns) that border on the cells of ``reach``, corner to corner too."""
    from scipy import ndimage

    return np.isnan(terrain.elevation) & ndimage.binary_dilation(reach, np.ones((3, 3)))  # type: ignore[no-any-return]


def statement(terrain: Terrain, cells: np.ndarray) -> str:
    """Where mass may come to the ``cells`` (rows, columns) without elevation, how many these are, and what happens then."""
    from scipy import ndimage

    parts, count = ndimage.label(np.isnan(terrain.elevation), structure=np.ones((3, 3)))
    rim = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    numbers = np.bincount(parts[cells], minlength=count + 1)
    order = [int(part) for part in np.argsort(-numbers, kind="stable") if numbers[part]]
    places = [_place(terrain, cells & (parts == part), parts == part, part in rim) for part in order[:SHOWN]]
    more = f"; and {len(order) - SHOWN} more places" if len(order) > SHOWN else ""
    return (
        f"{terrain.source}: the mass may come to {int(cells.sum())} cells without elevation (energy line): "
        f"{'; '.join(places)}{more}; what enters them is booked as escaped mass, an elevation raster without these gaps avoids it"
    )


def _place(terrain: Terrain, cells: np.ndarray, part: np.ndarray, outer: bool) -> str:
    """A stretch of the outer edge, or a hole, in words."""
    rows, columns = np.nonzero(cells)
    if not outer:
        middle_row, middle_column = (round(float(index.mean())) for index in np.nonzero(part))
        at = f"easting {terrain.easting[middle_column]:.1f}, northing {terrain.northing[middle_row]:.1f}"
        return f"a hole of {int(part.sum())} cells around row {middle_row}, column {middle_column} ({at})"
    east, north = terrain.easting[columns], terrain.northing[rows]
    within = f"easting {east.min():.1f} to {east.max():.1f}, northing {north.min():.1f} to {north.max():.1f}"
    return f"{len(rows)} cells along the edge of the known ground ({within})"
