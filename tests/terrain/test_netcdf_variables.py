"""Which variable of a NetCDF file is the elevation, and what its numbers mean."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from runout import Terrain
from runout.errors import DemError
from runout.terrain.netcdf import open_elevation

X, Y = 515000.0 + 20.0 * np.arange(12), 5183000.0 - 20.0 * np.arange(10)
Z = 1500.0 + 3.0 * np.arange(12) + 2.0 * np.arange(10)[:, None]
OTHER = np.full(Z.shape, 7.0) + 0.01 * np.arange(12)


def add(file, name, values, dimensions=("y", "x"), **attributes):
    """Variable that holds the values as they are stored."""
    values = np.asarray(values)
    variable = file.createVariable(name, values.dtype, dimensions, fill_value=attributes.pop("_FillValue", None))
    variable.set_auto_maskandscale(False)
    variable.setncatts(attributes)
    variable[:] = values
    return variable


@pytest.fixture
def file(tmp_path):
    """Open NetCDF file with axes in metres."""
    opened = netCDF4.Dataset(tmp_path / "dem.nc", "w")
    axes(opened)
    yield opened
    if opened.isopen():
        opened.close()


@pytest.fixture
def read(file, tmp_path):
    """Function that closes the file and gives its terrain."""

    def terrain(variable=None):
        if file.isopen():
            file.close()
        path = tmp_path / "dem.nc"
        return Terrain.from_raster(f'NETCDF:"{path}":{variable}' if variable else path)

    return terrain


def axes(group):
    for name, values in (("x", X), ("y", Y)):
        group.createDimension(name, len(values))
        add(group, name, values, (name,), units="m")


@pytest.mark.parametrize(
    ("ground", "other"),
    [
        ("dtm", ("height", {})),
        ("surface", ("height", {})),
        ("bed", ("z", {})),
        ("ground", ("altitude", {})),
        ("elevation", ("dem", {})),
        ("dsm", ("dtm", {})),
        ("topographic__elevation", ("bedrock__elevation", {})),
        ("dem", ("Band1", {"units": "feet"})),
        ("a", ("slope", {"units": "1"})),
        ("dem", ("unnamed", {})),
    ],
)
def test_a_file_with_two_possible_elevations_asks_and_names_both(file, read, ground, other):
    add(file, ground, Z, units="m")
    add(file, other[0], OTHER, **{"units": "m"} | other[1])
    with pytest.raises(DemError) as refused:
        read()
    assert f"cannot tell which variable is the elevation (two-dimensional ones: {ground}, {other[0]})" in str(refused.value)
    assert f"{ground} (m, 1500 to 1551)" in str(refused.value)
    assert f'dem.nc":{ground}, in place of' in str(refused.value)
    for name, values in ((ground, Z), (other[0], OTHER)):
        if other[1].get("units", "m") == "m":
            np.testing.assert_array_equal(read(name).elevation, values)


@pytest.mark.parametrize(
    ("ground", "other"),
    [
        (("dtm", {}), ("height", {"long_name": "vegetation height"})),
        (("dtm", {}), ("height", {"standard_name": "canopy_height"})),
        (("topographic__elevation", {}), ("soil__depth", {})),
        (("elevation", {}), ("elevation_error", {})),
        (("elevation", {}), ("slope", {"units": "degree"})),
        (("Band1", {}), ("tid", {"units": None})),
        (("bed", {"standard_name": "bedrock_altitude"}), ("z", {})),
        (("h", {"standard_name": "surface_altitude"}), ("elevation", {})),
        (("h", {"standard_name": "surface_altitude"}), ("err", {"standard_name": "surface_altitude standard_error"})),
        (("dem", {"ancillary_variables": "spread"}), ("spread", {})),
        (("dem", {}), ("temperature_2m", {"units": "K"})),
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_an_elevation_is_taken_where_nothing_else_can_be_meant(file, read, ground, other, first):
    rows = [(ground, Z), (other, OTHER)]
    for (name, more), values in rows if first else rows[::-1]:
        add(file, name, values, **{k: v for k, v in ({"units": "m"} | more).items() if v})
    np.testing.assert_array_equal(read().elevation, Z)


@pytest.mark.parametrize("attributes", [{"long_name": "GDAL Band Number 1"}, {"units": "1"}, {"units": "m a.s.l."}])
@pytest.mark.parametrize("name", ["Band1", "surface", "z", "dem"])
def test_a_variable_that_is_alone_is_taken_whatever_its_name(file, name, attributes):
    add(file, name, Z, **attributes)
    path = Path(file.filepath())
    file.close()
    with open_elevation(str(path)) as source:
        np.testing.assert_array_equal(source.read(None).values, Z)


@pytest.mark.parametrize(
    ("name", "attributes"),
    [("depth_of_snow", {}), ("slope", {}), ("h", {"standard_name": "canopy_height"}), ("t", {"units": "K"})],
)
def test_a_variable_that_says_another_quantity_is_not_taken_even_if_it_is_alone(file, read, name, attributes):
    add(file, name, OTHER, **{"units": "m"} | attributes)
    with pytest.raises(DemError, match=rf"cannot tell which variable is the elevation \(two-dimensional ones: {name}\)"):
        read()


def test_a_name_that_is_not_in_the_file_is_refused_with_those_that_are(file, read):
    add(file, "dtm", Z)
    with pytest.raises(DemError, match="there is no variable 'dem'; its variables of two dimensions or more: dtm"):
        read("dem")


def test_variables_of_groups_are_named_and_can_be_chosen(file, read):
    for name, values in (("lidar", Z), ("radar", Z + 5.0)):
        group = file.createGroup(name)
        add(group, "elevation", values, units="m")
        add(group, "x", X, ("x",), units="m")
    with pytest.raises(DemError, match=r"groups hold /lidar/elevation, /radar/elevation; name the variable"):
        read()
    np.testing.assert_array_equal(read("/radar/elevation").elevation, Z + 5.0)  # y is that of the file


def test_the_grid_mapping_of_the_file_counts_in_its_groups(file, read):
    file.createVariable("crs", "i4", ()).setncatts({"spatial_ref": "EPSG:32632"})
    group = file.createGroup("a").createGroup("b")
    add(group, "dem", Z, grid_mapping="crs")
    assert "UTM zone 32N" in str(read("/a/b/dem").crs)


@pytest.mark.parametrize(
    ("stored", "attributes", "expected"),
    [
        (Z, {"positive": "up"}, Z),
        (-Z, {"positive": "down"}, Z),
        (-Z, {"standard_name": "sea_floor_depth_below_geoid"}, Z),
        (Z / 0.3048, {"units": "feet"}, Z),
        (-Z / 0.3048, {"units": "ft", "positive": "down"}, Z),
        ((Z * 2 - 3000).astype("i2"), {"scale_factor": 0.5, "add_offset": 1500.0}, Z),
        ((Z - 1500).astype("i1"), {"_Unsigned": "true", "add_offset": 1500.0}, Z),
        ((Z - 1300).astype("u1").view("i1"), {"_Unsigned": "true", "add_offset": 1300.0}, Z),
    ],
)
def test_sign_unit_and_packing_of_the_values_count(file, read, stored, attributes, expected):
    add(file, "elevation", stored, **{"units": "m"} | attributes)
    np.testing.assert_allclose(read().elevation, expected, rtol=1e-6)


def limited(file, kind):
    """Elevations whose cells at row 3 are not valid, by one of the attributes of CF."""
    z = Z.copy()
    z[3] = 4000.0
    packed = ((z - 1500.0) * 10.0).astype("i2")
    packing = {"scale_factor": 0.1, "add_offset": 1500.0}
    cases = {
        "valid_max": (z, {"valid_max": 3999.0}),
        "valid_max in single precision": (z.astype("f4"), {"valid_max": 3999.9}),
        "valid_range": (z, {"valid_range": np.array([0.0, 3000.0])}),
        "valid_min of depths": (-z, {"positive": "down", "valid_min": -3000.0}),
        "valid_max in packed numbers": (packed, packing | {"valid_max": np.int16(2000)}),
        "valid_range in unpacked numbers": (packed, packing | {"valid_range": np.array([1000.0, 2000.0])}),
        "_FillValue": (z, {"_FillValue": 4000.0}),
        "missing_value": (z, {"missing_value": 4000.0}),
        "two missing values": (z, {"missing_value": np.array([-1.0, 4000.0])}),
        "missing_value in packed numbers": (packed, packing | {"missing_value": np.int16(25000)}),
        "valid_max without sign": (
            np.where(z > 3000, 250, (z - 1400.0)).astype("u1").view("i1"),
            {"_Unsigned": "true", "add_offset": 1400.0, "valid_max": np.int8(-56)},  # 200 as a number without sign
        ),
    }
    add(file, "elevation", cases[kind][0], **{"units": "m"} | cases[kind][1])


@pytest.mark.parametrize(
    "kind",
    [
        *("valid_max", "valid_max in single precision", "valid_range", "valid_min of depths", "valid_max in packed numbers"),
        *("valid_range in unpacked numbers", "_FillValue", "missing_value", "two missing values"),
        *("missing_value in packed numbers", "valid_max without sign"),
    ],
)
def test_cells_that_the_file_calls_invalid_are_unknown(file, read, kind):
    limited(file, kind)
    terrain = read()
    assert np.unique(np.argwhere(np.isnan(terrain.elevation))[:, 0]).tolist() == [3]
    np.testing.assert_allclose(np.delete(terrain.elevation, 3, axis=0), np.delete(Z, 3, axis=0), rtol=1e-6)
    assert any("12 cells outside the valid range" in change for change in terrain.changes) == kind.startswith("valid")


def test_a_value_at_the_limit_is_valid(file, read):
    add(file, "elevation", np.where(Z > 1550.0, 1551.1, Z).astype("f4"), valid_max=1551.1)
    assert np.isfinite(read().elevation).all()


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"standard_name": "surface_altitude", "positive": "down"}, "is a surface_altitude with positive = 'down'"),
        ({"standard_name": "sea_floor_depth_below_geoid", "positive": "up"}, "with positive = 'up'"),
        ({"positive": "north"}, "positive = 'north'; it must be up or down"),
        ({"valid_range": np.array([3.0, 1.0])}, "two numbers in order are needed"),
        ({"valid_range": 5.0}, "two numbers in order are needed"),
        ({"valid_max": "high"}, "two numbers in order are needed"),
        ({"scale_factor": 0.0}, "has the scale_factor 0"),
        ({"scale_factor": "a half"}, "scale_factor of 'elevation' is 'a half', not a number"),
        ({"missing_value": "none"}, "missing_value of 'elevation' is 'none', not a number"),
        ({"add_offset": "100"}, "add_offset of 'elevation' is '100', not a number"),
        ({"scale_factor": np.array([1.0, 2.0])}, "cannot be read as NetCDF"),
        ({"valid_range": np.array([np.nan, 1.0])}, "two numbers in order are needed"),
        ({"units": "furlong"}, "elevations are in 'furlong'"),
    ],
)
def test_attributes_that_contradict_themselves_are_refused(file, read, attributes, message):
    add(file, "elevation", Z, **{"units": "m"} | attributes)
    with pytest.raises(DemError, match=message):
        read()


@pytest.mark.parametrize("name", ["depth", "bathymetry", "lake_depth"])
@pytest.mark.parametrize("chosen", [True, False])
def test_a_depth_has_to_say_which_way_it_counts(file, read, tmp_path, name, chosen):
    add(file, name, -Z, units="m")
    with pytest.raises(DemError, match=rf"'{name}' does not say whether it counts upwards or downwards.*ncatted -a positive"):
        read(name if chosen else None)
    with netCDF4.Dataset(tmp_path / "dem.nc", "a") as again:
        again[name].positive = "down"
    np.testing.assert_array_equal(read(name if chosen else None).elevation, Z)


def test_of_several_variables_in_layers_the_elevation_is_named_with_the_command_that_cuts_it(file, read):
    file.createDimension("time", 2)
    add(file, "time", [30.0, 31.0], ("time",), units="days since 2020-01-01", axis="T")
    add(file, "elevation", np.stack([Z, Z]), ("time", "y", "x"), units="m")
    add(file, "temperature", np.stack([OTHER, OTHER]), ("time", "y", "x"), units="K")
    with pytest.raises(DemError, match=r"variable 'elevation' has the dimensions time \(2\), y \(10\), x \(12\); keep one layer"):
        read()


def test_a_variable_of_four_dimensions_is_named_with_the_command_that_cuts_both(file, read):
    file.createDimension("time", 2)
    file.createDimension("member", 3)
    add(file, "elevation", np.tile(Z, (2, 3, 1, 1)), ("time", "member", "y", "x"), units="m")
    add(file, "temperature", np.tile(OTHER, (2, 3, 1, 1)), ("time", "member", "y", "x"), units="K")
    said = r"time \(2\), member \(3\), y \(10\), x \(12\); keep one layer, for example `ncks -d time,0 -d member,0 .*dem.nc "
    with pytest.raises(DemError, match=said):
        read()


def test_a_time_of_one_is_left_out_with_a_word_and_more_are_refused(file, read, tmp_path):
    file.createDimension("time", None)
    add(file, "time", [30.0], ("time",), units="days since 2020-01-01", axis="T")
    add(file, "elevation", Z[None], ("time", "y", "x"), units="m")
    terrain = read()
    np.testing.assert_array_equal(terrain.elevation, Z)
    assert "dimension time of length 1 (30.0) is left out" in terrain.changes
    with netCDF4.Dataset(tmp_path / "dem.nc", "a") as again:
        again["elevation"][1] = Z + 1.0
        again["time"][1] = 31.0
    for name in (None, "elevation"):
        with pytest.raises(DemError, match=r"time \(2\), y \(10\), x \(12\); keep one layer, for example `ncks -d time,0 "):
            read(name)


@pytest.mark.parametrize("dimensions", [("y", "x"), ("x", "y")])
@pytest.mark.parametrize("rows", [1, -1])
@pytest.mark.parametrize("columns", [1, -1])
def test_any_order_of_axes_gives_the_same_terrain(tmp_path, dimensions, rows, columns):
    with netCDF4.Dataset(tmp_path / "dem.nc", "w") as file:
        for name, values in (("x", X[::columns]), ("y", Y[::rows])):
            file.createDimension(name, len(values))
            add(file, name, values, (name,), units="m")
        z = Z[::rows, ::columns]
        add(file, "elevation", z if dimensions == ("y", "x") else z.T, dimensions)
    terrain = Terrain.from_raster(tmp_path / "dem.nc")
    np.testing.assert_array_equal(terrain.elevation, Z)
    assert terrain.extent == (514990.0, 5182810.0, 515230.0, 5183010.0)


def test_packed_coordinates_are_unpacked(tmp_path):
    with netCDF4.Dataset(tmp_path / "dem.nc", "w") as file:
        for name, values, first in (("x", X, X[0]), ("y", Y, Y[-1])):
            file.createDimension(name, len(values))
            packed = ((values - first) / 0.5).astype("i2")
            add(file, name, packed, (name,), units="m", scale_factor=0.5, add_offset=first)
        add(file, "elevation", Z)
    assert Terrain.from_raster(tmp_path / "dem.nc").extent == (514990.0, 5182810.0, 515230.0, 5183010.0)


@pytest.mark.parametrize("suffix", [".nc", ".grd", ".dat"])
@pytest.mark.parametrize("format", ["NETCDF4", "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET"])
def test_the_content_tells_that_a_file_is_netcdf(tmp_path, suffix, format):
    with netCDF4.Dataset(tmp_path / f"dem{suffix}", "w", format=format) as file:
        axes(file)
        add(file, "z", Z)
    np.testing.assert_array_equal(Terrain.from_raster(tmp_path / f"dem{suffix}").elevation, Z)
