"""Debris flows beside observed outlines and volumes: choices by what is left out, and a run of each case."""

import numpy as np
import pytest

import runout
from runout.scores import Thalweg
from runout.studies.validation_cases import cascades_2021, cascades_2021_fit, flume, maipo


def test_the_choice_for_a_flow_does_not_see_it():
    """Two choices: the second is best only for the last flow, whose prediction must be by the first."""
    csi = np.array([[0.5, 0.4, 0.1], [0.3, 0.2, 0.9]])
    lengths = np.array([[100.0, 200.0, 330.0], [90.0, 190.0, 300.0]])
    rows = maipo.left_out(lengths, csi, np.array([100.0, 100.0, 300.0]))
    assert [row["choice"] for row in rows] == [1, 1, 0]
    assert rows[2]["csi_of_others"] == pytest.approx(0.45)
    assert rows[2]["length_error"] == pytest.approx(0.1)
    assert rows[2]["best_csi"] == 0.9


def flow(fall, length=1000.0):
    """A flow of a length down a straight slope that ends on level ground."""
    s = np.linspace(0.0, 2000.0, 201)
    z = np.maximum(1000.0 - fall * s, 1000.0 - fall * length)
    path = Thalweg(np.column_stack([s, np.zeros(201)]))
    return maipo.Flow((0.0, 0.0), None, path, np.zeros((1, 1), bool), length, np.column_stack([s, z]))


def test_the_slope_of_reach_of_others_meets_the_ground_where_it_must():
    """A flow that ends at a slope of 0.5; a line of 0.4 from its source meets the level ground at 500 / 0.4 m."""
    own = flow(0.5)
    assert own.reach_slope == pytest.approx(0.5)
    assert own.length_by_slope(0.4) == pytest.approx(1250.0, abs=10.0)
    rows = maipo.by_reach_slope([own, flow(0.4), flow(0.4)])
    assert rows[0]["length_error"] == pytest.approx(0.25, abs=0.01)


def event_of(observed):
    """An event on level ground, of the rows of Cascades 2021 and three columns of cells."""
    return cascades_2021.Event(runout.Terrain(np.zeros(observed.shape), (10.0, 10.0)), None, observed)


def change_of(*volumes, column=1):
    """Change of the ground [m] with a net volume [1000 m3] in the second row of each reach."""
    change = np.zeros((cascades_2021.REACH_ROWS[-1], 3))
    for row, volume in zip(cascades_2021.REACH_ROWS, volumes, strict=False):
        change[row + 1, column] = 10.0 * volume
    return change


def member(event, change):
    return {"change": change, "numbers": {}} | cascades_2021.compared(event, change)


def chosen(event, *changes):
    rows = cascades_2021_fit.by_halves(event, [member(event, change) for change in changes])
    return {(row["criterion"], row["fitted"][0]): row for row in rows}


def test_halves_choose_on_one_half_and_judge_on_the_other():
    event = event_of(change_of(-5, 2, 1, 2, 1, 2))
    rows = chosen(event, change_of(-5, 9, 1, 9, 1, 9), change_of(0, 2, 0, 2, 0, 2))
    assert set(rows) == {(name, first) for name in ("net", "gross", "map", "areas") for first in (0, 1)}
    for name in ("net", "gross", "map", "areas"):
        first, second = rows[name, 0], rows[name, 1]
        assert (first["error_fitted"], first["error"]) == pytest.approx((0.0, 21e3))
        assert (second["error_fitted"], second["error"], second["least"]) == pytest.approx((0.0, 7e3, 0.0))
        assert second["error_of_several"] == pytest.approx(3.5e3)
        assert (second["least_several"], second["most_several"]) == pytest.approx((0.0, 7e3))


def test_no_criterion_sees_the_other_half():
    """Changes of the rows of the other half leave each criterion as it is, also beside the end of a reach."""
    change, other = change_of(-5, 2, 1, 2, 1, 2), change_of(-3, 2, 3, 2, 3, 2)
    rows = np.arange(len(change))
    for half, judged in (cascades_2021_fit.HALVES, cascades_2021_fit.HALVES[::-1]):
        outside = np.isin(event_of(change).reaches.number[:, 1], judged)
        altered, observed = other.copy(), change.copy()
        altered[rows[outside]] += 7.0
        observed[rows[outside]] -= 4.0
        before = cascades_2021_fit.mismatches(event_of(change), other[None], half)
        after = cascades_2021_fit.mismatches(event_of(observed), altered[None], half)
        assert all(after[name] == pytest.approx(before[name]) for name in before)


def test_gross_volumes_see_erosion_and_deposits_that_compensate():
    event = event_of(change_of(-5, 2, 1, 2, 1, 2))
    both = change_of(-5, 2, 1, 2, 1, 2) + change_of(0, 0, 3, column=0) + change_of(0, 0, -3, column=2)
    found = cascades_2021_fit.mismatches(event, np.array([both, change_of(-5, 2, 1, 2, 1, 2)]), [0, 2, 4])
    assert found["net"] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found["gross"] == pytest.approx([6e3, 0.0])
    assert found["areas"] == pytest.approx([6e3 / 7e3 + 1.0 - 3.0 / 5.0, 0.0])
    assert found["map"][0] > found["map"][1] == 0.0


def test_a_map_that_is_off_by_one_cell_is_better_than_one_that_is_off_by_two():
    event = event_of(change_of(0, 0, 5, column=0))
    near, far = change_of(0, 0, 5, column=1), change_of(0, 0, 5, column=2)
    values = cascades_2021_fit.mismatches(event, np.array([near, far]), [0, 2, 4])["map"]
    assert 0.0 < values[0] < values[1]


def test_the_mean_of_all_members_belongs_to_no_half():
    event = event_of(change_of(-5, 2, 1, 2, 1, 2))
    rows = [member(event, change_of(-5, 9, 1, 9, 1, 9)), member(event, change_of(-5, 1, 3, 1, 1, 2))]
    assert cascades_2021_fit.of_all(event, rows)["errors"] == pytest.approx([1e3, 9.5e3])


def test_members_are_counted_that_leave_half_of_each_deposit():
    event = event_of(change_of(-5, 0, 4, 6, 0, 2))
    volumes = ((-5, 0, 2, 3, 0, 1), (-5, 9, 9, 9, 9, 9), (-5, 0, 1.9, 6, 0, 2), (-5, 0, 4, 6, 0, 0))
    rows = [member(event, change_of(*volume)) for volume in volumes]
    assert cascades_2021_fit.of_all(event, rows)["with_deposits"] == 2


def test_only_a_member_with_both_scores_has_what_is_aimed_at():
    scores = {"csi": 0.5, "agreement": 0.85}
    assert cascades_2021_fit.has_both_scores(scores)
    assert not cascades_2021_fit.has_both_scores(scores | {"csi": 0.49})
    assert not cascades_2021_fit.has_both_scores(scores | {"agreement": 0.84})


ALL_RANGES = [cascades_2021_fit.RANGES, *cascades_2021_fit.LAW_RANGES.values()]


@pytest.mark.parametrize("ranges", ALL_RANGES)
def test_numbers_are_drawn_within_their_ranges_and_cover_them(ranges):
    jobs = cascades_2021_fit.drawn("runout", ranges, 64)
    for name, (low, high) in ranges.items():
        values = np.array([job.numbers[name] for job in jobs])
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high
    assert len({job.seed for job in jobs}) == 64


@pytest.mark.parametrize(("law", "low", "high"), [("growth", 3e-4, 3e-3), ("energy", 1e3, 2e4)])
def test_numbers_of_a_member_name_its_law_of_erosion(law, low, high):
    for job in cascades_2021_fit.drawn("runout", cascades_2021_fit.LAW_RANGES[law], 4):
        erosion = cascades_2021_fit._erosion(job.numbers)
        assert erosion.law == law
        assert low < (erosion.growth_rate if law == "growth" else erosion.specific_energy) < high
    assert cascades_2021_fit._erosion(cascades_2021_fit.wet({})).law == "ramms"


def test_a_flow_with_a_bed_is_judged_with_what_it_takes_from_it(monkeypatch):
    """Runs of the Maipo on the coarse grid: scores made up from the numbers of each choice, in the order of flows and choices."""

    def scores(function, jobs):
        assert {cell_size for _, _, cell_size in jobs} == {maipo.COARSE_CELL_SIZE}
        return [
            {"csi": 0.1 * flow + choice.numbers[0], "length": 100.0 * flow, "entrained": choice.bed * 500.0}
            for flow, choice, _ in jobs
        ]

    monkeypatch.setattr(maipo, "on_all_processors", scores)
    families = maipo.coarse(np.array([100.0, 100.0, 200.0]))
    assert "entrained" not in families["rigid"]
    assert np.unique(families["bed"]["entrained"]).tolist() == [500.0 * maipo.BED]
    assert all(choice.endswith("bed of 1 m") for choice in families["bed"]["choices"])
    for family in families.values():
        best = int(np.argmax(np.array(family["csi"])[:, 0]))
        assert [row["choice"] for row in family["left_out"]] == [best] * 3
        assert family["left_out"][1]["length_error"] == pytest.approx(0.0)


def test_a_flow_of_the_maipo_stays_in_its_valley_and_reaches_the_floor(results):
    (run,) = results("maipo")["runs"]
    assert run["length"] == pytest.approx(run["observed_length"], rel=0.15)
    assert run["csi"] > 0.4


def test_a_wet_member_of_cascades_erodes_its_bed(results):
    (row,) = results("cascades_2021_fit")["members"]
    assert row["entrained_volume"] > 2000.0
    assert row["csi"] > 0.25


def test_the_bed_of_the_flume_falls_by_31_deg_and_ends_on_a_pad_of_2_5_deg():
    s, x, z, slope = flume.bed()
    at = np.interp([0.0, 60.0, 78.0, 100.0, 120.0], s, np.arange(len(s))).astype(int)
    assert z[at[1]] - z[at[0]] == pytest.approx(-60.0 * np.sin(np.radians(31.0)), rel=1e-6)
    assert x[at[1]] - x[at[0]] == pytest.approx(60.0 * np.cos(np.radians(31.0)), rel=1e-6)
    assert (z[at[3]] - z[at[4]]) / (x[at[4]] - x[at[3]]) == pytest.approx(np.tan(np.radians(2.5)), rel=1e-6)
    turn = 10.0 * np.radians(28.5)
    assert slope[np.searchsorted(s, 78.0 + turn / 2)] == pytest.approx(np.radians(31.0 - 28.5 / 2), abs=2e-3)


def test_a_side_wall_is_a_closed_body_with_its_surface_outside():
    import trimesh

    wall = flume.side_wall(np.array([0.0, 10.0, 15.0]), np.array([0.0, -6.0, -7.0]), 2.0, 2.6, "wall")
    body = trimesh.Trimesh(wall.vertices, wall.faces, process=False)
    assert body.is_watertight
    assert body.volume == pytest.approx(15.0 * 0.6 * (flume.WALL_HEIGHT + 0.5))


def test_a_wet_mass_runs_down_the_flume_and_stops_on_its_pad(results):
    """Cells of 0.4 m, nothing fitted; the tests: 3.9 and 4.1 s at 31.7 m, 10 and 11 s at 80 m, front about 112 m."""
    found = results("flume")
    (run,), observed = found["runs"], found["observed"]["2017-05-25"]
    near, far = found["gauges"].index(31.7), found["gauges"].index(80.0)
    assert run["arrival"][near] == pytest.approx(observed["arrival"][near], rel=0.15)
    assert 6.0 < run["arrival"][far] < observed["arrival"][far]
    assert 0.05 < run["peak"][near] < observed["peak"][near]
    assert run["stop"] == "at rest"
    assert run["deposit"]["volume"] == pytest.approx(9.9, rel=0.01)
    assert 100.0 < run["deposit"]["front"] < 120.0
