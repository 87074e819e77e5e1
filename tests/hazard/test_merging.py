"""Merged maps of several sites, by hand."""

import numpy as np
import pyproj
import pytest
import rasterio
import xarray as xr

from runout import cli
from runout.errors import ConfigError, ExitCode, InputError, StorageError
from runout.hazard.merging import Grid, write_merged
from runout.io import netcdf
from runout.model.terrain import Terrain

UTM = pyproj.CRS("EPSG:32616").to_wkt()


def hazard(folder, name, probability, *, west=0.0, south=0.0, cell=10.0, rate=None, limit=0.5, crs=UTM, ground=None):
    """A hazard.nc with the maps that merging reads: peak thickness of 4 P, arrival of 10 / P."""
    p = np.asarray(probability, float)
    elevation = np.full(p.shape, 100.0) if ground is None else np.asarray(ground, float)
    terrain = Terrain(elevation, (cell, cell), west, south, crs, source=name)
    with np.errstate(divide="ignore"):
        maps = {"elevation": elevation, "inundation_probability": p, "peak_flow_thickness": 4 * p}
        maps["first_arrival_time"] = np.where(p > 0, 10 / p, np.nan)
    dataset = netcdf.map_dataset(terrain, maps, title=name, attrs={"site": name})
    dataset = dataset.assign_coords(thickness_threshold=[limit, 2.0])
    netcdf.add_map(dataset, "thickness_exceedance_probability", np.stack([p, p / 2]), ("thickness_threshold",))
    if rate is not None:
        netcdf.add_map(dataset, "thickness_annual_exceedance", rate * np.stack([p, p / 2]), ("thickness_threshold",))
    return netcdf.write(dataset, folder / name / "results" / "hazard.nc")


A = [[0.5, 0.2, 0.0, 0.0], [0.0, 0.4, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
B = [[0.5, 0.0, 0.0, 0.0], [0.8, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@pytest.fixture
def merged(tmp_path):
    """Two sites of 3 x 4 cells, the second two cells further east and one further south."""
    a = hazard(tmp_path, "a", A, rate=0.1)
    b = hazard(tmp_path, "b", B, west=20.0, south=-10.0, rate=0.01)
    write_merged([a, b], tmp_path / "merged")
    with xr.open_dataset(tmp_path / "merged" / "merged.nc") as file:
        return file.load()


def test_cells_of_two_sites_join_as_by_hand(merged):
    assert merged["inundation_probability"].shape == (4, 6)
    p = merged["inundation_probability"].values
    assert p[0, 0] == pytest.approx(0.5)  # a alone
    assert p[1, 2] == pytest.approx(0.5)  # cell (1, 2) of a, where P is 0, and (0, 0) of b
    assert p[3, 5] == pytest.approx(1.0)
    assert p[2, 2] == pytest.approx(0.8)
    assert merged["thickness_annual_exceedance"].values[0, 2, 2] == pytest.approx(0.01 * 0.8)
    assert list(merged["source_name"].values) == ["a", "b"]
    np.testing.assert_array_equal(merged["main_source"].values[[0, 2, 3], [0, 2, 0]], [1, 2, 0])


def test_where_both_arrive_probabilities_multiply_and_rates_add(tmp_path):
    a, b = hazard(tmp_path, "a", A, rate=0.1), hazard(tmp_path, "b", np.array(A) / 2, rate=0.01)
    write_merged([a, b], tmp_path / "m")
    with xr.open_dataset(tmp_path / "m" / "merged.nc") as file:
        p = np.array(A)
        np.testing.assert_allclose(file["inundation_probability"], 1 - (1 - p) * (1 - p / 2), atol=1e-6)
        np.testing.assert_allclose(file["thickness_exceedance_probability"][1], 1 - (1 - p / 2) * (1 - p / 4), atol=1e-6)
        np.testing.assert_allclose(file["thickness_annual_exceedance"][0], 0.1 * p + 0.01 * p / 2, atol=1e-6)
        np.testing.assert_allclose(file["peak_flow_thickness"], 4 * p, atol=1e-6)
        np.testing.assert_array_equal(file["sources_reached"], 2 * (p > 0))
        np.testing.assert_allclose(file["source_probability"], np.stack([p, p / 2]), atol=1e-6)
        assert file["first_arrival_time"].values[0, 0] == pytest.approx(20.0)
        assert "independent" in file["inundation_probability"].attrs["comment"]


def test_cells_that_no_site_covers_have_no_value_and_those_that_one_covers_have(merged):
    p = merged["inundation_probability"].values
    assert np.isnan(p[0, 4:]).all()
    assert np.isnan(p[3, :2]).all()
    assert np.isfinite(p[1:3, 2:4]).all()
    assert merged["source_probability"].values[0, 3, 5] == 0.0


def test_cells_without_elevation_in_one_site_have_the_value_of_the_other(tmp_path):
    hole = np.where(np.array(A) == 0.2, np.nan, 100.0)
    a = hazard(tmp_path, "a", np.where(np.isnan(hole), np.nan, A), ground=hole)
    b = hazard(tmp_path, "b", A)
    write_merged([a, b], tmp_path / "m")
    with xr.open_dataset(tmp_path / "m" / "merged.nc") as file:
        assert file["inundation_probability"].values[0, 1] == pytest.approx(0.2)


def test_larger_cells_come_to_the_finer_ones_and_the_file_says_so(tmp_path, caplog):
    fine = hazard(tmp_path, "fine", np.zeros((6, 8)), cell=5.0)
    coarse = hazard(tmp_path, "coarse", A, cell=10.0)
    write_merged([coarse, fine], tmp_path / "m")
    with xr.open_dataset(tmp_path / "m" / "merged.nc") as file:
        np.testing.assert_allclose(file["inundation_probability"], np.kron(A, np.ones((2, 2))), atol=1e-6)
        assert file.attrs["changes_of_inputs"] == "brought to cells of 5 x 5 m by the nearest cell: coarse"
    assert "nearest cell: coarse" in caplog.text


def test_shifted_cells_keep_their_place_within_half_a_cell(tmp_path):
    a, b = hazard(tmp_path, "a", np.zeros((3, 4))), hazard(tmp_path, "b", A, west=4.0)
    write_merged([a, b], tmp_path / "m")
    with xr.open_dataset(tmp_path / "m" / "merged.nc") as file:
        at = file["inundation_probability"].sel(x=9.0, y=25.0, method="nearest")
        assert float(at) == pytest.approx(0.5)
        assert "by the nearest cell: b" in file.attrs["changes_of_inputs"]


def test_a_grid_around_others_covers_each_of_them_and_keeps_the_lattice():
    grids = [Grid(3.0, 50.0, (10.0, 10.0), (4, 4), None), Grid(-17.0, 90.0, (10.0, 10.0), (2, 3), None)]
    whole = Grid.around(grids)
    assert whole.edges == (-17.0, 10.0, 43.0, 90.0)
    assert whole.offset(grids[0]) == (4, 2)
    assert whole.offset(grids[1]) == (0, 0)


@pytest.mark.parametrize(
    ("other", "message"),
    [({"crs": pyproj.CRS("EPSG:32617").to_wkt()}, "coordinate systems differ"), ({"crs": None}, "local coordinates")],
)
def test_other_coordinate_systems_are_refused(tmp_path, other, message):
    with pytest.raises(ConfigError, match=message):
        write_merged([hazard(tmp_path, "a", A), hazard(tmp_path, "b", A, **other)], tmp_path / "m")


def test_other_thresholds_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"its thickness_thresholds are 1, 2, those of the first site 0.5, 2"):
        write_merged([hazard(tmp_path, "a", A), hazard(tmp_path, "b", A, limit=1.0)], tmp_path / "m")


def test_a_map_that_one_site_lacks_is_left_out_with_a_sentence(tmp_path, caplog):
    for order in (("a", "b"), ("b", "a")):
        files = {"a": hazard(tmp_path, "a", A, rate=0.1), "b": hazard(tmp_path, "b", A)}
        write_merged([files[name] for name in order], tmp_path / "m")
        with xr.open_dataset(tmp_path / "m" / "merged.nc") as file:
            assert "thickness_annual_exceedance" not in file
        assert "not all sites have thickness_annual_exceedance" in caplog.text
        caplog.clear()


def test_rasters_lie_where_the_maps_lie(merged, tmp_path):
    with rasterio.open(tmp_path / "merged" / "maps" / "inundation_probability.tif") as raster:
        assert raster.crs.to_epsg() == 32616
        assert tuple(raster.bounds) == (0.0, -10.0, 60.0, 30.0)
        np.testing.assert_allclose(raster.read(1, masked=True).filled(np.nan), merged["inundation_probability"])
    with rasterio.open(tmp_path / "merged" / "maps" / "sources" / "b.tif") as raster:
        np.testing.assert_allclose(raster.read(1)[1:, 2:], B, atol=1e-6)
    assert (tmp_path / "merged" / "maps" / "thickness_annual_exceedance_over_2.tif").is_file()


def test_the_command_takes_sites_results_and_files(tmp_path):
    a, b = hazard(tmp_path, "a", A), hazard(tmp_path, "b", B)
    out = tmp_path / "out"
    assert cli.main(["merge", str(a), str(b.parent), str(tmp_path / "b"), "--out", str(out)]) == 0
    with xr.open_dataset(out / "merged.nc") as file:
        assert list(file["source_name"].values) == ["a", "b", "b (2)"]


def test_a_missing_product_names_its_remedy(tmp_path):
    with pytest.raises(InputError, match="`runout run` makes it"):
        write_merged([tmp_path / "hazard.nc"], tmp_path / "m")


def test_another_file_and_a_folder_that_is_a_file_are_refused(tmp_path, capsys):
    product = hazard(tmp_path, "a", A)
    (tmp_path / "note").write_text("x")
    assert cli.main(["merge", str(product), "--out", str(tmp_path / "note")]) == ExitCode.CONFIGURATION
    assert "is a file; name a folder" in capsys.readouterr().err
    other = netcdf.write(netcdf.read(product).drop_vars("inundation_probability"), tmp_path / "other.nc")
    with pytest.raises(StorageError, match="holds no hazard maps"):
        write_merged([other], tmp_path / "m")


def with_danger(path, rates, scheme="swiss_flood"):
    """A hazard.nc with the annual rate (classes,) at which each class is reached wherever P > 0, and its own classes."""
    from runout.config.scheme import read_scheme
    from runout.hazard.danger import DangerClasses, from_rates, with_classes

    with xr.open_dataset(path) as file:
        dataset = file.load()
    record = DangerClasses(read_scheme(scheme), np.ones(1), 0.5).record()
    reached = (dataset["inundation_probability"].values > 0).astype(float)
    dataset = with_classes(dataset, record)
    dataset["class_annual_exceedance"].values[...] = np.array(rates)[:, None, None] * reached
    for name, values in from_rates(dataset["class_annual_exceedance"].values, record).items():
        dataset[name].values[...] = values
    return netcdf.write(dataset, path)


def test_classes_and_levels_follow_from_the_summed_rates_of_the_sources(tmp_path):
    """Each source alone reaches its classes at 1/200 a year: beyond 100 years. Both together do at 1/100."""
    a = with_danger(hazard(tmp_path, "a", A, rate=0.1), [1 / 200, 1 / 200, 0.0])
    b = with_danger(hazard(tmp_path, "b", np.array(A) / 2, rate=0.01), [1 / 200, 0.0, 0.0])
    write_merged([a, b], tmp_path / "m")
    with xr.open_dataset(a) as one, xr.open_dataset(tmp_path / "m" / "merged.nc") as both:
        assert one["intensity_class"].values[:, 0, 0].tolist() == [0, 0, 2]
        assert both["intensity_class"].values[:, 0, 0].tolist() == [0, 1, 2]  # weak at 1/100, medium at 1/200
        np.testing.assert_allclose(both["class_annual_exceedance"].values[:, 0, 0], [1 / 100, 1 / 200, 0.0], rtol=1e-6)
        assert int(one["danger_level"][0, 0]) == 2  # yellow: medium at 300 years
        assert int(both["danger_level"][0, 0]) == 2
        assert int(both["danger_level"][0, 2]) == 0
        assert "sum of the annual rates" in both["danger_level"].attrs["comment"]
    assert (tmp_path / "m" / "maps" / "danger_level.tif").is_file()


def test_the_level_of_two_sources_may_be_above_that_of_each(tmp_path):
    files = [with_danger(hazard(tmp_path, name, A, rate=0.1), [1 / 150, 1 / 150, 0.0]) for name in "ab"]
    write_merged(files, tmp_path / "m")
    with xr.open_dataset(files[0]) as one, xr.open_dataset(tmp_path / "m" / "merged.nc") as both:
        assert (int(one["danger_level"][0, 0]), int(both["danger_level"][0, 0])) == (2, 3)  # medium: yellow at 300, blue at 100


def test_cells_that_no_site_covers_have_no_level(tmp_path):
    a = with_danger(hazard(tmp_path, "a", A, rate=0.1), [0.1, 0.1, 0.1])
    b = with_danger(hazard(tmp_path, "b", B, west=20.0, south=-10.0, rate=0.01), [0.1, 0.1, 0.1])
    write_merged([a, b], tmp_path / "m")
    with xr.open_dataset(tmp_path / "m" / "merged.nc", mask_and_scale=False) as file:
        assert (file["danger_level"].values[0, 4:] == 255).all()
        assert file["danger_level"].values[3, 5] == 4


def test_sites_of_different_schemes_are_refused_and_classes_of_some_sites_are_left_out(tmp_path, caplog):
    a = with_danger(hazard(tmp_path, "a", A, rate=0.1), [0.1, 0.1, 0.1])
    b = with_danger(hazard(tmp_path, "b", A, rate=0.1), [0.1, 0.1], "swiss_debris_flow")
    with pytest.raises(ConfigError, match="its scheme of danger classes is 'Swiss debris flow'"):
        write_merged([a, b], tmp_path / "m")
    write_merged([a, hazard(tmp_path, "c", A, rate=0.1)], tmp_path / "n")
    assert "not all sites have class_annual_exceedance, which is left out" in caplog.text
    with xr.open_dataset(tmp_path / "n" / "merged.nc") as file:
        assert "danger_level" not in file


def test_a_second_call_of_the_same_content_writes_nothing(tmp_path, caplog):
    caplog.set_level("INFO")
    files = [hazard(tmp_path, "a", A), hazard(tmp_path, "b", B)]
    first = write_merged(files, tmp_path / "m")
    times = [path.stat().st_mtime_ns for path in first]
    assert sorted(write_merged(files, tmp_path / "m")) == sorted(first)
    assert [path.stat().st_mtime_ns for path in first] == times
    assert "nothing to do" in caplog.text
    first[1].unlink()  # a raster that somebody removed
    write_merged(files, tmp_path / "m")
    assert first[1].is_file()
    before = (tmp_path / "m" / "merged.nc").stat().st_mtime_ns
    hazard(tmp_path, "b", np.array(B) / 2)
    write_merged(files, tmp_path / "m")
    assert (tmp_path / "m" / "merged.nc").stat().st_mtime_ns != before
