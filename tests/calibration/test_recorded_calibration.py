"""The recorded calibration of Frank Slide holds the friction of the runs that it was calibrated by, and the guide states it."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RECORD = json.loads((ROOT / "tests" / "benchmarks" / "records" / "calibration_frank_slide.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("angle", ["15", "20"])
def test_intervals_hold_the_friction_of_the_other_code_and_stand_in_the_guide(angle):
    friction = RECORD["angles"][angle]["parameters"]["basal_friction_angle_deg"]
    assert friction["p5"] < float(angle) < friction["p95"]
    guide = " ".join((ROOT / "docs" / "guide" / "calibration.md").read_text(encoding="utf-8").split())
    assert f"{friction['p5']:.1f} to {friction['p95']:.1f} degrees" in guide
