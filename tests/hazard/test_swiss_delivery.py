"""The delivery has the tables, attributes, ranges and constraints of the Swiss model Hazard_Mapping_LV95_V1_2, by hand."""

import geopandas as gpd
import numpy as np
import pyogrio
import pyproj
import pytest

from runout import cli
from runout.config.scheme import read_scheme
from runout.errors import ConfigError, ExitCode
from runout.hazard.danger import DangerClasses
from runout.hazard.swiss_delivery import NAME, Delivery, write_delivery
from runout.io import netcdf
from runout.model.terrain import Terrain

DEBRIS = Delivery("VS", "w_debris_flow", "Made torrent")
INTENSITY = {  # attributes of the class, without those that may be undefined and are
    *("impact_zone", "data_responsibility", "comments", "intensity_class", "process_cantonal_term", "return_period_in_years"),
    *("extreme_scenario", "process_source", "subproc_intensity_by_source", "subscenario_probability", "scenario_description"),
}
PARAMETER = INTENSITY - {"intensity_class", "subproc_intensity_by_source"} | {"method_of_assessment"}
AREA = {
    "impact_zone",
    "data_responsibility",
    "comments",
    "main_process",
    "hazard_level",
    "subprocesses_complete",
    "sources_complete",
}


def hazard(crs=2056, scheme="swiss_debris_flow"):
    """Classes 2 in two cells that touch at a corner, 1 around, at 300 years; 1 in one cell at 30 and 100 years."""
    terrain = Terrain(np.full((4, 5), 900.0), (10.0, 10.0), 2_600_000.0, 1_120_000.0, pyproj.CRS(crs).to_wkt() if crs else None)
    dataset = netcdf.map_dataset(terrain, {"elevation": terrain.elevation}, title="made")
    dataset = DangerClasses(read_scheme(scheme), np.ones(1), 0.1).add_to(dataset)
    classes = np.zeros((3, 4, 5), np.uint8)
    classes[2, 1:3, 1:4] = 1
    classes[2, 1, 1] = classes[2, 2, 2] = 2
    classes[:2, 1, 1] = 1
    periods = dataset.sizes["class_return_period"]
    dataset["intensity_class"].values[...] = np.minimum(classes, len(read_scheme(scheme).classes))[-periods:]
    if "danger_level" in dataset:
        dataset["danger_level"].values[1, 1:3] = 4, 2
        dataset["danger_level"].values[0, 0] = 1
    depth = np.zeros((3, 4, 5), np.float32)
    depth[2, 1:3, 1:4] = 0.7
    depth[2, 1, 1] = 12.0
    dataset = dataset.assign_coords(return_period=[30.0, 100.0, 300.0])
    netcdf.add_map(dataset, "flow_thickness_at_return_period", depth, ("return_period",))
    netcdf.add_map(dataset, "speed_at_return_period", 2 * depth, ("return_period",))
    return dataset


@pytest.fixture(scope="module")
def layers(tmp_path_factory):
    path = write_delivery(hazard(), DEBRIS, tmp_path_factory.mktemp("delivery") / NAME)
    return {name: gpd.read_file(path, layer=name).rename_geometry("impact_zone") for name, _ in pyogrio.list_layers(path)}


def test_layers_have_the_attributes_of_their_classes(layers):
    bands = {f"par_debris_flow_{word}": {f"df_{letter}_{end}_{unit}" for end in ("lower", "upper")} for word, letter, unit in
             (("depth", "h", "m"), ("velocity", "v", "m_s"))}  # fmt: skip
    expected = {"intensity_by_source": INTENSITY, "hazard_area": AREA} | {name: PARAMETER | own for name, own in bands.items()}
    assert {name: set(layer.columns) - {"t_ili_tid"} for name, layer in layers.items()} == expected


def test_values_are_those_of_the_domains(layers):
    rows = layers["intensity_by_source"]
    assert set(rows["intensity_class"]) == {"mean", "high"}
    assert set(rows["data_responsibility"]) == {"VS"}
    assert set(rows["subproc_intensity_by_source"]) == {"w_debris_flow"}
    assert (rows["subscenario_probability"] == 1.0).all()
    assert not rows["extreme_scenario"].any()
    assert rows["return_period_in_years"].between(1, 300).all()
    assert set(layers["hazard_area"]["hazard_level"]) == {"substantial", "slight", "residual_hazard"}
    assert set(layers["hazard_area"]["main_process"]) == {"water"}


def test_texts_are_no_longer_than_the_model_allows_and_identifiers_are_unique(layers):
    most = {"comments": 250, "process_source": 50, "process_cantonal_term": 50, "scenario_description": 400, "t_ili_tid": 120}
    for layer in layers.values():
        assert layer["t_ili_tid"].is_unique
        assert layer["t_ili_tid"].str.endswith(".vs.ch").all()
        for name, length in most.items():
            assert name not in layer or layer[name].dropna().str.len().le(length).all()


def test_surfaces_are_polygons_in_lv95_whose_areas_are_those_of_the_cells(layers):
    for layer in layers.values():
        assert layer.crs.to_epsg() == 2056
        assert set(layer.geom_type) == {"Polygon"}
        assert layer.is_valid.all()
    rows = layers["intensity_by_source"]
    high = rows[rows["intensity_class"] == "high"]
    assert len(high) == 2  # cells that touch at a corner are two surfaces
    assert high.area.tolist() == [100.0, 100.0]
    assert rows[rows["return_period_in_years"] == 300].area.sum() == 600.0
    assert rows[rows["return_period_in_years"] == 30].area.sum() == 100.0


def test_bands_of_depth_and_velocity_hold_the_values_and_end_at_ten(layers):
    depth, velocity = layers["par_debris_flow_depth"], layers["par_debris_flow_velocity"]
    found = {(low, high): area for low, high, area in zip(depth["df_h_lower_m"], depth["df_h_upper_m"], depth.area, strict=True)}
    assert found == {(0.5, 1.0): 500.0, (4.0, 10.0): 100.0}
    assert set(zip(velocity["df_v_lower_m_s"], velocity["df_v_upper_m_s"], strict=True)) == {(1.0, 2.0), (4.0, 10.0)}
    assert set(depth["method_of_assessment"]) == {"model_evaluation"}


def test_parameters_are_those_of_debris_flows_only(tmp_path):
    path = write_delivery(
        hazard(scheme="swiss_rock_avalanche"), Delivery("UR", "r_rock_slide_rock_avalanche", "Scar"), tmp_path / NAME
    )
    names = {name for name, _ in pyogrio.list_layers(path)}
    assert not {name for name in names if name.startswith("par_")}
    assert set(gpd.read_file(path, layer="intensity_by_source")["intensity_class"]) == {"high"}


@pytest.mark.parametrize(("crs", "word"), [(32632, "UTM zone 32N"), (None, "local coordinates"), (21781, "LV03")])
def test_other_systems_than_lv95_are_refused(tmp_path, crs, word):
    with pytest.raises(ConfigError, match=f"{word}.*needs LV95"):
        write_delivery(hazard(crs), DEBRIS, tmp_path / NAME)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("XX", "w_debris_flow", "a"), "canton 'XX'"),
        (("VS", "flow", "a"), "process 'flow'"),
        (("VS", "w_debris_flow", ""), "1 to 50"),
    ],
)
def test_values_that_the_model_does_not_have_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        Delivery(*values)


def test_maps_without_classes_or_with_classes_of_other_schemes_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"state hazard\.scheme"):
        write_delivery(hazard().drop_vars(["intensity_class"]), DEBRIS, tmp_path / NAME)
    with pytest.raises(ConfigError, match="the model has no class reached"):
        write_delivery(hazard(scheme="austria_design_event"), DEBRIS, tmp_path / NAME)


def test_the_command_writes_beside_the_maps_or_to_out(tmp_path):
    whole = hazard()
    netcdf.add_map(whole, "inundation_probability", np.ones((4, 5)))
    netcdf.add_map(whole, "first_arrival_time", np.ones((4, 5)))
    netcdf.write(whole, tmp_path / "site" / "results" / "hazard.nc")
    stated = ["--canton", "VS", "--process", "w_debris_flow", "--source", "Made torrent", "--term", "Murgang"]
    assert cli.main(["deliver", str(tmp_path / "site"), *stated]) == ExitCode.OK
    rows = gpd.read_file(tmp_path / "site" / "results" / NAME, layer="intensity_by_source")
    assert set(rows["process_cantonal_term"]) == {"Murgang"}
    assert cli.main(["deliver", str(tmp_path / "site"), *stated, "--out", str(tmp_path / "out")]) == ExitCode.OK
    assert (tmp_path / "out" / NAME).is_file()
