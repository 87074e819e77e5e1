"""The ledger holds the work of a backend: active blocks and nodes, sparsity and memory over time."""

import json
import logging

import numpy as np
import pytest
from scenes import SAND, at, engine_of, scene

from runout.backends.protocol import box_blocks
from runout.backends.scan.backend import ScanBackend
from runout.ensemble import work_log
from runout.log import JsonLines
from runout.model.particles import Particles
from runout.simulation.observers import Ledger
from runout.simulation.run import Run, RunControl
from runout.variables import VARIABLES

CELLS = (1.0, 1.0, 1.0)
FLYING = scene(spacing=CELLS, gravity=(0.0, 0.0, -0.1), materials=(SAND,))


def pair(east):
    """Two lumps of particles, so far apart to the east [m] and 4 m upwards."""
    x = np.random.default_rng(3).uniform(4.0, 7.9, (60, 3))
    places = np.concatenate([x, x + np.array((east, 0.0, 4.0))])
    p = at(places, CELLS, volume=0.125)
    p.velocity[:] = (2.0, 0.0, 0.0)
    return p


def expected(particles, first=0):
    """Active blocks, and those of the box around them; blocks are counted from the node ``first``."""
    blocks = np.unique((particles.node - first) >> 2, axis=0)
    return len(blocks), int(np.prod(blocks.max(axis=0) - blocks.min(axis=0) + 1))


@pytest.mark.parametrize("east", [0.0, 36.0])
def test_backends_count_active_blocks_and_the_box_around_them(backend, east):
    particles = pair(east)
    first = particles.node.min(axis=0) if isinstance(backend, ScanBackend) else 0
    backend.load(FLYING, particles)
    row = backend.ledger()
    assert (row.active_blocks, row.box_blocks) == expected(particles, first)
    for _ in range(100):
        backend.step(0.015)
    row = backend.ledger()
    assert (row.active_blocks, row.box_blocks) == expected(backend.particles(), first)
    assert backend.memory_bytes() > 100 * len(particles)


def test_sparsity_is_the_box_over_the_active_blocks_and_unknown_without_any():
    ledger, engine = Ledger(), engine_of("reference")
    for particles in (pair(36.0), Particles.zeros(0)):
        engine.load(FLYING, particles)
        ledger.record(float(len(ledger.time)), 0.1, engine.ledger(), engine.memory_bytes())
    series = ledger.series()
    active, box = expected(pair(36.0))
    assert series["active_nodes"].tolist() == [64 * active, 0]
    assert series["sparsity"][0] == box / active > 3.0
    assert np.isnan(series["sparsity"][1])
    assert series["memory"][0] > series["memory"][1] >= 0
    assert box_blocks(np.zeros((0, 3), np.int32)) == 0


def test_work_of_a_mass_that_has_left_is_logged_as_valid_json():
    ledger, engine = Ledger(), engine_of("reference")
    for k, particles in enumerate((pair(36.0), Particles.zeros(0))):
        engine.load(FLYING, particles)
        ledger.record(float(k), 0.1, engine.ledger(), engine.memory_bytes())
    lines, handler = [], logging.Handler()
    handler.emit = lambda record: lines.append(json.loads(JsonLines().format(record), parse_constant=pytest.fail))
    work_log.LOGGER.addHandler(handler)
    work_log.LOGGER.setLevel(logging.DEBUG)
    try:
        work_log.log_work(7, {"time": np.arange(2.0), **ledger.series()})
    finally:
        work_log.LOGGER.removeHandler(handler)
        work_log.LOGGER.setLevel(logging.NOTSET)
    (line,) = lines
    assert (line["member"], line["work"]["active_blocks"][1], line["work"]["sparsity"][1]) == (7, 0, None)


def test_work_over_time_is_in_the_ledger_of_a_run_with_units(backend):
    run = Run(backend, FLYING, RunControl(0.6, stop=False), None, None)
    run.start(pair(36.0))
    run.go()
    series = run.ledger.series()
    for name in ("active_blocks", "active_nodes", "sparsity", "memory"):
        assert len(series[name]) == len(series["dt"]) > 2
        assert (series[name] > 0).all()
        assert VARIABLES[name].units in ("1", "byte")
    again = Ledger()
    again.restore(run.ledger.state())
    for name, values in again.series().items():
        np.testing.assert_array_equal(values, series[name], err_msg=name)
