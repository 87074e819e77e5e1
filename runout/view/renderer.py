"""The process that draws what the folder of its argument describes, with pyvista.

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
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pyvista as pv

from runout.palettes import Palette
from runout.report.marks import INK, RELEASE
from runout.report.relief import hillshade
from runout.view import surfaces
from runout.view.camera import VIEW_ANGLE_DEG, camera_for
from runout.view.scene import FlowScene

SKY_TOP, SKY = "#dfe7ee", "#ffffff"
GROUND_TINT = np.array([0.95, 0.93, 0.89])  # of the brightest ground
DARKEST = 0.9  # brightness of ground in the shade, before it is scaled to at most 1
STRUCTURE = "#b9bdc2"
LINE_WIDTH, LIFT = 4.0, 0.03  # [pixel]; of a cell above the surface
BAR_BACKGROUND = 0.55  # opacity
SMALLEST_POINT, LARGEST_POINT, COVERED = 3.0, 14.0, 0.3  # [pixel]; share of the picture that all particles cover at most
TEXT_HEIGHT = 45.0  # of the picture, per height of its text
HIDDEN_POINT = 2  # vtkDataSetAttributes::HIDDENPOINT
NOT_IN_A_NAME = r"[^\w.-]"
HEAD = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
FRAME = "frame_{:04d}.png"
PACKAGE_MISSING = 3  # exit code


@dataclass(frozen=True)
class Look:
    """How a scene is drawn."""

    colour: str = "thickness"  # "thickness" or "speed"
    show: str = "surface"  # "surface" or "particles"
    direction: tuple[float, float] | None = None  # azimuth and elevation of the camera [rad]; None: the best
    size: tuple[int, int] = (1280, 720)  # width and height [pixel]
    caption: str = ""  # second line of the picture, instead of the time of the frame
    top: float = 0.0  # value of the last colour; 0: that of the scene


def _plotter(off_screen: bool, size: tuple[int, int]) -> Any:
    return pv.Plotter(off_screen=off_screen, window_size=list(size))


class Picture:
    """A scene in a window or off screen; :meth:`show` changes its frame.

    ``off_screen``: no window.
    """

    def __init__(self, scene: FlowScene, look: Look, off_screen: bool = True):
        self.scene, self.look = scene.refined(), look
        self.coarse = scene  # one cell of the raster each
        self.scale = surfaces.scale_of(scene, look.colour, look.top)
        self.colours = Palette(self.scale.colours).listed()
        self.plotter = _plotter(off_screen, look.size)
        self.text = max(10, round(look.size[1] / TEXT_HEIGHT))
        self.plotter.set_background(SKY, top=SKY_TOP)
        self.plotter.enable_anti_aliasing("ssaa" if off_screen else "msaa")
        self._ground()
        self._structures()
        self._frame_of_picture()
        self.show(0)

    def _ground(self) -> None:
        mesh = self._surface(self.scene.points(), surfaces.known_faces(self.scene))
        if self.scene.image is None:
            mesh.point_data["colours"] = self._shade()
            self.plotter.add_mesh(mesh, scalars="colours", rgb=True, lighting=False, name="ground")
            return
        x, y = mesh.points[:, 0], mesh.points[:, 1]
        mesh.active_texture_coordinates = np.column_stack([x / x.max(), y / y.max()])
        light = {"smooth_shading": True, "ambient": 0.15, "diffuse": 0.8}
        self.plotter.add_mesh(mesh, texture=pv.Texture(self.scene.image), name="ground", **light)

    def _shade(self) -> np.ndarray:
        """Colours (n, 3) of uint8 of the ground by the sun."""
        light = hillshade(self.scene.points()[..., 2], self.scene.cell_size)
        brightness = (light.reshape(-1, 1) + DARKEST) / (1.0 + DARKEST)
        return (255 * brightness * GROUND_TINT).astype(np.uint8)

    def _surface(self, points: np.ndarray, faces: np.ndarray) -> pv.PolyData:
        corners = surfaces.quads(faces)
        return pv.PolyData(points.reshape(-1, 3), np.column_stack([np.full(len(corners), 4), corners]).ravel())

    def _outlines(self, points: np.ndarray) -> None:
        """Outlines of the releases on a surface (rows, columns, 3)."""
        lift = np.array([0.0, 0.0, LIFT * min(self.coarse.cell_size)])
        for k, outline in enumerate(self.scene.outlines):
            line = pv.lines_from_points(self.scene.draped(outline, points[..., 2]) + lift)
            choices = {"color": RELEASE, "line_width": LINE_WIDTH, "lighting": False, "render": False, "reset_camera": False}
            self.plotter.add_mesh(line, name=f"outline {k}", **choices)

    def _structures(self) -> None:
        for name, (points, faces) in self.scene.meshes.items():
            mesh = pv.PolyData(self.scene.local(points), np.column_stack([np.full(len(faces), 3), faces]).ravel())
            self.plotter.add_mesh(mesh, color=STRUCTURE, show_edges=False, ambient=0.25, name=f"structure {name}")

    def _frame_of_picture(self) -> None:
        """Title, directions and camera."""
        self._write(self.scene.title, 2.0, "title")
        self.plotter.add_axes(xlabel="E", ylabel="N", zlabel="up", color=INK, line_width=3)
        camera = camera_for(self.coarse, self.look.direction, self.look.size[0] / self.look.size[1])
        self.plotter.camera_position = [tuple(camera.position), tuple(camera.focus), tuple(camera.up)]
        self.plotter.camera.view_angle = VIEW_ANGLE_DEG

    def show(self, frame: int) -> None:
        """Draw a frame."""
        scene, look = self.scene, self.look
        choices: dict[str, Any] = {
            "scalars": look.colour, "cmap": self.colours, "clim": (0.0, self.scale.top), "scalar_bar_args": self._bar(),
            "name": "flow",
        }  # fmt: skip
        surface = surfaces.flow_points(scene, frame)
        if look.show == "particles":
            points, values = surfaces.particle_values(scene, frame, look.colour)
            mesh = pv.PolyData(points)
            choices |= {"point_size": self._point_size(len(points)), "render_points_as_spheres": True}
        else:
            mesh = self._surface(surface, surfaces.flow_faces(scene, frame))
            values = surfaces.flow_values(scene, frame, look.colour).ravel()
            choices |= {"smooth_shading": True, "ambient": 0.3, "specular": 0.15}
        self.plotter.remove_actor("flow", render=False)
        if len(values) and mesh.n_cells:
            mesh.point_data[look.colour] = values
            self.plotter.add_mesh(mesh, render=False, reset_camera=False, **choices)
            self._lighten(self.plotter.scalar_bars[self._bar()["title"]])
        self._outlines(surface)
        stamp = look.caption or f"t = {scene.times[frame]:.4g} s"
        self._write(stamp, 3.9, "time")
        self.plotter.render()

    def _lighten(self, bar: Any) -> None:
        """A light background, so that a dark image does not hide the words."""
        bar.GetBackgroundProperty().SetOpacity(BAR_BACKGROUND)
        bar.GetTitleTextProperty().SetBackgroundColor(1.0, 1.0, 1.0)
        bar.GetTitleTextProperty().SetBackgroundOpacity(BAR_BACKGROUND)

    def _point_size(self, points: int) -> float:
        """Size of particles [pixel]: the fewer, the larger."""
        size = np.sqrt(COVERED * self.look.size[0] * self.look.size[1] / max(1, points))
        return float(np.clip(size, SMALLEST_POINT, LARGEST_POINT * self.look.size[1] / 720))

    def _write(self, text: str, line: float, name: str) -> None:
        """Text so many lines below the upper edge."""
        place = (12, self.look.size[1] - line * self.text)
        self.plotter.add_text(text, position=place, font_size=round(self.text / 2), color=INK, name=name, render=False)

    def _bar(self) -> dict[str, Any]:
        return {
            "title": self.scale.label + "\n", "vertical": True, "position_x": 0.88, "position_y": 0.25,
            "width": 0.05, "height": 0.5, "background_color": "white", "fill": True, "color": INK,
            "title_font_size": self.text, "label_font_size": self.text, "n_labels": self.scale.labels, "fmt": "%.3g",
        }  # fmt: skip


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
