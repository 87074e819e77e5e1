"""The inputs of a site are read once a run, and again only when a file has changed."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ramp_site import write_raster, write_site

from runout import cli
from runout.config.site import read_site
from runout.errors import ExitCode
from runout.release import read as release_reader
from runout.release.read import read_raster
from runout.terrain import read
from runout.workflow import hazard_map
from runout.workflow.study import Study

JACKSBORO = Path(__file__).parents[2] / "sites" / "jacksboro"


@pytest.fixture
def readings(monkeypatch):
    """Rasters that were read as terrain, one entry each time."""
    found, real = [], read.read_terrain

    def counted(source, *arguments, **choices):
        found.append(source)
        return real(source, *arguments, **choices)

    monkeypatch.setattr(read, "read_terrain", counted)
    return found


def test_a_whole_run_reads_the_elevations_once(tmp_path, readings):
    hazard_map.run(write_site(tmp_path / "ramp"), workers=1)
    assert len(readings) == 1


def test_a_check_reads_elevations_and_releases_once(tmp_path, readings, monkeypatch, capsys):
    found, real = [], read_raster
    monkeypatch.setattr(release_reader, "read_raster", lambda path, *of, **how: found.append(path) or real(path, *of, **how))
    assert cli.main(["check", str(write_site(tmp_path / "ramp"))]) == ExitCode.OK
    assert (len(readings), len(found)) == (1, 1)
    assert "release slab: 2.88e+04 m3" in capsys.readouterr().out


def test_another_process_gets_what_this_one_has_read(tmp_path, readings):
    site = read_site(write_site(tmp_path / "ramp"))
    data = site.data()
    copy = pickle.loads(pickle.dumps(site))
    assert np.array_equal(copy.data().terrain.elevation, data.terrain.elevation)
    assert copy.data().releases[0].volume == data.releases[0].volume
    assert len(readings) == 1


def test_changed_elevations_are_read_again(tmp_path, readings):
    folder = write_site(tmp_path / "ramp")
    site = read_site(folder)
    before = site.data().terrain.elevation.copy()
    write_raster(folder / "inputs" / "dem.tif", before[::-1] + 1.0)
    assert np.array_equal(site.data().terrain.elevation, before + 1.0)
    assert len(readings) == 2


def test_nothing_to_do_loads_no_library_that_it_does_not_need(finished_site):
    folder, _ = finished_site
    Study.open(folder).keep()
    code = (
        "import sys; from runout.cli import main; sys.argv = ['runout', 'run', sys.argv[1]]\n"
        "try: main()\n"
        "except SystemExit as ended: assert not ended.code\n"
        "unneeded = 'scipy', 'pandas', 'xarray', 'matplotlib', 'geopandas', 'numba', 'warp'\n"
        "own = 'model.scene', 'io.netcdf', 'terrain.prepare', 'backends.protocol', 'engine_notes'\n"
        "print(*(n for n in (*unneeded, *(f'runout.{part}' for part in own)) if n in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True)
    assert "nothing to do" in done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize("cost", [[1e-4, 3e-8], None])
def test_a_check_loads_no_compiler_whether_the_kernels_are_known_or_not(cost):
    code = (
        "import sys; from runout.forecast import engine_notes; from runout.cli import main\n"
        f"engine_notes.known = lambda name, of, times=1: 100_000_000 if name == 'memory' else {cost}\n"
        "assert main(['check', sys.argv[1]]) == 0\n"
        "unneeded = 'numba', 'warp', 'matplotlib', 'xarray', 'rasterio', 'runout.structures.read', 'runout.scores.comparison'\n"
        "print(*(n for n in unneeded if n in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(JACKSBORO)], capture_output=True, text=True, check=False)
    assert "time      about" in done.stdout, done.stderr
    assert done.stdout.splitlines()[-1] == ""
