"""Presets of accuracy: what they choose, what overrides them, and what is refused."""

import json
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

from runout import read_site, simulate
from runout.errors import ConfigError, ReleaseError
from runout.forecast.accuracy import BOUNDS, PRESETS, SOURCE, chosen_cell_size, expected_errors, lines, work
from runout.model.limits import CFL

WIDE = SimpleNamespace(volume=4e6, area=1e5)  # 40 m thick
SMALL = SimpleNamespace(volume=4e3, area=100.0)  # 40 m thick, 10 m wide


def test_standard_has_its_cells_through_the_mean_thickness():
    assert chosen_cell_size("standard", [WIDE]) == pytest.approx(40 / PRESETS["standard"].cells, rel=0.05)  # rounded down


def test_presets_are_finer_and_dearer_one_after_the_other():
    costs = [work({"cell_size": chosen_cell_size(name, [WIDE]), "cfl": 0.6, "particles_per_cell": 8}) for name in PRESETS]
    assert list(PRESETS) == ["screening", "standard", "high"]
    assert all(b > 4 * a for a, b in pairwise(costs))


def test_expected_errors_are_those_of_the_published_study_and_fall_with_the_cells():
    measured = json.loads((Path(__file__).parents[2] / SOURCE).read_text())["expected"]
    for found, name in zip(expected_errors(1.0), ("thickness_map", "f99"), strict=True):
        assert found == float(f"{measured[name]:.2g}"), name
    assert expected_errors(2.0) == pytest.approx([error / 2.0 for error in expected_errors(1.0)])


def test_no_cell_is_wider_than_a_quarter_of_the_smallest_release():
    assert chosen_cell_size("screening", [WIDE, SMALL]) == 2.5


@pytest.mark.parametrize("accuracy", [None, "standard"])
def test_an_explicit_cell_size_counts(accuracy):
    assert chosen_cell_size(accuracy, [WIDE], 25.0) == 25.0
    assert chosen_cell_size(accuracy, [WIDE], (20.0, 20.0, 10.0)) == (20.0, 20.0, 10.0)


@pytest.mark.parametrize(
    ("accuracy", "size", "said"),
    [
        (None, None, "neither cell_size nor accuracy is given"),
        ("best", None, "accuracy is 'best'; choose one of screening, standard, high"),
        ("best", 5.0, "accuracy is 'best'; choose one of screening, standard, high"),
    ],
)
def test_unknown_and_missing_choices_are_refused(accuracy, size, said):
    with pytest.raises(ConfigError, match=said):
        chosen_cell_size(accuracy, [WIDE], size)


def test_a_run_without_a_mass_is_refused_also_where_accuracy_would_choose_its_cells(site_folder):
    arguments = read_site(site_folder).member_arguments()
    with pytest.raises(ReleaseError, match="neither a release nor an inflow is given"):
        simulate(arguments["terrain"], [], arguments["material"], end_time=1.0, accuracy="standard")


def test_work_grows_with_the_fourth_power_of_the_cells():
    grid = {"particles_per_cell": 8, "cfl": 0.4}
    assert work({**grid, "cell_size": 5.0}) == pytest.approx(16 * work({**grid, "cell_size": 10.0}))
    assert work({**grid, "cell_size": (10.0, 10.0, 5.0)}) == pytest.approx(4 * work({**grid, "cell_size": 10.0}))
    assert work({**grid, "cell_size": 5.0, "particles_per_cell": (3, 3, 3)}) == pytest.approx(
        54 * work({**grid, "cell_size": 10.0})
    )


def test_lines_tell_the_cells_and_what_every_preset_would_cost():
    grid = {"cell_size": chosen_cell_size("standard", [WIDE]), "cfl": 0.6, "particles_per_cell": (2, 2, 4)}
    said = lines("standard", [WIDE], grid, lambda height: (2, 2, 4), {})
    assert "accuracy standard: cells of 26 m with 2 x 2 x 4 particles, 1.5 through the mean thickness of 40 m" in said[0]
    assert "standard: 26 m with 2 x 2 x 4, 1 times this work" in said[2]
    assert f"± {100 * expected_errors(40 / 26)[1]:.2g} % of the run-out" in said[0]
    assert f"± {100 * expected_errors(40 / 13)[0]:.2g} % of the thickness map" in said[3]
    assert BOUNDS in said[-1]
    flat = lines(None, [WIDE], {**grid, "cell_size": (20.0, 20.0, 10.0)}, lambda height: (2, 2, 4), {})
    assert flat[0].startswith("grid      cells of 20 x 20 x 10 m with 2 x 2 x 4 particles, 4.0")
    thin = lines(None, [WIDE], {**grid, "cell_size": 100.0}, lambda height: (2, 2, 4), {})
    assert "0.4 through the mean thickness of 40 m; expected numerical error not known with fewer than 0.7 cells" in thin[0]
    level = lines(None, [WIDE], grid, lambda height: (3, 3, 1) if height < 20 else (2, 2, 4), {})
    assert "standard: 26 m with 2 x 2 x 4, 1 times" in level[2]
    assert "high: 13 m with 3 x 3 x 1, 9 times" in level[3]


def test_lines_state_the_errors_that_a_site_has_measured_at_all_cells():
    grid = {"cell_size": 26.0, "cfl": 0.6, "particles_per_cell": (2, 2, 4)}
    quantities = {"f99": {"relative_error": 0.05}, "thickness_map": {"relative_error": 0.12}}
    measured = {"quantities": quantities, "levels": [{"cell_size": [52.0] * 3}, {"cell_size": [26.0] * 3}]}
    said = lines("standard", [WIDE], grid, lambda height: (2, 2, 4), measured)
    assert "measured numerical error ± 5 % of the run-out, ± 12 % of the thickness map" in said[0]
    assert said[0].endswith(said[2].split("; ")[1])  # the preset has the same cells
    assert "± 2.5 % of the run-out, ± 6 % of the thickness map" in said[3]  # half the cells
    assert not any("expected" in line.lower() for line in said)


def test_a_site_takes_its_grid_from_the_release_unless_it_states_one(edited):
    site = read_site(edited("cell_size: 10", "accuracy: standard\n  cfl: 0.3"))
    arguments = site.member_arguments()
    depth = sum(r.volume for r in arguments["release"]) / sum(r.area for r in arguments["release"])
    assert arguments["cell_size"] == pytest.approx(depth / PRESETS["standard"].cells, rel=0.1)
    assert arguments["cfl"] == 0.3
    assert arguments["particles_per_cell"] == (2, 2, 4)
    assert site.resolved()["simulation"]["cell_size"] == arguments["cell_size"]
    assert site.resolved()["simulation"]["particles_per_cell"] == [2, 2, 4]
    assert "particles_per_cell" not in site.computed()["simulation"]  # each member has its own
    larger = site.member_arguments({"release_volume_factor": 2.0})
    assert larger["cell_size"] == arguments["cell_size"]


def test_cells_and_time_step_beside_accuracy_are_those_of_the_site(edited):
    site = read_site(edited("cell_size: 10", "cell_size: 10\n  accuracy: high\n  cfl: 0.4"))
    assert {name: site.member_arguments()[name] for name in ("cell_size", "cfl")} == {"cell_size": 10.0, "cfl": 0.4}


def test_accuracy_leaves_the_time_step_as_it_is(edited):
    site = read_site(edited("cell_size: 10", "accuracy: high"))
    assert site.member_arguments()["cfl"] == CFL
    assert "cfl" not in site.stated()["simulation"]


def test_a_run_takes_its_cells_from_accuracy_alone(site_folder):
    stated = read_site(site_folder).member_arguments()
    given = {name: stated[name] for name in ("terrain", "release", "material")} | {"end_time": 0.05, "backend": "reference"}
    result = simulate(**given, accuracy="screening")
    assert result.spacing == (chosen_cell_size("screening", stated["release"]),) * 3
    assert simulate(**given, accuracy="screening", cell_size=8.0).spacing == (8.0, 8.0, 8.0)
    with pytest.raises(ConfigError, match="neither cell_size nor accuracy"):
        simulate(**given)


@pytest.mark.parametrize(
    ("new", "said"),
    [
        ("accuracy: best", "accuracy"),
        ("cfl: 0.3", "neither cell_size nor accuracy is given"),
    ],
)
def test_a_site_with_conflicts_is_refused(edited, new, said):
    with pytest.raises(ConfigError, match=said):
        read_site(edited("cell_size: 10", new))


def test_a_misspelt_key_is_told_beside_what_it_leaves_out(edited):
    with pytest.raises(ConfigError, match=r"(?s)neither cell_size.*did you mean 'cell_size'"):
        read_site(edited("cell_size: 10", "cellsize: 10"))


def test_a_parameter_of_another_law_names_that_law(edited):
    with pytest.raises(ConfigError, match=r"mu: unknown key; it belongs to law: voellmy"):
        read_site(edited("basal_friction_angle_deg: 20", "basal_friction: {friction_angle_deg: 15, mu: 0.2}"))
