"""Blocks of 4 x 4 x 4 nodes, their 63-bit keys and the mixing of keys."""

from typing import Any

from runout.physics.tensors import i64


def block_of(n: Any):
    """Block coordinate of a node coordinate; floors for negative ones."""
    return n >> 2


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


def mixed(key: Any):
    """31-bit mixture of a key: neighbouring blocks fall far apart in a table.

    Two multiplications by odd constants near 2^31 / golden ratio and 2^30 (Knuth 1998, The Art of Computer Programming 3,
    sec. 6.4) with shifts between; no product passes 63 bits, so that every compiler finds the same number.
    """
    low = key & i64(2147483647)
    high = key >> i64(31)
    h = low * i64(1640531527) + high * i64(625341585)
    h = h ^ (h >> i64(32))
    h = (h & i64(2147483647)) * i64(73244475)
    return (h ^ (h >> i64(28))) & i64(2147483647)
