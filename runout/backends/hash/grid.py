"""Arrays by node and by block: the grid, the ground under the blocks, and contact.

    nodes      | block 0: 64 nodes x (mass, momentum x, y, z) | block 1 | ...       all blocks
    tiles      | place 0: 36 coefficients | place 1 | ...                           blocks whose particles may touch the ground
    shares     | slot 0: 256 numbers | slot 1 | ...                                 blocks whose nodes such particles reach

    block -> place  near[b]        place -> block  standing[place]        block -> slot  grounded[b]

Only blocks near the ground have a place, and only those whose nodes take part in contact have a slot: memory grows with the ground
that the mass covers, not with all blocks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from runout.backends.hash.contact_area import COLUMNS, PLAN
from runout.backends.hash.groups import filled, groups_of
from runout.backends.hash.layout import CELL_LANES, TILE, layers_of, more_room_for, room_for
from runout.backends.hash.limits import largest_in_contact, room_within

NEARLY = 0.8  # share of the room from which on arrays grow with others

if TYPE_CHECKING:
    from runout.backends.hash.index import Index
    from runout.backends.hash.scenes import SceneArrays
    from runout.backends.hash.state import Store
    from runout.model.basal_friction import BasalFriction
    from runout.model.friction_laws import FrictionLaw


def new_room(wanted: tuple[int, int], held: tuple[int, int], exactly: bool) -> tuple[int, int]:
    """Room for the ``wanted`` blocks of two kinds, never less than is ``held``; see :meth:`NodeArrays.make_room`."""
    pairs = list(zip(wanted, held, strict=True))
    if held[0] > 0 and not exactly and any(want > room for want, room in pairs):
        pairs = [(room + 1 if NEARLY * room < want <= room else want, room) for want, room in pairs]
    places, slots = (
        room if want <= room else want if exactly else more_room_for(want) if room > 0 else room_for(want) for want, room in pairs
    )
    return places, room_within(slots, wanted[1], largest_in_contact(), "blocks of nodes in contact")


def bytes_of_areas(friction: BasalFriction | FrictionLaw, mixed: int, blocks: int, number: int, ordered: bool) -> int:
    """Memory [byte] of the ground areas, and of the drag on columns of nodes, with numbers of ``number`` bytes.

    ``mixed``: releases whose frictions differ, 1 if all are alike.
    """
    columns = 9 * 4 + (4 * ((PLAN + 2 * COLUMNS) if ordered else 2 * COLUMNS) + PLAN * mixed * (mixed > 1)) * number
    return blocks * ((5 * 4 + COLUMNS * number) * friction.uses_area + columns * friction.drags_column)


class NodeArrays:
    """Arrays by block on the device of the scope.

    Its arrays are those of :class:`runout.backends.hash.groups.GridGroup`, ``GroundGroup``, ``ContactGroup`` and ``ColumnGroup``,
    except:

    Attributes
    ----------
    grid : (64 capacity,) four numbers
        The nodes. Longer if it takes more to hold a number for each particle, see :meth:`scratch`.
    contact : (64 slots,) or (128 slots,) four numbers
        The memory of ``shares``; behind it, with substeps, the impulses from which the contacts of a substep start.
    places, slots : int
        Room for blocks whose particles may touch the ground, and for blocks whose nodes these reach.
    generation : int
        Counts how often arrays were made anew.
    """

    def __init__(
        self, index: Index, store: Store, number: Any, areas: bool = False, structured: bool = False,
        dragged: int = 0, substepped: bool = False,
    ):  # fmt: skip
        capacity, particles, ordered = index.capacity, store.size, index.ordered
        self.number, self.generation, self.slots, self.places = number, 0, -1, -1
        self.substepped = substepped
        self.types = groups_of(number)
        self.vec4 = wp.types.vector(length=4, dtype=number)
        layers, self.nothing = layers_of(substepped), wp.zeros(0, dtype=wp.int32)
        self.grid = wp.zeros(max(layers * capacity * 64, (particles + 3) // 4), dtype=self.vec4)
        self.arenas = wp.zeros(capacity * TILE * ordered, dtype=self.vec4)
        self.held = wp.zeros(capacity * ordered, dtype=wp.int32)
        apart = substepped or structured  # the lists of all particles are needed behind contact with the ground
        lists = particles * apart, (capacity * apart, CELL_LANES + 1)
        self.pressed, self.pressed_start = (wp.zeros(shape, dtype=wp.int32) for shape in lists)
        self.listed = (self.pressed, self.pressed_start) if apart else (store.order, index.cstart)
        self.touched, self.touching = (wp.zeros(shape, dtype=wp.int32) for shape in ((capacity, 2), capacity))
        self.columns = wp.zeros((capacity * areas, 5), dtype=wp.int32)
        self.plan = wp.zeros(COLUMNS * capacity * areas, dtype=number)
        self.column_group = self._columns(capacity, dragged, ordered)
        self.grounded = wp.full(capacity, -1, dtype=wp.int32)
        self.near = wp.full(capacity, -1, dtype=wp.int32)
        self.ground_slopes = wp.zeros(capacity, dtype=self.vec4)
        self.approach_speeds = wp.full(2 * capacity, wp.inf, dtype=number)
        self.booked = wp.zeros((capacity, 6), dtype=wp.float64)
        self.grid_group = filled(self.types.GridGroup, self, nodes=self.grid)
        self.make_room(0, 0)

    def _columns(self, capacity: int, releases: int, ordered: bool) -> Any:
        """Columns of nodes that drag slows; ``releases`` have a friction of their own, 0 without such drag."""
        real, dragged = self.number, capacity * (releases > 0)
        sizes = PLAN if ordered else COLUMNS, COLUMNS, COLUMNS * ordered
        self.column_pushes, self.moving, self.change = (wp.zeros(size * dragged, dtype=self.vec4) for size in sizes)
        self.beside = wp.full((dragged, 9), -1, dtype=wp.int32)
        self.masses = wp.zeros(PLAN * releases * capacity * (releases > 1), dtype=real)
        return filled(self.types.ColumnGroup, self)

    def make_layers(self, index: Index, store: Store, scenes: SceneArrays) -> None:
        """The layers in which pore pressure drains, if any mass of the ``scenes`` is wet, and its group."""
        self.layers = wp.zeros(COLUMNS * index.capacity * scenes.wet, dtype=self.number)
        arrays = {"left": store.pore_left, "excess": store.pore_excess, "layers": self.layers}
        self.pore_group = filled(self.types.PoreGroup, self, **arrays, records=scenes.pores, density=scenes.pore_density)

    def scratch(self, shape: int | tuple[int, int], kind: Any) -> Any:
        """The memory of the grid for something else, while it holds nothing; it must be zero again for the next step."""
        return wp.array(ptr=self.grid.ptr, dtype=kind, shape=shape, device=self.grid.device)

    def make_room(self, places: int, slots: int, exactly: bool = False) -> None:
        """Room for the surface under so many blocks, and for the impulses of so many; ``exactly`` so many, or some more.

        What is nearly full grows with the other, since both are recorded in the same graphs.
        """
        places, slots = new_room((places, slots), (self.places, self.slots), exactly)
        if places > self.places:
            self.places = places
            self.generation += 1
            self.tiles = wp.zeros((self.places, 36), dtype=self.number)
            self.standing = wp.full(self.places, -1, dtype=wp.int32)
            self.near_up = wp.zeros((self.places, 8), dtype=wp.int32)
            self.bounds = wp.zeros((self.places, 32), dtype=wp.float16)
        if slots > self.slots:
            self.slots = slots
            self.generation += 1
            self.contact = wp.zeros(64 * self.slots * (1 + self.substepped), dtype=self.vec4)
            memory = self.contact.ptr
            self.shares = wp.array(ptr=memory, dtype=self.number, shape=256 * self.slots, device=self.contact.device)
        self.ground_group = filled(self.types.GroundGroup, self, slopes=self.ground_slopes)
        pressed, pressed_start = self.listed
        self.contact_group = filled(
            self.types.ContactGroup, self, memory=self.contact, pressed=pressed, pressed_start=pressed_start
        )
