import errno
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from runout.errors import DiskFullError, StorageError
from runout.io import atomic, netcdf, part
from runout.io.geotiff import write_cog
from runout.io.vector import write_outlines
from runout.model.release import Release
from runout.model.terrain import Terrain

TERRAIN = Terrain(np.ones((40, 50)), (10.0, 10.0))


def make_netcdf(path: Path) -> None:
    noise = np.random.default_rng(0).random(TERRAIN.shape)
    netcdf.write(netcdf.map_dataset(TERRAIN, {"max_speed": noise}, title="t"), path)


def make_cog(path: Path) -> None:
    noise = np.random.default_rng(0).random(TERRAIN.shape)
    write_cog(netcdf.map_dataset(TERRAIN, {"max_speed": noise}, title="t"), "max_speed", path)


def make_outlines(path: Path) -> None:
    write_outlines(path, TERRAIN, [Release(np.ones(TERRAIN.shape), TERRAIN)], np.ones(TERRAIN.shape))


def make_json(path: Path) -> None:
    atomic.write_json({"numbers": list(range(5000))}, path)


WRITERS = {"a.nc": make_netcdf, "a.tif": make_cog, "a.gpkg": make_outlines, "a.json": make_json}
each_writer = pytest.mark.parametrize(("name", "writer"), WRITERS.items(), ids=WRITERS)


@each_writer
def test_a_full_disk_is_reported_and_the_old_file_stays(name: str, writer: Callable, tmp_path: Path) -> None:
    """A limit on file sizes makes the system refuse to write on, as a full disk does."""
    (tmp_path / name).write_bytes(b"old")
    script = f"""
        import resource, signal, sys
        from pathlib import Path
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import test_whole_files as t
        from runout.errors import DiskFullError, StorageError
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        try:
            t.WRITERS[{name!r}](Path({str(tmp_path)!r}) / {name!r})
        except StorageError as error:
            print("refused:", error)
    """
    run = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("refused:"), run.stdout + run.stderr
    assert "free some space" in run.stdout
    assert name in run.stdout
    assert os.listdir(tmp_path) == [name], "nothing half-written is left"
    assert (tmp_path / name).read_bytes() == b"old"


def full(*_: object, **__: object) -> None:
    """Fail as a disk without space does."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@each_writer
def test_a_disk_that_fills_at_the_last_moment_is_reported(
    name: str, writer: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(b"old")
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(StorageError, match=rf"{name}: cannot be written \(No space left on device\); the disk is full; free"):
        writer(tmp_path / name)
    assert os.listdir(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == b"old"


@each_writer
def test_a_folder_that_forbids_writing_is_reported(
    name: str, writer: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(part.tempfile, "mkdtemp", forbidden)
    with pytest.raises(StorageError, match=r"Permission denied\); no permission to write there; change the permissions"):
        writer(tmp_path / name)
    assert os.listdir(tmp_path) == []


@each_writer
def test_a_path_through_a_file_is_reported(name: str, writer: Callable, tmp_path: Path) -> None:
    (tmp_path / "results").write_text("a file where the folder should be")
    with pytest.raises(StorageError, match="a part of the path is a file, not a folder; choose another folder with --out"):
        writer(tmp_path / "results" / name)


@each_writer
def test_a_file_appears_whole_in_a_new_folder_and_replaces_an_older_one(name: str, writer: Callable, tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / name
    writer(path)
    first = path.stat().st_size
    path.write_bytes(b"old")
    writer(path)
    assert path.stat().st_size == first > 3
    assert os.listdir(path.parent) == [name]


@pytest.mark.parametrize("error", [RuntimeError("NetCDF: HDF error"), PermissionError(errno.EACCES, "Permission denied")])
def test_a_full_disk_that_a_library_calls_otherwise_is_called_full(error: Exception, tmp_path: Path, monkeypatch) -> None:
    def fail(*_: object, **__: object) -> None:
        monkeypatch.setattr(atomic.tempfile, "TemporaryFile", full)
        raise error

    monkeypatch.setattr(xr.Dataset, "dump_to_store", fail)
    with pytest.raises(
        DiskFullError, match=r"a\.nc: cannot be written \(No space left on device\); the disk is full; free some space"
    ):
        make_netcdf(tmp_path / "a.nc")


def test_an_error_of_the_library_that_is_no_os_error_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xr.Dataset, "dump_to_store", fail)
    with pytest.raises(StorageError, match=r"NetCDF: HDF error\); the disk may be full"):
        make_netcdf(tmp_path / "a.nc")
    assert os.listdir(tmp_path) == []


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    writing = textwrap.dedent(f"""
        import os, signal
        from runout.io.atomic import whole_file
        with whole_file({str(tmp_path / "0003.nc")!r}) as temporary:
            temporary.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    """)
    subprocess.run([sys.executable, "-c", writing], check=False)
    assert list(tmp_path.glob("*.nc")) == [], "half a file is never taken for a member"
    assert len(os.listdir(tmp_path)) == 1
    assert part.remove_stale(tmp_path) == 1
    assert os.listdir(tmp_path) == []
