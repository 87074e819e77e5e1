"""Block keys, also for negative nodes, and limits of the time step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runout.physics import blocks, timestep

node = st.integers(-(2**22), 2**22 - 1)
block = st.integers(-(2**20), 2**20 - 1)


@given(node)
def test_block_and_place_in_it_give_the_node_back(n):
    place = blocks.local_index(0, 0, n)
    assert 4 * blocks.block_of(n) + place == n
    assert 0 <= place <= 3


@given(block, block, block)
def test_key_gives_the_block_back_and_fits_63_bits(x, y, z):
    key = blocks.block_key(x, y, z)
    assert (blocks.key_x(key), blocks.key_y(key), blocks.key_z(key)) == (x, y, z)
    assert 0 <= key < 2**63


@given(st.tuples(block, block, block), st.tuples(block, block, block))
def test_keys_order_blocks_as_their_coordinates_do(a, b):
    assert (blocks.block_key(*a) < blocks.block_key(*b)) == (a < b)


@given(block, block, block)
def test_mixture_of_a_key_never_passes_63_bits_on_its_way(x, y, z):
    key = blocks.block_key(x, y, z)
    assert 0 <= blocks.mixed(key) < 2**31
    assert (key & (2**31 - 1)) * 1640531527 + (key >> 31) * 625341585 < 2**63


@pytest.mark.parametrize("shape", [(64, 64, 1), (16, 16, 16), (4096, 1, 1), (1, 1, 4096)])
def test_mixed_keys_of_a_body_of_blocks_find_their_place_in_a_half_full_table_quickly(shape):
    """Linear probing at load 1/2 takes 1.5 probes for keys that fall at random (Knuth 1998, sec. 6.4)."""
    taken, probes = set(), 0
    for xyz in np.ndindex(*shape):
        place = blocks.mixed(blocks.block_key(*(int(c) - 7 for c in xyz))) % 8192
        while place in taken:
            place, probes = (place + 1) % 8192, probes + 1
        taken.add(place)
    assert 1 + probes / 4096 < 1.7


def test_negative_nodes_lie_in_floored_blocks():
    assert [blocks.block_of(n) for n in (-1, -4, -5, 0, 3, 4)] == [-1, -1, -2, 0, 0, 1]


def test_local_index_numbers_the_64_nodes_of_a_block():
    numbers = [blocks.local_index(x, y, z) for x in range(-4, 0) for y in range(8, 12) for z in range(4)]
    assert numbers == list(range(64))


def test_acoustic_limit_counts_the_speed_of_the_material():
    assert timestep.acoustic_limit(0.4, 2.0, 60.0, 20.0) == pytest.approx(0.01)


def test_particle_limit_is_half_a_cell():
    assert timestep.particle_limit(2.0, 20.0) == pytest.approx(0.05)


def test_mixture_of_a_key_is_the_number_of_earlier_versions():
    keys = [(0, 0, 0), (1, -1, 7), (-1048576, 1048575, -5)]
    assert [blocks.mixed(blocks.block_key(*xyz)) for xyz in keys] == [117125070, 903677300, 623442407]
