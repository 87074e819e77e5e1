"""`runout reproduce hazard.nc`: the maps are made again from what the file says, and what differs is named."""

import hashlib
import json
import shutil

import netCDF4
import numpy as np
import pytest
from ramp_site import SITE, slab, write_raster, write_site

from runout import cli
from runout.errors import ExitCode

SHORT = SITE.replace("end_time: 20", "end_time: 3").replace("members: 4", "members: 2")


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A site with the results of a run whose command line changed a setting; its site.yaml states something else by now."""
    folder = write_site(tmp_path_factory.mktemp("reproduction") / "ramp", SHORT)
    results = folder / "results_8"
    call = ["-q", "run", str(folder), "--workers", "1", "--set", "simulation.cell_size=8", "--out", str(results)]
    assert cli.main(call) == ExitCode.OK
    (folder / "site.yaml").write_text(SHORT.replace("cell_size: 10", "cell_size: 20"))
    return folder


@pytest.fixture
def site(finished, tmp_path):
    """A copy of the finished site."""
    return shutil.copytree(finished, tmp_path / "ramp")


def reproduce(capsys, *arguments):
    """Exit code, and what is printed."""
    capsys.readouterr()
    code = cli.main(["-q", "reproduce", *map(str, arguments), "--workers", "1", "--threads", "1", "--device", "cpu"])
    said = capsys.readouterr()
    return code, said.out.replace("\n", " "), said.err.replace("\n", " ")


def test_maps_are_reproduced_to_the_bit_and_one_that_differs_is_named(site, tmp_path, capsys):
    product, out = site / "results_8" / "hazard.nc", tmp_path / "again"
    code, said, _ = reproduce(capsys, product, "--out", out)
    assert code == ExitCode.OK
    assert "differs" not in said
    assert "equal to the bit" in said
    assert (out / "hazard.nc").is_file()
    with netCDF4.Dataset(product, "a") as file:
        peak = file["peak_flow_thickness"][:].filled(np.nan)
        row, column = np.unravel_index(np.nanargmax(peak), peak.shape)
        file["peak_flow_thickness"][row, column] = peak[row, column] + np.float32(0.25)
        file.setncattr("versions", json.dumps({**json.loads(file.versions), "numba": "0.1"}))
        file.setncattr("source_code_sha256", "0")
    code, said, err = reproduce(capsys, product, "--out", out)
    assert code == ExitCode.CONFIGURATION
    assert "holds members, which would not be run again" in err
    code, said, _ = reproduce(capsys, product)
    assert code == ExitCode.FAILURE
    assert "peak_flow_thickness: 1 of 1200 values differ, by 0.25 at most" in said
    assert "numba: 0.1 made the maps" in said
    assert "source code of runout: 0 made the maps" in said
    assert ": 1 variables differ" in said


def test_an_input_that_has_changed_is_named_with_both_checksums(site, capsys):
    path = site / "inputs" / "thickness.tif"
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    write_raster(path, 1.01 * slab())
    code, _, err = reproduce(capsys, site / "results_8")
    assert code == ExitCode.CONFIGURATION
    now = hashlib.sha256(path.read_bytes()).hexdigest()
    assert f"inputs/thickness.tif: has changed (SHA-256 {before} made the maps, it is {now} now)" in err
    assert "dem.tif" not in err
    path.unlink()
    code, _, err = reproduce(capsys, site / "results_8")
    assert code == ExitCode.CONFIGURATION
    assert "there is no file 'inputs/thickness.tif'" in err
    assert "--site names the folder of the site" in err


def test_maps_that_lie_apart_from_their_site_need_its_folder(site, tmp_path, capsys):
    product = tmp_path / "elsewhere" / "hazard.nc"
    product.parent.mkdir()
    (site / "results_8" / "hazard.nc").rename(product)
    code, _, err = reproduce(capsys, product)
    assert code == ExitCode.CONFIGURATION
    assert "--site names the folder" in err
    assert reproduce(capsys, product, "--site", site)[0] == ExitCode.OK


def test_a_file_without_its_settings_is_refused(site, capsys):
    product = site / "results_8" / "hazard.nc"
    with netCDF4.Dataset(product, "a") as file:
        file.delncattr("site_settings")
    code, _, err = reproduce(capsys, product)
    assert code == ExitCode.FAILURE
    assert "has no attribute site_settings" in err
