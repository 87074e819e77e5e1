"""A run records where the flow reaches several thresholds at one time, on all backends alike, and nothing else changes."""

import json

import numpy as np
import pytest
from scenes import HASH_DEVICE, assert_same_arrays, scene

from runout import ConfigError, DruckerPrager, Release, Terrain, simulate
from runout.backends.protocol import RasterSums
from runout.model.joint_conditions import ATTRIBUTE
from runout.quantities import MET
from runout.simulation.batch import simulate_batch
from runout.simulation.observers import PeakMaps, flow_fields

TERRAIN = Terrain(np.tile(40.0 - 2.0 * np.arange(20), (14, 1)), (5.0, 5.0))
THICKNESS = np.zeros(TERRAIN.shape)
THICKNESS[5:9, 2:6] = 5.0
HOUSE = {"house_force": 35.3e3, "house_height": 5.6}
PAIR, TRIPLE = {"thickness": 1.0, "speed": 2.0}, {"thickness": 0.5, "speed": 3.0, "pressure": 2.5e4}
RUN = {
    "terrain": TERRAIN,
    "release": Release(THICKNESS, TERRAIN, placement="on_surface"),
    "material": DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0),
    "basal_friction_angle": 10.0,
    "cell_size": 5.0,
    "end_time": 1.5,
    "precision": "float64",
}


def column(thickness, speed, density=2000.0, area=5.0):
    """One cell of a flow."""
    mass = np.full((1, 1), thickness * area * density)
    return RasterSums(mass / density, mass, mass[..., None] * np.array((0.6 * speed, 0.0, 0.8 * speed)), 4, 7)


@pytest.mark.parametrize(
    ("flows", "met"),
    [
        ([(1.0, 2.0)], 1),  # both at their thresholds
        ([(0.8, 5.0), (2.0, 2.0 - 1e-6)], 2),  # of the pair each on its own, and h v and h v^2 as well; the triple at first
        ([(0.4, 9.0), (2.0, 1.2), (1.5, 2.5)], 1),
        ([(0.6, 3.6)], 2),  # 2000 * 3.6^2 = 25.92 kPa
        ([(0.6, 3.5), (0.4, 9.0)], 0),  # 24.5 kPa
        ([(1.2, 4.0)], 3),
    ],
)
def test_bits_are_those_of_conditions_reached_at_one_moment(flows, met):
    peaks = PeakMaps(scene(), 0.1, conditions=(PAIR, TRIPLE))
    for time, (thickness, speed) in enumerate(flows):
        peaks.observe(float(time), column(thickness, speed))
    bits = peaks.maps()[MET]
    assert bits[4, 7] == met
    assert bits.sum() == met


@pytest.mark.parametrize(
    ("flows", "broken"),
    [
        ([(1.0, 1.96)], True),  # 2000 * 1.96^2 = 7.683 kPa against 35.3 / (1 * 4.6) = 7.674 kPa
        ([(1.0, 1.95)], False),  # 7.605 kPa
        ([(0.5, 2.0), (4.0, 1.4)], False),  # 8.0 against 13.843 kPa, then 3.92 against the least, 35.3 / 2.8^2 = 4.503 kPa
        ([(4.0, 1.51)], True),  # 4.560 kPa
        ([(0.5, 2.64)], True),  # 13.939 kPa
    ],
)
def test_a_house_breaks_where_pressure_and_strength_meet_at_one_moment(flows, broken):
    """In the third case the largest pressure of 8.0 kPa passes the strength at the largest thickness: at different moments."""
    peaks = PeakMaps(scene(), 0.1, conditions=(HOUSE, PAIR))
    for time, (thickness, speed) in enumerate(flows):
        peaks.observe(float(time), column(thickness, speed))
    assert int(peaks.maps()[MET][4, 7]) & 1 == broken


def simulated(backend, **choices):
    """Result of a run."""
    if backend == "hash":
        ((_, result),) = simulate_batch([{**RUN, **choices}], device=HASH_DEVICE)
        return result
    return simulate(**RUN, **choices, backend=backend)


@pytest.mark.parametrize("backend", ["reference", "scan", "hash"])
def test_the_record_is_that_of_all_observations_and_the_maps_keep_their_bits(backend, monkeypatch):
    """Thickness and speed of every observation, on the cells of the raster, give the same record; the other maps are the same."""
    plain, observe, met = simulated(backend), PeakMaps.observe, np.zeros((2, *TERRAIN.shape), bool)

    def noted(self, time, columns):
        observe(self, time, columns)
        depth = columns.depth_volume / TERRAIN.cell_area
        speed = flow_fields(columns, self.scene.raster)[1]
        met[0, *columns.window] |= (depth >= PAIR["thickness"]) & (speed >= PAIR["speed"])
        against = np.maximum(np.minimum(depth, 2.8), 1e-9)
        strength = 35.3e3 / (against * (5.6 - against))
        density = columns.mass / np.maximum(columns.volume, np.finfo(float).tiny)
        met[1, *columns.window] |= (depth >= 0.1) & (density * speed**2 >= strength)

    monkeypatch.setattr(PeakMaps, "observe", noted)
    result = simulated(backend, joint_conditions=[PAIR, HOUSE])
    assert (result.maps[MET].values == met[0] + 2.0 * met[1]).all()
    assert 0 < met[0].sum() < (result.fields["max_flow_thickness"] >= 1.0).sum()
    assert 0 < met[1].sum() < (result.fields["max_flow_thickness"] > 0.0).sum()
    assert json.loads(result.maps.attrs[ATTRIBUTE]) == [PAIR, HOUSE]
    assert result.fields.keys() - plain.fields.keys() == {MET}
    assert_same_arrays(plain.fields, result.fields)
    assert ATTRIBUTE not in plain.maps.attrs


@pytest.mark.parametrize(
    "wrong",
    [
        {"thickness": 1.0}, {"thickness": 1.0, "deposit": 1.0}, {"thickness": 0.0, "speed": 1.0}, {"house_force": 1.0},
        {**HOUSE, "speed": 1.0},
    ],
)  # fmt: skip
def test_conditions_that_no_flow_reaches_at_one_time_are_refused(wrong):
    with pytest.raises(ConfigError, match="joint_conditions"):
        simulate(**RUN, joint_conditions=[wrong])
    with pytest.raises(ConfigError, match="25 conditions"):
        simulate(**RUN, joint_conditions=[PAIR] * 25)
