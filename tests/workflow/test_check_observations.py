"""What `runout check` says of observations that score nothing, hold elevations, or more than any release can leave."""

import geopandas
import numpy as np
import pytest
import shapely
from ramp_site import NORTH, SITE, WEST, ramp, slab, write_raster, write_site

from runout.errors import ConfigError
from runout.workflow.check import inspect

DEPOSIT = "observations:\n  deposit: {raster: inputs/deposit.tif}\n"
CHANGE = "observations:\n  difference: {raster: inputs/dod.tif, detection_limit: 0.5}\n"
GAUGES = "observations:\n  gauges: {points: inputs/gauges.gpkg, speed: v}\n"
FLAT = np.zeros((24, 50))


def laid(thickness, rows=slice(6, 18), columns=slice(30, 36)):
    """A deposit (rows, columns) [m] on 72 cells of 100 m2 by default; the slab holds 28 800 m3."""
    found = FLAT.copy()
    found[rows, columns] = thickness
    return found


def warned(folder, text, **rasters):
    """Warnings of the observations of a site."""
    write_site(folder, SITE + text, elevation=ramp() + 300.0)
    for name, values in rasters.items():
        write_raster(folder / "inputs" / f"{name}.tif", values)
    found = inspect(folder)
    assert found.problems == []
    return [warning for warning in found.warnings if ": observations" in warning]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (FLAT, "no cell has a deposit: all known values are 0; check the file, or remove the key"),
        (ramp() + 300.0, "its values of 300 to 441.5 m are elevations, like those of"),
        (ramp() + 300.0 + laid(4.0) - slab(), "elevations, like those of"),  # after the event
        (ramp() + 320.0, "elevations, like those of"),  # of another datum
        ((ramp() + 300.0) / 0.3048, "times the release of 2.88e+04 m3; check its values, their unit"),
        (laid(41.0), "2.95e+05 m3 above the ground, 10.2 times the release of 2.88e+04 m3"),
    ],
)
def test_a_deposit_that_cannot_be_one_gets_one_warning_with_its_place(tmp_path, values, said):
    (warning,) = warned(tmp_path / "ramp", DEPOSIT, deposit=values)
    assert warning.startswith("site.yaml:19: observations.deposit.raster: inputs/deposit.tif: ")
    assert said in warning
    assert str(tmp_path) not in warning


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (FLAT + 1e6, "1.2e+11 m3 above the ground, 4.17e+06 times the release"),
        (FLAT - 1e6, "1.2e+11 m3 below the ground, 4.17e+06 times the release"),
        (laid(-41.0), "2.95e+05 m3 below the ground, 10.2 times the release"),
        (laid(-900.0, slice(7, 8), slice(30, 31)), "its largest value is 900 m, more than relief and release together (149 m)"),
        (np.where(np.arange(1200).reshape(24, 50) == 7, 2000.0, laid(1.0)), "its largest value is 2e+03 m, more than relief"),
        (laid(0.501) * (np.arange(50) < 31), None),
        ((laid(0.6) - laid(0.6, columns=slice(20, 21))) * (np.arange(24) == 7)[:, None], None),
        (laid(0.6, slice(7, 8), slice(30, 33)), "it holds only 180 m3 above the ground, 0.00625 times the release of 2.88e+04 m3"),
        (-laid(0.6, slice(7, 8), slice(30, 33)), "it holds only 180 m3 below the ground, 0.00625 times the release of 2.88e+04 m3"),
        (-ramp() - 300.0, "its values of -441.5 to -300 m are elevations"),
    ],
)
def test_a_difference_out_of_proportion_gets_a_warning_on_both_sides(tmp_path, values, said):
    found = warned(tmp_path / "ramp", CHANGE, dod=values)
    assert len(found) == (said is not None)
    assert all(said in warning for warning in found)


@pytest.mark.parametrize("values", [laid(4.0), laid(39.0), np.where(laid(1.0) > 0, 3.0, np.nan)])
def test_a_deposit_that_a_release_can_leave_gets_none(tmp_path, values):
    assert warned(tmp_path / "ramp", DEPOSIT, deposit=values) == []


def test_a_deposit_on_ground_near_sea_level_is_not_taken_for_elevations(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE + DEPOSIT)  # the plain lies at 0 m
    write_raster(folder / "inputs" / "deposit.tif", laid(4.0))
    assert not any(": observations" in warning for warning in inspect(folder).warnings)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (FLAT, "no cell shows a change: all known values are 0"),
        (0.3 * laid(1.0), "the largest is 0.3 m, the detection_limit 0.5 m"),
        (ramp() + 300.0, "are elevations"),
        (laid(41.0) - slab(), "10.2 times the release"),
    ],
)
def test_a_dem_of_difference_that_cannot_be_one_gets_one_warning(tmp_path, values, said):
    (warning,) = warned(tmp_path / "ramp", CHANGE, dod=values)
    assert "observations.difference.raster: inputs/dod.tif: " in warning
    assert said in warning


def test_a_dem_of_difference_of_a_scar_and_a_deposit_gets_none(tmp_path):
    assert warned(tmp_path / "ramp", CHANGE, dod=laid(4.0) - slab()) == []


@pytest.mark.parametrize(
    ("reaches", "line", "said"),
    [
        ("3", False, "observations.difference: reaches need the line along which they lie; add thalweg: {line: FILE}"),
        ("0", True, "observations.difference.reaches: "),
        ("[100]", True, "observations.difference.reaches: "),
        ("[0, 300, 200]", True, "200 m follows 300 m; state the lengths along the thalweg in ascending order"),
        ("[0, 300, 441]", True, "observations.difference.reaches: reaches: 441 m is not on the thalweg, which is 440 m long"),
        ("[0, 300, 440]", True, None),
        ("4", True, None),
    ],
)
def test_reaches_that_are_not_on_a_thalweg_get_one_line_with_key_and_remedy(tmp_path, reaches, line, said):
    text = CHANGE.replace("0.5}", f"0.5, reaches: {reaches}}}") + line * "  thalweg: {line: inputs/thalweg.gpkg}\n"
    folder = write_site(tmp_path / "ramp", SITE + text)
    write_raster(folder / "inputs" / "dod.tif", laid(4.0) - slab())
    drawn = shapely.LineString([(WEST + 50, NORTH - 120), (WEST + 490, NORTH - 120)])
    geopandas.GeoDataFrame(geometry=[drawn], crs="EPSG:32632").to_file(folder / "inputs" / "thalweg.gpkg")
    problems = inspect(folder).problems
    assert len(problems) == (said is not None), problems
    assert all(said in problem and problem.startswith("site.yaml:19: ") for problem in problems)


def test_reaches_are_not_blamed_for_a_thalweg_whose_file_is_missing(tmp_path):
    text = CHANGE.replace("0.5}", "0.5, reaches: 3}") + "  thalweg: {line: inputs/none.gpkg}\n"
    folder = write_site(tmp_path / "ramp", SITE + text)
    write_raster(folder / "inputs" / "dod.tif", laid(4.0) - slab())
    found = inspect(folder)
    assert ["inputs/none.gpkg" in problem for problem in found.problems].count(True) == 1
    assert not [problem for problem in found.problems if "reaches" in problem]


def test_an_observation_with_a_fault_is_not_called_missing(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE + CHANGE.replace("0.5}", "-0.5}"))
    write_raster(folder / "inputs" / "dod.tif", laid(4.0) - slab())
    found = inspect(folder)
    assert len(found.problems) == 1
    assert not [warning for warning in found.warnings if "nothing is scored" in warning]


@pytest.mark.parametrize(("speeds", "said"), [([0.0, 0.0], "is 0 at all 2 points"), ([0.0, None], "is 0"), ([3.0, None], "")])
def test_gauges_without_any_value_get_a_warning(tmp_path, speeds, said):
    folder = write_site(tmp_path / "ramp", SITE + GAUGES)
    places = [shapely.Point(WEST + x, NORTH - 120.0) for x in (150, 250)]
    geopandas.GeoDataFrame({"v": speeds}, geometry=places, crs="EPSG:32632").to_file(folder / "inputs" / "gauges.gpkg")
    found = [warning for warning in inspect(folder).warnings if ": observations" in warning]
    assert len(found) == bool(said)
    assert all("observations.gauges.speed: inputs/gauges.gpkg: attribute 'v' " in line and said in line for line in found)


def test_observations_that_state_nothing_are_named(tmp_path):
    (warning,) = warned(tmp_path / "empty", "observations: {}\n")
    assert warning == (
        "site.yaml:18: observations: holds nothing, so that nothing is scored; state outline, deposit, difference, gauges, or "
        "remove it"
    )


@pytest.mark.parametrize(("beside", "expected"), [("", 1), (DEPOSIT.partition("\n")[2], 0)])
def test_a_thalweg_scores_nothing_unless_there_is_an_observation(tmp_path, beside, expected):
    text = f"observations:\n  thalweg: {{line: inputs/thalweg.gpkg}}\n{beside}"
    folder = write_site(tmp_path / "ramp", SITE + text)
    write_raster(folder / "inputs" / "deposit.tif", laid(4.0))
    line = shapely.LineString([(WEST + 50, NORTH - 120), (WEST + 490, NORTH - 120)])
    geopandas.GeoDataFrame(geometry=[line], crs="EPSG:32632").to_file(folder / "inputs" / "thalweg.gpkg")
    found = inspect(folder)
    assert found.problems == []
    said = "site.yaml:18: observations: holds only a thalweg, which is no observation, so that nothing is scored"
    assert [warning.startswith(said) for warning in found.warnings if ": observations" in warning] == [True] * expected


def test_paths_of_problems_are_those_of_the_site(tmp_path):
    folder = write_site(tmp_path / "ramp", SITE + DEPOSIT, thickness=-slab())
    write_raster(folder / "inputs" / "deposit.tif", -laid(1.0))
    problems = inspect(folder).problems
    assert len(problems) == 2
    assert not any(str(tmp_path) in problem for problem in problems), problems


def test_a_broken_dem_does_not_hide_files_of_structures_and_other_inputs(tmp_path):
    structures = "structures:\n  - {file: inputs/wall.stl, units: m}\n  - {file: inputs/dam.fbx}\n"
    folder = write_site(tmp_path / "ramp", SITE + structures)
    for name in ("dem.tif", "wall.stl", "dam.fbx"):
        (folder / "inputs" / name).write_text("neither elevations nor a mesh")
    problems = inspect(folder).problems
    assert len(problems) == 3
    assert any(line.startswith("site.yaml:4: terrain.dem: inputs/dem.tif") for line in problems)
    assert any("structures[0].file: inputs/wall.stl" in line for line in problems)
    assert any("structures[1].file: inputs/dam.fbx: meshes of .fbx are not read" in line for line in problems)


def test_errors_stay_errors_of_their_kind(tmp_path):
    from runout.workflow.check import require_sound

    folder = write_site(tmp_path / "ramp", SITE)
    (folder / "inputs" / "dem.tif").write_text("no raster")
    with pytest.raises(ConfigError, match=r"terrain.dem: inputs/dem.tif"):
        require_sound(folder)
