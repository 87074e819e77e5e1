"""The part of a raster that a site needs: its margin around the area within reach, its four sides, and what it is told."""

import numpy as np
import pytest

from runout import read_site
from runout.config import extent as extents
from runout.config.extent import needed_extent
from runout.config.read import load
from runout.errors import DemError


@pytest.fixture
def level_site(edited, site_folder, monkeypatch):
    """A site on 200 x 300 level cells of 10 m, more than are read as a whole; its mass of 4 m lies on the ground."""
    monkeypatch.setattr(extents, "LARGEST_WHOLE", 50_000)
    head = "ncols 300\nnrows 200\nxllcorner 499000\nyllcorner 4999000\ncellsize 10\nNODATA_value -9999\n"
    (site_folder / "inputs" / "dem.asc").write_text(head + (" ".join(["100"] * 300) + "\n") * 200, encoding="utf-8")
    return edited("    thickness: 4.0\n", "    thickness: 4.0\n    placement: on_surface\n")


def test_the_extent_is_the_area_within_reach_and_a_margin(level_site):
    """On level ground 4 m reach 4 m / tan 12 deg = 18.8 m from rim to rim of cells of 14.1 m: three cells more on each side."""
    found = needed_extent(load(level_site), level_site / "site.yaml")
    margin = 16 * 10.0 + 0.05 * 90.0
    np.testing.assert_allclose(found.edges, [500015 - margin, 5000015 - margin, 500105 + margin, 5000105 + margin])
    assert found.sentence == (
        "300 x 200 cells are more than a site reads as a whole (50,000); its extent is derived from the releases and the energy "
        "line at the least friction of 12 deg; terrain.extent sets another one"
    )


def test_the_largest_volume_and_the_least_friction_of_the_ensemble_count(level_site, edited):
    more = "    release_volume_factor: {distribution: uniform, low: 0.5, high: 3}\n"
    edited("  parameters:\n", f"  parameters:\n{more}")
    found = needed_extent(load(level_site), level_site / "site.yaml")
    assert found.edges[0] == pytest.approx(499975 - 16 * 10.0 - 0.05 * 170.0), "12 m reach 56 m at 12 deg: seven cells"
    edited("low: 12, high: 22", "low: 30, high: 45")
    found = needed_extent(load(level_site), level_site / "site.yaml")
    assert found.edges[0] == pytest.approx(500015 - 16 * 10.0 - 0.05 * 90.0), "21 m at 30 deg: three cells"


def test_a_terrain_of_a_part_says_first_how_the_part_was_found(level_site):
    site = read_site(level_site)
    terrain = site.terrain()
    assert terrain.changes[0].endswith("terrain.extent sets another one")
    assert terrain.shape == (42, 42)
    assert (terrain.west, terrain.south) == (499850.0, 4999850.0)


@pytest.mark.parametrize(("east", "north"), [(-5000, 0), (5000, 0), (0, -5000), (0, 5000)])
def test_a_release_beside_the_raster_is_named_whatever_side_it_lies_on(level_site, east, north):
    file = level_site / "inputs" / "release.geojson"
    text = file.read_text(encoding="utf-8")
    for old in (40, 80):
        text = text.replace(f"{5000000 + old}]", f"{5000000 + old + north}]").replace(
            f"[{500000 + old},", f"[{500000 + old + east},"
        )
    file.write_text(text, encoding="utf-8")
    with pytest.raises(DemError, match=r"the releases \[.*\] lie outside \[499000, 4999000, 502000, 5001000\]"):
        needed_extent(load(level_site), level_site / "site.yaml")


def test_sides_that_the_reach_touches_are_those_of_its_two_outermost_rows_and_columns():
    for (row, column), sides in {
        (5, 1): "west", (8, 5): "south", (5, 8): "east", (1, 5): "north", (2, 7): "", (7, 2): "", (0, 0): "west north",
    }.items():  # fmt: skip
        reach = np.zeros((10, 10), bool)
        reach[row, column] = True
        touched = extents._touched(reach)
        assert [name for name, is_it in zip(("west", "south", "east", "north"), touched, strict=True) if is_it] == sides.split()
    whole = (0.0, 10.0, 100.0, 110.0)
    assert [extents._limited(edge, side, whole) for side, edge in enumerate((-5.0, 20.0, 120.0, 90.0))] == [0.0, 20.0, 100.0, 90.0]
