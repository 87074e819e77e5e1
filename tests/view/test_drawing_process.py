"""The process that draws, and how it fails."""

import ctypes.util
import os
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from runout.errors import RenderError
from runout.view import process

SMALL = {"size": (240, 160)}


def instead(monkeypatch, code):
    """Let a process with this program take the place of the one that draws."""
    monkeypatch.setattr(process, "RENDERER", code)


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


@pytest.mark.usefixtures("opengl")
def test_every_frame_is_drawn_with_the_flow_where_it_is(scene, tmp_path):
    done = []
    made = process.make("frames", scene, {**SMALL, "direction": (np.pi, np.pi / 2)}, tmp_path, done.append)
    frames = [path for path in made if path.suffix == ".png"]
    assert [path.name for path in frames] == ["frame_0000.png", "frame_0001.png", "frame_0002.png"]
    assert "VTK" in (tmp_path / "made" / "renderer.txt").read_text()
    middles = []
    for path in frames:
        image = pixels(path)[:, :190]
        assert image.shape == (160, 190, 3)
        coloured = (image[..., 1] < 60) & (image[..., 2] > 60) & (image[..., 2] < 140) & (image[..., 0] < 110)  # darkest of viridis
        assert coloured.sum() > 50, path.name
        middles.append(np.nonzero(coloured)[1].mean())
    assert middles[0] + 15 < middles[1] < middles[2] - 15  # from west to east


@pytest.mark.usefixtures("opengl")
def test_particles_structures_and_an_image_are_drawn(crowded, tmp_path):
    green = np.zeros((50, 100, 3), np.uint8)
    green[..., 1] = 180
    look = {**SMALL, "show": "particles", "colour": "speed"}
    made = process.make("frames", replace(crowded, image=green).frames(1), look, tmp_path)
    image = pixels(made[0])
    assert ((image[..., 1] > 60) & (image[..., 0] < 30)).mean() > 0.1


@pytest.mark.usefixtures("drawable")
def test_a_process_that_vtk_ends_becomes_one_line(scene, tmp_path, monkeypatch):
    instead(monkeypatch, "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(RenderError, match=r"need OpenGL.*the run is complete without them"):
        process.make("frames", scene, SMALL, tmp_path)


@pytest.mark.usefixtures("drawable")
@pytest.mark.skipif(sys.platform != "linux", reason="VTK chooses its window by this variable on Linux")
@pytest.mark.skipif(ctypes.util.find_library("OSMesa") is not None, reason="OSMesa is installed, so that VTK can draw")
def test_vtk_without_opengl_becomes_one_line(scene, tmp_path, monkeypatch):
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")
    monkeypatch.setattr(process, "osmesa_library", lambda: None)
    with pytest.raises(RenderError) as caught:
        process.make("frames", scene.frames(1), SMALL, tmp_path)
    assert str(caught.value) == process.NO_OPENGL


@pytest.mark.usefixtures("opengl")
def test_the_extra_software_gl_draws_without_display_and_driver(scene, tmp_path, monkeypatch):
    if process.osmesa_library() is None:
        pytest.skip("lavavu-osmesa is not installed (extra software-gl), or has no wheel for this machine")
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")  # what VTK takes where nothing else is found
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    made = process.make("frames", scene.frames(1), SMALL, tmp_path)
    assert "llvmpipe" in (tmp_path / "made" / "renderer.txt").read_text()
    assert len(np.unique(pixels(made[0]).reshape(-1, 3), axis=0)) > 100


def test_a_library_path_of_the_user_comes_before_the_extra(tmp_path, monkeypatch):
    (tmp_path / "wheel").mkdir()
    osmesa = tmp_path / "wheel" / "libOSMesa-1234.so.8"
    osmesa.write_bytes(b"")
    monkeypatch.setattr(process, "osmesa_library", lambda: osmesa)
    monkeypatch.setenv("LD_LIBRARY_PATH", "/of/the/user")
    job = tmp_path / "job"
    job.mkdir()
    assert process.opengl_environment(job) == {"LD_LIBRARY_PATH": os.pathsep.join(["/of/the/user", str(job), str(osmesa.parent)])}
    assert (job / process.OSMESA_NAME).resolve() == osmesa


def test_without_the_extra_the_library_path_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "OSMESA_DISTRIBUTION", "no-such-distribution")
    assert process.opengl_environment(tmp_path) == {}


@pytest.mark.usefixtures("drawable")
def test_a_process_that_hangs_is_ended(scene, tmp_path, monkeypatch):
    instead(monkeypatch, "import time; time.sleep(60)")
    monkeypatch.setattr(process, "START_SECONDS", 0.3)
    monkeypatch.setattr(process, "FRAME_SECONDS", 0.0)
    with pytest.raises(RenderError, match="not finished after"):
        process.make("frames", scene, SMALL, tmp_path)


@pytest.mark.usefixtures("drawable")
def test_an_error_of_the_process_is_named(scene, tmp_path, monkeypatch):
    instead(monkeypatch, "raise OSError(28, 'No space left on device')")
    with pytest.raises(RenderError, match="No space left on device"):
        process.make("frames", scene, SMALL, tmp_path)


def test_without_pyvista_one_line_says_what_to_install(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(process, "find_spec", lambda name: None)
    with pytest.raises(RenderError, match=r"pip install 'runout\[view\]'"):
        process.make("frames", scene, SMALL, tmp_path)


@pytest.mark.usefixtures("drawable")
def test_a_pyvista_that_cannot_be_imported_is_told_with_its_reason(scene, tmp_path, monkeypatch):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "pyvista.py").write_text("raise ImportError('libXrender.so.1 is missing')")
    program = "import sys; sys.path.insert(0, sys.argv[1] + '/../broken'); from pathlib import Path; "
    instead(monkeypatch, program + "from runout.view.renderer import main; sys.exit(main(Path(sys.argv[1])))")
    (tmp_path / "job").mkdir()
    with pytest.raises(RenderError, match=r"libXrender\.so\.1 is missing"):
        process.make("frames", scene, SMALL, tmp_path / "job")


def test_an_error_of_several_lines_is_told_by_its_first_one(tmp_path):
    (tmp_path / "messages.txt").write_text("Traceback:\n  File\nvtk.MissingError: no grid\n    use another\n")
    assert process._reason(tmp_path, 1, "files") == "3D pictures: vtk.MissingError: no grid; -v shows more"
