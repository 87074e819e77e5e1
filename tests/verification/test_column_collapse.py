"""Collapse of a granular column (F4 of the suite) against the envelope of experiments, 8 cells in the radius.

Experiments scatter by 15 to 25 % between materials; the tolerance is theirs. Columns of H_0/R_0 = 0.5 are four cells high
on this grid and run out 49 % too short; so are all others on coarser grids.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from collapse import collapsed_column

from runout.materials.drucker_prager import Cone
from runout.studies.verification_cases.bodies import filled, lattice
from runout.studies.verification_cases.closed_forms import axisymmetric_height, axisymmetric_runout
from runout.studies.verification_cases.column_collapse import WALLED, deposit, held_by, round_column, sand

SCATTER = 0.25
RECORD = Path(__file__).parents[2] / "tests" / "benchmarks" / "records" / "verification.json"


@pytest.mark.parametrize("aspect", [1.0, 1.5])
def test_column_of_sand_runs_out_within_the_scatter_of_experiments(aspect):
    """Run-out 0.99 and 1.75 radii against 1.24 and 1.86 (-20 and -6 %); height 0.62 and 0.67 radii against 0.74."""
    runout, height = collapsed_column(aspect, 30.0)
    assert runout == pytest.approx(axisymmetric_runout(aspect), rel=SCATTER)
    assert height == pytest.approx(axisymmetric_height(aspect), rel=SCATTER)


def test_column_of_60_degrees_falls_out_of_the_envelope():
    """The negative control: 0.52 radii."""
    runout, _ = collapsed_column(1.0, 60.0)
    assert runout < axisymmetric_runout(1.0) * (1 - SCATTER)


def test_core_of_a_tall_round_column_fills_the_space_that_its_strains_claim():
    """Four radii high, 6 cells in the radius: 1.013. By four strings of particles on the axis it looked like 1.7."""
    end = round_column(4.0, 6, Cone.PLANE_STRAIN, "float32")
    assert end.claimed == pytest.approx(1.0, abs=0.05)
    assert end.runout == pytest.approx(axisymmetric_runout(4.0), rel=SCATTER)


def squeezed_cylinder(flattened=1.0):
    """Deposit of a cylinder of the initial radius and half of it high, squeezed to a share of its height; and its particles."""
    apart = WALLED / 20
    x = lattice((2 * WALLED, 2 * WALLED, WALLED / 2), apart, 1) - (WALLED, WALLED, 0.0)
    x = x[np.hypot(x[:, 0], x[:, 1]) < WALLED]
    p = filled(x, apart, 2000.0, apart**3)
    return deposit(p, x * (1.0, 1.0, flattened), 2000.0), p, x


def test_core_that_is_packed_too_dense_is_found_out():
    """The measure of the core: particles squeezed to two thirds of the height that their strains say claim 1.5 times the space."""
    assert squeezed_cylinder()[0].claimed == pytest.approx(1.0, abs=0.05)
    assert squeezed_cylinder(2 / 3)[0].claimed == pytest.approx(1.5, abs=0.1)


def test_core_that_came_apart_claims_the_volume_that_it_gained():
    _, p, x = squeezed_cylinder()
    before = deposit(p, x, 2000.0).claimed
    p.history[:] = 0.1
    assert deposit(p, x, 2000.0).claimed == pytest.approx(np.exp(0.1) * before)


def test_floor_holds_no_more_than_sand_in_simple_shear_hands_on():
    assert held_by(sand(2.0, 30.0)) == pytest.approx(np.sin(np.radians(30.0)))
    assert held_by(sand(2.0, 30.0, Cone.TRIAXIAL_COMPRESSION)) == pytest.approx(np.tan(np.radians(30.0)))


def test_published_exponents_of_run_out_are_those_of_experiments_within_a_tenth():
    """1/2 for round columns and 2/3 between walls; at full size, which takes too long here: `runout verify F4 --full`."""
    results = next(case for case in json.loads(RECORD.read_text())["cases"] if case["name"] == "F4")["results"]
    found = {r["quantity"].split(",")[0]: r["value"] for r in results if r["quantity"].startswith("exponent")}
    assert found["exponent of round run-out"] == pytest.approx(1 / 2, abs=0.1)
    assert found["exponent of planar run-out"] == pytest.approx(2 / 3, abs=0.1)
