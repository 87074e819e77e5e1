"""Collapse of a granular column (F4 of the suite) against the envelope of experiments, 8 cells in the radius.

Experiments scatter by 15 to 25 % between materials; the tolerance is theirs. Columns of H_0/R_0 = 0.5 are four cells high
on this grid and run out 49 % too short; so are all others on coarser grids.
"""

import pytest
from collapse import collapsed_column

from pipelines.verification_cases.closed_forms import axisymmetric_height, axisymmetric_runout

SCATTER = 0.25


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
