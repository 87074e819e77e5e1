"""Runs the process that draws, with a time limit; its end by VTK becomes one sentence.

VTK tries a display, then EGL, then OpenGL in software (OSMesa), which it searches as ``libOSMesa.so.8`` on the library path. The
wheel ``lavavu-osmesa`` of the extra ``software-gl`` holds that library under another name, so that the process gets a link to it.
"""

import json
import logging
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import RenderError
from runout.processes.interrupt import at_end
from runout.processes.lifetime import import_path, python_command
from runout.view.renderer import PACKAGE_MISSING
from runout.view.scene import FlowScene

LOGGER = logging.getLogger(__name__)
RENDERER = "from runout.view.renderer import command; command()"
START_SECONDS, FRAME_SECONDS = 120.0, 20.0  # time limit [s], and what each frame adds to it
POLL_SECONDS = 0.2
INSTALL = "pip install 'runout[view]'"
NO_PACKAGE = f"3D pictures need pyvista: {INSTALL}"
INSTALL_SOFTWARE_GL = "pip install 'runout[software-gl]'"
NO_OPENGL = (
    f"3D pictures need OpenGL, and VTK found none on this machine: {INSTALL_SOFTWARE_GL} (Linux x86-64), or install a driver "
    "(Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri); the run is complete without them"
)
OSMESA_DISTRIBUTION, OSMESA_FOLDER = "lavavu-osmesa", "lavavu_osmesa.libs"  # the wheel, and its folder of libraries
OSMESA_NAME = "libOSMesa.so.8"  # that VTK opens
LIBRARY_PATH = "LD_LIBRARY_PATH"


def require_packages() -> None:
    """Raise RenderError unless pyvista is installed."""
    if find_spec("pyvista") is None:
        raise RenderError(NO_PACKAGE)


def drawn_by() -> str:
    """Versions and driver that draw here, found by drawing a small picture. Raises RenderError if nothing can be drawn."""
    axis, ground = np.arange(4.0), np.zeros((4, 4))
    scene = FlowScene(axis, axis[::-1], ground, np.zeros(1), ground[None], ground[None])
    with folder_for_job() as folder:
        product_folder = make("frames", scene, {"size": (64, 64)}, folder)
        return next(path for path in product_folder if path.suffix == ".txt").read_text(encoding="utf-8")


def make(
    task: str, scene: FlowScene, look: Mapping[str, Any], folder: Path, progress: Callable[[float], None] | None = None
) -> list[Path]:
    """Products of a task of :mod:`runout.view.renderer`, "frames", "files" or "window", in ``made`` of an empty folder.

    ``look`` holds the arguments of :class:`runout.view.renderer.Look`. ``progress`` is called with the finished fraction, 0 to 1.
    Raises RenderError if pyvista is missing, there is no OpenGL, the disk is full, or the time limit is exceeded.
    """
    require_packages()
    scene.save(folder / "scene.npz")
    (folder / "job.json").write_text(json.dumps({"task": task, "look": dict(look)}), encoding="utf-8")
    limit = None if task == "window" else START_SECONDS + FRAME_SECONDS * len(scene.times)
    code = _run(folder, limit, progress, len(scene.times))
    if code:
        raise RenderError(_reason(folder, code, task))
    return sorted((folder / "made").iterdir())


def _run(folder: Path, limit: float | None, progress: Callable[[float], None] | None, frames: int) -> int:
    """Exit code of the process; RenderError at the time limit."""
    started = time.monotonic()
    with open(folder / "messages.txt", "wb") as messages:
        streams = {"stdout": messages, "stderr": messages, "stdin": subprocess.DEVNULL}
        process = subprocess.Popen(python_command(RENDERER, str(folder)), env=_environment(folder), **streams)  # type: ignore[call-overload]
        with at_end(process.kill):
            try:
                while True:
                    try:
                        return process.wait(POLL_SECONDS)
                    except subprocess.TimeoutExpired:
                        _tell(folder, progress, frames)
                    if limit is not None and time.monotonic() - started > limit:
                        raise RenderError(f"3D pictures: not finished after {limit:.0f} s; draw fewer frames or a smaller picture")
            finally:
                if process.poll() is None:
                    process.kill()
                    process.wait()


def _tell(folder: Path, progress: Callable[[float], None] | None, frames: int) -> None:
    if progress and (folder / "made").is_dir():
        progress(sum(1 for _ in (folder / "made").iterdir()) / max(1, frames))


def _environment(folder: Path) -> dict[str, str]:
    """Environment in which the process finds this package and OpenGL."""
    return {**os.environ, **opengl_environment(folder), "PYTHONPATH": import_path()}


def osmesa_library() -> Path | None:
    """OSMesa of the extra, or None where it is not installed."""
    if sys.platform != "linux":
        return None
    try:
        folder = Path(str(metadata.distribution(OSMESA_DISTRIBUTION).locate_file(OSMESA_FOLDER)))
    except metadata.PackageNotFoundError:
        return None
    return next(iter(sorted(folder.glob("libOSMesa*.so*"))), None)


def opengl_environment(folder: Path) -> dict[str, str]:
    """Variables with which a new process finds OSMesa; empty without the extra.

    ``folder``: gets the link to the library; it exists as long as the process draws.
    """
    osmesa = osmesa_library()
    if osmesa is None:
        return {}
    (folder / OSMESA_NAME).symlink_to(osmesa)
    before = os.environ.get(LIBRARY_PATH)  # a library that the user chose comes first
    return {LIBRARY_PATH: os.pathsep.join([*([before] if before else []), str(folder), str(osmesa.parent)])}


def _reason(folder: Path, code: int, task: str) -> str:
    """Sentence about a process that failed."""
    messages = (folder / "messages.txt").read_text(encoding="utf-8", errors="replace")
    LOGGER.debug("the process that draws ended with code %d: %s", code, messages)
    if code == PACKAGE_MISSING:
        cause = (folder / "reason.txt").read_text(encoding="utf-8")
        return f"3D pictures: pyvista cannot be imported ({cause}); repair it with {INSTALL}"
    errors = re.findall(r"^[\w.]*Error\b.*", messages, re.MULTILINE)
    if code == 1 and errors:
        return f"3D pictures: {errors[-1]}; -v shows more"
    return NO_OPENGL


@contextmanager
def folder_for_job() -> Iterator[Path]:
    """Temporary folder of a job, which an interrupt removes as well."""
    with tempfile.TemporaryDirectory(prefix="runout_view_") as folder, at_end(partial(shutil.rmtree, folder, ignore_errors=True)):
        yield Path(folder)
