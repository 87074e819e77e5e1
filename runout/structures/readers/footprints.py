"""Bodies from footprints: polygons of a vector file, extruded from below the ground to their height."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.polygons import PolygonLayer, is_missing, read_frame, read_polygons
from runout.model.limits import checked
from runout.model.terrain import Terrain
from runout.structures.facades import numbered, walls_of
from runout.structures.ground import GroundUnder, elevation_at, ground_under
from runout.structures.readers import StructureReader
from runout.structures.solid import Solid
from runout.structures.source import Read, StructureSource, Top

BELOW = 2.0  # how far a body reaches below the lowest ground under it, in cells of the raster,
DEEP = 0.5  # and at least so much of its height
REPEATED = 1e-3  # distance of points of an outline that are one [m]
FRICTION = "friction_deg"


@dataclass(frozen=True)
class _Feature:
    """What a feature states: name, height, base, clearance [m], Coulomb coefficient, and its place for messages."""

    name: str
    height: float
    base: float | None
    clearance: float | None
    friction: float
    place: str


def read_footprints(source: StructureSource, terrain: Terrain) -> Read:
    """Bodies of the polygons of a vector file, problems, and changes."""
    problems: list[str] = []
    try:
        layer = read_polygons(source.path, terrain, source.layer, "structure", faults=problems)
    except InputError as error:
        return Read((), (str(error),), ())
    lacks = _missing_attributes(source, layer)
    if lacks:
        return Read((), (*problems, *lacks), layer.changes)
    solids = []
    for row, number in enumerate(layer.attributes.index + 1):
        place = f"{source.path}: feature {number}"
        faults: list[str] = []
        feature = _feature(source, layer, row, place, faults)
        if feature is not None and not faults:
            faults += _impossible(feature)
        if feature is not None and not faults:
            shape = _local(layer.polygons[row], terrain)
            ground = ground_under(shape, terrain)
            faults += _off_the_ground(ground, layer.polygons[row], terrain, place)
            if not faults:
                solids.append(_extruded(shape, feature, source.top, ground, terrain))
        problems += faults
    return Read(tuple(solids), tuple(problems), layer.changes)


def _local(polygon: Any, terrain: Terrain) -> Any:
    import shapely

    return shapely.remove_repeated_points(shapely.transform(polygon, terrain.frame.to_local), REPEATED)


def _missing_attributes(source: StructureSource, layer: PolygonLayer) -> list[str]:
    """Messages on attributes that are stated and that no feature has."""
    sources = {"height": "height" if source.height is None else source.height, "base": source.base, "clearance": source.clearance}
    names = {key: name for key, name in sources.items() if isinstance(name, str) and name not in layer.attributes}
    return [f"{layer.lacks(name, key)}; state {key}, a number or the name of an attribute" for key, name in names.items()]


def _feature(source: StructureSource, layer: PolygonLayer, row: int, place: str, problems: list[str]) -> _Feature | None:
    """What a feature states, or None and what is wrong with it."""
    columns = layer.attributes.columns
    values: dict[str, float | None] = {}
    sources: dict[str, tuple[float | str | None, str]] = {
        "height": ("height" if source.height is None else source.height, "structure_height"),
        "base": (source.base if source.base is not None else "base" if "base" in columns else None, "elevation"),
        "clearance": (
            source.clearance if source.clearance is not None else "clearance" if "clearance" in columns else None,
            "structure_clearance",
        ),
        "friction": (FRICTION if FRICTION in columns else source.friction_angle_deg, "basal_friction_angle"),
    }
    for key, (entry, quantity) in sources.items():
        try:
            values[key] = _value(layer, row, entry, quantity, place)
        except InputError as error:
            problems.append(str(error))
    if problems:
        return None
    height, friction = values["height"], values["friction"]
    if height is None:
        problems.append(f"{place}: its height is empty; every structure needs one")
        return None
    angle = source.friction_angle_deg if friction is None else friction
    return _Feature(_name(source, layer, row), height, values["base"], values["clearance"], math.tan(math.radians(angle)), place)


def _name(source: StructureSource, layer: PolygonLayer, row: int) -> str:
    """Name of a feature: its attribute, or that of the source where it is empty."""
    attribute = layer.attributes["name"].iloc[row] if "name" in layer.attributes else None
    return source.name if is_missing(attribute) or not str(attribute).strip() else str(attribute)


def _value(layer: PolygonLayer, row: int, entry: float | str | None, quantity: str, place: str) -> float | None:
    """A number that is stated, or that of an attribute of a feature; None where it is empty."""
    key = quantity
    if isinstance(entry, str):
        key, entry = f"attribute {entry!r}", layer.attributes[entry].iloc[row]
        if is_missing(entry):
            return None
        entry = entry.item() if isinstance(entry, np.generic) else entry
    return None if entry is None else checked(quantity, entry, place=place, key=key, error=InputError)


def _impossible(feature: _Feature) -> Iterator[str]:
    if feature.clearance is not None and feature.clearance >= feature.height:
        yield (
            f"{feature.place}: clearance is {feature.clearance:g} m and height {feature.height:g} m, both above the ground; "
            "a structure needs a clearance less than its height"
        )


def _off_the_ground(ground: GroundUnder, polygon: Any, terrain: Terrain, place: str) -> Iterator[str]:
    if not math.isnan(ground.lowest):
        return
    x, y = polygon.representative_point().coords[0]
    yield (
        f"{place}: the structure at easting {x:.1f}, northing {y:.1f} lies beyond the terrain {terrain.source} or where "
        "that has no elevation; move it, use a larger DEM, or remove it"
    )


def _extruded(shape: Any, feature: _Feature, top: Top, ground: GroundUnder, terrain: Terrain) -> Solid:
    """A body from its footprint in local positions."""
    import shapely

    level = ground.mean if feature.base is None else feature.base
    step = min(terrain.cell_size)
    along_ground = top is Top.ALONG_GROUND and feature.base is None
    if along_ground:
        shape = shapely.segmentize(shape, step)
    points, walls, caps, names = _outline(shape)
    base = elevation_at(terrain, points) if along_ground else np.full(len(points), level)
    hangs = feature.clearance is not None and feature.clearance > 0
    if hangs or (feature.base is not None and feature.base > ground.highest):  # the latter floats, unless a clearance is stated
        bottom = base + (feature.clearance or 0.0)
    else:
        bottom = np.full(len(points), min(ground.lowest, level) - max(BELOW * step, DEEP * feature.height))
    n = len(points)
    vertices = np.concatenate([np.column_stack([points, bottom]), np.column_stack([points, base + feature.height])])
    a, b, wall = walls.T
    faces = np.concatenate([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n]), caps + n, caps[:, ::-1]])
    facade = np.concatenate([wall, wall, np.full(len(caps), len(names)), np.full(len(caps), len(names) + 1)])
    clearance = feature.clearance if hangs else None
    facades = tuple(numbered([*names, "top", "underside"]))
    return Solid(feature.name, vertices, faces, facade, facades, feature.friction, feature.place, clearance)


def _outline(shape: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Points (n, 2) of a polygon or multipolygon; from, to and wall (n, 3) of its sides; triangles (m, 3) in it; names of walls."""
    import shapely

    points, sides, count = [], [], 0
    names: list[str] = []
    for part in shapely.get_parts(shapely.orient_polygons(shapely.normalize(shape))):
        for number, ring in enumerate([part.exterior, *part.interiors]):
            xy = shapely.get_coordinates(ring)[:-1]
            wall, names_of_ring = walls_of(xy)
            here = count + np.arange(len(xy))
            sides.append(np.column_stack([here, np.roll(here, -1), len(names) + wall]))
            names += [f"inner {name}" for name in names_of_ring] if number else names_of_ring
            points.append(xy)
            count += len(xy)
    joined = np.concatenate(points)
    return joined, np.concatenate(sides), _triangles(shape, joined), names


def _triangles(shape: Any, points: np.ndarray) -> np.ndarray:
    """Rows of the points (m, 3) of triangles that fill a polygon, counterclockwise."""
    import shapely
    from scipy.spatial import cKDTree

    parts = shapely.get_parts(shapely.orient_polygons(shapely.constrained_delaunay_triangles(shape)))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    return cKDTree(points).query(corners)[1]  # type: ignore[no-any-return]


READER = StructureReader(
    "footprints", (), ("height", "base", "layer", "top"), read_footprints,
    lambda source: read_frame(source.path, source.layer, "structure"), has_attributes=True,
)  # fmt: skip
