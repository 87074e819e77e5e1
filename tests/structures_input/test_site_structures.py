"""Structures of site.yaml: keys, problems with their lines, checks, and what a change of a file changes."""

import sys
from pathlib import Path

import pytest
import shapely

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import COLUMNS, NORTH, ROWS, WEST, write_site

from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.errors import ConfigError, InputError, StructureError
from runout.workflow import check


def with_structures(folder, text, **features):
    """The site of the ramp with a block of structures, and inputs/houses.gpkg with features if any are given."""
    site = write_site(folder)
    yaml = site / "site.yaml"
    yaml.write_text(yaml.read_text() + "structures:\n" + text)
    if features:
        draw(site, **features)
    return site


def draw(site, shapes, **attributes):
    import geopandas as gpd

    path = site / "inputs" / "houses.gpkg"
    path.unlink(missing_ok=True)
    gpd.GeoDataFrame(attributes, geometry=shapes, crs="EPSG:32632").to_file(path)
    return path


def square(column, row, size):
    """A square, its south-west corner at a column and a row from the south of the terrain, 10 m each."""
    x, y = WEST + 10 * column, NORTH - 10 * ROWS + 10 * row
    return shapely.box(x, y, x + size, y + size)


THIN, HIGH, IN_RELEASE = square(38, 12, 15.0), square(0.9 * COLUMNS, 12, 40.0), square(7, 10, 40.0)


def test_wrong_keys_are_named_with_their_lines(tmp_path):
    text = "  - file: inputs/none.gpkg\n    units: m\n    hieght: 3\n  - file: inputs/dem.obj\n    height: 4\n    crs: EPSG:1\n"
    site = with_structures(tmp_path / "ramp", text)
    with pytest.raises(ConfigError) as caught:
        read_site(site)
    said = [str(problem).split("site.yaml:")[1] for problem in caught.value.problems]
    first = len((site / "site.yaml").read_text().splitlines()) - 5
    assert sorted(said) == sorted([
        f"{first}: structures[0].file: there is no file 'inputs/none.gpkg'; paths are relative to the folder of site.yaml",
        f"{first + 1}: structures[0].units: has no meaning with footprints (inputs/none.gpkg); remove it",
        f"{first + 2}: structures[0].hieght: unknown key; did you mean 'height'?",
        f"{first + 3}: structures[1].units: required key is missing for a mesh; add units: m, cm, mm or ft",
        f"{first + 3}: structures[1].file: there is no file 'inputs/dem.obj'; paths are relative to the folder of site.yaml",
        f"{first + 4}: structures[1].height: has no meaning with a mesh (inputs/dem.obj); remove it",
        f"{first + 5}: structures[1].crs: 'EPSG:1' is not a coordinate reference system; write its code, for example EPSG:32632",
    ])  # fmt: skip


def test_check_lists_all_problems_of_structures_and_the_run_refuses_them(tmp_path):
    values = {"height": [20.0, 8.0], "base": [0, 900]}
    site = with_structures(tmp_path / "ramp", "  - file: inputs/houses.gpkg\n", shapes=[THIN, HIGH], **values)
    (floats,) = check.inspect(site).problems
    assert "feature 2: floats 900 m above the ground" in floats
    draw(site, [THIN, IN_RELEASE], height=[20.0, 30.0])
    thin, overlap = check.inspect(site).problems
    assert "feature 1: a wall is 15 m thick, less than two cells of 10 m" in thin
    assert "feature 2: the structure 'structure 2' overlaps release slab on" in overlap
    with pytest.raises(StructureError, match="a wall is 15 m thick"):
        read_site(site).data()


def test_check_warns_of_structures_lower_than_a_cell(tmp_path):
    text = "  - {file: inputs/houses.gpkg, name: dam}\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(38, 12, 30.0)], height=[4.0])
    found = check.inspect(site, forecast=False)
    assert not found.problems
    assert sum("the structure 'dam' is 4 m high, less than one cell of 10 m" in warning for warning in found.warnings) == 1


def test_structures_of_a_site_go_to_every_member_and_into_its_key(tmp_path):
    text = "  - {file: inputs/houses.gpkg, height: 20, name: house}\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(38, 12, 30.0)])
    read = read_site(site)
    given = read.member_arguments({})["structures"]
    assert given.names == ("house",)
    assert given.field.spacing == 5.0
    assert read.member_arguments({})["structures"] is given
    assert site / "inputs" / "houses.gpkg" in read.inputs()
    before = plan_members(read)[0].key
    draw(site, [square(38, 12, 31.0)])
    assert plan_members(read_site(site))[0].key != before


def test_a_site_without_structures_passes_none_on(tmp_path):
    assert "structures" not in read_site(write_site(tmp_path / "ramp")).member_arguments({})


UNUSABLE = [(shapely.Point(WEST, NORTH), "holds Point"), (square(9000, 0, 10.0), "beyond the terrain")]


@pytest.mark.parametrize(("area", "said"), UNUSABLE)
def test_an_area_behind_a_dam_that_cannot_be_used_is_refused_before_the_run(tmp_path, area, said):
    import geopandas as gpd

    text = "  - file: inputs/houses.gpkg\n    protects: inputs/area.gpkg\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(30, 12, 40.0)], height=[20.0])
    gpd.GeoDataFrame(geometry=[area], crs="EPSG:32632").to_file(site / "inputs" / "area.gpkg")
    assert any(f"area.gpkg: {said}" in problem or said in problem for problem in map(str, check.inspect(site).problems))
    with pytest.raises(InputError, match=said):
        read_site(site).data()


def write_layers(path, **layers):
    import geopandas as gpd

    for name, (shape, attributes) in layers.items():
        gpd.GeoDataFrame({key: [value] for key, value in attributes.items()}, geometry=[shape], crs="EPSG:32632").to_file(
            path, layer=name
        )


def test_problems_of_all_files_come_at_once_with_their_lines_of_site_yaml(tmp_path):
    text = (
        "  - {file: inputs/town.gpkg, protects: inputs/town.gpkg}\n"
        "  - {file: inputs/town.gpkg, layer: house}\n"
        "  - {file: inputs/town.gpkg, layer: dam, height: hight, protects: inputs/town.gpkg, protects_layer: point}\n"
        "  - {file: inputs/open.obj, units: m}\n"
        "  - {file: inputs/town.gpkg, layer: high}\n"
        "  - {file: inputs/town.gpkg, layer: thin}\n"
    )
    site = with_structures(tmp_path / "ramp", text)
    write_layers(
        site / "inputs" / "town.gpkg",
        houses=(square(30, 12, 30.0), {"height": 20.0}), dam=(square(34, 12, 30.0), {"height": 20.0}),
        high=(square(38, 12, 30.0), {"height": 8.0, "base": 900.0}), thin=(THIN, {"height": 8.0}),
        point=(shapely.Point(WEST + 300, NORTH - 100), {"height": 8.0}),
    )  # fmt: skip
    (site / "inputs" / "open.obj").write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 4\n")
    names, first = "houses, dam, high, thin, point", len((site / "site.yaml").read_text().splitlines()) - 5
    path = "inputs/town.gpkg"  # as site.yaml states it
    said = [problem.replace(path, "town.gpkg") for problem in map(str, check.inspect(site).problems)]
    wanted = [
        f"site.yaml:{first}: structures[0].file: town.gpkg: holds 5 layers ({names}); name the one with the structure, for example "
        "layer: houses",
        f"site.yaml:{first + 1}: structures[1].file: town.gpkg: no layer 'house'; did you mean 'houses'? layers: {names}",
        f"site.yaml:{first + 2}: structures[2].file: town.gpkg: no attribute 'hight' for the height; did you mean 'height'? "
        "numeric attributes: height; state height, a number or the name of an attribute",
        f"site.yaml:{first + 3}: structures[3].file: inputs/open.obj: line 4: a face has vertex 4; the file has 3 vertices; "
        "export it again as OBJ, PLY, STL or GLB",
        f"site.yaml:{first + 4}: structures[4].file: town.gpkg: feature 1: floats 900 m above the ground",
        f"site.yaml:{first}: structures[0].protects: town.gpkg: holds 5 layers ({names}); name the one with the protected area, "
        "for example protects_layer: houses",
        f"site.yaml:{first + 2}: structures[2].protects: town.gpkg: holds Point; draw polygons around the protected area",
    ]
    assert len(said) == len(wanted)
    assert all(line.startswith(start) for line, start in zip(said, wanted, strict=True))
    with pytest.raises(StructureError) as caught:
        read_site(site).data()
    assert len(caught.value.problems) == len(wanted)


def test_several_layers_of_a_file_are_structures_and_areas(tmp_path):
    text = (
        "  - {file: inputs/town.gpkg, layer: houses}\n"
        "  - {file: inputs/town.gpkg, layer: dam, protects: inputs/town.gpkg, protects_layer: behind}\n"
    )
    site = with_structures(tmp_path / "ramp", text)
    write_layers(
        site / "inputs" / "town.gpkg",
        houses=(square(30, 12, 30.0), {"height": 20.0, "name": "house"}),
        dam=(square(34, 12, 30.0), {"height": 20.0, "name": "dam"}),
        behind=(square(39, 12, 30.0), {"height": 0.0}),
    )  # fmt: skip
    read = read_site(site)
    assert read.member_arguments({})["structures"].names == ("house", "dam")
    (area,) = read.files.protected_areas().values()
    assert area.sum() == pytest.approx(900.0)
    assert "protects_layer" not in str(read.computed()["structures"])


def test_lines_stay_right_where_another_block_has_a_wrong_key(tmp_path):
    text = "  - {file: inputs/houses.gpkg, height: -1}\n  - {file: inputs/houses.gpkg, layer: nope, height: 4}\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(30, 12, 30.0)], height=[20.0])
    first = len((site / "site.yaml").read_text().splitlines()) - 1
    one, two = map(str, check.inspect(site).problems)
    assert "structures[0].height: -1 m is out of range" in one
    assert two.startswith(f"site.yaml:{first + 1}: structures[1].file: ")


def test_the_same_bodies_twice_are_refused(tmp_path):
    text = "  - {file: inputs/houses.gpkg, height: 20}\n  - {file: inputs/houses.gpkg, height: 30}\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(30, 12, 30.0)])
    with pytest.raises(ConfigError, match=r"structures\[1\]\.file: structures\[0\] states the same bodies; remove one of the two"):
        read_site(site)


def test_a_layer_of_protected_areas_needs_their_file(tmp_path):
    text = "  - {file: inputs/houses.gpkg, height: 20, protects_layer: behind}\n"
    site = with_structures(tmp_path / "ramp", text, shapes=[square(30, 12, 30.0)])
    with pytest.raises(ConfigError, match=r"structures\[0\]\.protects_layer: has no meaning without protects; add protects"):
        read_site(site)


def test_an_empty_file_is_named_once_with_its_line_and_key(tmp_path):
    text = "  - {file: inputs/houses.gpkg, height: 8}\n  - {file: inputs/dam.ply, units: m, protects: inputs/area.gpkg}\n"
    site = with_structures(tmp_path / "ramp", text)
    for name in ("houses.gpkg", "dam.ply", "area.gpkg"):
        (site / "inputs" / name).write_bytes(b"")
    first = len((site / "site.yaml").read_text().splitlines()) - 1
    empty = [(first, 0, "file", "houses.gpkg"), (first + 1, 1, "file", "dam.ply"), (first + 1, 1, "protects", "area.gpkg")]
    assert list(map(str, check.inspect(site).problems)) == [
        f"site.yaml:{line}: structures[{number}].{key}: 'inputs/{name}' is empty (0 bytes); copy or export it again"
        for line, number, key, name in empty
    ]


def test_findings_name_a_problem_once():
    found = check.Findings()
    for error in (InputError("dem.tif: is cut off"), StructureError(["a", "b", "a"]), InputError("dem.tif: is cut off")):
        found.note(error)
    assert found.problems == ["dem.tif: is cut off", "a", "b"]
