"""Blocks of 4 x 4 x 4 nodes, their 63-bit keys and the mixing of keys."""

from typing import Any

from runout.physics.tensors import i64


def block_of(n: Any):
    """Block coordinate of a node coordinate; floors for negative ones."""
    return n >> 2


def place_in_block(n: Any):
    """Position of a node within its block, 0 to 3."""
    return n & 3


def local_index(x: Any, y: Any, z: Any):
    """Index 0 to 63 of a node within its block from its three positions."""
    return ((x & 3) << 4) | ((y & 3) << 2) | (z & 3)


def block_key(x: Any, y: Any, z: Any):
    """63-bit key of a block: three 21-bit coordinates with bias 2^20, so that -2^20 <= coordinate < 2^20."""
    bias = i64(1048576)
    return ((i64(x) + bias) << i64(42)) | ((i64(y) + bias) << i64(21)) | (i64(z) + bias)


def key_x(key: Any):
    """First block coordinate of a key."""
    return (key >> i64(42)) - i64(1048576)


def key_y(key: Any):
    """Second block coordinate of a key."""
    return ((key >> i64(21)) & i64(2097151)) - i64(1048576)


def key_z(key: Any):
    """Third block coordinate of a key."""
    return (key & i64(2097151)) - i64(1048576)
