"""Elevations of NetCDF files lie where the grid mapping of CF places them, and in the unit of their axes."""

import netCDF4
import numpy as np
import pyproj
import pytest

from runout import Terrain
from runout.errors import DemError

PLACE, UTM = (9.2, 46.8), "EPSG:32632"  # longitude and latitude of the middle of the files [deg]
ROWS, COLUMNS = 24, 30
CENTRAL = {"longitude_of_central_meridian": 9.0, "latitude_of_projection_origin": 46.0}
ORIGIN = {"longitude_of_projection_origin": 9.0, "latitude_of_projection_origin": 46.0}
CONES = CENTRAL | {"standard_parallel": np.array([45.0, 48.0]), "false_easting": 4e5, "false_northing": 3e5}
SATELLITE = {"perspective_point_height": 35785831.0}
MAPPINGS = {
    "albers_conical_equal_area": CONES,
    "albers_conical_equal_area one parallel": CENTRAL | {"standard_parallel": 46.5},
    "azimuthal_equidistant": ORIGIN,
    "geostationary": SATELLITE | ORIGIN | {"latitude_of_projection_origin": 0.0, "sweep_angle_axis": "y"},
    "geostationary fixed": SATELLITE | {"longitude_of_projection_origin": 9.0, "fixed_angle_axis": "y"},
    "lambert_azimuthal_equal_area": ORIGIN | {"false_easting": 4321000.0, "false_northing": 3210000.0},
    "lambert_conformal_conic": CONES,
    "lambert_conformal_conic one parallel": CENTRAL | {"standard_parallel": 46.5},
    "lambert_conformal_conic at its parallel": CENTRAL | {"standard_parallel": 46.0},
    "lambert_cylindrical_equal_area": {"longitude_of_central_meridian": 9.0, "standard_parallel": 46.0},
    "lambert_cylindrical_equal_area scaled": {"longitude_of_central_meridian": 9.0, "scale_factor_at_projection_origin": 0.7},
    "latitude_longitude": {},
    "mercator": {"longitude_of_projection_origin": 9.0, "standard_parallel": 46.0},
    "mercator scaled": {"longitude_of_projection_origin": 9.0, "scale_factor_at_projection_origin": 0.7},
    "oblique_mercator": ORIGIN | {"azimuth_of_central_line": 30.0, "scale_factor_at_projection_origin": 1.0},
    "orthographic": ORIGIN,
    "polar_stereographic": {
        "straight_vertical_longitude_from_pole": 0.0,
        "latitude_of_projection_origin": 90.0,
        "standard_parallel": 70.0,
    },
    "polar_stereographic scaled": {
        "straight_vertical_longitude_from_pole": 0.0,
        "latitude_of_projection_origin": 90.0,
        "scale_factor_at_projection_origin": 0.97,
    },
    "rotated_latitude_longitude": {"grid_north_pole_latitude": 39.25, "grid_north_pole_longitude": -162.0},
    "sinusoidal": {"longitude_of_projection_origin": 9.0},
    "stereographic": ORIGIN | {"scale_factor_at_projection_origin": 0.9999},
    "transverse_mercator": {
        "longitude_of_central_meridian": 9.0,
        "latitude_of_projection_origin": 0.0,
        "scale_factor_at_central_meridian": 0.9996,
        "false_easting": 500000.0,
        "false_northing": 0.0,
    },
    "vertical_perspective": ORIGIN | SATELLITE,
}
FIGURES = {
    "nothing": {},
    "an ellipsoid": {"semi_major_axis": 6377397.155, "inverse_flattening": 299.1528128},
    "a sphere": {"earth_radius": 6371229.0},
    "a datum": {"horizontal_datum_name": "European Terrestrial Reference System 1989"},
    "a datum as GDAL writes it": {"horizontal_datum_name": "World_Geodetic_System_1984", "semi_major_axis": 6378137.0},
}


def ground(easting, northing):
    """Elevation [m] of places in UTM zone 32."""
    u, v = (np.asarray(easting) - 515000.0) / 1000.0, (np.asarray(northing) - 5183000.0) / 1000.0
    return 1500.0 + 300.0 * v + 100.0 * u + 40.0 * np.sin(2 * u) + 30.0 * np.cos(1.5 * v)


def truth(name, figure):
    """System of CF parameters. Two equal parallels are what CF means by one."""
    attributes = {"grid_mapping_name": name.split()[0]} | MAPPINGS[name] | figure
    if name.endswith("one parallel"):
        attributes["standard_parallel"] = [attributes["standard_parallel"]] * 2
    if figure is FIGURES["a datum as GDAL writes it"]:
        attributes["horizontal_datum_name"] = "World Geodetic System 1984"
    return pyproj.CRS.from_wkt(pyproj.CRS.from_cf(attributes).to_wkt())


def axes(system, cell=None):
    """Coordinates of cell centres around the place, the latter from the north, in the unit of the system."""
    to_map = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)
    x, y = to_map.transform(*PLACE)
    unit = system.axis_info[0].unit_conversion_factor
    cell = cell or (np.degrees(1.0) * 3e-6 * np.radians(1.0) / unit if system.is_geographic else 20.0 / unit)
    return x + cell * (np.arange(COLUMNS) - COLUMNS / 2), y - cell * (np.arange(ROWS) - ROWS / 2)


def elevations(system, x, y):
    """Elevation (rows, columns) [m] of the ground at coordinates of a system."""
    return ground(*pyproj.Transformer.from_crs(system, UTM, always_xy=True).transform(*np.meshgrid(x, y)))


def write(path, z, x, y, mapping=None, x_attributes=None, y_attributes=None, **attributes):
    """NetCDF file of elevations (y, x) [m]; the attributes of its grid mapping, of its coordinates, and of the elevations."""
    with netCDF4.Dataset(path, "w") as file:
        for name, values, more in (("x", x, x_attributes or {}), ("y", y, y_attributes or {})):
            file.createDimension(name, len(values))
            file.createVariable(name, np.asarray(values).dtype, (name,))[:] = values
            file[name].setncatts(more)
        file.createVariable("z", "f8", ("y", "x"))[:] = z
        file["z"].setncatts({"units": "m"} | ({"grid_mapping": "crs"} if mapping is not None else {}) | attributes)
        if mapping is not None:
            file.createVariable("crs", "i4", ()).setncatts(mapping)
    return path


def error(terrain):
    """Largest difference [m] of the elevations of a terrain from the ground."""
    to_utm = pyproj.Transformer.from_crs(terrain.crs, UTM, always_xy=True)
    east, north = to_utm.transform(*np.meshgrid(terrain.easting, terrain.northing))
    return np.nanmax(np.abs(terrain.elevation - ground(east, north)))


def units(system):
    """Attributes of x and y in the words of CF."""
    if system.is_derived and system.is_geographic:
        return {"standard_name": "grid_longitude", "units": "degrees"}, {"standard_name": "grid_latitude", "units": "degrees"}
    if system.is_geographic:
        return {"units": "degrees_east"}, {"units": "degrees_north"}
    return {"standard_name": "projection_x_coordinate", "units": "m"}, {"standard_name": "projection_y_coordinate", "units": "m"}


def read(path, system, mapping=None, *, x=None, y=None, **attributes):
    """Terrain of a file whose coordinates of a system are written as x and y."""
    own = axes(system)
    x_attributes, y_attributes = units(system)
    x_attributes |= attributes.pop("x_attributes", {})
    y_attributes |= attributes.pop("y_attributes", {})
    x, y = own[0] if x is None else x(own[0]), own[1] if y is None else y(own[1])
    return Terrain.from_raster(write(path, elevations(system, *own), x, y, mapping, x_attributes, y_attributes, **attributes))


CASES = [(name, list(FIGURES)[k % len(FIGURES)]) for k, name in enumerate(MAPPINGS)]  # each name and each figure, not each pair
CASES += [("latitude_longitude", figure) for figure in FIGURES] + [("lambert_conformal_conic", figure) for figure in FIGURES]


@pytest.mark.parametrize(("name", "figure"), sorted(set(CASES)))
def test_elevations_lie_where_the_parameters_of_cf_place_them(tmp_path, name, figure):
    mapping = {"grid_mapping_name": name.split()[0]} | MAPPINGS[name] | FIGURES[figure]
    terrain = read(tmp_path / "dem.nc", truth(name, FIGURES[figure]), mapping)
    assert terrain.elevation.size > 0.7 * ROWS * COLUMNS
    assert error(terrain) < 0.03
    assert ("names no datum; taken as WGS 84" in "".join(terrain.changes)) == (figure == "nothing")


UTM_32, LATITUDE_LONGITUDE, PARIS = pyproj.CRS(UTM), pyproj.CRS("EPSG:4326"), pyproj.CRS("EPSG:4807")
UTM_OF_CF = {"grid_mapping_name": "transverse_mercator"} | MAPPINGS["transverse_mercator"]
FEET = pyproj.CRS("+proj=tmerc +lon_0=9 +lat_0=46 +datum=WGS84 +units=us-ft")
KILOMETRES = pyproj.CRS("+proj=utm +zone=32 +datum=WGS84 +units=km")


@pytest.mark.parametrize(
    ("system", "mapping", "unit", "factor"),
    [
        (UTM_32, "wkt", "km", 1e-3),
        (UTM_32, "wkt", "kilometers", 1e-3),
        (UTM_32, "wkt", "1000 meter", 1e-3),
        (UTM_32, "wkt", "US_survey_foot", 3937 / 1200),
        (UTM_32, "wkt", "feet", 1 / 0.3048),
        (UTM_32, UTM_OF_CF | {"false_easting": 500.0}, "km", 1e-3),
        (UTM_32, UTM_OF_CF | {"false_easting": 500000.0 / 0.3048}, "ft", 1 / 0.3048),
        (FEET, "wkt", "US_survey_foot", 1.0),
        (FEET, "wkt", "ft", 1.0),
        (FEET, "wkt", "m", 1200 / 3937),
        (pyproj.CRS("+proj=tmerc +lon_0=9 +lat_0=46 +datum=WGS84 +to_meter=1.0000135965"), "wkt", "m", 1.0),
        (KILOMETRES, "wkt", "km", 1.0),
        (KILOMETRES, "wkt", "m", 1e3),
        (LATITUDE_LONGITUDE, "wkt", "radian", np.radians(1.0)),
        (LATITUDE_LONGITUDE, {"grid_mapping_name": "latitude_longitude"}, "arc_second", 3600.0),
        (PARIS, "wkt", "degrees", 0.9),
        (PARIS, "wkt", "grad", 1.0),
    ],
)
def test_the_unit_of_the_axes_counts_whatever_that_of_the_system(tmp_path, system, mapping, unit, factor):
    mapping = {"crs_wkt": system.to_wkt()} if mapping == "wkt" else mapping

    def in_unit(numbers):
        return numbers * factor

    stated = {"units": unit}
    terrain = read(tmp_path / "dem.nc", system, mapping, x=in_unit, y=in_unit, x_attributes=stated, y_attributes=stated)
    assert terrain.elevation.size > 0.7 * ROWS * COLUMNS
    assert error(terrain) < 0.03


def test_axes_of_which_one_is_in_degrees_are_refused(tmp_path):
    x, y = axes(UTM_32)
    path = write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y, None, {"units": "m"}, {"units": "degrees"})
    with pytest.raises(DemError, match="'x' is in 'm', but WGS 84 has coordinates in degree"):
        Terrain.from_raster(path)


def test_axes_of_a_local_grid_become_metres(tmp_path):
    x, y = 0.01 * np.arange(COLUMNS), 0.01 * np.arange(ROWS)[::-1]
    stated = {"units": "km"}
    terrain = Terrain.from_raster(write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y, None, stated, stated))
    assert terrain.crs is None
    assert terrain.extent == pytest.approx((-5.0, -5.0, 295.0, 235.0))
    assert "coordinate x was in km; multiplied by 1000 (metres)" in terrain.changes


@pytest.mark.parametrize(
    ("mapping", "x_attributes", "y_attributes", "message"),
    [
        (UTM_OF_CF, {"units": "km"}, {"units": "km"}, r"outside of transverse mercator.*false_easting.*in the unit of the"),
        ({"crs_wkt": UTM_32.to_wkt()}, {"units": "degrees"}, {"units": "degrees"}, "'x' is in 'degrees', but WGS 84 / UTM"),
        ({"crs_wkt": LATITUDE_LONGITUDE.to_wkt()}, {}, {}, "'x' is in 'm', but WGS 84 has coordinates in degree"),
        (UTM_OF_CF, {"units": "m"}, {"units": "degrees"}, "'y' is in 'degrees', but transverse mercator"),
        ({"crs_wkt": UTM_32.to_wkt()}, {"units": "km"}, {"units": "m"}, "'x' is in 'km', 'y' in 'm'; state both in one unit"),
        (UTM_OF_CF, {"units": "furlong"}, {}, "'x' is in 'furlong'; metres or degrees are needed"),
        (UTM_OF_CF, {"axis": "Y"}, {}, "'x' is told to run along both x and y"),
        ({"grid_mapping_name": "lambert"}, {}, {}, "'crs' is lambert, which is not understood .*crs_wkt"),
        ({"grid_mapping_name": "geostationary"}, {}, {}, "lacks the attribute"),
        ({"earth_model": "round"}, {}, {}, "states no grid_mapping_name"),
        (UTM_OF_CF | {"standard_parallel": 46.0}, {}, {}, "does not use its attribute standard_parallel = 46.0"),
        (UTM_OF_CF | {"horizontal_datum_name": "Atlantis"}, {}, {}, "names the datum 'Atlantis', which PROJ does not know"),
        (UTM_OF_CF | {"crs_wkt": pyproj.CRS("EPSG:32633").to_wkt()}, {}, {}, "longitude_of_central_meridian = 9.0, but its system"),
        (UTM_OF_CF | {"crs_wkt": UTM_32.to_wkt(), "earth_radius": 6371229.0}, {}, {}, "earth_radius = 6371229.0, but its system"),
        (
            {"grid_mapping_name": "vertical_perspective", "false_easting": 500.0} | ORIGIN | SATELLITE,
            {}, {}, "does not use its attribute false_easting",
        ),
        (
            {"grid_mapping_name": "polar_stereographic"} | MAPPINGS["polar_stereographic"] | {"standard_parallel": -70.0},
            {}, {}, "states the pole 90 and the standard_parallel -70",
        ),
    ],
)  # fmt: skip
def test_places_that_contradict_themselves_are_refused(tmp_path, mapping, x_attributes, y_attributes, message):
    def in_km(numbers):
        return numbers / 1000.0 if x_attributes.get("units") == "km" else numbers

    with pytest.raises(DemError, match=message):
        read(tmp_path / "dem.nc", UTM_32, mapping, x=in_km, y=in_km, x_attributes=x_attributes, y_attributes=y_attributes)


@pytest.mark.parametrize("attribute", ["crs_wkt", "spatial_ref", "esri_pe_string", "proj4", "epsg_code", "epsg_code of a number"])
def test_the_system_may_be_a_text_or_a_code(tmp_path, attribute):
    texts = {
        "esri_pe_string": UTM_32.to_wkt("WKT1_ESRI"), "proj4": "+proj=utm +zone=32 +datum=WGS84", "epsg_code": UTM,
        "epsg_code of a number": np.int32(32632),
    }  # fmt: skip
    terrain = read(tmp_path / "dem.nc", UTM_32, {attribute.split()[0]: texts.get(attribute, UTM_32.to_wkt())})
    assert pyproj.CRS(terrain.crs).to_epsg(min_confidence=60) == 32632
    assert error(terrain) < 1e-6


def test_the_datum_of_heights_reaches_the_terrain(tmp_path):
    terrain = read(tmp_path / "dem.nc", UTM_32, UTM_OF_CF | {"geopotential_datum_name": "NAVD88"})
    assert terrain.vertical_datum == "North American Vertical Datum 1988"
    assert error(terrain) < 1e-6


@pytest.mark.parametrize("system", ["+proj=utm +zone=32", "+proj=longlat"])
def test_a_shift_to_wgs_84_counts(tmp_path, system):
    bound = pyproj.CRS(f"{system} +ellps=bessel +towgs84=577,90,463")
    terrain = read(tmp_path / "dem.nc", bound, {"proj4": bound.to_proj4()})
    assert error(terrain) < 0.03


@pytest.mark.parametrize(
    ("text", "known"),
    [("crs: x y", True), ("crs: y x other: lat lon", True), ("other: lat lon crs: x y", True), ("other: lat lon", False)],
)
def test_the_mapping_of_the_own_axes_counts_in_the_extended_form(tmp_path, text, known):
    own = axes(UTM_32)
    path = write(tmp_path / "dem.nc", elevations(UTM_32, *own), *own, UTM_OF_CF, *units(UTM_32), grid_mapping=text)
    with netCDF4.Dataset(path, "a") as file:
        file.createVariable("other", "i4", ()).setncatts({"grid_mapping_name": "latitude_longitude"})
    terrain = Terrain.from_raster(path)
    assert (terrain.crs is not None) == known
    if known:
        assert error(terrain) < 1e-6


def test_a_mapping_that_is_not_in_the_file_is_refused(tmp_path):
    own = axes(UTM_32)
    path = write(tmp_path / "dem.nc", elevations(UTM_32, *own), *own, None, *units(UTM_32), grid_mapping="projection")
    with pytest.raises(DemError, match="names the grid mapping 'projection', which is not in the file"):
        Terrain.from_raster(path)


@pytest.mark.parametrize("stated", ["EPSG:4258", "EPSG:4326"])
def test_the_datum_of_unnamed_degrees_may_be_stated(tmp_path, stated):
    own = axes(LATITUDE_LONGITUDE)
    path = write(tmp_path / "dem.nc", elevations(LATITUDE_LONGITUDE, *own), *own, None, *units(LATITUDE_LONGITUDE))
    assert "coordinates are degrees of an unnamed datum; taken as WGS 84" in Terrain.from_raster(path).changes
    terrain = Terrain.from_raster(path, crs=stated)
    assert f"the file names no datum; {pyproj.CRS(stated).name} as given" in terrain.changes
    assert error(terrain) < 0.03
    with pytest.raises(DemError, match="crs says WGS 84 / UTM zone 32N"):
        Terrain.from_raster(path, crs=UTM)


def test_the_datum_of_a_projection_that_names_none_may_be_stated(tmp_path):
    own = axes(UTM_32)
    path = write(tmp_path / "dem.nc", elevations(UTM_32, *own), *own, UTM_OF_CF, *units(UTM_32))
    terrain = Terrain.from_raster(path, crs="EPSG:25832")
    assert pyproj.CRS(terrain.crs).to_epsg() == 25832
    assert "the file names no datum; ETRS89 / UTM zone 32N as given" in terrain.changes
    with pytest.raises(DemError, match="the file states transverse mercator of its grid mapping, crs says ETRS89 / UTM zone 33N"):
        Terrain.from_raster(path, crs="EPSG:25833")


@pytest.mark.parametrize("system", [UTM_32, LATITUDE_LONGITUDE], ids=["metres", "degrees"])
def test_coordinates_in_single_precision_are_even_to_their_rounding(tmp_path, system):
    x, y = axes(system)
    step = abs(y[1] - y[0])
    terrain = read(tmp_path / "dem.nc", system, {"crs_wkt": system.to_wkt()}, x=np.float32, y=np.float32)
    rounding = max(np.spacing(np.float32(x[0])), np.spacing(np.float32(y[0])))
    assert error(terrain) < 400e-3 * 20.0 * rounding / step + 0.02  # of a slope of at most 0.4, by half of the rounding
    assert any("is stored as float32, which resolves" in change for change in terrain.changes)


def test_coordinates_that_do_not_resolve_a_cell_are_refused(tmp_path):
    x, y = 515000.0 + 0.5 * np.arange(COLUMNS), 5183000.0 + 0.5 * np.arange(ROWS)
    path = write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y.astype(np.float32), UTM_OF_CF, *units(UTM_32))
    with pytest.raises(DemError, match=r"y is stored as float32, which resolves 0.5 there, cells are 0.5 wide; write it in double"):
        Terrain.from_raster(path)


def with_bounds(path, lower, upper):
    with netCDF4.Dataset(path, "a") as file:
        file.createDimension("side", 2)
        file.createVariable("x_bnds", "f8", ("x", "side"))[:] = np.stack([lower, upper], axis=1)
        file["x"].bounds = "x_bnds"
    return path


@pytest.mark.parametrize(("before", "after", "west"), [(10.0, 10.0, -10.0), (0.0, 20.0, 0.0), (20.0, 0.0, -20.0)])
@pytest.mark.parametrize("order", [1, -1], ids=["eastwards", "westwards"])
def test_bounds_say_where_the_edges_of_cells_are(tmp_path, before, after, west, order):
    x, y = axes(UTM_32)
    path = write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x[::order], y, UTM_OF_CF, *units(UTM_32))
    terrain = Terrain.from_raster(with_bounds(path, x[::order] - before, x[::order] + after))
    assert terrain.extent[0] == pytest.approx(x[0] + west, abs=1e-6)
    assert any("x lies 0.5 cells beside the centres of the cells; x_bnds counts" in c for c in terrain.changes) == (before != after)


def test_bounds_of_cells_that_overlap_are_refused(tmp_path):
    x, y = axes(UTM_32)
    path = write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y, UTM_OF_CF, *units(UTM_32))
    with pytest.raises(DemError, match="cells of 'x_bnds', bounds of 'x', do not touch"):
        Terrain.from_raster(with_bounds(path, x - 15.0, x + 15.0))


@pytest.mark.parametrize("order", [1, -1], ids=["north up", "south up"])
@pytest.mark.parametrize("shift", [0.2, 100.0])
def test_a_geotransform_counts_where_it_agrees_with_the_coordinates(tmp_path, order, shift):
    x, y = axes(UTM_32)
    west, north = x[0] - 10.0, y[0] + 10.0
    mapping = {"crs_wkt": UTM_32.to_wkt(), "GeoTransform": f"{west + shift} 20 0 {north + shift} 0 -20"}
    path = write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y.astype(np.float32)[::order], mapping, *units(UTM_32))
    terrain = Terrain.from_raster(path)
    counts = shift < 0.5  # which single precision resolves at this northing
    assert (terrain.extent[0] == west + shift) == counts
    assert any("GeoTransform differs from the coordinates by 100" in change for change in terrain.changes) != counts


@pytest.mark.parametrize("stated", ["514000.0 20.0", "a b c d e f", ""])
def test_a_geotransform_that_is_damaged_does_not_count(tmp_path, stated):
    x, y = axes(UTM_32)
    mapping = {"crs_wkt": UTM_32.to_wkt(), "GeoTransform": stated}
    terrain = Terrain.from_raster(write(tmp_path / "dem.nc", np.ones((ROWS, COLUMNS)), x, y, mapping, *units(UTM_32)))
    assert terrain.extent[0] == pytest.approx(x[0] - 10.0)


@pytest.mark.parametrize("pixel", [0, 1])
def test_files_of_gmt_hold_the_centres_of_cells_in_either_registration(tmp_path, pixel):
    x, y = axes(UTM_32)
    half = 10.0 * pixel
    ranges = ({"actual_range": np.array([v.min() - half, v.max() + half])} for v in (x, y))
    path = write(tmp_path / "dem.grd", elevations(UTM_32, x, y), x, y[::-1], UTM_OF_CF, *ranges)
    with netCDF4.Dataset(path, "a") as file:
        file.node_offset = pixel
        file["z"][:] = elevations(UTM_32, x, y[::-1])
    assert error(Terrain.from_raster(path)) < 1e-6


@pytest.mark.parametrize(
    "more",
    [
        *({"units": word} for word in ("degrees_east", "degree_E", "degreesE")),
        *({key: word} for key, word in (("standard_name", "longitude"), ("axis", "X"), ("_CoordinateAxisType", "Lon"))),
    ],
)
def test_an_axis_is_known_by_each_attribute_that_tells_it(tmp_path, more):
    x, y = axes(LATITUDE_LONGITUDE)
    with netCDF4.Dataset(tmp_path / "dem.nc", "w") as file:
        for name, values in (("a", x), ("b", y)):
            file.createDimension(name, len(values))
            file.createVariable(name, "f8", (name,))[:] = values
        file["a"].setncatts({"units": "degrees"} | more)
        words = {"east": "north", "E": "N", "longitude": "latitude", "X": "Y", "Lon": "Lat"}
        swapped = {key: next(value.replace(w, o) for w, o in words.items() if value.endswith(w)) for key, value in more.items()}
        file["b"].setncatts({"units": "degrees"} | swapped)
        file.createVariable("z", "f8", ("a", "b"))[:] = elevations(LATITUDE_LONGITUDE, x, y).T
    assert error(Terrain.from_raster(tmp_path / "dem.nc")) < 0.03


def test_longitudes_to_the_west_are_turned(tmp_path):
    x, y = axes(LATITUDE_LONGITUDE)
    stated = {"units": "degrees_west"}, {"units": "degrees_north"}
    path = write(tmp_path / "dem.nc", elevations(LATITUDE_LONGITUDE, x, y), -x, y, {"epsg_code": "EPSG:4326"}, *stated)
    assert error(Terrain.from_raster(path)) < 0.03


def with_own_dimensions(path, longitude, latitude, coordinates):
    """File whose dimensions j and i have no coordinates; longitude and latitude have other names, and one or two dimensions."""
    with netCDF4.Dataset(path, "w") as file:
        for name, length in (("j", ROWS), ("i", COLUMNS)):
            file.createDimension(name, length)
        for name, values, unit in (("lon", longitude, "degrees_east"), ("lat", latitude, "degrees_north")):
            dimensions = ("j", "i") if values.ndim == 2 else ("i" if name == "lon" else "j",)
            file.createVariable(name, values.dtype, dimensions)[:] = values
            file[name].units = unit
        file.createVariable("dem", "f8", ("j", "i"))[:] = elevations(LATITUDE_LONGITUDE, *axes(LATITUDE_LONGITUDE))
        if coordinates:
            file["dem"].coordinates = "lat lon"
    return path


@pytest.mark.parametrize("coordinates", [True, False])
@pytest.mark.parametrize("kind", ["one dimension", "two dimensions", "two dimensions in single precision"])
def test_coordinates_of_other_names_count_if_they_are_straight(tmp_path, kind, coordinates):
    longitude, latitude = axes(LATITUDE_LONGITUDE)
    if kind != "one dimension":
        longitude, latitude = np.meshgrid(longitude, latitude)
    dtype = np.float32 if "single" in kind else np.float64
    path = with_own_dimensions(tmp_path / "dem.nc", longitude.astype(dtype), latitude.astype(dtype), coordinates)
    assert error(Terrain.from_raster(path)) < (0.3 if "single" in kind else 0.03)


def test_coordinates_that_bend_are_refused_with_the_command_that_warps_them(tmp_path):
    longitude, latitude = np.meshgrid(*axes(LATITUDE_LONGITUDE))
    path = with_own_dimensions(tmp_path / "dem.nc", longitude + 0.1 * (latitude - PLACE[1]), latitude, True)
    with pytest.raises(DemError, match=r"'dem' has no x coordinate along .*; warp it by .*lon.*: `gdalwarp -geoloc"):
        Terrain.from_raster(path)
