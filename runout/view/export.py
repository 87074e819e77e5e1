"""Writes a scene for ParaView: surfaces (VTS), maps (VTI), particles (VTP), and collections with the time of each file (PVD).

Positions are local metres, so that single precision on a graphics card resolves them; the field ``map_origin`` of every file
holds the easting and northing of the local origin. Only the process that draws imports this module.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pyvista as pv

from runout.view import surfaces
from runout.view.scene import FlowScene

HIDDEN_POINT = 2  # vtkDataSetAttributes::HIDDENPOINT
NOT_IN_A_NAME = r"[^\w.-]"
HEAD = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'


def export(scene: FlowScene, folder: Path) -> list[Path]:
    """Write ``terrain.vts``, ``flow.pvd``, ``maps.pvd``, the frames and, where there are any, ``particles.pvd`` and structures."""
    written = [_saved(_ground(scene), scene, folder / "terrain.vts")]
    flow = [_saved(_flow(scene, k), scene, folder / f"flow_{k:04d}.vts") for k in range(len(scene.times))]
    written += [*flow, _collection(scene.times, flow, folder / "flow.pvd")]
    maps = [_saved(_map(scene, k), scene, folder / f"map_{k:04d}.vti") for k in range(len(scene.times))]
    written += [*maps, _collection(scene.times, maps, folder / "maps.pvd")]
    if scene.particles is not None:
        clouds = [_saved(_cloud(scene, k), scene, folder / f"particles_{k:04d}.vtp") for k in range(len(scene.times))]
        written += [*clouds, _collection(scene.times, clouds, folder / "particles.pvd")]
    for name, (points, faces) in scene.meshes.items():
        mesh = pv.PolyData(scene.local(points), np.column_stack([np.full(len(faces), 3), faces]).ravel())
        written.append(_saved(mesh, scene, folder / f"structure_{re.sub(NOT_IN_A_NAME, '_', name)}.vtp"))
    return written


def _grid(points: np.ndarray) -> pv.StructuredGrid:
    """Grid of points (rows, columns, 3); the numbers of its points run along the rows."""
    return pv.StructuredGrid(*(np.ascontiguousarray(points[..., axis].T[..., None]) for axis in range(3)))


def _of_points(values: np.ndarray) -> np.ndarray:
    """Values (rows, columns) in the order of the points of :func:`_grid`."""
    return values.T.ravel(order="F")


def _ground(scene: FlowScene) -> pv.StructuredGrid:
    grid = _grid(scene.points())
    grid.point_data["elevation"] = _of_points(scene.ground)
    return _hidden(grid, ~np.isfinite(scene.ground))


def _flow(scene: FlowScene, frame: int) -> pv.StructuredGrid:
    grid = _grid(surfaces.flow_points(scene, frame))
    grid.point_data["thickness"] = _of_points(np.nan_to_num(scene.thickness[frame]))
    grid.point_data["speed"] = _of_points(np.nan_to_num(scene.speed[frame]))
    return _hidden(grid, ~surfaces.covered(scene, frame))


def _map(scene: FlowScene, frame: int) -> pv.ImageData:
    """Thickness, speed and ground on the cells, flat at 0 m: for sums and sections over areas."""
    rows, columns = scene.ground.shape
    east, north = scene.cell_size
    shape, corner = (columns + 1, rows + 1, 1), (-0.5 * east, -0.5 * north, 0.0)
    raster = pv.ImageData(dimensions=shape, spacing=(east, north, 1.0), origin=corner)
    fields = {"thickness": scene.thickness[frame], "speed": scene.speed[frame], "elevation": scene.ground}
    for name, values in fields.items():
        raster.cell_data[name] = (values if name == "elevation" else np.nan_to_num(values))[::-1].ravel()
    return raster


def _hidden(grid: pv.StructuredGrid, cells: np.ndarray) -> pv.StructuredGrid:
    """The grid with points (rows, columns) that ParaView does not draw."""
    grid.point_data["vtkGhostType"] = np.where(_of_points(cells), HIDDEN_POINT, 0).astype(np.uint8)
    return grid


def _cloud(scene: FlowScene, frame: int) -> pv.PolyData:
    points, speed = surfaces.particle_values(scene, frame, "speed")
    cloud = pv.PolyData(points)
    cloud.point_data["speed"] = speed
    cloud.point_data["thickness"] = surfaces.particle_values(scene, frame, "thickness")[1]
    return cloud


def _saved(mesh: pv.DataSet, scene: FlowScene, path: Path) -> Path:
    mesh.field_data["map_origin"] = np.array(scene.origin)
    mesh.save(path)
    return path


def _collection(times: np.ndarray, files: Sequence[Path], path: Path) -> Path:
    """A PVD file: time [s] and name of each file."""
    named = zip(times, files, strict=True)
    rows = [f'    <DataSet timestep="{time:.9g}" part="0" file={quoteattr(file.name)}/>' for time, file in named]
    path.write_text(HEAD + "\n".join(rows) + "\n  </Collection>\n</VTKFile>\n", encoding="utf-8")
    return path
