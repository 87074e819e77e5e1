"""The numerical error of a site's maps: the index of convergence on made-up runs, and the study on a small site."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from ramp_site import write_site

from runout import cli, read_site
from runout.errors import ConfigError
from runout.studies import convergence
from runout.studies.convergence_page import as_lines
from runout.studies.grid_index import GridIndex, area_above, compared, restricted

CELLS = (4.0, 2.0, 1.0)


def series(order, noise=0.0):
    """A quantity 100 + 3 h^order on three grids, two shifts each."""
    return [[100 + 3 * h**order - noise, 100 + 3 * h**order + noise] for h in CELLS]


@pytest.mark.parametrize("order", [0.6, 1.0, 1.9])
def test_order_and_limit_of_a_power_law_are_found(order):
    found = GridIndex.of(series(order), 2.0)
    assert found.converging
    assert found.order == pytest.approx(order)
    assert found.extrapolated == pytest.approx(100)
    assert found.error == pytest.approx(max(1.25 * 3.0, 3.0 * (4.0**order - 1)))


def test_worked_example_of_bui_gives_its_order():
    """Fronts of 0.3436, 0.3941 and 0.4041 m: order 2.34, above 2, which is not trusted."""
    found = GridIndex.of([[0.3436], [0.3941], [0.4041]], 2.0)
    assert found.order == pytest.approx(2.34, abs=0.01)
    assert not found.converging
    assert found.error == pytest.approx(1.25 * (0.3941 - 0.3436) / (2**0.5 - 1))


def test_differences_within_the_noise_give_the_index_of_the_lowest_order():
    found = GridIndex.of(series(2.0, noise=10.0), 2.0)
    assert not found.converging
    assert found.error == pytest.approx(1.25 * 36 / (2**0.5 - 1) + 2 * 10 * np.sqrt(2))


@pytest.mark.parametrize("values", [([1.0], [3.0], [2.0]), ([0.0], [1.0], [1.9]), ([0.0], [1.0], [1.0])])
def test_grids_that_swing_or_hardly_converge_give_no_order(values):
    found = GridIndex.of(values, 2.0)
    assert not found.converging
    assert found.extrapolated is None
    assert found.error >= max(map(max, values)) - min(map(min, values))


@pytest.mark.parametrize("values", [([0.0], [1.0], [1.9]), ([0.0], [1.0], [3.0])])
def test_means_that_go_on_as_fast_get_the_index_of_the_lowest_order(values):
    found = GridIndex.of(values, np.sqrt(2.0))
    assert found.error >= 1.25 * (values[2][0] - values[1][0]) / (2**0.25 - 1) - 1e-12


def test_area_counts_fractions_of_cells():
    """A cone of 1 on cells of 0.05: the area above t is pi (1 - t)^2 within 0.7 %, and moves with t below a cell."""
    x = 0.05 * np.arange(-30, 31)
    cone = np.maximum(1.0 - np.hypot(*np.meshgrid(x + 0.013, x)), 0.0)
    areas = [area_above(cone, t, 0.05**2) for t in (0.2, 0.201, 0.5)]
    np.testing.assert_allclose(areas, [np.pi * (1 - t) ** 2 for t in (0.2, 0.201, 0.5)], rtol=7e-3)
    assert areas[1] < areas[0]
    assert area_above(np.ones((3, 4)), 0.5, 2.0) == pytest.approx(0.5 * 2.0 * (3 * 4 + 4 * 3))


def test_blocks_keep_the_volume_of_a_map():
    field = np.arange(35.0).reshape(5, 7)
    assert restricted(field, 3).sum() * 9 == pytest.approx(field.sum())


def test_maps_are_compared_cell_by_cell():
    a, b = np.zeros((4, 4)), np.zeros((4, 4))
    a[0, :2], b[0, 1:3] = 2.0, 2.0
    found = compared(a, b, 1, [1.0, 5.0])
    assert found["relative_l1"] == pytest.approx(1.0)
    assert found["critical_success_index"] == {"1": pytest.approx(1 / 3), "5": 1.0}


@pytest.fixture(scope="module")
def ramp(tmp_path_factory):
    return write_site(tmp_path_factory.mktemp("convergence") / "ramp")


def test_median_scenario_lies_in_the_middle_of_its_distributions(ramp):
    assert convergence.median_parameters(read_site(ramp)) == {"basal_friction_angle_deg": pytest.approx(17.0)}


def test_study_runs_shifted_coarser_grids_and_extrapolates(ramp):
    """A stand-in run whose front depends on the cell size squared, and a little on the shift."""
    calls = []

    def simulate(terrain, cell_size, seed, **_):
        h, lift = cell_size[0], terrain.elevation.min()
        calls.append((round(h, 6), round(lift / h, 6), seed))
        shape = terrain.shape
        front = 100.0 + 0.5 * h**2 + 1e-3 * lift / h
        state = SimpleNamespace(mass=np.ones(1), position=lambda spacing: np.array([[start[0] + front, start[1], 0.0]]))
        fields = {name: np.full(shape, 1.0) for name in ("max_flow_thickness", "deposit_thickness", "max_speed")}
        return SimpleNamespace(
            terrain=terrain, fields=fields, state=state, spacing=cell_size, n_particles=1, timing={"total": 0.5, "setup": 0.0}
        )

    site = read_site(ramp)
    start = _centre(site)
    seen = []
    found = convergence.study(site, shifts=3, ratio=1.5, simulate=simulate, progress=seen.append)
    assert [(h, lift) for h, lift, _ in calls] == [
        *((h, pytest.approx(k / 3, abs=1e-5)) for h in (22.5, 15.0) for k in range(3)),
        (10.0, 0.0),
    ]
    assert len({seed for _, _, seed in calls}) == 3
    assert found["quantities"]["f99"]["order"] == pytest.approx(2.0, abs=0.01)
    assert found["quantities"]["f99"]["extrapolated"] == pytest.approx(100.0, abs=0.01)
    assert [level["runs"] for level in found["levels"]] == [3, 3, 1]
    assert found["block_of_cells"] == 3
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    assert any("front of 99 % of the mass: 150" in line for line in as_lines(found))


def _centre(site):
    terrain = site.terrain()
    thickness = site.releases(terrain)[0].thickness
    x = (np.arange(thickness.shape[1]) + 0.5) * 10.0
    y = (thickness.shape[0] - 0.5 - np.arange(thickness.shape[0])) * 10.0
    return (thickness.sum(0) @ x) / thickness.sum(), (thickness.sum(1) @ y) / thickness.sum()


def test_cells_too_coarse_for_the_release_are_refused(ramp):
    with pytest.raises(ConfigError, match=r"fewer than four of the coarsest cells"):
        convergence.study(read_site(ramp), ratio=6.0)


def test_command_writes_the_error_bars_of_the_site(ramp, capsys, monkeypatch):
    monkeypatch.setattr(convergence, "SHIFTS", 2)
    assert cli.main(["verify", str(ramp), "--convergence"]) == 0
    found = json.loads((ramp / "results" / "convergence.json").read_text())
    front = found["quantities"]["f99"]
    assert 0 < front["relative_error"] < 0.3
    fields = {field["map"]: field for field in found["fields"] if field["level"] == 1}
    assert set(fields) == {"flow_thickness", "deposit", "speed", "pressure", "arrival", "erosion", "deposition"}
    assert fields["deposit"]["critical_success_index"]["0.1"] > 0.6
    assert 0 < fields["flow_thickness"]["relative_l1"] < 1
    assert abs(fields["deposit"]["net_sum"]) <= fields["deposit"]["absolute_sum"]
    assert 0 < fields["arrival"]["root_mean_square"] < 5
    assert "front of 99 % of the mass" in capsys.readouterr().out
    assert "| cells [m] | runs |" in (ramp / "results" / "convergence.md").read_text()


def test_convergence_of_no_site_is_refused(capsys):
    assert cli.main(["verify", "--convergence"]) == 2
    assert "takes one site" in capsys.readouterr().err
