"""`runout screen`: the baseline in the products of a run, its balance, and the places on the flow path."""

import json
import os
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from ramp_site import CELL, slab

from runout import Terrain, cli
from runout.errors import ExitCode
from runout.io import netcdf
from runout.slopes.drainage import drainage
from runout.slopes.path_features import Standing, features, flow_path

SITES = Path(__file__).parents[2] / "sites"
FLUX = ("--threshold-flux", "0.2")


@pytest.fixture(scope="module")
def screened(finished_site, tmp_path_factory):
    """Folder of the baseline of the ramp."""
    out = tmp_path_factory.mktemp("screened")
    assert cli.main(["-q", "--out", str(out), "screen", str(finished_site[0]), *FLUX]) == ExitCode.OK
    return out / "screen"


def test_baseline_keeps_its_balance_and_has_the_variables_of_a_run(screened):
    maps, record = netcdf.read(screened / "screen.nc"), json.loads((screened / "screen.json").read_text())
    volumes = record["volumes_m3"]
    assert volumes["released"] == pytest.approx(slab().sum() * CELL**2, rel=1e-6)
    assert volumes["released"] + volumes["eroded"] == pytest.approx(volumes["deposited"] + volumes["left"], rel=1e-9)
    assert volumes["deposited"] == pytest.approx(float(maps["deposit_thickness"].sum()) * CELL**2, rel=1e-5)
    peak, deposit, release = (maps[n].values for n in ("max_flow_thickness", "deposit_thickness", "release_thickness"))
    assert (peak >= np.maximum(deposit, release) - 1e-5).all()
    change = maps["elevation_change"].values
    assert float(change.sum()) * CELL**2 == pytest.approx(-volumes["left"], abs=1.0)
    moved = (np.arange(peak.shape[1]) * peak.sum(axis=0)).sum() / peak.sum()
    assert moved > 10.0  # down the ramp, to the east
    assert not record["still_moving"]
    for name in ("max_flow_thickness", "deposit_thickness", "elevation_change", "release_thickness"):
        with rasterio.open(screened / f"{name}.tif") as file:
            assert file.crs.to_epsg() == 32632
    assert set(geopandas.list_layers(screened / "screen.gpkg")["name"]) >= {"extent", "flow_path"}
    styles = geopandas.read_file(screened / "screen.gpkg", layer="layer_styles")
    assert set(styles["f_table_name"]) == set(geopandas.list_layers(screened / "screen.gpkg")["name"]) - {"layer_styles"}
    assert (screened / "screen.png").read_bytes().startswith(b"\x89PNG")


def test_compare_takes_the_baseline_and_the_site(screened, finished_site, capsys):
    assert cli.main(["-q", "compare", str(screened), str(finished_site[0]), "--threshold", "0.1"]) == ExitCode.OK
    told = capsys.readouterr().out
    assert "flow of 0.1 m: CSI" in told
    assert "deposit" in told


def test_places_on_the_path_are_found():
    """A valley to the south with a step of 40 m, which opens into a plain with a wall."""
    y, x = np.mgrid[:80, :41]
    z = 300.0 - 3.0 * y - 40.0 * (y >= 20) + np.where(y < 50, 8.0 * np.abs(x - 20), 0.1 * np.abs(x - 20))
    terrain = Terrain.from_array(z, 10.0)
    drained = drainage(terrain)
    release, peak = np.zeros(z.shape), np.zeros(z.shape)
    release[3, 20] = 5.0
    peak[3:75, 18:23] = 2.0
    path = flow_path(drained, release, peak, 0.1)
    wall = shapely.box(170.0, 800.0 - 660.0, 240.0, 800.0 - 640.0)
    beside = shapely.translate(wall, 150.0) if hasattr(shapely, "translate") else shapely.box(320.0, 140.0, 390.0, 160.0)
    standing = [Standing("structure", name, outline, 4.0) for name, outline in (("wall", wall), ("shed", beside))]
    found = features(drained, path, peak, standing)
    assert [one.kind for one in found] == ["steep step", "leaves a channel", "structure"]
    step, mouth, structure = found
    assert step.size == pytest.approx(46.0, abs=4.0)
    assert step.distance == pytest.approx(170.0, abs=21.0)
    assert mouth.distance == pytest.approx(470.0, abs=21.0)
    assert (structure.easting, structure.northing, structure.size) == (205.0, 150.0, 2.0)
    assert structure.attributes()["name"] == "wall"
    assert structure.words() == (
        f"structure 'wall', 4 m high, at {structure.distance:.0f} m (easting 205, northing 150): 2 m of flow runs against it"
    )


@pytest.mark.parametrize(
    ("height", "clearance", "thickness", "said"),
    [
        (4.0, None, 5.0, "is higher than it"),
        (6.0, 4.0, 3.0, "runs under it"),
        (6.0, 4.0, 5.0, "fills the opening below it"),
        (-3.0, None, 1.0, "runs into it"),
    ],
)
def test_what_a_flow_meets_is_in_the_words_of_a_structure(height, clearance, thickness, said):
    assert Standing("structure", "dam", shapely.Point(0, 0), height, clearance).meeting(thickness) == said


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (["--critical-slope", "0"], "--critical-slope is 0"),
        (["--resolution", "2"], "finer than the terrain's 10 m"),
        (["--resolution", "-2"], "--resolution is -2 m"),
        (["--resolution", "1e9"], "leaves less than 5 cells"),
    ],
)
def test_bad_parameters_are_one_line(stated, message, finished_site, tmp_path, capsys):
    code = cli.main(["-q", "--out", str(tmp_path), "screen", str(finished_site[0]), *stated])
    told = capsys.readouterr().err
    assert code == ExitCode.CONFIGURATION
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "screen").exists()


def test_a_raster_has_no_release_to_run(tmp_path, capsys):
    assert cli.main(["-q", "screen", str(tmp_path / "dem.tif")]) == ExitCode.CONFIGURATION
    told = capsys.readouterr().err
    assert "is a raster; the baseline needs a site with a release" in told
    assert told.count("\n") == 1


def test_landslide_of_the_tutorial_of_landlab_scores_against_the_observation(tmp_path, capsys):
    observed = Path(os.environ.get("RUNOUT_DATA", "")) / "cascades_2021_landlab" / "DEM_of_Difference.asc"
    if not observed.is_file():
        pytest.skip("validation data cascades_2021_landlab not found; set RUNOUT_DATA to the folder that holds it")
    assert cli.main(["-q", "--out", str(tmp_path), "screen", str(SITES / "cascades_2021")]) == ExitCode.OK
    record = json.loads((tmp_path / "screen" / "screen.json").read_text())
    assert record["volumes_m3"]["released"] == pytest.approx(22480.7, rel=1e-4)
    assert record["volumes_m3"]["left"] == 0.0
    change = tmp_path / "screen" / "elevation_change.tif"
    out = tmp_path / "comparison"
    stated = ["compare", str(change), str(observed), "--quantity", "change", "--nodata", "zero"]
    assert cli.main(["-q", "--out", str(out), *stated]) == ExitCode.OK
    scores = {score["name"]: score["value"] for score in json.loads((out / "comparison.json").read_text())["scores"]}
    assert scores["erosion_volume_bias"] == pytest.approx(1.0, abs=0.05)
    assert scores["deposition_volume_bias"] == pytest.approx(1.0, abs=0.25)
    assert scores["erosion_csi"] > 0.4
    assert scores["deposition_csi"] > 0.25
