"""`runout check`: every problem of configuration and inputs at once, what a run would do, and what it takes."""

import re
import tracemalloc

import numpy as np
import pytest
from ramp_site import SITE, ramp, slab, write_raster, write_site

import runout
from runout import cli
from runout.errors import BudgetError, ExitCode
from runout.log import duration
from runout.model.depth_resolution import LOST
from runout.workflow import plan
from runout.workflow.check import inspect

SITE_OF_TWO = SITE.replace("material:", "  - {name: second, raster: inputs/second.tif, placement: on_surface}\nmaterial:")


def said(capsys, *arguments):
    code = cli.main([*map(str, arguments)])
    return code, capsys.readouterr().out


def test_a_good_site_is_planned_and_left_as_it_is(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp")
    before = sorted(tmp_path.rglob("*"))
    code, out = said(capsys, "check", folder)
    assert code == ExitCode.OK
    assert "problem" not in out
    assert "release slab: 2.88e+04 m3 on 3600 m2, 8 m thick on average, 8 m at most, on surface" in out
    assert "is forecast to have 0.33 cells through a depth of 3.3 m" in " ".join(out.split())
    assert "ensemble run the members: 4 of 4 members to simulate" in out
    assert all(word in out for word in ("particles", "steps", "time", "memory", "disk"))
    assert sorted(tmp_path.rglob("*")) == before


def test_parts_and_releases_that_start_together_are_said_with_the_remedy(tmp_path):
    second = np.zeros(ramp().shape)
    second[18:21, 4:8] = second[18:21, 12:16] = 3.0
    folder = write_site(tmp_path / "ramp", SITE_OF_TWO)
    write_raster(folder / "inputs/second.tif", second)
    notes = inspect(folder, forecast=False).notes
    patches = "release second: its 2 separate patches start together at time zero, in every member; where each may fail alone"
    assert sum(patches in note for note in notes) == 1
    assert (
        sum(
            "the 2 releases (slab, second) start together" in note and "name it in the releases of a scenario" in note
            for note in notes
        )
        == 1
    )
    assert not any("start together" in note for note in inspect(write_site(tmp_path / "one"), forecast=False).notes)


def test_relief_and_its_cost_are_stated_and_an_oscillation_is_named(tmp_path):
    text = SITE.replace("inputs/dem.tif", "inputs/dem.tif\n  smoothing: 20")
    even = inspect(write_site(tmp_path / "even"))
    (said,) = [note for note in even.notes if note.startswith("Relief in reach of the mass")]
    assert "0.34 m (rms) in waves of up to six cells, which act like 0.058 to 0.21 degrees of friction more" in said
    assert not any("oscillate" in warning for warning in even.warnings)
    z = ramp()
    rough = z + np.where(np.indices(z.shape).sum(0) % 2, 1.0, -1.0) * np.random.default_rng(1).uniform(0.5, 1.5, z.shape)
    found = inspect(write_site(tmp_path / "rough", elevation=rough))
    (warning,) = [w for w in found.warnings if "oscillate in waves of 20 m" in w]
    assert "terrain.smoothing: 20 takes them out" in warning
    smooth = inspect(write_site(tmp_path / "smooth", text, rough))
    assert not any("oscillate" in w for w in smooth.warnings)
    assert any("averaged over a triangle of half-width 20 m along both axes (terrain.smoothing)" in n for n in smooth.notes)


def test_check_compiles_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("runout.forecast.step_cost.measured_step_cost", lambda arguments: pytest.fail("a step is measured"))
    code, out = said(capsys, "check", write_site(tmp_path / "ramp"))
    assert code == ExitCode.OK
    assert "on a typical machine" in out
    assert "the first run compiles for a minute and measures this one" in " ".join(out.split())


def test_check_of_a_finished_site_says_that_nothing_is_left(finished_site, capsys):
    code, out = said(capsys, "check", finished_site[0])
    assert code == ExitCode.OK
    assert out.count("nothing: it is up to date") == 5
    assert "no member is left to simulate" in out


def test_problems_of_configuration_and_data_are_listed_at_once(tmp_path, capsys):
    text = SITE.replace("end_time", "end_tiem").replace("ensemble:", "budgt: 3\nensemble:")
    elevation = ramp()
    elevation[12, 8] = -9999.0  # under the slab
    code, out = said(capsys, "check", write_site(tmp_path / "ramp", text, elevation))
    assert code == ExitCode.CONFIGURATION
    assert "did you mean 'end_time'?" in out
    assert "did you mean 'budget'?" in out
    assert "row 12" in out
    assert "dem.tif" in out
    assert not (tmp_path / "ramp" / "results").exists()


def test_each_bad_release_is_named(tmp_path, capsys):
    second = SITE_OF_TWO.replace("on_surface}", "on_surface, volume: 1.0e+6}")
    folder = write_site(tmp_path / "ramp", second, thickness=-slab())
    write_raster(folder / "inputs" / "second.tif", slab())
    code, out = said(capsys, "check", folder)
    assert code == ExitCode.CONFIGURATION
    assert "negative" in out
    assert "second.tif" in out
    assert out.count("problem ") == 2


def test_overlapping_releases_are_refused(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SITE_OF_TWO)
    write_raster(folder / "inputs" / "second.tif", slab())
    code, out = said(capsys, "check", folder)
    assert code == ExitCode.CONFIGURATION
    assert "releases slab and second overlap on 36 cells" in out


def test_releases_that_share_a_sliver_of_a_border_do_not_overlap(tmp_path):
    import geopandas
    import shapely

    for width, overlap in ((1e-3, False), (1.0, True)):
        two = SITE_OF_TWO.replace("raster: inputs/second.tif", "polygons: inputs/second.gpkg, thickness: 2")
        two = two.replace("raster: inputs/thickness.tif", "polygons: inputs/slab.gpkg\n    thickness: 2")
        folder = write_site(tmp_path / str(width), two)
        west, south, _, north = runout.Terrain.from_raster(folder / "inputs" / "dem.tif").extent
        shapes = {"slab": (west + 50, west + 100), "second": (west + 100 - width, west + 150)}
        for name, (start, end) in shapes.items():
            box = shapely.box(start, (south + north) / 2 - 40, end, (south + north) / 2 + 40)
            geopandas.GeoDataFrame(geometry=[box], crs="EPSG:32632").to_file(folder / "inputs" / f"{name}.gpkg", engine="pyogrio")
        assert any("overlap on" in problem for problem in inspect(folder).problems) == overlap


def test_unknown_cells_that_the_mass_may_reach_are_named_with_place_and_number(tmp_path):
    behind, reached = ramp(), ramp()
    behind[12, 1] = -9999.0
    reached[12, 30] = reached[20:, 22:] = -9999.0
    assert not any("without elevation" in line for line in inspect(write_site(tmp_path / "behind", elevation=behind)).warnings)
    found = inspect(write_site(tmp_path / "reached", elevation=reached))
    (warning,) = [line for line in found.warnings if "without elevation" in line]
    assert found.problems == []
    assert "dem.tif: the mass may come to 32 cells without elevation" in warning
    assert "31 cells along the edge of the known ground (easting 500225.0 to 500495.0, northing 4999765.0 to 4999795.0)" in warning
    assert "a hole of 1 cells around row 12, column 30 (easting 500305.0, northing 4999875.0)" in warning
    assert any("113 of 1200 cells have no elevation" in note for note in found.notes)


def test_unknown_cells_under_the_release_are_refused(tmp_path):
    elevation = ramp()
    elevation[12, 8] = -9999.0
    (problem,) = inspect(write_site(tmp_path / "under", elevation=elevation)).problems
    assert "row 12, column 8" in problem


def test_cells_larger_than_the_release_are_refused(tmp_path):
    found = inspect(write_site(tmp_path / "ramp", SITE.replace("cell_size: 10", "cell_size: 200")))
    assert any("set simulation.cell_size to 15 or less" in problem for problem in found.problems)


def test_a_flow_that_may_leave_the_dem_is_a_warning(tmp_path):
    friction = "{distribution: uniform, low: 12, high: 22}"
    steep = inspect(write_site(tmp_path / "steep", SITE.replace(friction, "{distribution: uniform, low: 21, high: 22}")))
    flat = inspect(write_site(tmp_path / "flat", SITE.replace(friction, "{distribution: uniform, low: 4, high: 22}")))
    assert not any("leave the DEM" in warning and "east" in warning for warning in steep.warnings)
    assert any("leave the DEM in the" in warning and "east" in warning for warning in flat.warnings)
    assert steep.problems == flat.problems == []


def test_thin_and_soft_releases_are_warned_of(tmp_path):
    found = inspect(write_site(tmp_path / "ramp"))
    (thin,) = [warning for warning in found.warnings if warning.startswith("the member that is resolved least is forecast to have")]
    assert thin.endswith(LOST)
    assert any("the weight of 8 m strains the release by 5.8 %" in warning for warning in found.warnings)


def test_a_release_below_the_arrival_threshold_is_warned_of(tmp_path):
    found = inspect(write_site(tmp_path / "ramp", SITE.replace("end_time: 20}", "end_time: 20, arrival_threshold: 8}")))
    assert any("8 m is not above simulation.arrival_threshold of 8 m" in warning for warning in found.warnings)


def test_thresholds_thinner_than_the_grid_shows_are_warned_of(tmp_path):
    """Cells of 10 m with 8 particles: 0.8 m."""
    found = inspect(write_site(tmp_path / "ramp"))
    (said,) = [warning for warning in found.warnings if "the least thickness that this grid can show" in warning]
    assert "simulation.arrival_threshold 0.1 m" in said
    assert "hazard.deposit_thresholds 0.5 m: below 0.8 m" in said
    thick = SITE.replace("end_time: 20}", "end_time: 20, arrival_threshold: 0.9}")
    others = [warning for warning in inspect(write_site(tmp_path / "thick", thick)).warnings if "grid can show" in warning]
    assert not any("arrival_threshold" in warning for warning in others)


def test_rasters_of_friction_are_read_by_the_law_of_a_site_with_other_problems(tmp_path):
    text = SITE.replace("basal_friction_angle_deg: 20", "basal_friction: {law: voellmy, mu: 0.2, xi: 1000}")
    text = text.replace("basal_friction_angle_deg: {", "basal_mu: {").replace("low: 12, high: 22", "low: 0.1, high: 0.3")
    text = text.replace("dem.tif\n", "dem.tif\n  friction_rasters: {xi: inputs/dem.tif}\n").replace("end_time", "end_tiem")
    found = inspect(write_site(tmp_path / "ramp", text))
    (wrong,) = [str(problem) for problem in found.problems if "end_time" not in str(problem)]
    assert "xi is 0 at" in wrong  # elevations


def test_a_run_over_its_budget_is_refused_with_both_numbers(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SITE + "budget: {memory_gb: 0.001, hours: 10}\n")
    code, out = said(capsys, "check", folder)
    assert code == ExitCode.OVER_BUDGET
    assert "budget.memory_gb is 0.001, the run needs about" in out
    assert "budget.hours" not in out
    assert cli.main(["run", str(folder)]) == ExitCode.OVER_BUDGET
    assert "budget.memory_gb is 0.001" in capsys.readouterr().err
    assert not list((folder / "results").glob("members/*.nc"))
    with pytest.raises(BudgetError, match="raise it"):
        plan.require_budget(runout.read_site(folder), [0, 1])


def test_a_run_that_cannot_fit_is_refused_before_anything_is_calibrated(tmp_path, capsys, monkeypatch):
    def refused(*arguments):
        pytest.fail("particles were made")

    monkeypatch.setattr("runout.backends.resting_particles.sample_particles", refused)
    fine = SITE.replace("cell_size: 10", "cell_size: 0.25")
    code, out = said(capsys, "check", write_site(tmp_path / "budget", fine + "budget: {memory_gb: 2}\n"))
    assert code == ExitCode.OVER_BUDGET
    assert "budget.memory_gb is 2, the run needs about" in out
    folder = write_site(tmp_path / "machine", fine)
    monkeypatch.setattr(plan, "available_bytes", lambda: 2.5e9)
    code, out = said(capsys, "check", folder)
    assert code == ExitCode.OVER_BUDGET
    assert "2.5 GB are available; use larger cells" in out


def test_check_makes_no_particles(tmp_path, capsys, monkeypatch):
    made = "runout.backends.resting_particles.ReleaseParticles.chunks"
    monkeypatch.setattr(made, lambda *given: pytest.fail("particles were made"))
    code, out = said(capsys, "check", write_site(tmp_path / "ramp"))
    assert code == ExitCode.OK
    assert out.startswith("particles 288 in the member with the largest volume")
    assert out.count("particles 288") == 1
    assert "particle-steps in all" in out


def test_millions_of_particles_are_counted_without_an_array_of_them(tmp_path):
    site = runout.read_site(write_site(tmp_path / "ramp", SITE.replace("cell_size: 10", "cell_size: 0.36")))
    site.data()
    tracemalloc.start()
    try:
        count = plan.particle_count(site)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == pytest.approx(8 * 28_800 / 0.36**3, rel=0.05)
    assert count > 4.5e6
    assert peak < 8 * count


def test_times_are_said_as_people_say_them():
    assert [duration(seconds) for seconds in (3.21, 45.4, 200, 7500)] == ["3.2 s", "45 s", "3 min 20 s", "2 h 5 min"]


def plan_members(site):
    from runout.ensemble.member import plan_members

    return plan_members(site)


def test_a_release_without_a_coordinate_system_is_named(tmp_path):
    folder = write_site(tmp_path / "ramp")
    write_raster(folder / "inputs" / "thickness.tif", slab(), crs=None)
    found = inspect(folder)
    assert found.problems == []
    assert any(
        "thickness.tif states no coordinate system; taken to be in the terrain's, EPSG:32632" in note for note in found.notes
    )


def test_mass_that_is_trapped_in_its_scar_is_named(tmp_path):
    excavated = SITE.replace("on_surface", "excavated")
    pit = [w for w in inspect(write_site(tmp_path / "pit", excavated)).warnings if "this mass is trapped" in w]
    assert len(pit) == 1
    assert (
        "slab: 23% of 2.88e+04 m3 lie below the lines that rise from the rim of the scar at the basal friction angle of 20 deg"
        in pit[0]
    )
    assert "a raster that thins out to its rim avoids it" in pit[0]
    assert not [w for w in inspect(write_site(tmp_path / "ramp")).warnings if "this mass is trapped" in w]
    wet = excavated.replace("placement: excavated", "placement: excavated\n    pore_pressure: {ratio: 0.5, decay_time: 20}")
    (less,) = [w for w in inspect(write_site(tmp_path / "wet", wet)).warnings if "this mass is trapped" in w]
    assert "at the basal friction angle of 10.3 deg, pore pressure included," in less
    assert int(re.search(r"slab: (\d+)%", less)[1]) < 23


def test_overlapping_polygons_of_one_thickness_are_named(tmp_path):
    import geopandas
    import shapely

    text = SITE.replace("raster: inputs/thickness.tif", "polygons: inputs/release.gpkg\n    thickness: 2.0")
    folder = write_site(tmp_path / "ramp", text)
    boxes = [shapely.box(500_050.0 + x, 4_999_850.0, 500_090.0 + x, 4_999_910.0) for x in (0.0, 30.0)]
    geopandas.GeoDataFrame(geometry=boxes, crs="EPSG:32632").to_file(folder / "inputs" / "release.gpkg")
    assert any("polygons 1 and 2 overlap and have one thickness; the common 600 m2 count once" in n for n in inspect(folder).notes)


def test_warnings_and_notes_name_files_as_site_yaml_does(tmp_path):
    """A DEM with a gap and an edge that the mass comes to, and a release of other cells: each message names a file."""
    elevation = ramp()
    elevation[9:12, 35:38] = np.nan
    folder = write_site(tmp_path / "ramp", SITE.replace("basal_friction_angle_deg: 20", "basal_friction_angle_deg: 2"), elevation)
    found = inspect(folder)
    told = [*found.warnings, *found.notes]
    assert sum(text.startswith("inputs/dem.tif: ") for text in told) >= 3
    assert not [text for text in told if str(tmp_path) in text]
