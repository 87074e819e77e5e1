"""Annual rates over three classes of volume and two sources, equal to a calculation by hand."""

from types import SimpleNamespace

import geopandas
import numpy as np
import pandas as pd
import pytest
import rasterio
from synthetic_ensemble import SHAPE, FakeSite, make_terrain, peaks_of

from runout.config.design_table import DesignTable
from runout.config.schema import EnsembleSettings
from runout.ensemble.design import Design, member_table
from runout.errors import ConfigError, PartialEnsembleError
from runout.hazard.exceedance import aggregate
from runout.hazard.frequency import Frequencies, annual_exceedance, at_return_period
from runout.hazard.maps import OWN_MAP
from runout.hazard.members import Ensemble
from runout.hazard.products import write_products
from runout.hazard.sampling import Estimator, Strata
from runout.io import netcdf

# Source a: return periods of exceedance of 30, 100 and 300 years; source b: one class of 1 / 50 years. By hand, in events a year:
SMALL, MIDDLE, LARGE, OTHER = 1 / 30 - 1 / 100, 1 / 100 - 1 / 300, 1 / 300, 1 / 50
TOTAL = 1 / 30 + 1 / 50
CLASSES = [
    {"name": "small", "exceedance_return_period": 30.0, "releases": ["a"], "parameters": {"release_volume_factor": 0.5}},
    {"name": "middle", "exceedance_return_period": 100.0, "releases": ["a"], "members": 2},
    {"name": "large", "exceedance_return_period": 300.0, "releases": ["a"], "parameters": {"release_volume_factor": 2.0}},
    {"name": "other", "return_period": 50.0, "releases": ["b"]},
]


def settings(scenarios=CLASSES, **more) -> EnsembleSettings:
    return EnsembleSettings.model_validate({"members": 1, "seed": 3, "scenarios": scenarios, **more})


def table_of(scenarios=CLASSES, **more) -> pd.DataFrame:
    table = member_table(settings(scenarios, **more))
    table["file"] = [f"{number:04d}.nc" for number in range(len(table))]
    return table


# Thickness [m] of the five members in four cells: near source a, farther, farthest, and near source b
CELLS = np.array([
    [1.0, 0.0, 0.0, 0.0],  # small
    [2.0, 0.5, 0.0, 0.0],  # middle, first member
    [4.0, 1.5, 0.0, 0.0],  # middle, second member
    [8.0, 3.0, 0.2, 0.0],  # large
    [0.0, 0.0, 0.0, 3.0],  # other
])  # fmt: skip
PLACES = ((3, 4), (5, 30), (20, 45), (36, 7))


def write_members(folder, values=CELLS) -> None:
    for number, thicknesses in enumerate(values):
        thickness = np.zeros(SHAPE)
        for place, value in zip(PLACES, thicknesses, strict=True):
            thickness[place] = value
        maps = peaks_of(thickness, 2.0 * thickness) | {
            "max_flow_thickness": thickness,
            "max_speed": 2.0 * thickness,
            "arrival_time": np.where(thickness > 0, 10.0, np.nan),
            "deposit_thickness": 0.5 * thickness,
        }
        terrain = make_terrain()
        maps = {name: terrain.where_known(layer) for name, layer in maps.items()}
        dataset = netcdf.map_dataset(terrain, maps, title="member", attrs={"member_key": str(number)})
        netcdf.write(dataset, folder / f"{number:04d}.nc")


@pytest.fixture(scope="module")
def products(tmp_path_factory):
    """Products of the five members, and their folder."""
    site = FakeSite(tmp_path_factory.mktemp("classes"))
    (site.folder / "inputs").mkdir()
    (site.folder / "inputs" / "dem.tif").write_bytes(b"elevations")
    site.settings.hazard.return_periods = [20.0, 30.0, 50.0, 100.0, 150.0, 300.0, 1000.0]
    results = site.folder / "results"
    write_members(results / "members")
    write_products(site, results, table_of(), None)
    return netcdf.read(results / "hazard.nc"), results


def in_cells(array, **at) -> list[float]:
    return [float(array.sel(**at).values[place]) for place in PLACES]


def test_weights_and_rates_of_the_classes_are_those_by_hand():
    table = table_of()
    rates = [SMALL, MIDDLE / 2, MIDDLE / 2, LARGE, OTHER]
    np.testing.assert_allclose(table["annual_rate"], rates, rtol=1e-13)
    np.testing.assert_allclose(table["weight"], np.array(rates) / TOTAL, rtol=1e-13)
    assert table["scenario"].tolist() == ["small", "middle", "middle", "large", "other"]
    assert table["a.fails"].tolist() == [1, 1, 1, 1, 0]
    assert table["b.fails"].tolist() == [0, 0, 0, 0, 1]
    assert Design.of(settings()).samples()[1] == {"a.fails": 1.0, "b.fails": 0.0}, "the volume factor is that of the site"


def test_return_period_is_that_of_the_class_and_the_power_law_gives_the_difference_of_two_rates():
    law = {"coefficient": 2.0, "exponent": 0.5}
    one = {"name": "one", "power_law": law | {"low": 100.0, "high": 10_000.0}}
    two = {"name": "two", "power_law": law | {"low": 10_000.0}}
    own = {"name": "own", "return_period": 40.0}, {"name": "rate", "annual_rate": 0.03}
    rates = table_of([one, two, *own])["annual_rate"]
    np.testing.assert_allclose(rates, [2 / 10 - 2 / 100, 2 / 100, 1 / 40, 0.03], rtol=1e-13)


def test_annual_exceedance_of_every_cell_is_that_by_hand(products):
    hazard, _ = products
    rate = hazard["thickness_annual_exceedance"]
    assert rate.attrs["units"] == "year-1"
    assert in_cells(rate, thickness_threshold=0.1) == pytest.approx([1 / 30, 1 / 100, LARGE, OTHER], rel=1e-6)
    assert in_cells(rate, thickness_threshold=1.0) == pytest.approx([1 / 30, MIDDLE / 2 + LARGE, 0.0, OTHER], rel=1e-6)
    assert in_cells(rate, thickness_threshold=2.0) == pytest.approx([1 / 100, LARGE, 0.0, OTHER], rel=1e-6)
    np.testing.assert_allclose(  # a rate is the conditional probability times the rate of all scenarios
        rate.values, TOTAL * hazard["thickness_exceedance_probability"].values, rtol=2e-6
    )
    assert float(rate.sel(thickness_threshold=0.1).values[10, 10]) == 0.0
    assert np.isnan(rate.values[:, -1, -1]).all(), "a cell without elevation has no rate"


def test_joint_condition_has_the_annual_rate_of_the_members_that_meet_it(products):
    hazard, _ = products
    assert in_cells(hazard["joint_annual_exceedance"], joint=1) == pytest.approx([1 / 100, LARGE, 0.0, OTHER], rel=1e-6)


@pytest.mark.parametrize(
    ("years", "thicknesses"),
    [
        (20, [np.nan, np.nan, np.nan, np.nan]),
        (30, [1.0, np.nan, np.nan, np.nan]),
        (50, [1.0, np.nan, np.nan, 3.0]),
        (100, [2.0, 0.5, np.nan, 3.0]),
        (150, [4.0, 1.5, np.nan, 3.0]),  # 1 / 150 = MIDDLE / 2 + LARGE
        (300, [8.0, 3.0, 0.2, 3.0]),
        (1000, [8.0, 3.0, 0.2, 3.0]),
    ],
)
def test_value_at_a_return_period_is_the_largest_one_reached_that_often(products, years, thicknesses):
    hazard, _ = products
    assert in_cells(hazard["flow_thickness_at_return_period"], return_period=years) == pytest.approx(thicknesses, nan_ok=True)
    speeds = [2 * value for value in thicknesses]
    assert in_cells(hazard["speed_at_return_period"], return_period=years) == pytest.approx(speeds, nan_ok=True)
    assert hazard["speed_at_return_period"].attrs["units"] == "m s-1"
    assert "pressure_at_return_period" in hazard


def test_annual_maps_become_rasters_with_styles_and_outlines(products):
    _, results = products
    maps = {path.name for path in (results / "maps").rglob("*.*")}
    wanted = {"thickness_annual_exceedance_over_1.tif", "thickness_annual_exceedance_over_1.qml"}
    wanted |= {"flow_thickness_at_return_period_100.tif", "pressure_at_return_period_300.qml"}
    assert wanted <= maps
    assert all(OWN_MAP.fullmatch(name) for name in maps)
    with rasterio.open(results / "maps" / "return_periods" / "flow_thickness_at_return_period_100.tif") as raster:
        assert [raster.read(1, masked=True)[place] for place in PLACES][:2] == pytest.approx([2.0, 0.5])
    layer = geopandas.read_file(results / "outlines.gpkg", layer="return_periods").set_index("return_period_a")
    cell = 120.0  # [m2]
    assert layer.area.to_dict() == pytest.approx(
        {30: cell, 50: 2 * cell, 100: 3 * cell, 150: 3 * cell, 300: 4 * cell, 1000: 4 * cell}
    )


def test_products_say_what_probabilities_suppose_and_the_rates_of_scenarios(products):
    hazard, results = products
    assert "one of the scenarios" in hazard.attrs["summary"]
    assert "large: 0.00333333" in hazard.attrs["scenarios"]
    assert {"annual_rate", "scenario", "weight"} <= set(netcdf.read(results / "members.nc").data_vars)


def test_without_rates_there_are_no_annual_maps_and_none_can_be_asked_for(tmp_path):
    write_members(tmp_path / "members")
    files = sorted((tmp_path / "members").iterdir())
    hazard = aggregate(files, [1] * 5, {"thickness": [0.1]}, [50.0])
    assert not [name for name in hazard.variables if "annual" in str(name) or "return_period" in str(name)]
    with pytest.raises(ValueError, match="annual rates"):
        aggregate(files, [1] * 5, {"thickness": [0.1]}, [50.0], return_periods=[100.0])
    site = FakeSite(tmp_path)
    (tmp_path / "inputs").mkdir()
    (tmp_path / "inputs" / "dem.tif").write_bytes(b"elevations")
    site.settings.hazard.return_periods = [100.0]
    table = table_of().drop(columns=["annual_rate", "scenario"])
    with pytest.raises(ConfigError, match=r"hazard\.return_periods"):
        write_products(site, tmp_path, table, None)


def test_valid_members_take_over_the_rate_of_those_of_their_scenario_that_failed():
    table = table_of()
    ensemble = Ensemble(table, {0: "a", 2: "c", 3: "d", 4: "e"}, {1: "it failed"})
    rates = [SMALL, MIDDLE, LARGE, OTHER]
    np.testing.assert_allclose(ensemble.frequencies.rate, rates, rtol=1e-13)
    np.testing.assert_allclose(ensemble.weights, np.array(rates) / TOTAL, rtol=1e-13)
    assert ensemble.frequencies.scenario_rates == pytest.approx(
        dict(zip(("small", "middle", "large", "other"), rates, strict=True))
    )
    assert "the weight of each scenario" in ensemble.statement()
    with pytest.raises(PartialEnsembleError, match="scenario large"):
        _ = Ensemble(table, {0: "a", 1: "b", 4: "e"}, {}).weights


def test_formulas_on_arrays_agree_with_a_loop_over_cells():
    rng = np.random.default_rng(5)
    values = np.where(rng.random((9, 4, 6)) < 0.4, 0.0, rng.random((9, 4, 6)))
    values[2, 1, 1] = np.nan
    rate = rng.random(9) * 0.01
    exceedance, level = annual_exceedance(values, 0.4, rate), at_return_period(values, rate, 60.0)
    for place in np.ndindex(4, 6):
        cell = values[(slice(None), *place)]
        if np.isnan(cell).any():
            assert np.isnan([exceedance[place], level[place]]).all()
            continue
        assert exceedance[place] == pytest.approx(rate[cell >= 0.4].sum())
        reached = [v for v in cell if v > 0 and rate[cell >= v].sum() >= 1 / 60]
        assert level[place] == pytest.approx(max(reached, default=np.nan), nan_ok=True)


def test_each_scenario_has_its_own_net_and_keeps_its_members_when_others_change():
    sampled = {"basal_friction_angle_deg": {"distribution": "uniform", "low": 10, "high": 20}}
    one = {
        "name": "one",
        "return_period": 30.0,
        "parameters": {"release_volume_factor": {"distribution": "uniform", "low": 1, "high": 2}},
    }
    two = {"name": "two", "return_period": 300.0, "parameters": {"basal_friction_angle_deg": 12.0}}
    small, large = (
        table_of([one, two], members=16, parameters=sampled),
        table_of([two, one | {"members": 32}], members=16, parameters=sampled),
    )
    columns = ["basal_friction_angle_deg", "release_volume_factor", "seed"]
    first = small[small["scenario"] == "one"][columns].reset_index(drop=True)
    pd.testing.assert_frame_equal(first, large[large["scenario"] == "one"][columns].iloc[:16].reset_index(drop=True))
    for name, low, width in (("basal_friction_angle_deg", 10, 10), ("release_volume_factor", 1, 1)):
        sixteenth = np.floor((first[name] - low) / width * 16)
        assert sorted(sixteenth) == list(range(16)), "a net has one member in each sixteenth of a parameter"
    fixed = small[small["scenario"] == "two"]
    assert set(fixed["basal_friction_angle_deg"]) == {12.0}
    assert fixed["release_volume_factor"].isna().all()
    assert small["seed"].is_unique


def test_error_over_scenarios_is_that_of_their_nets_weighted_by_their_shares():
    sampled = {"basal_friction_angle_deg": {"distribution": "uniform", "low": 10, "high": 20}}
    scenarios = [
        {"name": "one", "annual_rate": 0.03, "members": 16},
        {"name": "two", "annual_rate": 0.01, "members": 3},
        {"name": "rest", "annual_rate": 0.06, "members": 1},
    ]
    table = table_of(scenarios, parameters=sampled)
    estimator = Estimator.of(table, table.index)
    assert isinstance(estimator, Strata)
    assert estimator.blocks == (4, 0, 0)
    rng = np.random.default_rng(1)
    values = rng.random((5, 20)).astype(np.float32)
    limits = np.array([0.3, 0.6], np.float32)
    errors = estimator.spread(values, np.arange(20), 20, limits)
    for k, limit in enumerate(limits):
        hit = values >= limit
        blocks = hit[:, :16].reshape(5, 4, 4).mean(axis=2)
        of_net, p = blocks.var(axis=1, ddof=1) / 4, hit[:, 16:19].mean(axis=1)
        np.testing.assert_allclose(errors[k], np.sqrt(0.3**2 * of_net + 0.1**2 * p * (1 - p) / 3), atol=1e-9)
    some = np.array([0, 3, 7, 16, 18])  # members that have values in a tile; the others have 0
    whole = np.zeros((5, 20), np.float32)
    whole[:, some] = values[:, some]
    np.testing.assert_allclose(
        estimator.spread(values[:, some], some, 20, limits), estimator.spread(whole, np.arange(20), 20, limits), atol=1e-12
    )


def test_rates_and_weights_of_a_table_of_the_user_pass_through():
    rows = DesignTable({"basal_friction_angle_deg": [12.0, np.nan]}, {"annual_rate": [0.03, 0.01], "seed": [5.0, 6.0]}, ["x", "y"])
    table = member_table(EnsembleSettings.model_validate({"table": "members.csv"}).with_rows(rows))
    assert table["weight"].tolist() == [0.75, 0.25]
    assert table["seed"].tolist() == [5, 6]
    assert Frequencies.of(table, [0, 1]).total == pytest.approx(0.04)
    assert "design" not in table.attrs


def test_ensemble_without_scenarios_keeps_its_members_and_columns():
    plain = SimpleNamespace(members=4, seed=1, parameters={})
    assert member_table(plain).columns.tolist() == ["weight", "seed"]
