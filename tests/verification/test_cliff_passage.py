"""A flow passes the edge of a cliff, however steep the face: at most 3 % of it stays behind, as on the slope without a cliff."""

import numpy as np
import pytest

import runout

SLOPE, EDGE, DROP = np.tan(np.radians(20.0)), 51.0, 40.0
SAND = runout.DruckerPrager(density=2000.0, youngs_modulus=1e7, poisson_ratio=0.3, friction_angle=34.0, cohesion=0.0)


@pytest.mark.parametrize(
    ("face_deg", "cell", "azimuth_deg"),
    [(60.0, 2.0, 0.0), (80.0, 2.0, 0.0), (85.0, 4.0, 0.0), (89.0, 2.0, 0.0), (89.0, 1.0, 0.0), (89.0, 2.0, 30.0)],
)
def test_flow_of_4_m_leaves_at_most_3_percent_behind_the_edge(face_deg, cell, azimuth_deg):
    """Measured 1.7 to 2.6 %; with a surface that overshoots 10 % at 80 deg and 96 % at 89 deg."""
    x = (np.arange(int(128 / cell)) + 0.5) * cell
    east, north = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    along, across = x[None, :] * east + (x[::-1, None] - 64) * north, -x[None, :] * north + (x[::-1, None] - 64) * east
    face = np.tan(np.radians(face_deg)) - SLOPE
    terrain = runout.Terrain.from_array(600 - SLOPE * along - np.clip((along - EDGE) * face, 0, DROP), cell)
    thickness = np.where((along > 12) & (along < 36) & (np.abs(across - 10 * north) < 10), 4.0, 0.0)
    release = runout.Release(thickness, terrain, placement=runout.Placement("on_surface"))
    result = runout.simulate(
        terrain, release, SAND, basal_friction_angle=10.0, cell_size=2.0, particles_per_cell=(2, 2, 2), end_time=9.0, threads=1,
        stop=False,
    )  # fmt: skip
    p = result.particles
    behind = p.easting.values * east + (p.northing.values - 64) * north < EDGE - 1
    assert p.mass.values[behind].sum() < 0.03 * thickness.sum() * cell**2 * SAND.density
