"""Every case of `runout verify` at the sizes of CI: bounds and orders hold, and no error grows.

`golden_errors.json` holds the errors of an earlier version. An error that is larger by more than 5 % fails; after a change that
is meant to cost accuracy, and says so in the changelog, put the new errors there (`runout verify --json` prints them).
"""

import json
from pathlib import Path

import pytest

from runout.studies.verification import CASES
from runout.studies.verification_cases.closed_forms import AxisAlignedWave
from runout.studies.verification_cases.column_collapse import measured_surface
from runout.studies.verification_cases.finding import Bound, Convergence
from runout.studies.verification_cases.manufactured import wave_error

GOLDEN = json.loads(Path(__file__).with_name("golden_errors.json").read_text())
GROWTH, ROUNDING = 1.05, 1e-12


@pytest.fixture(scope="module", params=CASES, ids=str)
def measured(request):
    """A case and what it measures."""
    case = CASES[request.param]
    return case, case.measure(False)


def test_bounds_and_declared_orders_hold(measured):
    _, results = measured
    assert [r for r in results if not r.holds] == []


def test_no_error_grew_beyond_the_golden_one(measured):
    case, results = measured
    errors = {r.quantity: r.errors for r in results if isinstance(r, Convergence)}
    golden = GOLDEN.get(case.name, {})
    assert set(errors) == set(golden)
    for quantity, found in errors.items():
        limits = [GROWTH * e + ROUNDING for e in golden[quantity]]
        assert all(e <= limit for e, limit in zip(found, limits, strict=True)), (quantity, found, golden[quantity])


def test_every_case_of_the_suite_is_there():
    ground = ["sliding-box", *(f"t{k}" for k in range(2, 7)), "t8", "layers", "float32"]
    ground += ["voellmy", "weakening", "zones", "pore-pressure"]
    assert list(CASES) == [*(f"u{k}" for k in range(1, 11)), *ground, *(f"f{k}" for k in range(1, 6)), "t7", "mud", "bed", "inflow"]


def test_surface_of_the_rods_is_compared_where_the_experiment_is_at_hand(monkeypatch):
    if measured_surface() is None:
        pytest.skip("RUNOUT_DATA names no folder with the surface of Bui et al. 2008")
    assert measured_surface().shape == (23, 2)
    monkeypatch.setenv("RUNOUT_DATA", "/nowhere")
    assert measured_surface() is None


def test_not_a_number_holds_no_bound_and_no_order():
    assert not Bound("a number", float("nan"), 1.0).holds
    assert not Convergence("errors", (1, 2, 4), (1.0, float("nan"), 0.1), 1.0).holds


def test_order_is_the_slope_of_the_errors():
    second = Convergence("errors", (8, 16, 32), (4e-2, 1e-2, 2.5e-3), 2.0)
    assert second.order == pytest.approx(2.0)
    assert second.holds
    assert not Convergence("errors", (8, 16, 32), (4e-2, 2e-2, 1e-2), 2.0).holds


def test_order_is_lost_when_the_body_force_is_one_percent_off(monkeypatch):
    """The negative control: order 1.33 instead of 2.00; a stress one percent off leaves 0.29."""
    force = AxisAlignedWave.body_force
    monkeypatch.setattr(AxisAlignedWave, "body_force", lambda self, X, t: 1.01 * force(self, X, t))
    assert not Convergence("u", (8, 16, 32), tuple(wave_error(n, 0.005)[0] for n in (8, 16, 32)), 2.0).holds
