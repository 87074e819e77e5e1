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
    pores : (numbers, slots) real
        Pore pressure of the particle in each slot, as far as particles differ in it (:mod:`runout.backends.scan.pore_pressure`).
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
    pores: np.ndarray


class Buffers(NamedTuple):
    """One block of particles for each thread: fields of :class:`Particles` with a first axis of threads; one row of ``pores``."""

    rec: np.ndarray
    state: np.ndarray
    particle_index: np.ndarray
    cell: np.ndarray
    pores: np.ndarray


class Blocks(NamedTuple):
    """The index: blocks of 4 x 4 x 4 cells, their neighbours and the slots of their particles. Owners come first.

    Attributes
    ----------
    nown, nall : int
        Owner blocks, which may hold particles; all node blocks, which hold nodes that particles reach.
    bxyz : (nall, 3) int32
        Coordinates of the blocks.
    up : (nown, 8) int32
        Node blocks at the block itself and one step up in each axis.
    down : (nall, 8) int32
        Owners at the block itself and one step down; -1 where there is none.
    around : (nown, 27) int32
        Owners among the neighbours; -1 where there is none.
    starts : (nown, 65) int32
        First particle of each cell in the order of the block.
    held, first, capacity : (nown,) int64
        Number of particles; first slot; number of slots.
    """

    nown: int
    nall: int
    bxyz: np.ndarray
    up: np.ndarray
    down: np.ndarray
    around: np.ndarray
    starts: np.ndarray
    held: np.ndarray
    first: np.ndarray
    capacity: np.ndarray


class Pass(NamedTuple):
    """One pass over the owners and over the nodes that are summed meanwhile (:mod:`runout.backends.scan.schedule`).

    Attributes
    ----------
    nown : int
        Owners; 0 where only nodes are summed.
    cuts : (threads + 1,) int64
        First owner of each thread.
    due, nodes : (strips + 1,) int64, (nall,) int32
        Node blocks in the order in which they are summed, and where those begin that are summed after each strip.
    over, owners : (strips + 1,) int64, (nown,) int32
        Owners in the order in which their arenas become free, and where those begin that are free after each strip.
    """

    nown: int
    cuts: np.ndarray
    due: np.ndarray
    nodes: np.ndarray
    over: np.ndarray
    owners: np.ndarray


class Arenas(NamedTuple):
    """Arenas: what the particles of one block give to the 6 x 6 x 6 nodes that they reach.

    Attributes
    ----------
    values : (threads x capacity + 1, ARENA) real
        The arenas, as many for each thread; the last one stays empty.
    free : (threads, capacity) int32
        Arenas of each thread that may be used again.
    cursors : (threads, 8) int64
        What each thread counts in a kernel.
    number, lent : (nown,) int32
        Arena of each owner for mass and momentum, and of each owner with contacts for impulses.
    reached : (nown,) uint8
        Parts of the arena that the particles reach, as bits (:mod:`runout.backends.scan.particles_to_grid`).
    """

    values: np.ndarray
    free: np.ndarray
    cursors: np.ndarray
    number: np.ndarray
    lent: np.ndarray
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
    masses : (nall, 64) or (0, 64) real
        Mass of the nodes [kg], in scenes where pore pressure drains by the thickness of the layer.
    """

    nodes: np.ndarray
    shared: np.ndarray
    inverse: np.ndarray
    masses: np.ndarray


class Ground(NamedTuple):
    """The surface under the blocks, see :func:`runout.backends.scan.ground.cut_tiles`.

    Attributes
    ----------
    tiles : (nown, 36) real
        Spline coefficients at 6 x 6 nodes, above the lowest node of the block [cells].
    planes : (nown, 48) real
        For each of 16 columns of cells a plane that bounds the surface from above: value and two slopes [cells].
    bounds : (nown, 2) real
        Highest point of these planes [cells], least vertical component of the normal [1].
    """

    tiles: np.ndarray
    planes: np.ndarray
    bounds: np.ndarray


class Contacts(NamedTuple):
    """Rows of particles that touch the ground (:mod:`runout.backends.scan.contact_detection` draws them), and their blocks.

    Attributes
    ----------
    rows, felt, given : (rows, 4) real
        Cell and offset; what the grid gives; impulse that the nodes hold, and ground area. As many rows for each thread.
    measured : (rows / 16, 8, 16) real
        Normal, gap, friction (its number or the row of its record) and velocity, in tiles of 16 rows.
    drained : (rows / 16, 5, 16) real
        What the excess pressure follows from (:mod:`runout.backends.scan.pore_pressure`), in such tiles; empty in a dry scene.
    shares : (places, SHARES) real
        Weights of the contacts of an owner at the nodes that they reach; the last one stays empty.
    touching, candidates, place : (nown,) int64
        Particles that touch; particles that are measured; first row of the block.
    sharer : (nown,) int32
        Place of the owner among the ``shares``.
    pressed : (nown,) uint8
        Parts of the arena that the contacts reach, as bits.
    work : (nown, 4) float64
        Work of the ground [J] and its impulse [N s].
    """

    rows: np.ndarray
    measured: np.ndarray
    felt: np.ndarray
    given: np.ndarray
    drained: np.ndarray
    shares: np.ndarray
    touching: np.ndarray
    candidates: np.ndarray
    place: np.ndarray
    sharer: np.ndarray
    pressed: np.ndarray
    work: np.ndarray


class ContactSearch(NamedTuple):
    """Numbers by which contacts are found for a transfer.

    Attributes
    ----------
    reach, band : real
        Distance [m] from the ground beyond which no particle can touch; width [m] of the band in which friction acts.
    last : real
        Stamp of the step before, whose forces still hold.
    fastest : real, or (releases,) real where laws differ in it
        Speed [m/s] up to which contacts start from them; infinite for laws that do not use ground areas.
    lasting : real
        Time [s] within which a particle must touch the ground: that of all substeps.
    ahead : real
        Time [s] after the start at which contacts take the ground and its friction (:func:`runout.physics.substeps.time_ahead`).
    """

    reach: Any
    band: Any
    last: Any
    fastest: Any
    lasting: Any
    ahead: Any


class Moves(NamedTuple):
    """What moves between cells and blocks in a step, by block.

    Attributes
    ----------
    leaving, shifted, arrivals : (nown,) int64
        Particles that leave the block; that change their cell in it; that enter it.
    changed : (nown,) int64
        Bit q is set if a particle moves to destination q: a neighbour, or, 13, another cell of the block.
    before : (nown,) int64
        First slot before the block was moved to other slots.
    rim : (nown,) bool
        Whether particles of the block may leave the domain.
    motion : (nown, 4) float64
        Largest speed squared, longest move [cells], dissipated energy [J], refused moves.
    """

    leaving: np.ndarray
    shifted: np.ndarray
    arrivals: np.ndarray
    changed: np.ndarray
    before: np.ndarray
    rim: np.ndarray
    motion: np.ndarray


class Constants(NamedTuple):
    """Constants of the run, whatever the law.

    Attributes
    ----------
    friction : (releases,) real
        What contacts hold of the friction of a release: its number, or the row of its record where the law has several; the number
        of the release where there are friction zones.
    density : (releases,) float64
        [kg/m3]
    h, spacing : (3,) real, (3,) float64
        Spacing of the nodes [m].
    gravity : (3,) float64
        [m/s2]
    corner : (3,) int64
        Node from which blocks are counted.
    dv : (16,) real
        Change of velocity by gravity in one step [m/s], with 0 first, for four nodes.
    """

    friction: np.ndarray
    density: np.ndarray
    h: np.ndarray
    spacing: np.ndarray
    gravity: np.ndarray
    corner: np.ndarray
    dv: np.ndarray


class TimeStep(NamedTuple):
    """What follows from the time step.

    Attributes
    ----------
    mats : (releases,) record
        Parameters of the law; some laws have parameters that depend on the time step.
    dt : real
        [s]
    slopes, cells : (3,) tuple of real
        4 dt / h [s/m]; dt / h [s/m].
    pores : runout.backends.scan.pore_pressure.Pores or ()
        Pore pressure of the particles; set where kernels are called.
    """

    mats: np.ndarray
    dt: Any
    slopes: tuple[Any, Any, Any]
    cells: tuple[Any, Any, Any]
    pores: Any = ()


class Zones(NamedTuple):
    """Friction zones on the cells of the raster (:class:`runout.model.friction.FrictionZones`).

    Attributes
    ----------
    kind : (nx, ny) int32
        Kind of ground.
    cell_size : (2,) float64
        [m]
    friction : (releases, kinds) real
        What contacts hold of the friction of each release on each kind of ground.
    """

    kind: np.ndarray
    cell_size: np.ndarray
    friction: np.ndarray


class Domain(NamedTuple):
    """Where particles may be (:func:`runout.backends.scan.domain.domain_of`).

    Attributes
    ----------
    limits : (6,) float64
        West, east, south and north edge, and the size of the cells of the raster east and north [cells of the grid].
    unknown : (columns, rows) bool
        Cells of the raster without elevation; (1, 1) where all have one.
    sums : (columns + 1, rows + 1) int64
        Number of unknown cells west and south of each corner.
    """

    limits: np.ndarray
    unknown: np.ndarray
    sums: np.ndarray
