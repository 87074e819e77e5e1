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
