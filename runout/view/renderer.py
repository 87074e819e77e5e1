"""The process that draws what the folder of its argument describes.

The folder holds ``job.json`` (task and look) and ``scene.npz``; products go to its folder ``made``. A reason of failure goes to
``reason.txt``. VTK may end this process instead, see :mod:`runout.view.process`.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from runout.view.scene import FlowScene

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


def _frames(scene: FlowScene, look: dict[str, Any], made: Path) -> None:
    """A PNG of every frame, and the name of the renderer."""
    from runout.view.picture import Look, Picture

    picture = Picture(scene, Look(**look))
    for frame in range(len(scene.times)):
        picture.show(frame)
        picture.plotter.screenshot(made / FRAME.format(frame))
    (made / "renderer.txt").write_text(_renderer(picture), encoding="utf-8")


def _renderer(picture: Any) -> str:
    """VTK and the driver of OpenGL, in words."""
    import pyvista

    lines = picture.plotter.render_window.ReportCapabilities().splitlines()
    driver = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("OpenGL renderer string")), "unknown driver")
    return f"pyvista {pyvista.__version__}, VTK {'.'.join(map(str, pyvista.vtk_version_info))}, {driver}"


def _window(scene: FlowScene, look: dict[str, Any], made: Path) -> None:
    """A window with a slider for the time; returns when it is closed."""
    from runout.view.picture import Look, Picture
    from runout.view.window import open_window

    open_window(Picture(scene, Look(**look), off_screen=False))


def _files(scene: FlowScene, look: dict[str, Any], made: Path) -> None:
    from runout.view.export import export

    export(scene, made)


TASKS: dict[str, Callable[[FlowScene, dict[str, Any], Path], None]] = {"frames": _frames, "window": _window, "files": _files}


def command() -> None:
    """Main function of the process."""
    sys.exit(main(Path(sys.argv[1])))
