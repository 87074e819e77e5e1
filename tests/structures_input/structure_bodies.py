"""Terrains, boxes and footprints for the tests of structures."""

import numpy as np

from runout.structures.solid import Solid

WEST, SOUTH = 500000.0, 5000000.0


def body(mesh, name="body", friction=0.4):
    """A mesh of trimesh as a body with one facade."""
    faces = np.asarray(mesh.faces)
    return Solid(name, np.asarray(mesh.vertices, float), faces, np.zeros(len(faces), int), ("surface",), friction, name)


def box(centre, size, turned=None):
    """A box of trimesh, turned about its centre."""
    import trimesh

    made = trimesh.creation.box(size)
    if turned is not None:
        made.apply_transform(turned)
    made.apply_translation(centre)
    return made


def distance_to_box(points, centre, size):
    """Signed distance of points (..., 3) to a box along the axes."""
    q = np.abs(points - np.asarray(centre)) - np.asarray(size) / 2
    return np.linalg.norm(np.maximum(q, 0), axis=-1) + np.minimum(q.max(-1), 0)


def nodes(field):
    """Local positions (n, 9, 9, 9, 3) of the nodes of the blocks of a field, in the order of its rows."""
    block = np.argwhere(field.blocks >= 0)
    node = np.stack(np.meshgrid(*[np.arange(9)] * 3, indexing="ij"), -1)
    places = np.empty((len(block), 9, 9, 9, 3))
    places[field.blocks[tuple(block.T)]] = np.array(field.origin) + field.spacing * (8 * block[:, None, None, None] + node)
    return places


def write_footprints(path, polygons, **attributes):
    """A GeoPackage of polygons in metres from the south-west corner of ``level``."""
    import geopandas as gpd
    import shapely

    moved = [shapely.transform(p, lambda xy: xy + np.array([WEST, SOUTH])) for p in polygons]
    gpd.GeoDataFrame(attributes, geometry=moved, crs="EPSG:32632").to_file(path)
    return path
