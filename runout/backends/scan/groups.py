"""The groups of arrays that the kernels take as arguments.

A group is a named tuple: numba passes its fields as single arrays, and its cache knows the class by its name, so that a group costs
nothing in a kernel. The arrays of a group are written in place. Where an array has to be replaced, its owner makes a new tuple.

Sizes: ``slots`` of particles, ``n`` particles, ``nown`` owner blocks, ``nall`` node blocks, ``threads``; ``real`` is float32 or
float64, as the scene says.

    Particles, Moves       by slot            runout.backends.scan.state
    Blocks                 by block           runout.backends.scan.index
    Pass                   by strip           runout.backends.scan.schedule
    Arenas, Grid           by block in work   runout.backends.scan.particles_to_grid
    Contacts, Ground       by contact, block  runout.backends.scan.contact_detection, ground
    Constants, TimeStep    of the run         runout.backends.scan.constants
"""

from typing import Any, NamedTuple

import numpy as np


class Particles(NamedTuple):
    """Particle storage. A block owns a range of slots; all arrays by slot end with some padding.

    Attributes
    ----------
    rec : (slots, 16) real
        Records: mass and momentum, offset and affine matrix (:mod:`runout.backends.scan.stencil`).
    state : (slots, 8) real
        B = b_e - I (6), history variable of the law, stress-free volume [m3].
    particle_index : (slots,) int32
        Row of the particle in ``force``, ``radius`` and ``label``.
    cell : (slots,) uint8
        Cell in the block, 64 more if the particle leaves the block.
    order : (slots,) int32
        Slots of the particles of a block, sorted by cell.
    listed : (slots,) int32
        Particles that touch the ground; later in the step, particles that change their cell or block.
    force : (n, 4) real
        Stamp of the step in which the particle last touched the ground (:func:`state.stamp_of`), and the force of the ground [N].
    radius : (n,) or (1,) real
        Touching radius [m]; one number where all particles have the same.
    label : (n, 2) int32
        Release and identity.
    """

    rec: np.ndarray
    state: np.ndarray
    particle_index: np.ndarray
    cell: np.ndarray
    order: np.ndarray
    listed: np.ndarray
    force: np.ndarray
    radius: np.ndarray
    label: np.ndarray


class Buffers(NamedTuple):
    """One block of particles for each thread: fields as in :class:`Particles`, with a first axis of threads."""

    rec: np.ndarray
    state: np.ndarray
    particle_index: np.ndarray
    cell: np.ndarray


class Blocks(NamedTuple):
    """The index: blocks of 4 x 4 x 4 cells, their neighbours and the slots of their particles. Owners come first."""

    # nown, nall: owner blocks, which may hold particles; all node blocks, which hold nodes that particles reach
    nown: int
    nall: int
    bxyz: np.ndarray  # (nall, 3): coordinates of the blocks
    up: np.ndarray  # (nown, 8): node blocks at the block itself and one step up in each axis
    down: np.ndarray  # (nall, 8): owners at the block itself and one step down; -1 where there is none
    around: np.ndarray  # (nown, 27): owners among the neighbours; -1 where there is none
    starts: np.ndarray  # (nown, 65): first particle of each cell in the order of the block
    # held, first, capacity (nown,): number of particles; first slot; number of slots
    held: np.ndarray
    first: np.ndarray
    capacity: np.ndarray


class Pass(NamedTuple):
    """One pass over the owners and over the nodes that are summed meanwhile (:mod:`runout.backends.scan.schedule`)."""

    nown: int  # owners; 0 where only nodes are summed
    cuts: np.ndarray  # (threads + 1,): first owner of each thread
    # due, nodes (strips + 1,): node blocks in the order in which they are summed, and where those begin that are summed after each
    # strip
    due: np.ndarray
    nodes: np.ndarray
    # over, owners (strips + 1,): owners in the order in which their arenas become free, and where those begin that are free after
    # each strip
    over: np.ndarray
    owners: np.ndarray


class Arenas(NamedTuple):
    """Arenas: what the particles of one block give to the 6 x 6 x 6 nodes that they reach."""

    values: np.ndarray  # (threads x capacity + 1, ARENA): the arenas, as many for each thread; the last one stays empty
    free: np.ndarray  # (threads, capacity): arenas of each thread that may be used again
    cursors: np.ndarray  # (threads, 8): what each thread counts in a kernel
    # number, lent (nown,): arena of each owner for mass and momentum, and of each owner with contacts for impulses
    number: np.ndarray
    lent: np.ndarray
    # (nown,): parts of the arena that the particles reach, as bits (:mod:`runout.backends.scan.particles_to_grid`)
    reached: np.ndarray


class Grid(NamedTuple):
    """Nodes of the blocks.

    Attributes
    ----------
    nodes : (nall, 256) real
        Four numbers for each of the 64 nodes: mass, or compliance where contacts reach; velocity [m/s].
    shared : (nall,) bool
        Blocks with nodes that contacts reach.
    inverse : (nall, 64) real
        Inverse mass of the nodes of these blocks [1/kg].
    """

    nodes: np.ndarray
    shared: np.ndarray
    inverse: np.ndarray


class Ground(NamedTuple):
    """The surface under the blocks, see :func:`runout.backends.scan.ground.cut_tiles`."""

    tiles: np.ndarray  # (nown, 36): spline coefficients at 6 x 6 nodes, above the lowest node of the block [cells]
    # (nown, 48): for each of 16 columns of cells a plane that bounds the surface from above: value and two slopes [cells]
    planes: np.ndarray
    bounds: np.ndarray  # (nown, 2): highest point of these planes [cells], least vertical component of the normal [1]


class Contacts(NamedTuple):
    """Rows of particles that touch the ground (:mod:`runout.backends.scan.contact_detection` draws them), and their blocks."""

    # rows, felt, given (rows, 4): cell and offset; what the grid gives; impulse that the nodes hold, and ground area. As many rows
    # for each thread
    rows: np.ndarray
    # (rows / 16, 8, 16): normal, gap, friction (its number or the row of its record) and velocity, in tiles of 16 rows
    measured: np.ndarray
    felt: np.ndarray
    given: np.ndarray
    # (places, SHARES): weights of the contacts of an owner at the nodes that they reach; the last one stays empty
    shares: np.ndarray
    # touching, candidates, place (nown,): particles that touch; particles that are measured; first row of the block
    touching: np.ndarray
    candidates: np.ndarray
    place: np.ndarray
    sharer: np.ndarray  # (nown,): place of the owner among the ``shares``
    pressed: np.ndarray  # (nown,): parts of the arena that the contacts reach, as bits
    work: np.ndarray  # (nown, 4): work of the ground [J] and its impulse [N s]


class ContactSearch(NamedTuple):
    """Numbers by which contacts are found for a transfer."""

    # reach, band: distance [m] from the ground beyond which no particle can touch; width [m] of the band in which friction acts
    reach: Any
    band: Any
    last: Any  # stamp of the step before, whose forces still hold
    fastest: Any  # speed [m/s] up to which contacts start from them; infinite for laws that do not use ground areas
    lasting: Any  # time [s] within which a particle must touch the ground: that of all substeps
    # time [s] after the start at which contacts take the ground and its friction (:func:`runout.physics.substeps.time_ahead`)
    ahead: Any


class Moves(NamedTuple):
    """What moves between cells and blocks in a step, by block."""

    # leaving, shifted, arrivals (nown,): particles that leave the block; that change their cell in it; that enter it
    leaving: np.ndarray
    shifted: np.ndarray
    arrivals: np.ndarray
    # (nown,): bit q is set if a particle moves to destination q: a neighbour, or, 13, another cell of the block
    changed: np.ndarray
    before: np.ndarray  # (nown,): first slot before the block was moved to other slots
    rim: np.ndarray  # (nown,): whether particles of the block may leave the domain
    motion: np.ndarray  # (nown, 4): largest speed squared, longest move [cells], dissipated energy [J], refused moves


class Constants(NamedTuple):
    """Constants of the run, whatever the law."""

    # (releases,): what contacts hold of the friction of a release: its number, or the row of its record where the law has several;
    # the number of the release where there are friction zones
    friction: np.ndarray
    density: np.ndarray  # (releases,): [kg/m3]
    # h, spacing (3,): spacing of the nodes [m]
    h: np.ndarray
    spacing: np.ndarray
    gravity: np.ndarray  # (3,): [m/s2]
    corner: np.ndarray  # (3,): node from which blocks are counted
    dv: np.ndarray  # (16,): change of velocity by gravity in one step [m/s], with 0 first, for four nodes


class TimeStep(NamedTuple):
    """What follows from the time step."""

    mats: np.ndarray  # (releases,): parameters of the law; some laws have parameters that depend on the time step
    dt: Any  # [s]
    # slopes, cells (3,): 4 dt / h [s/m]; dt / h [s/m]
    slopes: tuple[Any, Any, Any]
    cells: tuple[Any, Any, Any]
    pores: Any = ()  # pore pressure of the particles; set where kernels are called


class Zones(NamedTuple):
    """Friction zones on the cells of the raster (:class:`runout.model.friction.FrictionZones`)."""

    kind: np.ndarray  # (nx, ny): kind of ground
    cell_size: np.ndarray  # (2,): [m]
    friction: np.ndarray  # (releases, kinds): what contacts hold of the friction of each release on each kind of ground


class Domain(NamedTuple):
    """Where particles may be (:func:`runout.backends.scan.domain.domain_of`)."""

    # (6,): west, east, south and north edge, and the size of the cells of the raster east and north [cells of the grid]
    limits: np.ndarray
    unknown: np.ndarray  # (columns, rows): cells of the raster without elevation; (1, 1) where all have one
    sums: np.ndarray  # (columns + 1, rows + 1): number of unknown cells west and south of each corner
