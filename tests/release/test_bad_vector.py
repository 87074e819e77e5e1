"""Vector files that cannot be a release: each refused with place, value and remedy."""

import json
import re

import numpy as np
import pandas
import pyogrio
import pytest
import shapely

from runout.errors import ReleaseError
from runout.model.release import Release
from runout.model.terrain import Terrain

SQUARE = shapely.box(50.0, 50.0, 100.0, 100.0)


def refused(path, terrain, *words, **choices):
    """Asserts that the file is refused and that the message holds the words; returns the message."""
    choices = choices or {"thickness": 1.0}
    with pytest.raises(ReleaseError) as caught:
        Release.from_vector(path, terrain, **choices)
    for word in (path.name, *words):
        assert word in str(caught.value)
    return str(caught.value)


def square(west, south, size=20.0):
    return shapely.box(west, south, west + size, south + size)


OUTLINE, HOLE = SQUARE.exterior, square(60.0, 60.0).exterior
DIAMOND = shapely.LinearRing([(50, 75), (75, 50), (100, 75), (75, 100)])
NOT_VALID = {
    "the outline crosses itself": (
        shapely.Polygon([(50, 50), (100, 100), (100, 50), (50, 100)]),
        ("its outline crosses itself", "easting 500075, northing 4000075", "sides do not cross", "makes 2 polygons of 1250 m2"),
    ),
    "the outline touches itself": (
        shapely.Polygon([(50, 50), (75, 75), (100, 50), (100, 100), (75, 75), (50, 100)]),
        ("touches itself", "500075", "split it there", "makes 2 polygons of 1250 m2"),
    ),
    "the outline runs out and back": (
        shapely.Polygon([(50, 50), (100, 50), (100, 100), (100, 140), (100, 100), (50, 100)]),
        ("runs out and back", "delete the corner at the end"),
    ),
    "a hole lies outside": (shapely.Polygon(OUTLINE, [square(200, 50).exterior]), ("hole lies outside", "belongs to the release")),
    "a hole crosses the outline": (shapely.Polygon(OUTLINE, [square(90, 60).exterior]), ("a hole crosses", "QGIS: Difference")),
    "a hole covers it all": (shapely.Polygon(OUTLINE, [OUTLINE]), ("holes cover all of it", "delete the hole")),
    "a hole lies in a hole": (shapely.Polygon(OUTLINE, [HOLE, square(65, 65, 5.0).exterior]), ("hole lies in another", "island")),
    "a hole cuts it into parts": (shapely.Polygon(OUTLINE, [DIAMOND]), ("separate parts", "makes 4 polygons of 1250 m2")),
    "it has no area": (shapely.Polygon([(50, 50), (100, 50), (75, 50)]), ("it has no area", "three corners or more")),
    "it is one point": (shapely.Polygon([(50, 50), (50, 50), (50, 50)]), ("it has no area", "delete it")),
    "two of its parts overlap": (shapely.MultiPolygon([SQUARE, square(90, 60)]), ("two of its parts overlap", "Dissolve")),
    "a part lies in another": (shapely.MultiPolygon([SQUARE, square(60, 60)]), ("lies in another", "count twice")),
}


@pytest.mark.parametrize("case", NOT_VALID)
def test_a_polygon_that_is_not_valid_names_the_place_and_the_remedy_of_its_case(case, write_polygons, terrain):
    polygon, words = NOT_VALID[case]
    message = refused(write_polygons([square(10, 10), polygon]), terrain, "polygon 2 is not valid", "at easting 500", *words)
    mended = shapely.make_valid(polygon)
    assert "-makevalid" not in message or f"{mended.area:.6g} m2" in message


def test_all_polygons_that_are_not_valid_are_named_at_once(write_polygons, terrain):
    path = write_polygons([NOT_VALID["it has no area"][0], SQUARE, NOT_VALID["the outline crosses itself"][0]])
    refused(path, terrain, "polygon 1 is not valid, it has no area", "\n", "polygon 3 is not valid, its outline crosses itself")


def test_points_that_stand_twice_are_no_fault(write_polygons, terrain):
    doubled = shapely.Polygon([(50, 50), (100, 50), (100, 50), (100, 100), (50, 100)])
    assert Release.from_vector(write_polygons([doubled]), terrain, 1.0).volume == pytest.approx(SQUARE.area)


@pytest.mark.parametrize(
    ("ring", "word"), [([(50, 50), (100, 50), (100, 100), (50, 100)], "not closed"), ([(50, 50)], "a line or ring has one point")]
)
def test_a_broken_ring_names_its_feature_and_what_it_lacks(ring, word, write_polygons, terrain):
    path = write_polygons([SQUARE, SQUARE], "release.geojson")
    content = json.loads(path.read_text())
    content["features"][1]["geometry"]["coordinates"] = [ring]
    path.write_text(json.dumps(content))
    refused(path, terrain, "feature 2 has a broken geometry", word, "first point once more")


def test_a_polygon_of_a_hundredth_of_a_cell_asks_for_its_unit(write_polygons, terrain):
    refused(write_polygons([square(50, 50, 0.1)]), terrain, "covers 0.01 m2", "0.0004 of one cell", "check its unit")


@pytest.mark.parametrize(
    ("place", "crs", "words"),
    [
        ((400.0, 50.0), "EPSG:32616", "use a DEM that covers it, or move the polygon"),
        ((9e4, 50.0), "EPSG:32616", "check the coordinate system of both"),
        ((-500_000.0 + 4_000_050.0, -4_000_000.0 + 500_050.0), "EPSG:32616", "easting and northing exchanged"),
        ((-500_000.0 + 9.0, -4_000_000.0 + 46.0), None, "look like degrees"),
    ],
)
def test_a_polygon_outside_the_terrain_names_the_way_back(place, crs, words, write_polygons, terrain):
    refused(write_polygons([square(*place)], crs=crs), terrain, "outside the terrain plane.tif", words)


def test_another_ellipsoid_without_a_datum_names_both_systems_and_the_remedy(write_polygons, terrain):
    path = write_polygons([SQUARE], crs="+proj=utm +zone=16 +ellps=intl +units=m")
    refused(path, terrain, "+ellps=intl", "plane.tif", "EPSG:32616 (WGS 84 / UTM zone 16N)", "names no datum", "ogr2ogr -a_srs")


def test_degrees_on_a_local_terrain_are_refused(write_polygons, terrain):
    local = Terrain(terrain.elevation, terrain.cell_size, source="local.asc")
    refused(write_polygons([SQUARE], crs="EPSG:4326"), local, "in degrees", "local.asc", "terrain.crs")


def test_release_outside_the_terrain_is_refused_with_both_extents(write_polygons, terrain):
    path = write_polygons([shapely.box(1000, 50, 1100, 100)])
    refused(path, terrain, "outside the terrain plane.tif", "easting 501000.00 to 501100.00", "easting 500000.00 to 500300.00")


def test_release_partly_outside_says_where_and_how_far(write_polygons, terrain):
    path = write_polygons([shapely.box(-20.0, 50.0, 60.0, 100.0)])
    refused(path, terrain, "20 m beyond the west edge", "25.0% of its area", "larger DEM")


def test_nodata_under_the_release_names_file_cells_and_fix(write_polygons, terrain):
    z = terrain.elevation.copy()
    z[24, 12] = z[25, 13] = z[0, 0] = np.nan
    holed = Terrain(z, terrain.cell_size, terrain.west, terrain.south, terrain.crs, "holed.tif")
    refused(
        write_polygons([SQUARE]), holed,
        "holed.tif: 2 of 100 cells", "row 24, column 12 (easting 500062.50, northing 4000077.50)", "gdal_fillnodata",
    )  # fmt: skip


def test_negative_thickness_of_a_polygon_is_named(write_polygons, terrain):
    path = write_polygons([SQUARE, shapely.box(0, 0, 10, 10)], depth=[2.0, -1.0])
    refused(path, terrain, "'depth' of polygon 2 is -1 m; it must be at least", thickness="depth")


def test_empty_attribute_of_a_polygon_is_named(write_polygons, terrain):
    path = write_polygons([SQUARE, shapely.box(0, 0, 10, 10)], depth=[2.0, None])
    refused(path, terrain, "'depth' of polygon 2", "every polygon needs a number", thickness="depth")


@pytest.mark.parametrize("depths", [[[], []], [[1, 2], 3], [{}, 1]])
def test_lists_in_place_of_numbers_are_named(depths, write_polygons, terrain):
    """GeoJSON allows them; they are read as arrays, or by older libraries not at all."""
    path = write_polygons([SQUARE, shapely.box(0, 0, 10, 10)], "release.geojson", depth=[0.0, 0.0])
    collection = json.loads(path.read_text(encoding="utf-8"))
    for feature, depth in zip(collection["features"], depths, strict=True):
        feature["properties"]["depth"] = depth
    path.write_text(json.dumps(collection), encoding="utf-8")
    assert re.search(r"'depth' (of polygon 1 is .*needs a number|for the thickness)", refused(path, terrain, thickness="depth"))


def test_missing_attribute_suggests_the_nearest(write_polygons, terrain):
    path = write_polygons([SQUARE], thickness=[2.0], owner=["canton"])
    refused(path, terrain, "'thicknes'", "did you mean 'thickness'?", thickness="thicknes")


def test_neither_thickness_nor_volume_lists_the_attributes(write_polygons, terrain):
    refused(write_polygons([SQUARE], depth=[2.0]), terrain, "neither thickness nor volume", "depth", thickness=None)


@pytest.mark.parametrize("volume", [2500.0 / 1.011, 2500.0 / 0.989])
def test_volume_that_disagrees_by_more_than_one_percent_is_refused(write_polygons, terrain, volume):
    refused(write_polygons([SQUARE]), terrain, "give 2500 m3", f"{volume:.6g} m3", "1.1%", thickness=1.0, volume=volume)


@pytest.mark.parametrize("volume", [0.0, -5.0])
def test_volume_must_be_above_zero(write_polygons, terrain, volume):
    refused(write_polygons([SQUARE]), terrain, f"volume is {volume:g} m3", volume=volume)


def test_overlap_of_different_thickness_is_refused(write_polygons, terrain):
    path = write_polygons([SQUARE, shapely.box(90, 50, 140, 100)], depth=[2.0, 3.0])
    refused(path, terrain, "polygons 1 (2 m) and 2 (3 m) overlap by 500 m2", thickness="depth")


def test_points_and_lines_are_refused(write_polygons, terrain):
    refused(write_polygons([shapely.Point(60, 60)], "point.gpkg"), terrain, "holds Point", "polygons")
    refused(write_polygons([shapely.LineString([(60, 60), (70, 80)])], "line.gpkg"), terrain, "holds LineString")


def test_empty_layer_and_table_without_geometry_are_refused(write_polygons, terrain, tmp_path):
    path = write_polygons([SQUARE])
    empty = tmp_path / "empty.gpkg"
    pyogrio.write_dataframe(pyogrio.read_dataframe(path).iloc[:0], empty, geometry_type="Polygon")
    refused(empty, terrain, "empty")
    table = tmp_path / "table.csv"
    pandas.DataFrame({"thickness": [1.0]}).to_csv(table, index=False)
    refused(table, terrain, "no geometries")


def test_feature_without_geometry_is_named(write_polygons, terrain):
    refused(write_polygons([SQUARE, None]), terrain, "feature 2 has no geometry")


def test_missing_file_suggests_a_neighbour(write_polygons, terrain):
    path = write_polygons([SQUARE])
    refused(path.with_name("realease.gpkg"), terrain, "no such file", "did you mean", "release.gpkg")


def test_file_of_another_kind_is_refused(tmp_path, terrain):
    path = tmp_path / "release.gpkg"
    path.write_text("not a database")
    refused(path, terrain, "cannot be read as a vector file", "use GeoPackage, Shapefile, GeoJSON or FlatGeobuf")


def test_shapefile_without_its_index_is_refused(write_polygons, terrain):
    path = write_polygons([SQUARE], "release.shp")
    path.with_suffix(".shx").unlink()
    refused(path, terrain, ".shx")


def test_several_layers_must_be_named_and_a_wrong_name_is_corrected(write_polygons, terrain):
    path = write_polygons([SQUARE])
    pyogrio.write_dataframe(pyogrio.read_dataframe(path), path, layer="deposit")
    refused(path, terrain, "2 layers (release, deposit)", "layer: ")
    refused(path, terrain, "did you mean 'deposit'", layer="deposits", thickness=1.0)


def test_friction_angle_out_of_range_or_different_among_polygons_is_refused(write_polygons, terrain):
    path = write_polygons([SQUARE, shapely.box(0, 0, 10, 10)], friction=[10.0, 20.0])
    refused(path, terrain, "basal_friction_angle_deg is 75", thickness=1.0, basal_friction_angle_deg=75.0)
    refused(path, terrain, "10 to 20 deg", thickness=1.0, basal_friction_angle_deg="friction")


def test_unknown_placement_lists_the_choices(write_polygons, terrain):
    with pytest.raises(ReleaseError, match="placement is 'below'; choose one of excavated, on_surface"):
        Release.from_vector(write_polygons([SQUARE]), terrain, thickness=1.0, placement="below")


def test_ring_that_does_not_close_is_refused(tmp_path, terrain):
    path = tmp_path / "open.geojson"
    path.write_text('{"type": "Polygon", "coordinates": [[[500050, 4000050], [500060, 4000050], [500060, 4000060]]]}')
    refused(path, terrain)


def test_a_path_with_a_semicolon_is_read_and_one_with_an_exclamation_mark_is_named(write_polygons, terrain):
    path = write_polygons([shapely.box(50, 50, 80, 80)])
    path = path.rename(path.with_name("a;b.gpkg"))
    assert Release.from_vector(path, terrain, thickness=2.0).volume > 0
    path = path.rename(path.with_name("a!b.gpkg"))
    with pytest.raises(ReleaseError, match="rename it or its folder without !"):
        Release.from_vector(path, terrain, thickness=2.0)


@pytest.mark.parametrize("case", ["the outline crosses itself", "a hole crosses the outline", "two of its parts overlap"])
def test_a_polygon_that_is_not_valid_is_refused_in_another_coordinate_system_too(case, write_polygons, terrain):
    polygon, words = NOT_VALID[case]
    path = write_polygons([square(10, 10), polygon], "release.geojson", crs="EPSG:4326")
    refused(path, terrain, "polygon 2 is not valid", words[0])


def test_geojson_with_the_latitude_first_is_refused_with_the_remedy(write_polygons, terrain):
    path = write_polygons([SQUARE], "release.geojson", crs="EPSG:4326")
    stated = json.loads(path.read_text())
    for feature in stated["features"]:
        rings = feature["geometry"]["coordinates"]
        feature["geometry"]["coordinates"] = [[[north, east] for east, north in ring] for ring in rings]
    path.write_text(json.dumps(stated))
    refused(path, terrain, "its coordinates are latitude, longitude", "Swap X and Y coordinates")
