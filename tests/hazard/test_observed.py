"""Members of an ensemble against observations: weighted means, medians, scar, and the layers that show what was observed."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from synthetic_ensemble import CELL, SHAPE, SOUTH, WEST, FakeSite, make_site, make_table, make_terrain, member_maps, write_member

from runout.config.stated_at import Reading
from runout.errors import StorageError
from runout.hazard.members import Ensemble
from runout.hazard.observed import observed_layers, removed, scored
from runout.hazard.products import write_products
from runout.io import netcdf
from runout.model.release import Placement, Release
from runout.scores.grid import Grid
from runout.scores.observations import Observations
from runout.scores.points import Gauges
from runout.scores.thalweg import Thalweg

WEIGHTS = [1.0, 1.0, 2.0]
SHARES = np.array(WEIGHTS) / 4.0
TERRAIN = make_terrain()
NORTH = SOUTH + SHAPE[0] * CELL[1]


def ensemble_in(folder, factors=None):
    """Three valid members with unequal weights; ``factors`` of their release volumes."""
    table = make_table([*WEIGHTS, 1.0, 1.0])
    if factors:
        table["release_volume_factor"] = [*factors, 1.0, 1.0]
    return Ensemble(table, {number: write_member(folder, number, TERRAIN) for number in range(3)}, {})


def release(placement=Placement.ON_SURFACE):
    thickness = np.zeros(SHAPE)
    thickness[2:5, 6:10] = 5.0
    return Release(thickness, TERRAIN, name="scar", placement=placement)


def scored_with(tmp_path, observed, factors=None, releases=None):
    site = replace(
        FakeSite(tmp_path), settings=SimpleNamespace(hazard=SimpleNamespace(thickness_thresholds=[0.1, 2.5]), inflow=None)
    )
    return scored(observed, site, ensemble_in(tmp_path, factors), TERRAIN, releases or [release()], tmp_path)


def of(stored, group, name):
    """Value of a stored score."""
    (value,) = [score["value"] for score in stored if score["of"] == group and score["name"] == name]
    return value


def test_what_a_release_takes_from_the_ground_is_its_scar_or_the_mass_on_it():
    np.testing.assert_array_equal(removed([release()]), release().thickness)
    dug = release(Placement.EXCAVATED)
    np.testing.assert_array_equal(removed([dug]), dug.excavation)
    assert removed([dug]).max() == 5.0
    np.testing.assert_array_equal(removed([dug, release()], 0.5), 5.0 * (release().thickness > 0))
    np.testing.assert_array_equal(removed([dug], 2.0), dug.excavation, err_msg="a larger mass digs no deeper")
    np.testing.assert_array_equal(removed([release()], 2.0), 2.0 * release().thickness)


def test_maps_are_the_weighted_means_and_their_differences_from_what_was_observed(tmp_path):
    deposit, change = np.full(SHAPE, 0.25), np.full(SHAPE, -0.5)
    observed = Observations(Grid.of(TERRAIN), deposit=deposit, change=change)
    maps = scored_with(tmp_path, observed, factors=(1.0, 2.0, 1.0)).maps
    known = np.isfinite(TERRAIN.elevation)
    deposits = np.array([member_maps(number)["deposit_thickness"] for number in range(3)])
    mean = np.tensordot(SHARES, deposits, 1)
    lowered = release().thickness * (SHARES @ [1.0, 2.0, 1.0])
    wanted = {
        "observed_deposit_thickness": deposit,
        "deposit_thickness_difference": mean - 0.25,
        "observed_elevation_change": change,
        "mean_elevation_change": mean - lowered,
        "elevation_change_difference": mean - lowered + 0.5,
    }
    assert set(maps) == set(wanted)
    for name, values in wanted.items():
        np.testing.assert_allclose(maps[name][known], values[known], rtol=1e-6, atol=1e-6, err_msg=name)
    assert np.isnan(maps["mean_elevation_change"][~known]).all()


def test_the_ensemble_is_scored_by_what_half_of_its_weight_reaches_and_each_member_by_itself(tmp_path):
    rows = slice(2, 14)  # of the third member, which has half of the weight
    west, east = (WEST + column * CELL[0] for column in (5, 20))
    outline = shapely.box(west, NORTH - rows.stop * CELL[1], east, NORTH - rows.start * CELL[1])
    record = scored_with(tmp_path, Observations(Grid.of(TERRAIN), outline=outline)).record
    group = next(score["of"] for score in record["ensemble"]["scores"] if score["of"].endswith("2.5 m"))
    hits = 12 * 15
    assert of(record["ensemble"]["scores"], group, "csi") == pytest.approx(
        hits / (hits + 1)
    )  # one false alarm, the marker of the corner
    assert of(record["members"]["2"], group, "csi") == pytest.approx(hits / (hits + 1))
    assert of(record["members"]["1"], group, "csi") == 0.0
    assert list(record["members"]) == ["0", "1", "2"]
    assert record["probability"] == 0.5
    assert record["energy_line_from"] is None
    assert record["statement"].startswith("observations: outline of the flow, ")


def test_gauges_get_the_weighted_median_and_a_thalweg_starts_at_the_top_of_the_release(tmp_path):
    east, north = WEST + 10.5 * CELL[0], NORTH - 3.5 * CELL[1]  # a cell of all members
    known = {"thickness": np.array([2.0]), "arrival_time": np.array([6.0])}
    line = Thalweg(np.array([(WEST + 65.0, NORTH - 6.0), (WEST + 65.0, SOUTH + 6.0)]))
    observed = Observations(Grid.of(TERRAIN), gauges=Gauges(np.array([east]), np.array([north]), known), thalweg=line)
    record = scored_with(tmp_path, observed).record
    assert of(record["ensemble"]["scores"], "gauges, thickness", "bias") == pytest.approx(
        0.0
    )  # 1, 2, and 3 m with half of the weight
    assert [of(record["members"][m], "gauges, thickness", "bias") for m in "012"] == pytest.approx([-1.0, 0.0, 1.0])
    assert of(record["ensemble"]["scores"], "gauges, arrival time", "arrival_bias") == pytest.approx(1.0)  # 6, 7, 8 s
    assert record["energy_line_from"] == "top of the release"


def test_members_of_another_raster_are_refused(tmp_path):
    grid = Grid(WEST, SOUTH, CELL, (SHAPE[0], SHAPE[1] + 1), source="dem.tif")
    with pytest.raises(StorageError, match=r"0000\.nc: its grid is not that of dem\.tif; remove the members"):
        scored_with(tmp_path, Observations(grid))


def test_layers_hold_what_was_observed():
    grid, outline = Grid.of(TERRAIN), shapely.box(WEST, SOUTH, WEST + 50.0, SOUTH + 50.0)
    gauges = Gauges(np.array([WEST, WEST + 5.0]), np.array([SOUTH, SOUTH + 7.0]), {"speed": np.array([3.0, np.nan])})
    line = Thalweg(np.array([(WEST, SOUTH), (WEST + 30.0, SOUTH + 40.0)]))
    layers = observed_layers(Observations(grid, outline, "deposit", gauges=gauges, thalweg=line))
    assert layers["observed_outline"] == ("MultiPolygon", [{"shows": "deposit", "geometry": outline}])
    kind, (row,) = layers["thalweg"]
    assert (kind, row["length_m"], row["geometry"].length) == ("LineString", 50.0, 50.0)
    kind, rows = layers["gauges"]
    assert kind == "Point"
    assert [(row["label"], row["geometry"].coords[0]) for row in rows] == [
        ("3 m/s", (WEST, SOUTH)),
        ("", (WEST + 5.0, SOUTH + 7.0)),
    ]
    assert rows[0]["speed"] == 3.0
    assert np.isnan(rows[1]["speed"])
    assert observed_layers(Observations(grid)) == {}


def test_products_of_a_site_with_observations_hold_their_maps_and_scores(tmp_path, monkeypatch):
    site, results = make_site(tmp_path)
    observed = Observations(Grid.of(TERRAIN), deposit=np.full(SHAPE, 0.25), changes=("deposit.tif: turned north up.",))
    files = SimpleNamespace(**{**vars(site.files), "observations": lambda: Reading(observed)})
    monkeypatch.setattr(FakeSite, "files", files)
    write_products(site, results, make_table(), {0: "done", 1: "done", 2: "left", 3: "failed", 4: "left"})
    hazard, record = netcdf.read(results / "hazard.nc"), json.loads((results / "run.json").read_text())
    deposits = [member_maps(number)["deposit_thickness"] for number in range(2)]
    known = np.isfinite(TERRAIN.elevation)
    difference = hazard["deposit_thickness_difference"].values
    np.testing.assert_allclose(difference[known], (np.mean(deposits, axis=0) - 0.25)[known], rtol=1e-6)
    assert list(record["observations"]["members"]) == ["0", "1"]
    assert "deposit.tif: turned north up." in record["changes"]
    assert (results / "maps" / "observed" / "observed_deposit_thickness.tif").is_file()
