"""The process that draws what the folder of its argument describes.

The folder holds ``job.json`` (task and look) and ``scene.npz``; products go to its folder ``made``. A reason of failure goes to
``reason.txt``. VTK may end this process instead, see :mod:`runout.view.process`.

For ParaView it writes surfaces (VTS), maps (VTI), particles (VTP), and collections with the time of each file (PVD). Positions are
local metres, so that single precision on a graphics card resolves them; the field ``map_origin`` of every file holds the easting
and northing of the local origin.
"""

import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pyvista as pv

from runout.view import surfaces
from runout.view.scene import FlowScene

if TYPE_CHECKING:
    from runout.view.picture import Picture

HIDDEN_POINT = 2  # vtkDataSetAttributes::HIDDENPOINT
NOT_IN_A_NAME = r"[^\w.-]"
HEAD = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
FRAME = "frame_{:04d}.png"
PACKAGE_MISSING = 3  # exit code


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


def main(folder: Path) -> int:
    """Do the task of a folder; exit code 0, or :data:`PACKAGE_MISSING`."""
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    (folder / "made").mkdir(exist_ok=True)
    try:
        import pyvista
    except ImportError as cause:
        (folder / "reason.txt").write_text(str(cause), encoding="utf-8")
        return PACKAGE_MISSING
    pyvista.OFF_SCREEN = job["task"] != "window"
    scene = FlowScene.load(folder / "scene.npz")
    TASKS[job["task"]](scene, job["look"], folder / "made")
    return 0


def _frames(scene: FlowScene, look: dict[str, Any], output: Path) -> None:
    """A PNG of every frame, and the name of the renderer."""
    from runout.view.picture import Look, Picture

    picture = Picture(scene, Look(**look))
    for frame in range(len(scene.times)):
        picture.show(frame)
        picture.plotter.screenshot(output / FRAME.format(frame))
    (output / "renderer.txt").write_text(_renderer(picture), encoding="utf-8")


def _renderer(picture: "Picture") -> str:
    """VTK and the driver of OpenGL, in words."""
    import pyvista

    lines = picture.plotter.render_window.ReportCapabilities().splitlines()
    driver = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("OpenGL renderer string")), "unknown driver")
    return f"pyvista {pyvista.__version__}, VTK {'.'.join(map(str, pyvista.vtk_version_info))}, {driver}"


def _window(scene: FlowScene, look: dict[str, Any], output: Path) -> None:
    """A window with a slider for the time; returns when it is closed."""
    from runout.view.picture import Look, Picture

    picture = Picture(scene, Look(**look), off_screen=False)
    _with_slider(picture)
    picture.plotter.show(title="runout view")


class Player:
    """Frame that a window shows; the slider and the arrow keys change it."""

    def __init__(self, picture: "Picture"):
        self.picture, self.frame = picture, 0

    def to_time(self, time: float) -> None:
        """Show the frame next to a time [s]."""
        self.show(int(np.argmin(np.abs(self.picture.scene.times - time))))

    def beside(self, by: int) -> int:
        """Number of an earlier or a later frame."""
        return int(np.clip(self.frame + by, 0, len(self.picture.scene.times) - 1))

    def show(self, frame: int) -> None:
        """Show a frame, unless it is shown."""
        if frame != self.frame:
            self.frame = frame
            self.picture.show(frame)


def _with_slider(picture: "Picture") -> Player:
    """A player of a picture, after adding the slider and the arrow keys to its window."""
    from runout.report.marks import INK

    player, times = Player(picture), picture.scene.times
    if len(times) > 1:
        slider = picture.plotter.add_slider_widget(
            player.to_time, [float(times[0]), float(times[-1])], value=float(times[0]), title="time [s]", fmt="%.3g",
            pointa=(0.3, 0.08), pointb=(0.7, 0.08), color=INK, interaction_event="always", style="modern",
        )  # fmt: skip

        def move(by: int) -> None:
            slider.GetRepresentation().SetValue(float(times[player.beside(by)]))  # before it is drawn
            player.show(player.beside(by))

        picture.plotter.add_key_event("Right", lambda: move(1))
        picture.plotter.add_key_event("Left", lambda: move(-1))
    return player


def _files(scene: FlowScene, look: dict[str, Any], output: Path) -> None:
    export(scene, output)


TASKS: dict[str, Callable[[FlowScene, dict[str, Any], Path], None]] = {"frames": _frames, "window": _window, "files": _files}


def command() -> None:
    """Main function of the process."""
    sys.exit(main(Path(sys.argv[1])))
