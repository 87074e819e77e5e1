"""Arrays by block: nodes, the ground under them, the impulses that they get, and what is booked there."""

from __future__ import annotations

from typing import Any

import warp as wp

from runout.backends.hash.layout import TILE


class NodeArrays:
    """Arrays by block on the device of the scope.

    Attributes
    ----------
    grid : (64 room,) four numbers
        Mass [kg] and momentum [kg m/s].
    grounded : (room,) int32
        Place of a block in ``contact``, -1 for one that is not near the ground.
    contact : (64 slots,) four numbers
        Sum of the weights of the contact particles, and impulse of the ground [N s].
    shares : (256 slots,)
        The same memory, number by number.
    tiles, near : (room, 36), (room,)
        Coefficients of the surface relative to the block's lowest node [cells]; whether particles of the block may touch it.
    arenas, held : (216 room,) four numbers, (room,) int32
        Sums of each block and particles that it holds, for sums in fixed order; else empty.
    booked : (room, 5) float64
        Plastic dissipation and work of the ground [J], impulse of the ground [N s].
    """

    def __init__(self, room: int, number: Any, ground: bool, ordered: bool):
        self.number, self.generation, self.slots = number, 0, -1
        self.vec4 = wp.types.vector(length=4, dtype=number)
        self.grid = wp.zeros(room * 64, dtype=self.vec4)
        self.arenas = wp.zeros(room * TILE * ordered, dtype=self.vec4)
        self.held = wp.zeros(room * ordered, dtype=wp.int32)
        self.grounded = wp.full(room, -1, dtype=wp.int32)
        self.near = wp.zeros(room, dtype=wp.int32)
        self.tiles = wp.zeros((room * ground, 36), dtype=number)
        self.booked = wp.zeros((room, 5), dtype=wp.float64)
        self.make_room(0)

    def make_room(self, slots: int) -> None:
        """Room for the impulses of so many blocks."""
        if slots > self.slots:
            self.slots = slots + slots // 8 + 8 * (slots > 0)
            self.generation += 1
            self.contact = wp.zeros(64 * self.slots, dtype=self.vec4)
            memory = self.contact.ptr
            self.shares = wp.array(ptr=memory, dtype=self.number, shape=256 * self.slots, device=self.contact.device)
