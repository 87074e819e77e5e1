"""Columns that a GPU spreads itself equal those that the host spreads, for several scenes in one launch and looks in one series."""

from copy import deepcopy
from types import SimpleNamespace

import numpy as np
from scenes import HASH_DEVICE

from runout import DruckerPrager, Release, Terrain
from runout.backends.hash import columns as hash_columns
from runout.backends.hash.batch import Batch
from runout.model.numerics import Numerics
from runout.simulation.scenario import build_scene

SIZE = 30  # cells of the raster along each axis


def scene(thickness: float, place: tuple[int, int], side: int):
    """A square of a mass on a rough slope; thin ones are single particles, and one lies at the edge of the raster."""
    y, x = np.mgrid[:SIZE, :SIZE] * 10.0
    terrain = Terrain(0.3 * (300.0 - x) + 2.0 * np.sin(x / 30.0) * np.cos(y / 40.0), (10.0, 10.0))
    depth = np.zeros((SIZE, SIZE))
    depth[place[0] : place[0] + side, place[1] : place[1] + side] = thickness
    material = DruckerPrager(density=1800.0, friction_angle=30.0)
    return build_scene(terrain, Release(depth, terrain), material, 20.0, Numerics(cell_size=10.0))


LOOKS = (1, 2, 3)  # of a series of transfers: the device goes on before the host reads the first
SCENES = ((25.0, (10, 5), 8), (3.0, (0, 0), 5), (0.5, (20, 20), 3))


def columns(monkeypatch, on_device: bool):
    """Columns of the scenes of one launch at a look after some transfers, and at their end."""
    monkeypatch.setattr(hash_columns, "spreads_on", lambda device: on_device)
    batch, looks = Batch([scene(*parts) for parts in SCENES], HASH_DEVICE, deterministic=HASH_DEVICE != "cpu"), []
    many = range(len(SCENES))

    def take(s, step, seen):
        assert seen.boxes.sums.any()  # read at once: the next series takes their place
        looks.append((s, deepcopy(seen)))

    dt = [0.5 * batch.stable_step(s) for s in many]
    for _ in range(3):
        batch.advance(dt, [3] * len(SCENES), dict.fromkeys(many, LOOKS), take)
    return [seen for _, seen in looks] + [batch.lattice_columns_of(s) for s in many]


def test_columns_of_the_device_are_those_of_the_host(monkeypatch):
    by_host, by_device = columns(monkeypatch, False), columns(monkeypatch, True)
    assert len(by_host) == len(by_device) == (3 * len(LOOKS) + 1) * len(SCENES)
    assert any((c.volume > 2.0 * c.depth_volume).any() for c in by_host)  # single particles
    assert any(c.column == 0 for c in by_host)  # at the edge of the raster, what lies beyond is mirrored
    for one, other in zip(by_host, by_device, strict=True):
        assert (one.row, one.column) == (other.row, other.column)
        for name in ("volume", "mass", "momentum", "depth_volume"):
            expected, value = getattr(one, name), getattr(other, name)
            assert expected.max() > 0
            np.testing.assert_allclose(value, expected, rtol=0, atol=1e-14 * np.abs(expected).max(), err_msg=name)
        np.testing.assert_array_equal(one.boxes.sums, other.boxes.sums)


def test_a_look_finds_its_arrays_where_the_last_one_left_them_until_a_window_grows(monkeypatch):
    monkeypatch.setattr(hash_columns, "LEAST_ROOM", 1)
    monkeypatch.setattr(hash_columns, "LEAST_SHARE", 1)
    batch = Batch([scene(*parts) for parts in SCENES], HASH_DEVICE)
    sums, many = batch.parts.columns, range(len(SCENES))
    assert sums.room == 0
    before = batch.lattice_columns_of(0).mass.copy()
    of_one = sums.room
    assert of_one > 0
    batch.look_at(many)
    packed, room = sums.packed, sums.room
    assert room > of_one  # three windows
    for _ in range(3):
        batch.report.forget()
        batch.look_at(many)
        np.testing.assert_allclose(batch.lattice_columns_of(0).mass, before, rtol=0, atol=1e-14 * before.max())
    assert sums.packed is packed
    assert sums.room == room


def test_a_gpu_spreads_its_sums():
    assert hash_columns.spreads_on(SimpleNamespace(is_cuda=True))
    assert not hash_columns.spreads_on(SimpleNamespace(is_cuda=False))
