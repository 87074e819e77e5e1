"""What 32-bit indices and strides cannot address is refused with the number that fits, before a run and when it grows."""

from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from scenes import SAND, box, engine_of, plane, scene

from runout import VoellmyBase
from runout.backends.hash import backend, grid, limits, readback
from runout.errors import CapacityError
from runout.forecast.memory import Extent, expected_memory
from runout.model.numerics import Scheme

UNIT = (1.0, 1.0, 1.0)
CARD = SimpleNamespace(device=SimpleNamespace(is_cuda=True))


def loaded(p, **choices):
    engine = engine_of("hash")
    engine.load(scene(**choices), p)
    return engine


@pytest.mark.parametrize(("number", "largest"), [(4, 2**29 - 1), (8, 2**28 - 1)])
def test_rows_of_the_particle_matrix_have_a_stride_of_32_bits(number, largest):
    assert limits.largest_particles(number) == largest
    limits.require_particles(largest, number)
    with pytest.raises(CapacityError, match=rf"{largest + 1} particles has more than the {largest} .* float{8 * number}"):
        limits.require_particles(largest + 1, number)


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("deterministic", [False, True])
def test_no_array_of_a_run_takes_more_numbers_by_block_than_the_limits_count(substeps, deterministic):
    engine = engine_of("hash", deterministic=deterministic)
    p = box((20.0, 20.0, 0.0), (8.0, 8.0, 4.0), UNIT)
    friction = (VoellmyBase(mu=0.2, xi=500.0), VoellmyBase(mu=0.3, xi=500.0))
    engine.load(scene(plane(), materials=(SAND, SAND), friction=friction, substeps=substeps), p)
    parts = engine.parts
    blocks, most = parts.index.capacity, 0
    for part in (parts.index, parts.nodes):
        for name, array in vars(part).items():
            if isinstance(array, wp.array) and array.ndim == 1 and name not in ("table", "slots", "members", "contact", "shares"):
                most = max(most, len(array) / blocks)
    assert limits.largest_blocks(deterministic, friction[0], 2, substeps > 1) == limits.LARGEST_INDEX // int(most)


def test_load_refuses_particles_that_cannot_be_addressed(monkeypatch):
    p = box((20.0, 20.0, 0.0), (2.0, 2.0, 2.0), UNIT)
    monkeypatch.setattr(limits, "LARGEST_INDEX", 8 * len(p) - 1)
    with pytest.raises(CapacityError, match=r"64 particles .* 63 .* float64; use a cell_size 1.01 times .*, or float32"):
        loaded(p)


def test_load_refuses_blocks_that_cannot_be_addressed(monkeypatch):
    p = box((20.0, 20.0, 0.0), (16.0, 16.0, 4.0), UNIT)
    monkeypatch.setattr(limits, "LARGEST_INDEX", 65 * 40)
    monkeypatch.setattr(limits, "require_particles", lambda *of: None)
    monkeypatch.setattr("runout.backends.hash.loading.require_particles", lambda *of: None)
    with pytest.raises(CapacityError, match=r"run of \d+ blocks has more than the \d+ that hash can address; use a cell_size"):
        loaded(p)


def test_an_index_that_grows_takes_no_more_room_than_can_be_addressed_and_then_ends_the_run(monkeypatch):
    """A cloud that expands: its room is cut at the limit first, and passes it later."""
    p = box((38.0, 36.0, 0.0), (2.0, 2.0, 2.0), UNIT)
    p.velocity[:] = 20.0 * (p.position(np.array(UNIT)) - np.array([39.0, 37.0, 1.0]))
    p.volume[:] = 1e-9
    engine = loaded(p, gravity=(0.0, 0.0, 0.0))
    largest = engine.parts.index.largest = engine.parts.index.capacity + 5
    with pytest.raises(CapacityError, match=rf"more than the {largest} that hash can address"):
        engine.steps(0.01, 150)
    assert engine.parts.index.capacity <= largest


def test_room_is_cut_where_what_is_needed_fits():
    assert limits.room_within(200, 90, 100, "blocks") == 100
    assert limits.room_within(80, 70, 100, "blocks") == 80
    with pytest.raises(CapacityError, match=r"110 blocks has more than the 100 .* cell_size 1.05 times"):
        limits.room_within(200, 110, 100, "blocks")


def test_blocks_in_contact_have_a_limit_of_their_own(monkeypatch):
    monkeypatch.setattr(limits, "LARGEST_INDEX", 256 * 100)
    assert grid.new_room((10, 90), (0, 0), False)[1] == 100
    with pytest.raises(CapacityError, match="101 blocks of nodes in contact has more than the 100"):
        grid.new_room((10, 101), (0, 0), False)


def test_sums_of_maps_that_cannot_be_addressed_are_refused(monkeypatch):
    engine = loaded(box((20.0, 20.0, 0.0), (2.0, 2.0, 2.0), UNIT))
    assert readback.require_index is limits.require_index
    monkeypatch.setattr(limits, "LARGEST_INDEX", 100)
    with pytest.raises(CapacityError, match=r"sums of maps take \d+ numbers, more than the 100"):
        engine.columns()


@pytest.mark.parametrize(("precision", "fits"), [("float32", 2**29 - 1), ("float64", 2**28 - 1)])
def test_the_forecast_for_a_card_refuses_what_it_cannot_address(precision, fits):
    extent = Extent(fits + 1, 1000, 1000, 1000, 1000)
    with pytest.raises(CapacityError, match=rf"more than the {fits} that hash can address in {precision}"):
        expected_memory(extent, 10_000, Scheme(precision=precision), CARD)
    assert expected_memory(extent, 10_000, Scheme(precision=precision)).backend > 0  # on the CPU
    assert backend.bytes_needed(fits, 1000, precision) > 2**35


def test_the_forecast_for_a_card_refuses_blocks_that_cannot_be_addressed():
    most = limits.largest_blocks(False, substepped=True)
    with pytest.raises(CapacityError, match=rf"{most + 1} blocks has more than the {most}"):
        expected_memory(Extent(1000, 1, 1, 1, most + 1), 10_000, Scheme(precision="float32"), CARD)
