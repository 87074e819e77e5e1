"""Resident memory of the hazard stage follows the wet cells, and neither the raster nor the caches of the netCDF library."""

import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from synthetic_ensemble import make_terrain, peaks_of, write_member

from runout.io import netcdf
from runout.io.map_layers import WRITE_CACHE, add_layers
from runout.io.member_maps import READ_CACHE, MemberMaps
from runout.model.terrain import Terrain

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="memory as Linux states it")
STAGE = """
import sys
from pathlib import Path
from runout.processes.imports import hide_dask
hide_dask()  # as the command does
import numpy as np, pandas as pd
from runout.hazard.exceedance import aggregate
from runout.hazard.members import Ensemble, members_file
from runout.io import netcdf
from runout.model.terrain import Terrain

written, folder, count = sorted(Path(sys.argv[1]).glob("*.nc")), Path(sys.argv[2]), 40
files = (written * count)[:count]
terrain = Terrain(np.zeros((1000, 1200)), (5.0, 5.0), 0.0, 0.0, None, "flat", ())
table = pd.DataFrame({"weight": [1 / count] * count})
thresholds = {"thickness": [0.1, 0.5, 1, 2], "speed": [1, 5], "pressure": [3e3, 3e4]}
with members_file(Ensemble(table, dict(enumerate(files)), {}), folder / "members.nc", terrain, {}) as members:
    maps = aggregate(files, table["weight"], thresholds, [5, 50, 95], each=members.copy)
    ground = {"elevation": terrain.elevation, "release_thickness": terrain.elevation}
    hazard = netcdf.map_dataset(terrain, ground, title="t").merge(maps)
    members.add_figures(hazard, 0.0)
netcdf.write(hazard, folder / "hazard.nc")
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def resident(folder: Path) -> float:
    """Largest resident memory [byte] of a process that makes members.nc and hazard.nc of the files in a folder."""
    products = folder / "products"
    products.mkdir()
    done = subprocess.run([sys.executable, "-c", STAGE, str(folder), str(products)], capture_output=True, text=True, check=True)
    return 1024.0 * int(done.stdout)


@on_linux
def test_hazard_stage_of_a_million_cells_keeps_below_300_megabytes(tmp_path: Path) -> None:
    terrain, rng = Terrain(np.zeros((1000, 1200)), (5.0, 5.0), 0.0, 0.0, None, "flat", ()), np.random.default_rng(0)
    for number in range(2):
        h = np.zeros(terrain.shape, np.float32)
        h[420:560, 300:900] = 4 * rng.random((140, 600), np.float32)
        maps = {**peaks_of(h, h), "arrival_time": np.where(h > 0, 9 - h, np.nan), "deposit_thickness": h / 2}
        netcdf.write(netcdf.map_dataset(terrain, maps, title="m"), tmp_path / f"{number:04d}.nc")
    assert resident(tmp_path) < 300e6


def test_library_caches_no_more_of_each_map_than_stated(tmp_path: Path) -> None:
    with MemberMaps(write_member(tmp_path, 0, make_terrain())) as member:
        assert {member.file[name].get_var_chunk_cache()[0] for name in member.held()} == {READ_CACHE}
    netcdf.write(netcdf.map_dataset(make_terrain(), {}, title="m"), tmp_path / "written.nc")
    with netCDF4.Dataset(tmp_path / "written.nc", "a") as file:
        assert add_layers(file, "peak_speed", {}).get_var_chunk_cache()[0] == WRITE_CACHE
