"""Largest numbers that a run can address: kernels compute indices in 32 bits, and warp keeps the stride of a row in 32 bits.

    array                       numbers                                        largest
    memory                      a row of 4 or 8 bytes by particle              536870911 particles, 268435455 in float64
    ends, pressed_start         65 by block                                    33038209 blocks
    nodes                       192 by block where transfers have substeps     11184810 blocks
    arenas                      216 by block, where sums have a fixed order    9942053 blocks
    column_pushes, masses       36 by block, and by release with own friction  59652323 blocks, over releases
    shares                      256 by block of nodes in contact               8388607 such blocks
    ground, map sums            one number by node or by cell and quantity     2147483647 numbers

Numbers count for all scenes of a batch. More room than what is needed is cut at the largest; more need is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from runout.backends.hash.contact_area import PLAN
from runout.backends.hash.layout import SLOT, STARTS, TILE, layers_of
from runout.errors import CapacityError

if TYPE_CHECKING:
    from runout.model.basal_friction import BasalFriction
    from runout.model.friction_laws import FrictionLaw

LARGEST_INDEX = 2**31 - 1
NODES = 64  # of a block


def largest_particles(number: int) -> int:
    """Most particles of all scenes of a run, with real numbers of ``number`` bytes."""
    return LARGEST_INDEX // number


def largest_blocks(
    ordered: bool, friction: BasalFriction | FrictionLaw | None = None, mixed: int = 1, substepped: bool = False
) -> int:
    """Most blocks of all scenes of a run.

    ``ordered``: sums have a fixed order. ``mixed``: releases whose frictions differ, 1 if all are alike; they count where the law
    of ``friction`` drags columns. ``substepped``: transfers may have several substeps.
    """
    columns = PLAN * mixed * bool(friction and friction.drags_column)
    return LARGEST_INDEX // max(STARTS, NODES * layers_of(substepped), TILE * ordered, columns)


def largest_in_contact() -> int:
    """Most blocks of nodes that take part in contact with the ground, or with structures."""
    return LARGEST_INDEX // SLOT


def require_particles(particles: int, number: int) -> None:
    """Raise CapacityError for more particles than can be addressed, with real numbers of ``number`` bytes."""
    largest = largest_particles(number)
    if particles > largest:
        single = ", or float32" if number == 8 and particles <= largest_particles(4) else ""
        coarser = f"use a cell_size {coarser_by(particles, largest, 3):g} times as large, fewer particles_per_cell{single}"
        raise CapacityError(
            f"a run of {particles} particles has more than the {largest} that hash can address in float{8 * number}; {coarser}"
        )


def room_within(room: int, needed: int, largest: int, what: str) -> int:
    """``room``, or as much of it as can be addressed.

    Raises CapacityError if not even the ``needed`` blocks, named by ``what``, can be addressed.
    """
    if needed > largest:
        coarser = f"use a cell_size {coarser_by(needed, largest, 2):g} times as large"
        raise CapacityError(f"a run of {needed} {what} has more than the {largest} that hash can address; {coarser}")
    return min(room, largest)


def require_index(count: int, what: str) -> None:
    """Raise CapacityError for a table of more numbers than can be addressed."""
    if count > LARGEST_INDEX:
        raise CapacityError(
            f"{what} take {count} numbers, more than the {LARGEST_INDEX} that hash can address; use a coarser or smaller raster"
        )


def coarser_by(needed: int, largest: int, power: int) -> float:
    """Factor of the cell size with which a number that falls with its ``power`` fits, rounded up to a hundredth."""
    return -(-100 * (needed / largest) ** (1 / power) // 1) / 100
