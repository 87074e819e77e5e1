"""The numerical error of a site's maps: distances of maps, made-up runs, and the study on a small site."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from ramp_site import write_site

from runout import Terrain, cli, read_site
from runout.errors import ConfigError
from runout.forecast.accuracy import BOUNDS
from runout.forecast.numerical_error import MAP_SAFETY, ORDER, SAFETY, statements
from runout.scores.flow import BAR_MAPS
from runout.studies import convergence
from runout.studies.convergence import area_above, compared


def test_area_counts_fractions_of_cells():
    """A cone of 1 on cells of 0.05: the area above t is pi (1 - t)^2 within 0.7 %, and moves with t below a cell."""
    x = 0.05 * np.arange(-30, 31)
    cone = np.maximum(1.0 - np.hypot(*np.meshgrid(x + 0.013, x)), 0.0)
    areas = [area_above(cone, t, 0.05**2) for t in (0.2, 0.201, 0.5)]
    np.testing.assert_allclose(areas, [np.pi * (1 - t) ** 2 for t in (0.2, 0.201, 0.5)], rtol=7e-3)
    assert areas[1] < areas[0]
    assert area_above(np.ones((3, 4)), 0.5, 2.0) == pytest.approx(0.5 * 2.0 * (3 * 4 + 4 * 3))


def test_maps_are_compared_cell_by_cell():
    a, b = np.zeros((4, 4)), np.zeros((4, 4))
    a[0, :2], b[0, 1:3] = 2.0, 2.0
    found = compared(a, b, [1.0, 5.0])
    assert found["relative_l1"] == pytest.approx(1.0)
    assert found["critical_success_index"] == {"1": pytest.approx(1 / 3), "5": 1.0}


@pytest.fixture(scope="module")
def ramp(tmp_path_factory):
    return write_site(tmp_path_factory.mktemp("convergence") / "ramp")


def test_median_scenario_lies_in_the_middle_of_its_distributions(ramp):
    assert convergence.median_parameters(read_site(ramp).settings) == {"basal_friction_angle_deg": pytest.approx(17.0)}


def made_up(calls, site, escaped=0.0):
    """A stand-in run whose front is 100 + 0.5 h^1.5 and whose map is h thick in one cell."""
    start = _centre(site)

    def simulate(terrain, cell_size, seed, **_):
        h, lift = cell_size[0], terrain.elevation.min()
        calls.append((round(h, 6), round(lift / h, 6), seed))
        front = 100.0 + 0.5 * h**ORDER
        place = np.array([[start[0] + front, start[1], 0.0]])
        thick = np.zeros(terrain.shape)
        thick[0, :10] = 100.0
        thick[0, 0] += h
        fields = dict.fromkeys(("max_flow_thickness", "deposit_thickness", "max_speed"), thick)
        state = SimpleNamespace(mass=np.full(1, 1.0 - escaped), position=lambda spacing: place)
        timing, series = {"total": 0.5, "setup": 0.0}, {"mass": np.ones(1)}
        given = {"terrain": terrain, "fields": fields, "state": state, "series": series, "spacing": cell_size}
        return SimpleNamespace(**given, n_particles=1, timing=timing)

    return simulate


def test_study_runs_shifted_coarser_grids_and_finds_trends(ramp):
    site, calls, seen = read_site(ramp), [], []
    found = convergence.study(site, coarser=(1.5, 2.25, 2.25), simulate=made_up(calls, site), progress=seen.append)
    assert [h for h, _, _ in calls] == [15.0, 22.5, 22.5, 15.0, 10.0]  # the first on the ground of finer grids
    assert [lift for _, lift, _ in calls] == pytest.approx([0.146, 0.382, 0.764, 0.146, 0.0], abs=1e-5)
    assert len({seed for _, _, seed in calls}) == 4
    front, depth = found["quantities"]["f99"], found["quantities"]["thickness_map"]
    assert front["trend"] == pytest.approx(0.5 * 10.0**ORDER, rel=1e-4)
    assert front["scatter"] == pytest.approx(0.0, abs=0.01)
    assert depth["error"] == pytest.approx(MAP_SAFETY * 10.0 / 1010.0, rel=1e-4)  # thickness of 10 in a map of 1010
    assert [level["cell_size"][0] for level in found["levels"]] == [15.0, 22.5, 22.5, 15.0, 10.0]
    thickness = next(field for field in found["fields"] if field["map"] == "flow_thickness")
    assert thickness["ratio"] == 1.5
    assert thickness["error_over_difference"] == pytest.approx(MAP_SAFETY * 2.0)  # half a cell finer than the other grid
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    assert any("run-out of 99 % of the mass 115.8" in line for line in statements(found))


def test_relief_that_finer_grids_meet_is_a_part_of_the_error(ramp, monkeypatch):
    """One more run, of the grid nearest to 1.2, has the relief; here it stops the mass 30 m earlier."""
    site, calls = read_site(ramp), []
    plain = made_up(calls, site)

    def simulate(terrain, **arguments):
        result = plain(terrain=terrain, **arguments)
        if terrain.fine_relief == 1.0:
            place = result.state.position(0.0) - np.array([30.0, 0.0, 0.0])
            result.state = SimpleNamespace(mass=result.state.mass, position=lambda spacing: place)
        else:
            assert terrain.fine_relief == 0.25
        return result

    monkeypatch.setattr(convergence, "grounds", lambda terrain, spacing: convergence.Ground(0.25, 1.0, 0.5))
    found = convergence.study(site, coarser=(1.5, 2.25), simulate=simulate)
    assert [h for h, _, _ in calls] == [15.0, 22.5, 15.0, 10.0]
    assert calls[0] == calls[2]  # one grid at one place, on two grounds
    front = found["quantities"]["f99"]
    assert front["ground"] == pytest.approx(15.0)  # by its weight
    assert front["trend"] == pytest.approx(0.5 * 10.0**ORDER, rel=1e-4)  # of the runs on one ground
    assert front["error"] >= SAFETY * np.hypot(front["trend"], 15.0)
    assert front["error"] < 1.3 * SAFETY * np.hypot(front["trend"], 15.0)


def test_a_study_has_a_second_ground_where_the_raster_has_relief_that_coarse_grids_filter():
    """Without it all of the difference is an error; with it, the square of the cells of the grid over those of the raster."""
    natural = np.random.default_rng(4).normal(size=(64, 64)).cumsum(0).cumsum(1)
    rough, plane = Terrain.from_array(natural, 10.0), Terrain.from_array(np.add.outer(np.arange(30.0), np.arange(30.0)), 10.0)
    assert convergence.grounds(rough, (12.0, 12.0)) == convergence.Ground(0.0, 1.0, 1.0)
    assert convergence.grounds(rough, (5.0, 4.0)) == convergence.Ground(1.0, 0.0, 0.25)
    assert convergence.grounds(plane, (12.0, 12.0)) == convergence.Ground(0.0)


@pytest.mark.parametrize(("escaped", "known"), [(0.005, True), (0.02, False), (1.0, False)])
def test_run_out_has_no_error_bar_where_more_than_a_hundredth_of_the_mass_left_the_terrain(ramp, escaped, known, caplog):
    site = read_site(ramp)
    found = convergence.study(site, coarser=(1.5, 2.0), simulate=made_up([], site, escaped))["quantities"]
    assert ("f99" in found, "centre_of_mass_runout" in found) == (known, known)
    assert "thickness_map" in found
    assert ("f99 has no error bar: more than 1 % of the mass left the terrain" in caplog.text) is not known


def _centre(site):
    terrain = site.terrain()
    thickness = site.releases(terrain)[0].thickness
    x = (np.arange(thickness.shape[1]) + 0.5) * 10.0
    y = (thickness.shape[0] - 0.5 - np.arange(thickness.shape[0])) * 10.0
    return (thickness.sum(0) @ x) / thickness.sum(), (thickness.sum(1) @ y) / thickness.sum()


def test_cells_too_coarse_for_the_release_are_refused(ramp):
    with pytest.raises(ConfigError, match=r"fewer than four of the coarsest cells"):
        convergence.study(read_site(ramp), coarser=(1.2, 36.0))


@pytest.mark.parametrize("coarser", [(), (2.0, 2.0), (1.0, 2.0)])
def test_grids_that_show_no_trend_are_refused(ramp, coarser):
    with pytest.raises(ConfigError, match="at least two cell sizes"):
        convergence.study(read_site(ramp), coarser=coarser)


def test_command_check_and_page_state_one_error_of_the_site(ramp, capsys, monkeypatch):
    monkeypatch.setattr(convergence, "COARSER", (2.0, 1.4))
    assert cli.main(["verify", str(ramp), "--convergence"]) == 0
    found = json.loads((ramp / "results" / "convergence.json").read_text())
    assert 0 < found["quantities"]["f99"]["relative_error"] < 0.3
    fields = {field["map"]: field for field in found["fields"]}
    assert set(fields) == {*BAR_MAPS.values(), "arrival", "erosion", "deposition"}
    assert fields["deposit"]["critical_success_index"]["0.1"] > 0.6
    assert 0 < fields["flow_thickness"]["relative_l1"] < 1
    assert abs(fields["deposit"]["net_sum"]) <= fields["deposit"]["absolute_sum"]
    assert 0 < fields["arrival"]["root_mean_square"] < 5
    front = next(line for line in statements(found) if "run-out of 99 %" in line)
    printed = " ".join(capsys.readouterr().out.split())
    assert front in printed
    assert BOUNDS in printed
    page = (ramp / "results" / "convergence.md").read_text()
    assert "| cells [m] | particles |" in page
    assert BOUNDS in page
    assert cli.main(["check", str(ramp)]) == 0
    checked = " ".join(capsys.readouterr().out.split())
    assert f"measured on this site, cells of {found['levels'][-1]['cell_size'][0]:g} m: " in checked
    assert front in checked
    front, of_map = (100 * found["quantities"][name]["relative_error"] for name in ("f99", "thickness_map"))
    assert f"measured numerical error ± {front:.2g} % of the run-out, ± {of_map:.2g} % of the thickness map" in checked
    assert "expected numerical error" not in checked
    assert BOUNDS in checked


def test_convergence_of_no_site_is_refused(capsys):
    assert cli.main(["verify", "--convergence"]) == 2
    assert "takes one site" in capsys.readouterr().err
