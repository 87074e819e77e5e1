"""Draws a scene with pyvista. Only the process that draws imports this module."""

from dataclasses import dataclass
from typing import Any

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
