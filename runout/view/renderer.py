"""The process that draws what the folder of its argument describes.

The folder holds ``job.json`` (task and look) and ``scene.npz``; products go to its folder ``made``. A reason of failure goes to
``reason.txt``. VTK may end this process instead, see :mod:`runout.view.process`.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.view.scene import FlowScene

if TYPE_CHECKING:
    from runout.view.picture import Picture

FRAME = "frame_{:04d}.png"
PACKAGE_MISSING = 3  # exit code


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
    from runout.view.export import export

    export(scene, output)


TASKS: dict[str, Callable[[FlowScene, dict[str, Any], Path], None]] = {"frames": _frames, "window": _window, "files": _files}


def command() -> None:
    """Main function of the process."""
    sys.exit(main(Path(sys.argv[1])))
