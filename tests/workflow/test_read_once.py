"""The inputs of a site are read once a run, and again only when a file has changed."""

import os
import pickle
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio.io
import shapely
from ramp_site import CELL, NORTH, ROWS, SITE, WEST, ramp, slab, write_raster, write_site

from runout import cli
from runout.config.site import read_site
from runout.errors import ExitCode
from runout.io import fingerprint, provenance
from runout.workflow.study import Study

JACKSBORO = Path(__file__).parents[2] / "sites" / "jacksboro"


SHORT = SITE.replace("end_time: 20", "end_time: 1").replace("members: 4", "members: 2")
FULL = SHORT.replace(
    "  dem: inputs/dem.tif\n",
    """  dem: inputs/dem.tif
  obstacles: [{polygons: inputs/dams.gpkg, height: 3.0}]
  friction_zones: [{polygons: inputs/zones.gpkg, factor: 1.5}]
  friction_rasters: {friction_angle_deg: inputs/friction.tif}
structures: [{file: inputs/houses.gpkg, height: 30.0, protects: inputs/behind.gpkg}]
probes: {points: inputs/points.gpkg, cross_sections: inputs/lines.gpkg}
observations:
  outline: {polygons: inputs/outline.gpkg}
  deposit: {raster: inputs/deposit.tif, nodata: zero}
  difference: {raster: inputs/difference.tif}
  gauges: {points: inputs/gauges.gpkg, arrival_time: seconds}
  thalweg: {line: inputs/thalweg.gpkg}
""",
)


def write_full_site(folder):
    """A site whose site.yaml names an input of every kind."""
    write_site(folder, FULL)
    middle = NORTH - 0.5 * ROWS * CELL

    def box(west, south, east, north):
        return shapely.box(WEST + west, middle + south, WEST + east, middle + north)

    def line(*ends):
        return shapely.LineString([(WEST + x, middle + y) for x, y in ends])

    point = shapely.Point(WEST + 303, middle)
    layers = {
        "dams": (box(400, -40, 430, 40), {}), "zones": (box(300, -80, 380, 80), {}), "houses": (box(440, -20, 480, 20), {}),
        "behind": (box(440, -60, 495, 60), {}), "points": (point, {"name": ["road"]}), "outline": (box(50, -40, 380, 35), {}),
        "lines": (line((320, -80), (320, 80)), {"name": ["fan"]}), "thalweg": (line((50, 0), (490, 0)), {}),
        "gauges": (point, {"seconds": [6.0]}),
    }  # fmt: skip
    for name, (geometry, columns) in layers.items():
        geopandas.GeoDataFrame(columns, geometry=[geometry], crs="EPSG:32632").to_file(folder / "inputs" / f"{name}.gpkg")
    for name, values in {"friction": 25.0 + 0 * ramp(), "deposit": slab(), "difference": -slab()}.items():
        write_raster(folder / "inputs" / f"{name}.tif", values)
    return folder


@pytest.fixture
def readings(monkeypatch):
    """How often the content of each raster and vector, and its checksum, was read: two counts by the name of the file."""
    contents, checksums = Counter(), Counter()

    class Dataset(rasterio.io.DatasetReader):
        counted = False

        def read(self, *arguments, **choices):
            contents[Path(self.name).name] += not self.counted
            self.counted = True  # by windows it is still one reading
            return super().read(*arguments, **choices)

    def read_file(path, *arguments, _real=geopandas.read_file, **choices):
        contents[Path(path).name] += 1
        return _real(path, *arguments, **choices)

    def sha256(path, _real=provenance.sha256):
        checksums[Path(path).name] += 1
        return _real(path)

    monkeypatch.setattr(rasterio.io, "DatasetReader", Dataset)
    monkeypatch.setattr(geopandas, "read_file", read_file)
    for module in (provenance, fingerprint):
        monkeypatch.setattr(module, "sha256", sha256)
    return contents, checksums


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_command_reads_each_raster_and_vector_once(tmp_path, readings, command):
    contents, checksums = readings
    folder = write_full_site(tmp_path / "ramp")
    files = {path.name: 1 for path in (folder / "inputs").iterdir()}
    old_enough = time.time() - 1.0
    for path in (folder / "inputs").iterdir():  # the checksum of a file that was just written is not trusted
        os.utime(path, (old_enough, old_enough))
    time.sleep(0.1)
    alone = ["--workers", "1"] if command == "run" else []
    assert cli.main([command, str(folder), *alone]) == ExitCode.OK
    assert {name: contents[name] for name in files} == files
    assert {name: checksums[name] for name in files} == files


def test_a_check_of_files_that_cannot_be_used_reads_each_once_and_names_all_problems(tmp_path, readings, capsys):
    folder = write_full_site(tmp_path / "ramp")
    write_raster(folder / "inputs" / "thickness.tif", -slab())
    write_raster(folder / "inputs" / "friction.tif", 95.0 + 0 * ramp())
    assert cli.main(["check", str(folder)]) == ExitCode.CONFIGURATION
    said = capsys.readouterr().out
    assert "release[0].raster: inputs/thickness.tif" in said
    assert "terrain.friction_rasters: inputs/friction.tif" in said
    assert readings[0]["dem.tif"] == readings[0]["outline.gpkg"] == 1


def test_another_process_gets_what_this_one_has_read(tmp_path, readings):
    site = read_site(write_site(tmp_path / "ramp"))
    data = site.data()
    copy = pickle.loads(pickle.dumps(site))
    assert np.array_equal(copy.data().terrain.elevation, data.terrain.elevation)
    assert copy.data().releases[0].volume == data.releases[0].volume
    assert readings[0]["dem.tif"] == 1


def test_changed_elevations_are_read_again(tmp_path, readings):
    folder = write_site(tmp_path / "ramp")
    site = read_site(folder)
    before = site.data().terrain.elevation.copy()
    write_raster(folder / "inputs" / "dem.tif", before[::-1] + 1.0)
    assert np.array_equal(site.data().terrain.elevation, before + 1.0)
    assert readings[0]["dem.tif"] == 2


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


def test_other_settings_read_only_what_depends_on_them_again(tmp_path, readings):
    site = read_site(write_full_site(tmp_path / "ramp"))
    site.data()
    before = dict(readings[0])
    assert before["dem.tif"] == before["points.gpkg"] == 1
    site.with_settings(probes=None).data()
    site.on_device("cpu").data()
    assert dict(readings[0]) == before
    other = site.with_settings(probes=site.settings.probes.model_copy(update={"cross_sections": None}))
    assert not other.data().probes.cross_sections
    assert dict(readings[0]) == before | {"points.gpkg": 2}
    terrain = site.settings.terrain.model_copy(update={"obstacles": None})
    flat = [one.terrain().elevation[:, 30:].max() for one in (site, site.with_settings(terrain=terrain))]
    assert flat == [3.0, 0.0]
    assert readings[0]["dem.tif"] == 2
