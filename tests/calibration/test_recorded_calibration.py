"""Recorded studies: the calibration of Frank Slide has the friction of the other code, and few members the indices of many."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECORDS = ROOT / "tests" / "benchmarks" / "records"
RECORD = json.loads((RECORDS / "calibration_frank_slide.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("angle", ["15", "20"])
def test_intervals_hold_the_friction_of_the_other_code_and_stand_in_the_guide(angle):
    friction = RECORD["angles"][angle]["parameters"]["basal_friction_angle_deg"]
    assert friction["p5"] < float(angle) < friction["p95"]
    guide = " ".join((ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8").split())
    assert f"{friction['p5']:.1f} to {friction['p95']:.1f} degrees" in guide


def test_indices_of_few_members_are_those_of_the_direct_study_and_stand_in_the_guide():
    record = json.loads((RECORDS / "direct_sensitivity.json").read_text(encoding="utf-8"))
    rows, guide = record["rows"], (ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8")
    assert record["runs"] == 384
    assert all(q2 > 0.9 for quantities in record["held_out_q2"].values() for q2 in quantities.values())
    for row in rows:
        apart = max(row["low"] - row["direct"], row["direct"] - row["high"]) - row["half_width"]
        assert row["agrees"] == (apart <= 0.01)
    agreeing = sum(row["agrees"] for row in rows)
    assert f"all {agreeing} indices agree" in guide
    assert agreeing == len(rows)
    stated = {(row["quantity"], row["parameter"]): row for row in rows if row["index"] == "total" and row["direct"] > 0.05}
    for row in stated.values():
        assert f"{row['direct']:.2f} ± {row['half_width']:.2f}" in guide
    for row in (row for row in rows if row["index"] == "total" and row["direct"] > 0.05):
        assert f"{row['emulated']:.2f} ({row['low']:.2f} to {row['high']:.2f})" in guide


def test_boundary_recovers_the_friction_at_least_as_well_as_the_area_and_the_guide_states_it():
    record = json.loads((RECORDS / "outline_likelihood.json").read_text(encoding="utf-8"))
    area, boundary = record["area"], record["boundary"]
    assert record["events"] == 20
    assert min(*area["covered"], *boundary["covered"]) >= 16
    assert boundary["rms_error"][0] <= area["rms_error"][0]
    guide = " ".join((ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8").split())
    assert "with the area it covered friction in {} and volume in {}".format(*area["covered"]) in guide
    assert f"the mean missed the friction by {area['rms_error'][0]:.2f} degrees" in guide
    assert "with the boundary in {} and {}".format(*boundary["covered"]) + f", and by {boundary['rms_error'][0]:.2f}" in guide


def test_the_guide_states_what_the_outline_of_com1dfa_gives():
    record = json.loads((RECORDS / "calibration_avakot.json").read_text(encoding="utf-8"))
    guide = " ".join((ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8").split())
    for outline in ("area", "boundary"):
        mu, xi = (record["outlines"][outline]["parameters"][name] for name in ("basal_mu", "basal_xi"))
        assert f"{mu['mean']:.3f} ± {mu['standard_deviation']:.3f} and" in guide
        assert f"{round(xi['mean'], -1):g} ± {round(xi['standard_deviation'], -1):g} m/s2" in guide
    area = record["outlines"]["area"]
    assert f"correlation {area['correlation'][0][1]:.2f}" in guide
    across, along = area["principal_axes"]["standard_deviation_over_prior"]
    assert f"{100 * across:.0f} % of the prior's deviation, that along it to {100 * along:.0f} %" in guide


def test_intervals_of_simulated_events_cover_nine_of_ten_truths_and_the_guide_states_it():
    record = json.loads((RECORDS / "calibration_coverage.json").read_text(encoding="utf-8"))
    rows, guide = record["calibrations"], " ".join((ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8").split())
    assert len(rows) == record["events"] == 19
    covered = [sum(row["drawn"][k] for row in rows) / len(rows) for k in range(3)]
    assert covered == pytest.approx(record["covered_of_drawn"], abs=1e-3)
    assert all(0.85 < share < 0.95 for share in covered)
    a, b, c = (f"{100 * share:.0f} %" for share in covered)
    assert f"the friction in {a} of the calibrations, the internal friction in {b} and the volume factor in {c}" in guide
    first, second, third = record["covered_by_chain"]
    assert [first, second, third] == [sum(row["chain"][k] for row in rows) for k in range(3)]
    assert f"in {first}, {second} and {third} of {record['events']}" in guide
