"""A slab with mass on both sides of a border of friction zones follows the closed form, on scan and hash.

The reference agrees with both in zones (test_friction_zones, tests/laws).
"""

from dataclasses import replace

import numpy as np
import pytest
from scenes import HARD, engine_of

from runout.studies.verification_cases import zone_crossing
from runout.studies.verification_cases.zone_crossing import CELL, SLOPE_DEG, THICK, VOELLMY, Crossing

BOUND = 0.004  # measured: 0.0022, since friction presses the front of the slab down (zone_crossing)
DRAG_BOUND = 0.025  # measured: 0.018, since the ground area at the rims is known to a tenth of a cell


@pytest.fixture(autouse=True)
def slab_below_its_strength(monkeypatch):
    """The law of the other tests of zones, which share its compiled code; the slab stays elastic."""
    elastic = zone_crossing.SLAB
    same = replace(HARD, density=elastic.density, youngs_modulus=elastic.youngs_modulus, poisson_ratio=elastic.poisson_ratio)
    monkeypatch.setattr(zone_crossing, "SLAB", same)


@pytest.mark.parametrize("name", ["scan", "hash"])
@pytest.mark.parametrize(("slab", "bound"), [(Crossing(), BOUND), (VOELLMY, DRAG_BOUND)], ids=["coulomb", "voellmy"])
def test_centre_of_mass_of_a_slab_that_crosses_zones_follows_the_closed_form(name, slab, bound):
    """Coulomb: mu 0.1, 0.35 and 0.6 around tan 25 deg = 0.47. Voellmy: all three zones lie below the slab at once."""
    places, speeds = slab.motion(engine_of(name))
    assert places[0] + slab.size[0] / 2 < slab.borders[0]
    assert places[-1] - slab.size[0] / 2 > slab.borders[-1]
    assert np.abs(slab.errors(places, speeds)).max() < bound
    moved = replace(slab, borders=tuple(b + CELL / 2 for b in slab.borders))  # the negative control
    assert np.abs(moved.errors(places, speeds)).max() > 2 * bound
    point = slab.closed_form().speeds(places, 0.1, SLOPE_DEG, slab.start)  # mass that changes its friction at once
    assert np.abs(speeds / point - 1.0).max() > 2 * bound


def test_friction_at_centres_of_cells_moves_the_border_to_that_of_a_cell():
    """Borders at 20.6 and 35.4 m are those at 20 and 36 m then."""
    slab = Crossing(sampled=True)
    assert slab.edges == (20.0, 36.0)
    places, speeds = slab.motion(engine_of("scan"))
    assert np.abs(slab.errors(places, speeds)).max() < BOUND
    assert np.abs(Crossing().errors(places, speeds)).max() > 2 * BOUND


def test_thick_slab_meets_borders_early_by_the_lever_of_its_friction():
    """Measured: 0.0051 with the same pressure everywhere, 0.0023 with that of a rigid body."""
    places, speeds = THICK.motion(engine_of("scan"))
    even, rigid = (np.abs(THICK.errors(places, speeds, lever)) for lever in (0.0, THICK.lever))
    assert even[-1] > 0.004
    assert rigid.max() < 0.003
    assert rigid[-1] < 0.0015
