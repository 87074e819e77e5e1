"""Functions in CUDA for tiles in shared memory, each with its equivalent for a CPU.

A GPU copies records and nodes to shared memory while its threads go on; :func:`come` and :func:`arrive` wait for them.
What is needed of a record are twelve numbers, each of which lies some places behind the one before.

    numbers of a record    0 mass | 1-3 offset | 4-9 strain | 10 history | 11 volume

``room`` is a tile of 2 x 12 x 64 numbers: two records for each of 64 lanes.
"""

from typing import Any

import warp as wp

ROOM = 2 * 12 * 64  # numbers of the room

ADD_IN = "tile.data(wp::tile_coord(i)) += value;"
PUT_IN = ADD_IN.replace("+=", "=")
MEET = "WP_TILE_SYNC();"
MEET_WARP = """
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
"""
ARRIVE = """
#if defined(__CUDA_ARCH__)
    asm volatile("cp.async.wait_all;" ::: "memory");
#endif
    WP_TILE_SYNC();
"""
COME = """
#if defined(__CUDA_ARCH__)
    asm volatile("cp.async.wait_all;" ::: "memory");
#endif
"""
STAGE = """
#if defined(__CUDA_ARCH__)
    unsigned to = (unsigned)__cvta_generic_to_shared(&room.data(wp::tile_coord(place)));
    const char* from = (const char*)(rec.data + p);
    #pragma unroll
    for (int n = 0; n < 12; ++n)
        if (n >= first) asm volatile("cp.async.ca.shared.global [%0], [%1], %2;"
                     :: "r"(to + n * apart * (unsigned)sizeof(*rec.data)),
                        "l"(from + (size_t)(n == 0 ? 0 : n < 4 ? n + 3 : n + 12) * rec.strides[0]), "n"(sizeof(*rec.data))
                     : "memory");
#else
    for (int n = first; n < 12; ++n)
        room.data(wp::tile_coord(place + n * apart)) = wp::index(rec, n == 0 ? 0 : n < 4 ? n + 3 : n + 12, p);
#endif
"""
# A copy of no bytes fills the place with zeros.
STAGE_NODE = """
#if defined(__CUDA_ARCH__)
    unsigned to = (unsigned)__cvta_generic_to_shared(&tile.data(wp::tile_coord(place)));
    const char* from = (const char*)(nodes.data + (n < 0 ? 0 : n));
    #pragma unroll
    for (unsigned k = 0; k < sizeof(*nodes.data); k += 16)
        asm volatile("cp.async.cg.shared.global [%0], [%1], 16, %2;" :: "r"(to + k), "l"(from + k), "r"(n < 0 ? 0 : 16) : "memory");
#else
    if (n < 0) tile.data(wp::tile_coord(place)) = {};
    else tile.data(wp::tile_coord(place)) = nodes.data[n];
#endif
"""


@wp.func_native(ADD_IN)
def add_in(tile: Any, i: int, value: Any):  # type: ignore[no-untyped-def]
    """Add to a number of a tile that no other lane changes at the same time; no lane waits."""


@wp.func_native(PUT_IN)
def put_in(tile: Any, i: int, value: Any):  # type: ignore[no-untyped-def]
    """Put another number in the place of one of a tile; no lane waits."""


@wp.func_native(MEET)
def meet():  # type: ignore[no-untyped-def]
    """The lanes of a block wait for each other; on a CPU lanes take turns."""


@wp.func_native(MEET_WARP)
def meet_warp():  # type: ignore[no-untyped-def]
    """The lanes of a warp wait for each other; on a CPU lanes take turns."""


@wp.func_native(ARRIVE)
def arrive():  # type: ignore[no-untyped-def]
    """All lanes of a block wait until their copies to shared memory have come."""


@wp.func_native(STAGE)
def stage(room: Any, rec: Any, p: int, place: int, apart: int, first: int):  # type: ignore[no-untyped-def]
    """Begin to copy what is needed of the record of a particle, from number ``first`` on, to a place and others ``apart``."""


@wp.func_native(STAGE_NODE)
def stage_node(tile: Any, place: int, nodes: Any, n: int):  # type: ignore[no-untyped-def]
    """Begin to copy node ``n`` to a place of a tile; zeros if ``n`` is negative."""


@wp.func_native(COME)
def come():  # type: ignore[no-untyped-def]
    """A lane waits until its own copies have come."""


PLAIN = (add_in, put_in, meet, meet_warp, arrive, come, stage, stage_node)
