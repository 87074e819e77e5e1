"""Where a mesh lies on the terrain: its units, offset and coordinate system, and what else they may be if it lies beyond."""

from collections.abc import Iterator

import numpy as np

from runout.errors import ReleaseError, StructureError
from runout.io import crs as coordinate_systems
from runout.io.layer_crs import to_terrain
from runout.io.mesh_files import DECIMALS
from runout.model.terrain import Terrain
from runout.structures.source import StructureSource

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
SINGLE = 2.0**-24  # relative rounding of coordinates in float32
COARSE = 0.05  # rounding of coordinates [m] that is reported
EARTH = 4.1e7  # circumference [m], beyond which no map has coordinates
LOCAL = 1e5  # coordinates [m] that may count from an origin of the mesh's own


def rounding_of(source: StructureSource, vertices: np.ndarray) -> float:
    """Rounding [m] of vertices (v, 3) in the units of a file that holds them in single precision; 0 for another file."""
    with np.errstate(over="ignore"):
        apart = np.abs(vertices - vertices.astype(np.float32))
    single = source.path.suffix.lower() != ".obj" and bool((apart <= 0.1**DECIMALS).all())
    whole = source.path.suffix.lower() == ".ply" and bool((vertices == np.round(vertices)).all())  # maybe in double precision
    return SINGLE * float(np.abs(vertices).max()) * UNITS[source.units or "m"] if single and not whole else 0.0


def on_terrain(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> tuple[np.ndarray, list[str]]:
    """Local positions [m] of the vertices of a file, and what was assumed.

    Raises
    ------
    StructureError
        If no units are stated, or all vertices lie beyond the terrain.
    InputError
        If the coordinate system is not understood.
    """
    path = source.path
    if source.units not in UNITS:
        raise StructureError(f"{path}: units is {source.units!r}; state the units of the mesh: {', '.join(UNITS)}")
    metres, said = vertices * UNITS[source.units], []
    rounding = rounding_of(source, vertices)
    if rounding > COARSE:
        said.append(
            f"{path}: its coordinates of up to {np.abs(metres).max():.3g} m are rounded to {rounding:.2g} m by single precision; "
            "export it near the origin and state offset"
        )
    if source.crs is not None:
        coordinate_systems.parse(source.crs, str(path))  # named as an option here, not as that of the file
    placed, sentences = _moved(metres + np.asarray(source.offset), source, source.crs or terrain.crs, terrain)
    if not _meets(placed, terrain):
        raise StructureError(f"{path}: {_beyond(placed, terrain)}; {_remedy(vertices, source, terrain)}")
    lost = np.abs(placed).max(1) > EARTH
    if lost.any():
        x, y, z = placed[lost.argmax()]
        remedy = "remove what is there, or check units and offset of the mesh"
        where = f"the first at easting {x:.8g}, northing {y:.8g}, elevation {z:.8g}"
        raise StructureError(f"{path}: {lost.sum()} of {len(placed)} vertices lie beyond the Earth, {where}; {remedy}")
    said += [] if source.crs else [f"{path}: states no crs; its coordinates are taken as the terrain's"]
    return terrain.frame.to_local(placed), [*said, *(sentences if source.crs else ())]


def _moved(points: np.ndarray, source: StructureSource, crs: str | None, terrain: Terrain) -> tuple[np.ndarray, tuple[str, ...]]:
    """Map positions (v, 3) of points of a coordinate system, and what was assumed."""
    bounds = [*points.min(0)[:2], *points.max(0)[:2]]
    found = to_terrain(source.path, crs, terrain, bounds, "trimesh")
    if found.forward is None:
        return points, found.sentences
    return np.column_stack([found.forward(points[:, :2]), points[:, 2]]), found.sentences


def _meets(placed: np.ndarray, terrain: Terrain) -> bool:
    """Whether the box around map positions meets the terrain."""
    west, south, east, north = terrain.extent
    (x0, y0), (x1, y1) = placed[:, :2].min(0), placed[:, :2].max(0)
    return bool(x0 <= east and x1 >= west and y0 <= north and y1 >= south)


def _beyond(placed: np.ndarray, terrain: Terrain) -> str:
    low, high = placed.min(0), placed.max(0)
    west, south, east, north = terrain.extent
    return (
        f"lies beyond the terrain {terrain.source}, at easting {low[0]:.8g} to {high[0]:.8g}, northing {low[1]:.8g} to "
        f"{high[1]:.8g}; the terrain has easting {west:.8g} to {east:.8g}, northing {south:.8g} to {north:.8g}"
    )


def _remedy(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> str:
    """What would place the mesh on the terrain."""
    for remedy, placed in _elsewhere(vertices, source, terrain):
        if np.isfinite(placed).all() and _meets(placed, terrain):
            return remedy
    assert source.units is not None  # else it was refused
    if np.abs(vertices).max() * UNITS[source.units] < LOCAL and not any(source.offset):
        return "its coordinates count from an origin of its own: state offset, [easting, northing, elevation] of that origin"
    return "check units, offset and crs of the mesh"


def _elsewhere(vertices: np.ndarray, source: StructureSource, terrain: Terrain) -> Iterator[tuple[str, np.ndarray]]:
    """Common mistakes: the remedy, and the map positions with it."""
    offset, stated = np.asarray(source.offset), UNITS[source.units or "m"]
    if any(source.offset):
        yield "it lies there without offset: remove offset", stated * vertices
    for units, factor in UNITS.items():
        yield f"its coordinates fit with units: {units}", factor * vertices + offset
    yield "its coordinates fit in kilometres: export it in metres", 1000.0 * vertices + offset
    metres = stated * vertices
    yield "easting and northing are swapped: export it with x to the east", metres[:, [1, 0, 2]] + offset
    glb = source.path.suffix.lower() == ".glb"
    for sign in (-1.0, 1.0):
        up = "z is up in it: export it with y up, as GLB files have it" if glb else "y is up in it: export it with z up"
        yield up, np.column_stack([metres[:, 0], sign * metres[:, 2], metres[:, 1]]) + offset
    if terrain.crs is not None and np.abs(vertices[:, 0]).max() <= 180.0 and np.abs(vertices[:, 1]).max() <= 90.0:
        try:
            yield "its coordinates are degrees: state crs, for example EPSG:4326", _moved(vertices, source, "EPSG:4326", terrain)[0]
        except ReleaseError:
            return
