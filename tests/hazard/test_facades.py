"""Forces on structures over weighted members, from records that are worked out by hand."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import xarray as xr
from synthetic_ensemble import CELL, SHAPE, FakeSite, make_table, make_terrain, member_maps

from runout.errors import StorageError
from runout.hazard.members import Ensemble
from runout.hazard.structure_products import (
    FacadeRecords,
    StructureProducts,
    _layers,
    facade_dataset,
    maxima_of,
    overtopping,
    write_facades,
    write_structures,
)
from runout.io import netcdf
from runout.simulation.structure_forces import AXES, GROUP, SERIES
from runout.structures.solid import Solid

SHARES = np.array([0.25, 0.25, 0.5])
TABLE = make_table([1.0, 1.0, 2.0, 1.0, 1.0])  # members 3 and 4 have no result


def series(factor, records=3, area=20.0):
    """Forces on two facades: on the first the largest comes at 2 s, on the second nothing."""
    zeros = np.zeros((records, 2))
    dataset = xr.Dataset(coords={"record_time": ("record", np.arange(records, dtype=float))})
    for name in SERIES:
        dataset[name] = (("record", "facade"), zeros.copy())
    for what, axes in (("force", (3.0, -4.0, 0.0)), ("moment", (0.0, 6.0, 8.0))):
        for axis, value in zip(AXES, axes, strict=True):
            dataset[f"facade_{what}_{axis}"][1:3, 0] = factor * value * np.array([0.5, 1.0])
    dataset["facade_pressure"][1:3, 0] = factor * 1e3 * np.array([1.0, 2.0])
    dataset["facade_high_pressure"][1:3, 0] = factor * 1e3 * np.array([5.0, 4.0])
    dataset["structure_name"] = ("facade", np.array(["house", "house"], object))
    dataset["facade_name"] = ("facade", np.array(["west", "top"], object))
    return dataset.assign(facade_area=("facade", [area, 30.0]))


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    """Three valid members of five, with records of different lengths; the third has half of the weight."""
    folder, terrain, files = tmp_path_factory.mktemp("facades"), make_terrain(), {}
    for number in range(3):
        maps = netcdf.map_dataset(terrain, member_maps(number), title="member")
        files[number] = netcdf.write(maps, folder / f"{number:04d}.nc", groups={GROUP: series(number + 1.0, 3 + number)})
    return Ensemble(TABLE, files, {})


@pytest.fixture(scope="module")
def records(ensemble):
    gathered = FacadeRecords()
    for path in ensemble.files.values():
        gathered.add(path)
    return gathered


def test_maxima_are_sizes_of_vectors_with_the_time_of_the_largest_force():
    maxima = maxima_of(series(2.0))
    assert maxima["max_facade_force"].tolist() == [10.0, 0.0]
    assert maxima["max_facade_moment"].tolist() == [20.0, 0.0]
    assert maxima["max_facade_pressure"].tolist() == [4e3, 0.0]
    assert maxima["max_facade_high_pressure"].tolist() == [10e3, 0.0]
    assert maxima["time_of_max_facade_force"][0] == 2.0
    assert np.isnan(maxima["time_of_max_facade_force"][1]), "nothing pressed on it"


def test_percentiles_and_probabilities_of_facades_take_the_weights_of_valid_members(ensemble, records):
    dataset = facade_dataset(records, ensemble, [25, 50, 75], [1.0, 4e3, 6e3, 7e3])
    assert dataset["max_facade_force"].dims == ("realization", "facade")
    np.testing.assert_array_equal(dataset["max_facade_force"].values[:, 0], [5.0, 10.0, 15.0, np.nan, np.nan])
    assert dataset["facade_force_at_percentile"].values[:, 0].tolist() == [5.0, 10.0, 15.0]
    assert dataset["facade_moment_at_percentile"].values[:, 0].tolist() == [10.0, 20.0, 30.0]
    assert dataset["facade_pressure_at_percentile"].values[:, 0].tolist() == [2e3, 4e3, 6e3]
    assert dataset["facade_high_pressure_at_percentile"].values[:, 0].tolist() == [5e3, 10e3, 15e3]
    assert "time_of_max_facade_force_at_percentile" not in dataset
    assert dataset["facade_pressure_probability"].dims == ("facade", "pressure_threshold")
    assert dataset["facade_pressure_probability"].values.tolist() == [[1.0, 0.75, 0.5, 0.0], [0.0] * 4]
    assert dataset["realization"].values.tolist() == [0, 1, 2, 3, 4]
    assert facade_dataset(records, ensemble, [50], [])["facade_pressure_probability"].shape == (2, 0)


def test_series_of_all_members_stand_in_one_file_and_are_missing_where_they_end(ensemble, records, tmp_path):
    dataset = facade_dataset(records, ensemble, [50], [1.0])
    written = netcdf.read(write_facades(dataset, records.lengths, ensemble, tmp_path / "structures.nc"))
    assert records.lengths == [3, 4, 5]
    assert written["facade_force_east"].dims == ("realization", "record", "facade")
    assert written["facade_force_east"].shape == (5, 5, 2)
    np.testing.assert_array_equal(written["facade_force_east"].values[1, :, 0], [0.0, 3.0, 6.0, 0.0, np.nan])
    np.testing.assert_array_equal(written["record_time"].values[0], [0.0, 1.0, 2.0, np.nan, np.nan])
    assert np.isnan(written["facade_force_east"].values[3:]).all()
    assert written["facade_force_east"].attrs["units"] == "N"
    assert written["facade_pressure_probability"].values[:, 0].tolist() == [1.0, 0.0]


def test_members_with_other_structures_are_refused(records, tmp_path):
    gathered = FacadeRecords(facades=records.facades)
    maps = netcdf.map_dataset(make_terrain(), {}, title="member")
    path = netcdf.write(maps, tmp_path / "0009.nc", groups={GROUP: series(1.0, area=21.0)})
    with pytest.raises(StorageError, match=r"0009\.nc: its structures are not those of the other members"):
        gathered.add(path)


def test_volumes_behind_a_dam_are_weighted_by_the_covered_area_of_cells(ensemble):
    cell = CELL[0] * CELL[1]
    area = np.zeros(SHAPE)
    area[8:12, 5:7] = 0.5 * cell  # below the tongue of the first member
    dataset = overtopping({"village": area, "far": np.zeros(SHAPE)}, ensemble, [50, 75], 1.0)
    wet = [0.5 * cell * member_maps(number)["deposit_thickness"][8:12, 5:7].sum() for number in range(3)]
    np.testing.assert_allclose(dataset["overtopping_volume"].values[:, 0], [*wet, np.nan, np.nan])
    assert wet[2] > wet[1] > wet[0] == 0.0
    np.testing.assert_allclose(dataset["overtopping_volume_at_percentile"].values[:, 0], [wet[1], wet[2]])
    assert dataset["overtopping_probability"].values.tolist() == [0.75, 0.0]
    assert overtopping({"village": area}, ensemble, [50], wet[1])["overtopping_probability"].values.tolist() == [0.75]
    assert overtopping({"village": area}, ensemble, [50], 1.01 * wet[1])["overtopping_probability"].values.tolist() == [0.5]


def house_and_cellar():
    """A house with two facades, and a body in the ground."""
    mesh = trimesh.creation.box((20.0, 10.0, 8.0))
    mesh.apply_translation((200.0, 150.0, 904.0))
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    west = np.asarray(mesh.triangles_center)[:, 0] < 190.1
    return (
        Solid("house", vertices, faces, np.where(west, 0, 1), ("west", "top"), 0.4, "house"),
        Solid("buried", vertices - 100.0, faces, np.zeros(12, int), ("all",), 0.4, "buried"),
    )


def test_layers_hold_the_largest_values_of_facades_and_structures(ensemble, records):
    solids = house_and_cellar()
    layers = _layers(solids, facade_dataset(records, ensemble, [50], [4e3]), make_terrain())
    kind, (house, buried) = layers["structures"]
    assert kind == "MultiPolygon"
    assert (house["name"], house["top_elevation_m"], house["max_force_n"], house["max_pressure_pa"]) == ("house", 908.0, 15.0, 6e3)
    assert (buried["name"], buried["max_force_n"], buried["max_pressure_pa"]) == ("buried", 0.0, 0.0)
    assert house["geometry"].area == pytest.approx(200.0)
    kind, (wall, roof) = layers["facades"]
    assert kind == "MultiLineString"
    assert wall["geometry"].length == pytest.approx(10.0)
    wanted = {
        "structure": "house", "facade": "west", "area_m2": 20.0, "max_force_n": 15.0, "force_n_p50": 10.0, "max_moment_nm": 30.0,
        "moment_nm_p50": 20.0, "max_pressure_pa": 6e3, "pressure_pa_p50": 4e3, "max_high_pressure_pa": 15e3,
        "high_pressure_pa_p50": 10e3, "time_of_max_force_s": 2.0, "probability_of_4000_pa": 0.75,
    }  # fmt: skip
    assert {name: value for name, value in wall.items() if name != "geometry"} == wanted
    assert (roof["facade"], roof["area_m2"], roof["max_force_n"]) == ("top", 30.0, 0.0)


@dataclass(frozen=True)
class SiteWithStructures(FakeSite):
    """A site with a house, and with a village behind it where ``areas`` says so."""

    solids: tuple[Solid, ...] = ()
    areas: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def files(self) -> SimpleNamespace:
        bodies = SimpleNamespace(solids=self.solids, changes=("its faces are turned outwards",))
        return SimpleNamespace(bodies=lambda: bodies, protected_areas=lambda: self.areas)


def site_with(folder, solids, areas):
    settings = SimpleNamespace(
        structures=["inputs/house.gpkg"],
        hazard=SimpleNamespace(percentiles=[25, 50], pressure_thresholds=[4e3]),
        simulation=SimpleNamespace(arrival_threshold=0.1),
    )
    return SiteWithStructures(folder, settings=settings, solids=solids, areas=areas)


def test_products_of_structures_are_a_file_layers_and_what_was_assumed(ensemble, tmp_path):
    area = np.zeros(SHAPE)
    area[8, 5] = 0.5 * CELL[0] * CELL[1]  # 1 m in the second member, 1.5 m in the third
    site = site_with(tmp_path, house_and_cellar(), {"village": area})
    products = write_structures(site, ensemble, make_terrain(), {"creator_name": "A. Name", "history": "now"}, tmp_path)
    assert products.paths == (tmp_path / "structures.nc",)
    assert set(products.layers) == {"structures", "facades"}
    assert products.changes == ("its faces are turned outwards",)
    dataset = netcdf.read(tmp_path / "structures.nc")
    assert dataset.attrs["title"] == "valley: forces on structures"
    assert dataset.attrs["history"] == "now"
    assert dataset["percentile"].values.tolist() == [25.0, 50.0]
    assert dataset["overtopping_probability"].values.tolist() == [0.75]
    np.testing.assert_allclose(dataset["overtopping_volume"].values[:3, 0], [0.0, 60.0, 90.0])


def test_a_volume_counts_as_overtopping_from_the_threshold_of_arrival_on_one_cell(ensemble, tmp_path):
    for depth, probability in ((0.0999, 0.0), (0.1001, 0.5)):
        area = np.zeros(SHAPE)
        area[8, 5] = depth / 1.5 * CELL[0] * CELL[1]
        write_structures(site_with(tmp_path, house_and_cellar(), {"village": area}), ensemble, make_terrain(), {}, tmp_path)
        assert netcdf.read(tmp_path / "structures.nc")["overtopping_probability"].values.tolist() == [probability]


def test_a_site_without_structures_loses_the_file_of_an_earlier_run(ensemble, tmp_path):
    for site in (site_with(tmp_path, (), {}), FakeSite(tmp_path)):
        (tmp_path / "structures.nc").write_bytes(b"old")
        assert write_structures(site, ensemble, make_terrain(), {}, tmp_path) == StructureProducts()
        assert not (tmp_path / "structures.nc").exists()


def test_a_site_without_protected_areas_has_no_overtopping(ensemble, tmp_path):
    write_structures(site_with(tmp_path, house_and_cellar(), {}), ensemble, make_terrain(), {}, tmp_path)
    assert "overtopping_volume" not in netcdf.read(tmp_path / "structures.nc")
