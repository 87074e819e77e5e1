"""Loops over the nodes of the plan: they make the ground, erode a bed under the columns of the flow and give birth.

Erosion has two passes. The first, which knows no law, takes speed and stresses of the columns and the slope of the ground; the
second takes the bed that is left, the rate, and what is eroded. The binding compiles them and puts the laws of the scene in the
place of ``rate`` and ``friction_stress``.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from runout.physics.bed import driving_stress, friction_stress, normal_stress
from runout.physics.bspline import first_node, weight_slopes, weights
from runout.physics.contact import covered_share
from runout.physics.heightfield import bend_smoothness, interpolate, resampled_coefficient, surface_at, upward_normal
from runout.physics.tensors import tens, vec

prange = range  # that of the compiler takes its place
DITHER = 0.35  # particles by which the rounding of a pool differs from a half at most
FAR_BELOW = -1e30  # [m]: ground that no mass is near
MOVING = 0.1  # [m/s]: a column that is slower in the mean erodes nothing
PARTS = 8  # of the time between two updates, where the rate changes with what is eroded in it


class Flow(NamedTuple):
    """Columns of the flow around n x m nodes of the bed."""

    sums: np.ndarray  # (5, nx, ny): volume [m3], momentum (3) [kg m/s] and mass [kg] around nodes
    pore_ratio: np.ndarray  # (n, m): pore pressure ratio [1] of the mass; empty: 0
    # (7,): where the n x m nodes begin in ``sums`` and among the nodes of the bed, and node 0 of the bed in ``Ground.change``; m
    begin: np.ndarray


class Ground(NamedTuple):
    """The ground under the bed."""

    # coefficients, change: coefficients [m] at the nodes of the bed and one around, and what those of some nodes have more
    coefficients: np.ndarray
    change: np.ndarray
    # spacing, gravity (2 or 3,), (3,): [m], [m/s2]
    spacing: np.ndarray
    gravity: np.ndarray


class Lattice(NamedTuple):
    """A surface on a lattice of its own, and the spacing of the grid."""

    coefficients: np.ndarray  # [m]
    # origin, spacing: of the lattice; nodes: of the grid (2,) [m]
    origin: np.ndarray
    spacing: np.ndarray
    nodes: np.ndarray


class Laws(NamedTuple):
    """Laws of friction and erosion."""

    basal: np.ndarray  # of the law of friction
    rows: np.ndarray  # (n, m): record of friction of the mass at nodes of the bed; empty: the first
    bed: np.ndarray  # (1,): of the law of erosion
    of_friction: int  # 1: tau is the friction of the flow, 0: the driving stress


class Depths(NamedTuple):
    """Depths of the bed at its nodes (NX, NY) [m]: there at the start, eroded since, and owed of that."""

    there: np.ndarray
    eroded: np.ndarray
    owed: np.ndarray


class Reached(NamedTuple):
    """What each row of nodes gets."""

    fastest: np.ndarray  # (n,): the largest rate [m/s]
    nodes: np.ndarray  # (n, 2): first node that was eroded, and the one after the last


class Pools(NamedTuple):
    """Nodes of the bed (NX, NY), of which a part (nx, ny) is in square pools."""

    # there, eroded, owed: as of :class:`Depths` [m]; less than nothing is owed where particles came early
    there: np.ndarray
    eroded: np.ndarray
    owed: np.ndarray
    releases: np.ndarray  # that own most of each column
    takes: np.ndarray  # (releases,): of the bed that a particle takes [m]
    born: np.ndarray  # (nx, ny): particles that are born there


class Newborn(NamedTuple):
    """Particles (n,) of the bed."""

    # node, offset, force: (n, 3) of :class:`runout.model.particles.Particles`; that of the ground [N]
    node: np.ndarray
    offset: np.ndarray
    force: np.ndarray
    speed: np.ndarray  # of the column that takes it up [m/s]
    release: np.ndarray


def rate(H: Any, u: Any, sigma: Any, tau: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Erosion rate [m/s]; that of a law stands in its place."""
    return 0.0


def _base_of(thickness: Any, density: Any, slopes: Any, g: Any):
    """Under a column of a vertical ``thickness`` [m]: thickness across [m], normal and driving stress [Pa], and n_z."""
    normal = upward_normal(slopes[0], slopes[1])
    across = thickness * normal[2]
    return across, normal_stress(density, across, g, normal), driving_stress(density, across, g, normal), normal[2]


def _rate_at(base: Any, u: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Vertical rate [m/s] where a column with a speed ``u`` [m/s] stands; of its ``base`` the third is tau of the law [Pa]."""
    return rate(base[0], u, base[1], base[2], pore_ratio, eroded * base[3], bed) / base[3]


def _eroded_in(time: Any, E: Any, left: Any, base: Any, u: Any, pore_ratio: Any, eroded: Any, bed: Any):
    """Depth [m] that a column erodes in a time [s], of what is ``left`` [m]; ``E`` is its rate [m/s] at first."""
    more, part = min(time * E, left), time / PARTS
    if more > 0.0 and _rate_at(base, u, pore_ratio, eroded + more, bed) != E:
        more = 0.0
        for _ in range(PARTS):
            more = min(more + part * _rate_at(base, u, pore_ratio, eroded + more, bed), left)
    return more


def _with_row(row: Any, j: int, around: Any, squares: Any):
    """Sums of masses and of their squares, with three more masses of a row."""
    a, b, c = row[j - 1], row[j], row[j + 1]
    return around + a + b + c, squares + a * a + b * b + c * c


def _covered_at(mass: Any, i: int, j: int):
    """Share [1] of its ground that the column of a node with a ``mass`` (nx, ny) [kg] covers."""
    around, squares = 0.0, 0.0
    for a in range(max(i - 1, 0), min(i + 2, mass.shape[0])):
        for b in range(max(j - 1, 0), min(j + 2, mass.shape[1])):
            around += mass[a, b]
            squares += mass[a, b] * mass[a, b]
    return covered_share(mass[i, j], around, squares)


def _note_covered(mass: Any, a: int, b: int, covered: Any):
    """Shares ``covered`` (n,) [1] of the ground of nodes from (a, b) on, as of :func:`_covered_at`."""
    n, inner = len(covered), 0 < a < mass.shape[0] - 1
    low = 0 if b > 0 else 1
    high = min(n, mass.shape[1] - 1 - b)
    if not inner or high <= low:
        for k in range(n):
            covered[k] = _covered_at(mass, a, b + k)
        return
    if low > 0:
        covered[0] = _covered_at(mass, a, b)
    for k in range(high, n):
        covered[k] = _covered_at(mass, a, b + k)
    first, end = b + low - 1, b + high + 1
    south, here, north, found = mass[a - 1, first:end], mass[a, first:end], mass[a + 1, first:end], covered[low:high]
    for k in range(len(found)):  # without branches: several nodes at once
        around, squares = _with_row(south, k + 1, 0.0, 0.0)
        around, squares = _with_row(here, k + 1, around, squares)
        around, squares = _with_row(north, k + 1, around, squares)
        found[k] = covered_share(here[k + 1], around, squares)


def _coefficient(ground: Any, i: int, j: int, begin: Any):
    """Coefficient [m] of the ground at a node; nothing has changed beyond the table of changes."""
    c, change = ground.coefficients, ground.change
    m, n = i + begin[4], j + begin[5]
    if m < 0 or n < 0 or m >= change.shape[0] or n >= change.shape[1]:
        return c[i + 1, j + 1]
    return c[i + 1, j + 1] + change[m, n]


def _coefficients_around(ground: Any, i: int, j: int, begin: Any):
    """The nine coefficients [m] around a node."""
    k, m, n = i - 1, j - 1, j + 1
    return tens(
        _coefficient(ground, k, m, begin), _coefficient(ground, k, j, begin), _coefficient(ground, k, n, begin),
        _coefficient(ground, i, m, begin), _coefficient(ground, i, j, begin), _coefficient(ground, i, n, begin),
        _coefficient(ground, i + 1, m, begin), _coefficient(ground, i + 1, j, begin), _coefficient(ground, i + 1, n, begin),
    )  # fmt: skip


def _levels(ground: Any, i: int, j: int, begin: Any, level: Any):
    """Coefficients ``level`` (n + 2,) [m] of the ground at a row of nodes from the one before (i, j) on."""
    change, m, n = ground.change, i + begin[4], j - 1 + begin[5]
    own = ground.coefficients[i + 1, j : j + len(level)]
    for k in range(len(own)):
        level[k] = own[k]
    if 0 <= m < change.shape[0]:
        low, high = max(-n, 0), min(len(level), change.shape[1] - n)
        if low < high:
            there, more = level[low:high], change[m, n + low : n + high]
            for k in range(len(there)):
                there[k] += more[k]


def _note_slopes(level: Any, spacing: Any, east: Any, north: Any):
    """Slopes (n,) [1] of the ground at nodes in a row, from coefficients ``level`` (3, n + 2) [m] of it and the rows beside."""
    west, here, beyond, dx, dy = level[0], level[1], level[2], spacing[0], spacing[1]
    for k in range(len(east)):
        nine = tens(
            west[k], west[k + 1], west[k + 2], here[k], here[k + 1], here[k + 2], beyond[k], beyond[k + 1], beyond[k + 2],
        )  # fmt: skip
        found = surface_at(nine, 1.0, 1.0)
        east[k] = found[1] / dx
        north[k] = found[2] / dy


def _note_base(flow: Any, a: int, b: int, area: float, g: Any, covered: Any, rows: Any):
    """Under the columns of nodes from (a, b) on: ``rows`` get speed, driving stress, n_z, thickness across, normal stress.

    They hold the slopes east and north in the second and the third.
    """
    end = b + len(covered)
    volume, x, y, z, mass = flow[0, a, b:end], flow[1, a, b:end], flow[2, a, b:end], flow[3, a, b:end], flow[4, a, b:end]
    speed, east, north, across, sigma = rows[0], rows[1], rows[2], rows[3], rows[4]
    for k in range(len(covered)):
        speed[k] = math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]) / mass[k]
    for k in range(len(covered)):
        base = _base_of(volume[k] / (area * covered[k]), mass[k] / volume[k], (east[k], north[k]), g)
        across[k], sigma[k], east[k], north[k] = base[0], base[1], base[2], base[3]


def _note_sunk(eroded: Any, sunk: Any, fall: Any):
    """By how much nodes in a row fall [m]; they are ``sunk`` (n,) [m] then by all that is ``eroded``."""
    for k in range(len(eroded)):
        fall[k] = eroded[k] - sunk[k]
        sunk[k] = eroded[k]


def _note_levels(ground: Any, i: int, j: int, begin: Any, floor: Any):
    """Coefficients (n,) [m] of the ground at a row of nodes from (i, j) on; :data:`FAR_BELOW` where none was made."""
    _levels(ground, i, j + 1, begin, floor)
    for k in range(len(floor)):
        if math.isnan(floor[k]):
            floor[k] = FAR_BELOW


def note_fall(depths: Any, sunk: Any, ground: Any, begin: Any, first: Any, size: Any, column: Any):
    """Note by how much nodes fall that were eroded since they fell last, and their ground before; ``sunk`` is what was eroded then.

    Parameters
    ----------
    depths : Depths
    sunk : ndarray (NX, NY)
        [m], set at the nodes that fall.
    ground : Ground
    begin : ndarray (7,) of int
        As of :class:`Flow`.
    first, size : ndarray (2,) of int
        First node that falls, among those of the bed, and number of nodes.
    column : ndarray (2, nx, ny)
        Fall and coefficients [m] of these nodes and as many around on each side; :data:`FAR_BELOW` all where no ground was made.
    """
    fall, floor, made, eroded = column[0], column[1], ground.coefficients.shape, depths.eroded
    around = (fall.shape[0] - size[0]) // 2, (fall.shape[1] - size[1]) // 2
    for k in prange(len(fall)):
        i, j = first[0] - around[0] + k, first[1] - around[1]
        fall[k], floor[k] = 0.0, FAR_BELOW
        if around[0] <= k < around[0] + size[0]:
            _note_sunk(eroded[i, first[1] : first[1] + size[1]], sunk[i, first[1] : first[1] + size[1]], fall[k, around[1] :])
        low, high = max(j, -1), min(j + fall.shape[1], made[1] - 1)
        if -1 <= i < made[0] - 1 and low < high:
            _note_levels(ground, i, low, begin, floor[k, low - j : high - j])


def _within(node: Any, way: Any, spacing: Any, size: Any):
    """Place [m] within half a cell of a ``node``, by the part of a ``way`` [cells] beyond whole cells; from 0 to ``size`` [m]."""
    return min(max((node + (way - math.floor(way)) - 0.5) * spacing, 0.0), size)


def _from_node(place: Any, spacing: Any):
    """First node of a particle at a place [m] along an axis, and its offset from there [cells]."""
    q = place / spacing
    first = first_node(q)
    return first, q - first


def bring_forth(born: Any, releases: Any, first: Any, numbers: Any, flow: Any, ground: Any, domain: Any, kinds: Any, newborn: Any):
    """Place particles within half a cell of nodes, on the ground; they bear the flow above them from the beginning.

    Each bears it on the area of its volume over the layer that it stands for.

    Parameters
    ----------
    born, releases : ndarray (nx, ny), (NX, NY) of int
        Particles of each node of a part of the bed; releases of all nodes.
    first : ndarray (2, 2) of int
        As of :func:`round_pools`.
    numbers : ndarray (nx, 2) of int
        Particles that were born before those of each row: in all, and of these.
    flow : Flow
    ground : Ground
    domain : ndarray (2, 2)
        Size of the raster [m]; way from particle to particle along each axis [cells].
    kinds : ndarray (releases + 1,)
        Volume [m3] of a particle of each release; radius [m].
    newborn : Newborn
        Filled.
    """
    spacing, begin, g = ground.spacing, flow.begin, vec(ground.gravity[0], ground.gravity[1], ground.gravity[2])
    sums, radius, area = flow.sums, kinds[-1], spacing[0] * spacing[1]
    node, offset, force, speed, release = newborn.node, newborn.offset, newborn.force, newborn.speed, newborn.release
    for k in prange(len(born)):
        number, p, i = numbers[k, 0], numbers[k, 1], first[0, 0] + k
        for n in range(born.shape[1]):
            if born[k, n] == 0:
                continue
            j = first[0, 1] + n
            nine = _coefficients_around(ground, i, j, begin)
            a, b, own, load, u = i - begin[2] + begin[0], j - begin[3] + begin[1], releases[i, j], 0.0, 0.0
            if 0 <= a < sums.shape[1] and 0 <= b < sums.shape[2] and sums[4, a, b] > 0.0:
                x, y, z = sums[1, a, b], sums[2, a, b], sums[3, a, b]
                load, u = sums[4, a, b] / area, math.sqrt(x * x + y * y + z * z) / sums[4, a, b]
            for _ in range(born[k, n]):
                number += 1
                x = _within(first[1, 0] + i, domain[1, 0] * number, spacing[0], domain[0, 0])
                y = _within(first[1, 1] + j, domain[1, 1] * number, spacing[1], domain[0, 1])
                at = surface_at(nine, x / spacing[0] - (first[1, 0] + i - 1), y / spacing[1] - (first[1, 1] + j - 1))
                east, north = at[1] / spacing[0], at[2] / spacing[1]
                normal = upward_normal(east, north)
                bears = normal_stress(load, normal[2], g, normal) * kinds[own] / (2.0 * radius)
                z = at[0] + radius * math.sqrt(1.0 + east * east + north * north)
                node[p, 0], offset[p, 0] = _from_node(x, spacing[0])
                node[p, 1], offset[p, 1] = _from_node(y, spacing[1])
                node[p, 2], offset[p, 2] = _from_node(z, spacing[2])
                force[p, 0], force[p, 1], force[p, 2] = bears * normal[0], bears * normal[1], bears * normal[2]
                speed[p], release[p] = u, own
                p += 1


def _place(lattice: Any, axis: int, first: int, half: int):
    """First of the three coefficients that count ``half`` half spacings after the node before the ``first``, and the offset."""
    x = lattice.nodes[axis] * (0.5 * half + (first - 1))
    q = (x - lattice.origin[axis]) / lattice.spacing[axis]
    k = min(max(first_node(q), 0), lattice.coefficients.shape[axis] - 3)
    return k, q - k


def _sample_line(lattice: Any, i: int, fx: float, first: int, line: Any):
    """Samples of a surface half a spacing apart from south to north, from the node before the ``first`` on.

    ``line`` (3, 2 m + 3) gets elevations [m] and slopes north and east [1].
    """
    a, b, c = lattice.coefficients[i], lattice.coefficients[i + 1], lattice.coefficients[i + 2]
    wx, dx = weights(fx), weight_slopes(fx)
    for n in range(line.shape[1]):
        j, fy = _place(lattice, 1, first, n)
        wy, dy = weights(fy), weight_slopes(fy)
        south, here = interpolate(wx, a[j], b[j], c[j]), interpolate(wx, a[j + 1], b[j + 1], c[j + 1])
        north = interpolate(wx, a[j + 2], b[j + 2], c[j + 2])
        line[0, n], line[1, n] = interpolate(wy, south, here, north), interpolate(dy, south, here, north) / lattice.spacing[1]
        south, here = interpolate(dx, a[j], b[j], c[j]), interpolate(dx, a[j + 1], b[j + 1], c[j + 1])
        north = interpolate(dx, a[j + 2], b[j + 2], c[j + 2])
        line[2, n] = interpolate(wy, south, here, north) / lattice.spacing[0]


def _resample(lattice: Any, first: Any, line: Any, along: Any, east: Any, found: Any):
    """Coefficients ``found`` (n, m) [m] on the nodes from the ``first`` on of the spline that follows a surface."""
    for k in range(len(along)):
        i, fx = _place(lattice, 0, first[0], k)
        _sample_line(lattice, i, fx, first[1], line)
        z, s = line[0], line[1]
        for m in range(found.shape[1]):
            n = 2 * m
            smooth = bend_smoothness(s[n], s[n + 1], s[n + 2], s[n + 3], s[n + 4])
            along[k, m] = resampled_coefficient(z[n + 1], z[n + 2], z[n + 3], smooth)
            east[k, m] = line[2, n + 2]
    for k in range(len(found)):
        n = 2 * k
        for m in range(found.shape[1]):
            smooth = bend_smoothness(east[n, m], east[n + 1, m], east[n + 2, m], east[n + 3, m], east[n + 4, m])
            found[k, m] = resampled_coefficient(along[n + 1, m], along[n + 2, m], along[n + 3, m], smooth)


def resample_windows(lattice: Any, first: Any, windows: Any, values: Any):
    """Coefficients of :meth:`runout.model.surface.Surface.on_nodes` in windows of nodes, with the same bits.

    Parameters
    ----------
    lattice : Lattice
    first : ndarray (2,) of int
        Node of ``values[0, 0]``, counted from that of the plan.
    windows : ndarray (n, 2, 2) of int
        First node and the one after the last, east and north, counted from the ``first``. Where they overlap, they get the same.
    values : ndarray (nx, ny)
        [m], filled there.
    """
    for k in prange(len(windows)):
        (west, south), (east, north) = windows[k, 0], windows[k, 1]
        lines, rows = 2 * (east - west) + 3, north - south
        line, along, bends = np.empty((3, 2 * rows + 3)), np.empty((lines, rows)), np.empty((lines, rows))
        begin = (first[0] + west, first[1] + south)
        _resample(lattice, begin, line, along, bends, values[west:east, south:north])


def note_bases(flow: Any, ground: Any, base: Any):
    """Note what the laws read under the columns of nodes of the bed; of use where a column has mass.

    Parameters
    ----------
    flow : Flow
    ground : Ground
    base : ndarray (n, 6, m)
        For each row of nodes speed [m/s], driving stress [Pa], n_z, thickness across [m], normal stress [Pa] and the share of its
        ground that a column covers [1].
    """
    begin, spacing, gravity = flow.begin, ground.spacing, ground.gravity
    g, area = vec(gravity[0], gravity[1], gravity[2]), spacing[0] * spacing[1]
    for k in prange(len(base)):
        a, b, i, j = begin[0] + k, begin[1], begin[2] + k, begin[3]
        rows, level = base[k], np.empty((3, base.shape[2] + 2))
        for n in range(3):
            _levels(ground, i + n - 1, j, begin, level[n])
        _note_slopes(level, spacing, rows[1], rows[2])
        _note_covered(flow.sums[4], a, b, rows[5])
        _note_base(flow.sums, a, b, area, g, rows[5], rows)


def erode_nodes(flow: Any, base: Any, laws: Any, depths: Any, lasting: float, reached: Any):
    """Add what a flow erodes in a time ``lasting`` [s] to the depths eroded and owed, at the nodes of the bed that it covers.

    Parameters
    ----------
    flow : Flow
    base : ndarray (n, 6, m)
        As of :func:`note_bases`.
    laws : Laws
    depths : Depths
        ``eroded`` and ``owed`` grow.
    reached : Reached
        Filled.
    """
    begin, mass = flow.begin, flow.sums[4]
    eroded, owed = depths.eroded, depths.owed  # a parallel loop writes into arrays that have a name, not into those of a record
    fastest, nodes = reached.fastest, reached.nodes
    for k in prange(len(fastest)):
        a, b, i, j, rows = begin[0] + k, begin[1], begin[2] + k, begin[3], base[k]
        largest, first, last = 0.0, eroded.shape[1], 0
        for n in range(begin[6]):
            was, u = eroded[i, j + n], rows[0, n]
            left = depths.there[i, j + n] - was
            if not (left > 0.0 and mass[a, b + n] > 0.0) or u < MOVING:
                continue
            wet = flow.pore_ratio[k, n] if len(flow.pore_ratio) else 0.0
            tau = rows[1, n]
            if laws.of_friction != 0:
                tau = friction_stress(rows[4, n], wet, u, laws.basal[laws.rows[k, n] if len(laws.rows) else 0])
            at = rows[3, n], rows[4, n], tau, rows[2, n]
            E = _rate_at(at, u, wet, was, laws.bed[0])
            more = _eroded_in(lasting * rows[5, n], E, left, at, u, wet, was, laws.bed[0])
            largest = max(largest, E)
            if more > 0.0:
                eroded[i, j + n] = was + more
                owed[i, j + n] += more
                first, last = min(first, j + n), j + n + 1
        fastest[k], nodes[k, 0], nodes[k, 1] = largest, first, last


def _pool_owes(owed: Any, low: Any, high: Any):
    """What the nodes of a pool owe [m]: the sum, that of those which owe something, and the node that owes most."""
    total, due, most, at = 0.0, 0.0, 0.0, (low[0], low[1])
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            total += owed[i, j]
            due += max(owed[i, j], 0.0)
            if owed[i, j] > most:
                most, at = owed[i, j], (i, j)
    return total, due, at


def _pool_has(pools: Any, low: Any, high: Any, share: float):
    """Whether each node of a pool has what it gives, a ``share`` of what it owes."""
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            due, left = max(pools.owed[i, j], 0.0), pools.there[i, j] - pools.eroded[i, j]
            if share * due > due + left + 1e-12:
                return False
    return True


def round_pools(pools: Any, first: Any, steps: Any, nearest: bool, size: int):
    """Particles for what square pools of nodes owe, rounded to whole ones at the node that owes most.

    What is added before a number is rounded down is half a particle in the mean and differs by :data:`DITHER` from pool to pool, so
    that a flow that is the same everywhere does not grow in jumps. With a larger mean each pool that the flow leaves has given too
    much. Numbers are rounded upwards only where the nodes have so much.

    Parameters
    ----------
    pools : Pools
        What is given is owed no more; its particles are added to ``born``.
    first : ndarray (2, 2) of int
        First node of the part, counted from that of the bed; that of the bed, counted from that of the plan.
    steps : ndarray (2,)
        By which the rounding moves from node to node along each axis [1].
    nearest : bool
        False: numbers are rounded down.
    size : int
        Nodes of a pool along each axis.
    """
    owed, born = pools.owed, pools.born
    end = first[0, 0] + born.shape[0], first[0, 1] + born.shape[1]
    for k in prange((len(born) + size - 1) // size):
        i0 = first[0, 0] + size * k
        for j0 in range(first[0, 1], end[1], size):
            low, high = (i0, j0), (min(i0 + size, end[0]), min(j0 + size, end[1]))
            total, due, at = _pool_owes(owed, low, high)
            if due <= 0.0:
                continue
            each = pools.takes[pools.releases[at[0], at[1]]]
            particles = max(total, 0.0) / each + 1e-9
            whole = number = math.floor(particles)
            if nearest:
                place = (first[1, 0] + i0) * steps[0] + (first[1, 1] + j0) * steps[1]
                number = math.floor(particles + 0.5 + DITHER * (1.0 - 2.0 * (place - math.floor(place))))
            if number > whole and not _pool_has(pools, low, high, number * each / due):
                number = whole
            if number == 0:
                continue
            born[at[0] - first[0, 0], at[1] - first[0, 1]] += number
            for i in range(low[0], high[0]):
                for j in range(low[1], high[1]):
                    owed[i, j] -= max(owed[i, j], 0.0) / due * (number * each)
