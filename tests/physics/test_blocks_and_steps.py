"""Block keys, also for negative nodes, and limits of the time step."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runout.physics import blocks, timestep

node = st.integers(-(2**22), 2**22 - 1)
block = st.integers(-(2**20), 2**20 - 1)


@given(node)
def test_block_and_place_give_the_node_back(n):
    assert 4 * blocks.block_of(n) + blocks.place_in_block(n) == n
    assert 0 <= blocks.place_in_block(n) <= 3


@given(block, block, block)
def test_key_gives_the_block_back_and_fits_63_bits(x, y, z):
    key = blocks.block_key(x, y, z)
    assert (blocks.key_x(key), blocks.key_y(key), blocks.key_z(key)) == (x, y, z)
    assert 0 <= key < 2**63


@given(st.tuples(block, block, block), st.tuples(block, block, block))
def test_keys_order_blocks_as_their_coordinates_do(a, b):
    assert (blocks.block_key(*a) < blocks.block_key(*b)) == (a < b)


def test_negative_nodes_lie_in_floored_blocks():
    assert [blocks.block_of(n) for n in (-1, -4, -5, 0, 3, 4)] == [-1, -1, -2, 0, 0, 1]


def test_local_index_numbers_the_64_nodes_of_a_block():
    numbers = [blocks.local_index(x, y, z) for x in range(-4, 0) for y in range(8, 12) for z in range(4)]
    assert numbers == list(range(64))


def test_acoustic_limit_counts_the_speed_of_the_material():
    assert timestep.acoustic_limit(0.4, 2.0, 60.0, 20.0) == pytest.approx(0.01)


def test_particle_limit_is_half_a_cell():
    assert timestep.particle_limit(2.0, 20.0) == pytest.approx(0.05)
