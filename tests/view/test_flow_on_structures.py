"""Flow is drawn on the tops of structures where its particles lie there, and on the ground below them elsewhere."""

import numpy as np
import pytest

from runout.view.scene import FlowScene, on_structures
from runout.view.surfaces import flow_points


def scene(elevations):
    """Level ground at 100 m, 7 x 7 cells of 2 m, 1 m of flow in the middle, and particles there at an elevation for each frame."""
    axis = 1000.0 + 2.0 * np.arange(7)
    thickness = np.zeros((len(elevations), 7, 7))
    thickness[:, 3, 3] = 1.0
    particles = np.array([[[axis[3], axis[3], z, 5.0], [np.nan] * 4] for z in elevations])
    ground = np.full((7, 7), 100.0)
    return FlowScene(axis, axis[::-1], ground, np.arange(len(elevations)) * 1.0, thickness, thickness, particles=particles)


def span(hangs):
    """A structure over the 3 x 3 cells in the middle, its top 6 m and its underside 4 m above the ground if it hangs."""
    low, high = np.full((2, 7, 7), np.nan)
    low[2:5, 2:5], high[2:5, 2:5] = 104.0 if hangs else 95.0, 106.0
    return low, high, hangs


@pytest.mark.parametrize("hangs", [True, False])
def test_particles_say_whether_a_flow_is_on_a_structure_or_beside_and_below_it(hangs):
    found = on_structures(scene((106.4, 101.0)), [span(hangs)])
    assert [flow_points(found, frame)[3, 3, 2] for frame in (0, 1)] == pytest.approx([107.0, 101.0])
    assert found.lift[0][2:5, 2:5] == pytest.approx(6.0)
    assert not np.delete(found.lift[0].ravel(), np.ravel_multi_index(np.ix_([2, 3, 4], [2, 3, 4]), (7, 7)).ravel()).any()
    assert not found.lift[1].any()
    finer = found.frames(1).refined()
    assert flow_points(finer, 0)[..., 2].max() == pytest.approx(107.0, abs=0.3)


def test_without_particles_or_structures_the_flow_is_on_the_ground():
    from dataclasses import replace

    assert on_structures(scene((106.4,)), []).lift is None
    assert on_structures(replace(scene((106.4,)), particles=None), [span(True)]).lift is None
