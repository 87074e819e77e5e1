"""Quadratic stencils in lanes: particles of one cell share nine rows of nodes, which stay in registers.

Record of a particle (16 numbers, one cache line in float32); f is the offset from its cell's first node, 0.5 <= f < 1.5:

    [ m, px, py, pz | fx, A column 0 | fy, A column 1 | fz, A column 2 ]

with A = h_j (m C - dt 4/h_j^2 V0 tau), so that the momentum at node x is m v + A (x - f) with x in cells
(Hu et al. 2018, ACM TOG 37:150, eq. 18), and p this momentum at the middle node x = 1: the other nodes are a sum away.
Between gather and law the record holds v in place of p and the first moments sum w v_i x_j about the first node in place of A.

A row of nodes is four nodes along z of four numbers each, mass or weight first: one vector. An arena holds the 6 x 6 x 6
nodes that the particles of one block reach, and room for the vector that starts at its last row.
"""

import numpy as np

from runout.backends.lanes import (
    constant,
    load4,
    load8,
    load16,
    local_array,
    permutation,
    permutation_of_two,
    prefetch,
    store,
)

ROW = 24  # numbers per row of six nodes
PLANE = 144
ARENA = 880  # 864 and padding
AHEAD = 30  # particles between a prefetch and its use: particles are read in the order of their cells
EVERY, UPPER = 0xFF, 0xAA  # parts of an arena, as bits
ALL = 16  # numbers that a vector of weights takes


def in_groups(values):
    """Lanes with each of four values four times."""
    return [x for x in values for _ in range(4)]


# weights as (scale d) d + offset with d = f - centre, see bspline.weights: group 1 + j is axis j, a lane of it a node
all_scale = constant([0.0] * 4 + [0.5, -1.0, 0.5, 1.0] * 3)  # the last lane is twice the third weight
all_centre = constant([0.0] * 4 + [1.5, 1.0, 0.5, 0.5] * 3)
all_offset = constant([0.0] * 4 + [0.0, 0.75, 0.0, 0.0] * 3)
weights_of_z = permutation(in_groups((12, 13, 14, 0)))
# of the three nodes along z in the sum and the moments about x, y and z
lower_of_z = permutation(in_groups((12, 12, 12, 0)))
middle_of_z = permutation(in_groups((13, 13, 13, 13)))
upper_of_z = permutation(in_groups((14, 14, 14, 15)))


def lanes_of_groups(groups):
    """Lanes of four of the eight groups of two vectors."""
    return [4 * g + k for g in groups for k in range(4)]


lower_and_middle = permutation_of_two(lanes_of_groups((0, 1, 4, 5)))  # nodes of two sums
upper = permutation_of_two(lanes_of_groups((2, 2, 6, 6)))
all_lower = permutation_of_two(lanes_of_groups((0, 2, 4, 4)))
all_middle = permutation_of_two(lanes_of_groups((1, 3, 5, 1)))
all_upper = permutation_of_two(lanes_of_groups((0, 2, 6, 0)))
z_side_of_a = constant([0.0, -1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
zeros, ones = constant([0.0] * 16), constant([1.0] * 16)
repeated = permutation([0, 1, 2, 3] * 4)  # a b c d -> abcd abcd abcd abcd
even_groups = permutation_of_two([0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27])
odd_groups = permutation_of_two([4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31])
first_group, second_group = permutation(range(4)), permutation(range(4, 8))
offsets = permutation([0] * 4 + [4] * 4 + [8] * 4 + [12] * 4)  # record -> m, fx, fy, fz in the groups
in_all_four = permutation(in_groups(range(4)))
heads_and_tails = permutation_of_two([i if i % 4 == 0 else 16 + i for i in range(16)])  # heads of groups of a, rest of b
tails = permutation([16 if i % 4 == 0 else i for i in range(16)])  # zero in the heads of groups
local_nodes = local_array((ARENA,))
local_weights = local_array((2 * ALL,))


def _first_node(c):
    """Place in an arena of the first node of cell ``c`` of a block."""
    return (c >> 4) * PLANE + ((c >> 2) & 3) * ROW + (c & 3) * 4


def _weigh(rec, r, ready, w):
    """Write the weights of the record at place ``r`` to place ``w`` of ``ready``.

    One vector holds the weights of all axes, which takes two thirds of the instructions of weights by axis. It is written one
    particle ahead, so that the write is complete when the weights are read into all lanes.
    """
    d = offsets(load16(rec, r))
    d = d - all_centre(d)
    store(ready, w, (all_scale(d) * d) * d + all_offset(d))


def _weigh_four(contacts, r, ready, w):
    """The same of a row of four numbers, the last three of them the offsets."""
    d = in_all_four(load4(contacts, r))
    d = d - all_centre(d)
    store(ready, w, (all_scale(d) * d) * d + all_offset(d))


def _place_of(t):
    """Place of the weights of particle ``t`` of a list: two particles take turns."""
    return (t & np.uint64(1)) * np.uint64(ALL)


def _add_weighted(arena, o, ready, w, numbers):
    """Add four ``numbers`` of a contact to the arena from its first node ``o`` on, by its weights at place ``w`` of ``ready``."""
    q = repeated(numbers) * weights_of_z(load16(ready, w))
    u0 = ready[w + np.uint64(8)] * q
    u1 = ready[w + np.uint64(9)] * q
    u2 = ready[w + np.uint64(10)] * q
    for i in range(3):
        x = ready[w + np.uint64(4 + i)]
        a = o + i * PLANE
        store(arena, a, load16(arena, a) + x * u0)
        store(arena, a + ROW, load16(arena, a + ROW) + x * u1)
        store(arena, a + 2 * ROW, load16(arena, a + 2 * ROW) + x * u2)


def _nothing(array):
    """Nine empty rows."""
    z = zeros(array)
    return z, z, z, z, z, z, z, z, z


def _scatter(rec, r, ready, w, rows):
    """Rows with mass and momentum of the record at place ``r`` added; its weights are at place ``w``."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = rows
    y0 = ready[w + np.uint64(8)]
    y1 = ready[w + np.uint64(9)]
    y2 = ready[w + np.uint64(10)]
    z = weights_of_z(load16(ready, w))
    z_of_a = tails(z)
    ax = repeated(load4(rec, r + np.uint64(4))) * z_of_a
    ay = repeated(load4(rec, r + np.uint64(8))) * z_of_a
    q = repeated(load4(rec, r)) * z + repeated(load4(rec, r + np.uint64(12))) * (z_side_of_a(z) * z)  # row (1, 1)
    u0 = y0 * (q - ay)
    u1 = y1 * q
    u2 = y2 * (q + ay)
    d0 = y0 * ax
    d1 = y1 * ax
    d2 = y2 * ax
    x = ready[w + np.uint64(5)]
    a10 += x * u0
    a11 += x * u1
    a12 += x * u2
    x = ready[w + np.uint64(4)]
    a00 += x * (u0 - d0)
    a01 += x * (u1 - d1)
    a02 += x * (u2 - d2)
    x = ready[w + np.uint64(6)]
    a20 += x * (u0 + d0)
    a21 += x * (u1 + d1)
    a22 += x * (u2 + d2)
    return a00, a01, a02, a10, a11, a12, a20, a21, a22


def _add_products(x, y, q, rows):
    """Nine rows with x_i y_j q added to row (i, j)."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = rows
    u0 = y[0] * q
    u1 = y[1] * q
    u2 = y[2] * q
    a00 += x[0] * u0
    a01 += x[0] * u1
    a02 += x[0] * u2
    a10 += x[1] * u0
    a11 += x[1] * u1
    a12 += x[1] * u2
    a20 += x[2] * u0
    a21 += x[2] * u1
    a22 += x[2] * u2
    return a00, a01, a02, a10, a11, a12, a20, a21, a22


def _gather(rec, r, ready, w, rows):
    """Record at place ``r`` with v and its first moments about the first node [m/s cells] in place of momentum and A."""
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = rows
    x0 = ready[w + np.uint64(4)]
    x1 = ready[w + np.uint64(5)]
    x2 = ready[w + np.uint64(6)]
    # weighted sums and first moments in x: w0 g0 + (w1 g1 + w2 g2) and (w1 g1 + w2 g2) + w2 g2
    d0 = x2 * g20
    d1 = x2 * g21
    d2 = x2 * g22
    c0 = x1 * g10 + d0
    c1 = x1 * g11 + d1
    c2 = x1 * g12 + d2
    d0 += c0
    d1 += c1
    d2 += c2
    c0 += x0 * g00
    c1 += x0 * g01
    c2 += x0 * g02
    y0 = ready[w + np.uint64(8)]
    y1 = ready[w + np.uint64(9)]
    y2 = ready[w + np.uint64(10)]
    t2 = y2 * c2
    t1 = y1 * c1 + t2
    s = y0 * c0 + t1
    y = t1 + t2
    x = y0 * d0 + y1 * d1 + y2 * d2
    two = lower_and_middle(s, x)
    z = load16(ready, w)
    about_node = lower_of_z(z) * all_lower(two, y) + middle_of_z(z) * all_middle(two, y) + upper_of_z(z) * all_upper(upper(s, x), y)
    return heads_and_tails(load16(rec, r), about_node)


def _clear(arenas, a, parts):
    """Set the ``parts`` of the arena at place ``a`` to zero; others may be set to zero too."""
    if parts & UPPER == 0:
        for o in range(a, a + 6 * PLANE, ROW):
            store(arenas, o, zeros(arenas))
    else:
        for o in range(a, a + ARENA, 16):
            store(arenas, o, zeros(arenas))


def _add_rows(arena, o, rows):
    """Add nine rows to an arena from place ``o`` on."""
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = rows
    store(arena, o, load16(arena, o) + a00)
    store(arena, o + ROW, load16(arena, o + ROW) + a01)
    store(arena, o + 2 * ROW, load16(arena, o + 2 * ROW) + a02)
    o += PLANE
    store(arena, o, load16(arena, o) + a10)
    store(arena, o + ROW, load16(arena, o + ROW) + a11)
    store(arena, o + 2 * ROW, load16(arena, o + 2 * ROW) + a12)
    o += PLANE
    store(arena, o, load16(arena, o) + a20)
    store(arena, o + ROW, load16(arena, o + ROW) + a21)
    store(arena, o + 2 * ROW, load16(arena, o + 2 * ROW) + a22)


def _load_rows(arena, o):
    """Nine rows of an arena from place ``o`` on."""
    p = o + PLANE
    q = o + 2 * PLANE
    return (
        load16(arena, o), load16(arena, o + ROW), load16(arena, o + 2 * ROW),
        load16(arena, p), load16(arena, p + ROW), load16(arena, p + 2 * ROW),
        load16(arena, q), load16(arena, q + ROW), load16(arena, q + 2 * ROW),
    )  # fmt: skip


def _next_filled(held, b, end):
    """The next block after ``b`` with ``held`` > 0, or ``end``."""
    later = np.int64(b) + 1
    while later < end and held[later] == 0:
        later += 1
    return later


def _expect_nodes(grid, up, b, parts):
    """Prefetch what :func:`_load_nodes` will load."""
    above = parts & UPPER != 0
    for x in range(6):
        for y in range(6):
            q = ((x >> 2) << 2) | ((y >> 2) << 1)
            n = ((x & 3) * 4 + (y & 3)) * 16
            prefetch(grid, np.int64(up[b, q]) * 256 + n)
            if above:
                prefetch(grid, np.int64(up[b, q + 1]) * 256 + n)


def _load_nodes(nodes, grid, up, b, parts):
    """Load the 6 x 6 x 6 nodes that block ``b`` reaches from up to eight node blocks.

    If the ``parts`` (bits, see :mod:`particles_to_grid`) are all of the lower half along z, the upper two nodes are not loaded.
    """
    above = parts & UPPER != 0
    for x in range(6):
        for y in range(6):
            q = ((x >> 2) << 2) | ((y >> 2) << 1)
            n = ((x & 3) * 4 + (y & 3)) * 16
            a = x * PLANE + y * ROW
            store(nodes, a, load16(grid, up[b, q] * 256 + n))
            if above:
                store(nodes, a + 16, load8(grid, up[b, q + 1] * 256 + n))
