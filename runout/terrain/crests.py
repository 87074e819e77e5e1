"""Crests and channels of a raster: where they run, and a surface that keeps their elevations.

A spline rounds off what is two or three cells wide. How much depends on where the crest lies between the nodes and on its
azimuth, which no formula along one axis at a time can see.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from runout.model.surface import Surface, smoothness_along
from runout.physics import bspline
from runout.terrain.prepare import below_energy_line

WIDEST = 5  # cells of one elevation across a crest
BESIDE = 3  # cells within which the ground falls on both sides of a crest
LOWEST, HIGHEST = 0.05, 0.15  # cells of the grid: crests below the one are left alone, from the other on kept wholly
LEVEL = 1e-4  # of the height of a crest: differences between its cells that rounding makes
LEAST_TRUST = 0.05  # in a crest whose tilt is uncertain
WITHIN = 0.005  # of the height of a crest; smaller misses are left alone
LARGEST = 0.25  # of the height of a crest; the most that it is moved
ASIDE = 0.75  # cells of the raster between a crest of the raster and that of the surface, at most
APART = 4  # half cells that the crests of two neighbouring rows may lie apart
LEAST = 0.2  # of the squared weights that move a coefficient by the whole mean miss
SEARCH, SWEEPS = 6, 10  # steps to the crest of the surface, and corrections of its height
RELAXATION = 1.75  # of each correction; stable below 2
MARGIN = 4  # cells of the raster around what the masses may reach
LARGEST_WINDOW = 250_000  # cells in the window
LARGEST_TABLE = 2_000_000  # nodes in the window
FINE = 0.2  # cells of the raster: crests stand well enough on nodes that lie no farther apart without a table of their own

Box = tuple[tuple[int, int], tuple[int, int]]  # first cell and the one behind the last, east and north


@dataclass(frozen=True)
class Crests:
    """Points (n,) on crests and channels, each seen along one axis."""

    axis: np.ndarray  # 0 east, 1 north
    # along, across: local position along that axis and the other one [m]
    along: np.ndarray
    across: np.ndarray
    elevation: np.ndarray  # of the raster [m]
    height: np.ndarray  # over the tilted ground on both sides [m]; negative in a channel
    weight: np.ndarray  # 1 at an edge, 0 on smooth ground, which the surface follows anyway
    tilt: np.ndarray  # slope of the ground under it along the axis [1]
    trust: np.ndarray  # how much the point counts beside others [1]
    is_lid: np.ndarray  # the surface may be lower there (in a channel higher): the edge of a wide crest
    cell: np.ndarray  # size of the cell along the axis [m]

    @classmethod
    def of(
        cls, z: np.ndarray, cell_size: tuple[float, float], spacing: float, corner: tuple[float, float] = (0.0, 0.0)
    ) -> "Crests":
        """Crests and channels of elevations (nx, ny) [m] of cells of ``cell_size`` [m], for a grid of ``spacing`` [m].

        ``corner`` is the south-west corner of the first cell [m].
        """
        if min(z.shape) < BESIDE:
            return cls(*(np.zeros(0) for _ in fields(cls)))
        parts = []
        for axis, (cell, other) in enumerate((cell_size, cell_size[::-1])):
            steps = 1 + math.ceil((1.0 - 1e-9) * other / spacing)
            rows = np.ascontiguousarray(np.moveaxis(z, axis, 0))
            rough = 1.0 - smoothness_along(rows)
            for sign in (1.0, -1.0):
                place, values = _along(sign * rows, rough, spacing, steps)
                elevation, height, weight, tilt, trust, is_lid = values
                along, across = corner[axis] + (place[0] + 0.5) * cell, corner[1 - axis] + (place[1] + 0.5) * other
                fixed = (np.full(len(weight), value) for value in (axis, cell))
                signed = (sign * elevation, sign * height, weight, sign * tilt / cell, trust, is_lid > 0.0)
                parts.append((next(fixed), along, across, *signed, next(fixed)))
        return cls(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def moved(self, by: tuple[float, float]) -> "Crests":
        """The same points, so far [m] to the east and the north."""
        east, north = by
        along, across = (np.where(self.axis == axis, east, north) for axis in (0, 1))
        return replace(self, along=self.along + along, across=self.across + across)

    def take(self, which: np.ndarray) -> "Crests":
        """Some of the points."""
        return Crests(*(values[which] for values in vars(self).values()))


def with_crests(surface: Surface, crests: Crests) -> Surface:
    """The surface with coefficients changed so that its crests and channels have the elevations of the raster.

    Each sweep adds to a coefficient the mean miss of the points around it (SIRT, Gilbert 1972), weighted by the squares of the
    weights. The miss is taken where the surface is highest across the crest, over the tilt of the ground; that place is searched
    anew in each sweep. Points beside which nothing moves in a sweep are left out of the next ones.
    """
    if not len(crests.axis):
        return surface
    search, along, c = _Search(surface, crests), crests.along, surface.coefficients.flatten()
    for _ in range(SEARCH):
        along, reached = search.climb(c, along)[:2]
    is_beside = np.abs(along - crests.along) < (1.0 - 1e-9) * ASIDE * crests.cell  # else the surface rises to something else
    crests, along, reached = crests.take(is_beside), along[is_beside], reached[is_beside]
    most = LARGEST * np.abs(crests.height)
    aim = reached + crests.weight * np.clip(crests.elevation - reached, -most, most)
    search = _Search(surface, crests)
    room = np.zeros(c.shape)  # of a coefficient, twice what the highest crest beside it may move
    for nodes in search.climb(c, along)[2]:
        np.maximum.at(room, nodes, 2.0 * most)
    low, high = c - room, c + room
    for _ in range(SWEEPS):
        along, reached, nodes, share = search.climb(c, along)
        off = np.where(crests.is_lid & ((aim - reached) * crests.height > 0.0), 0.0, aim - reached)
        share = np.where(crests.is_lid & (off == 0.0), 0.0, share)
        miss = np.sign(off) * np.maximum(np.abs(off) - WITHIN * np.abs(crests.height), 0.0)
        sums, shares = (np.bincount(nodes.ravel(), v.ravel(), len(c)) for v in (share * miss, share))
        moves = sums != 0.0
        n = np.flatnonzero(moves)
        c[n] = np.clip(c[n] + RELAXATION * sums[n] / np.maximum(shares[n], LEAST), low[n], high[n])
        beside = moves[nodes].any(axis=0)
        if not beside.any():
            break
        if not beside.all():
            crests, along, aim = crests.take(beside), along[beside], aim[beside]
            search = _Search(surface, crests)
    return replace(surface, coefficients=c.reshape(surface.coefficients.shape))


class _Search:
    """Search for the crests of a surface across those of the raster, whose places across the axis stay."""

    def __init__(self, surface: Surface, crests: Crests):
        axis, shape = crests.axis, np.array(surface.coefficients.shape)
        self.crests, self.up = crests, np.sign(crests.height)
        self.origin, self.spacing, self.last = np.array(surface.origin)[axis], np.array(surface.spacing)[axis], shape[axis] - 3
        strides = np.array([shape[1], 1])
        self.stride = strides[axis]
        beside = [surface.patch(crests.across, other) for other in (1, 0)]
        first, offset = (np.where(axis == 0, *pair) for pair in zip(*beside, strict=True))
        self.beside = (first + np.arange(3)[:, None]) * strides[1 - axis]  # (3, n)
        self.share = np.stack(bspline.weights(offset))

    def climb(self, c: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Places (n,) [m] a step towards the crest of the surface of coefficients ``c``, and elevations (n,) [m] before it.

        Both over the tilt of the ground, the elevations at the crest of the raster.

        Then the nodes (12, n) that make these, and the squares of their weights.
        """
        q = (along - self.origin) / self.spacing
        n = np.clip(np.floor(q).astype(np.int64), 1, self.last)
        t, late = q - n, q - n >= 0.5
        three = np.stack(bspline.weights(np.where(late, t, t + 1.0)))
        none = np.zeros((1, len(t)))
        own = np.where(late, np.concatenate([none, three]), np.concatenate([three, none]))
        nodes = ((n - 1 + np.arange(4)[:, None]) * self.stride)[:, None] + self.beside
        values = (c[nodes] * self.share).sum(axis=1)  # (4, n)
        tilt = self.crests.tilt * self.spacing
        before, after = (_slope(np.diff(values, axis=0), t + aside) - tilt for aside in (-0.25, 0.25))
        bend = np.maximum(2.0 * self.up * (before - after), 0.1 * np.abs(self.crests.height))
        step = np.clip(0.5 * self.up * (before + after) / bend, -0.25, 0.25) * self.spacing
        most = ASIDE * self.crests.cell
        moved = np.clip(along + step, self.crests.along - most, self.crests.along + most)
        reached = (own * values).sum(axis=0) - self.crests.tilt * (along - self.crests.along)
        return moved, reached, nodes.reshape(12, -1), (own[:, None] * self.share).reshape(12, -1) ** 2 * self.crests.trust


def _slope(rises: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Slope of a spline of three ``rises`` (3, n) between coefficients at -1, 0, 1 and 2: linear between -1/2, 1/2 and 3/2."""
    return np.where(t < 0.5, rises[1] + (t - 0.5) * (rises[1] - rises[0]), rises[1] + (t - 0.5) * (rises[2] - rises[1]))


def _along(z: np.ndarray, rough: np.ndarray, spacing: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Crests along axis 0 of elevations (n, m) [m], how ``rough`` these are: places (2, k) [cells], and values (6, k).

    The values are the elevations, heights [m], weights, tilts [m/cell], trust and whether it is a lid. A crest is one to
    :data:`WIDEST` cells of one elevation over the tilt of the ground; its place is their middle. Between two rows it runs
    straight, with a point at each of so many ``steps``.
    """
    n, m = z.shape
    rows = np.pad(z, ((WIDEST, WIDEST), (0, 0)), mode="edge")
    rises = np.diff(rows, axis=0)
    first, j, wide = _bulges(rises, rough)
    tilt, doubt = _tilt(rows, first, first + wide, j)
    fall, height = _over_tilt(rows, first, first + wide, j, tilt)
    is_level = (height > 0.0) & (fall > LEVEL * height)
    for k in range(1, WIDEST):
        is_level &= (k > wide) | (np.abs(rows[first + WIDEST + k, j] - z[first, j] - k * tilt) <= LEVEL * height)
    first, j, wide, tilt, height, doubt = (values[is_level] for values in (first, j, wide, tilt, height, doubt))
    last = first + wide
    place = 0.5 * (first + last) + _aside(rows, first, last, j, height, tilt)
    weight = np.minimum(rough[first, j], rough[last, j])
    weight *= np.clip((height / spacing - LOWEST) / (HIGHEST - LOWEST), 0.0, 1.0)
    trust = np.clip(1.0 - BESIDE * doubt / height, LEAST_TRUST, 1.0)
    halves = np.zeros((7, 2 * n, m))  # elevation, height, weight, tilt, trust, lid and place at half cells, where a crest is
    halves[:, first + last, j] = z[first, j] + tilt * (place - first), height, weight, tilt, trust, 0.0 * trust, place
    crest = halves[2] > 0.0
    row, column = _indices(crest)
    parts = [(np.stack([halves[-1, row, column], column]), halves[:-1, row, column])]
    for cells in range(2, WIDEST):
        for edge in (first, last):
            e, c, *of_edge = (values[wide == cells] for values in (edge, j, height, weight, tilt, trust))
            parts.append((np.stack([e, c]), np.stack([z[e, c], *of_edge, np.ones(len(e))])))
    parts.append(_between(z, halves, crest, row, column, steps))
    places, values = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    some = values[2] > 0.0
    return places[:, some], values[:, some]


def _bulges(rises: np.ndarray, rough: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First cells (2, k) of all that may be crests, and how many cells more these have: the ground rises more before, less behind.

    ``rises`` are those from each cell to the next one [m], with :data:`WIDEST` more at both ends.
    """
    bulges, is_rough = [], rough > 0.0
    for wide in range(min(WIDEST, len(rough))):
        count = len(rough) - wide
        part = [rises[WIDEST - 1 + k : WIDEST - 1 + k + count] for k in range(wide + 2)]
        may = (part[0] > part[-1]) & is_rough[:count] & is_rough[wide:]
        for inner in part[1:-1]:
            may &= (part[0] > inner) & (inner > part[-1])
        first, j = _indices(may)
        bulges.append((first, j, np.full(len(first), wide)))
    first, j, wides = (np.concatenate(part) for part in zip(*bulges, strict=True))
    return first, j, wides


def _indices(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second index (k,) of what is true in an array (n, m); numpy's nonzero takes ten times as long."""
    first, second = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return first, second


def _tilt(rows: np.ndarray, first: np.ndarray, last: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope [m/cell] of the ground under crests from their ``first`` to their ``last`` cell, and how uncertain it is [m/cell].

    The least of the slopes between two feet on each side, 0 if they have two signs: a cliff beside a crest is no tilt. It is
    certain where both are the same, and where both sides fall alike. ``rows`` reach :data:`WIDEST` cells farther at both ends.
    """
    before = 0.5 * (rows[first + WIDEST - BESIDE, j] - rows[first, j])
    after = 0.5 * (rows[last + 2 * WIDEST, j] - rows[last + WIDEST + BESIDE, j])
    tilt = np.maximum(np.minimum(before, after), 0.0) + np.minimum(np.maximum(before, after), 0.0)
    return tilt, np.minimum(np.abs(before - after), np.abs(before + after))


def _over_tilt(
    rows: np.ndarray, first: np.ndarray, last: np.ndarray, j: np.ndarray, tilt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How much [m] the ground falls over a tilt beside what may be crests, on the side where it is less: at once and farther on."""
    top = rows[first + WIDEST, j], rows[last + WIDEST, j]
    before = [top[0] - rows[first + WIDEST - k, j] - k * tilt for k in range(1, BESIDE + 1)]
    after = [top[1] - rows[last + WIDEST + k, j] + k * tilt for k in range(1, BESIDE + 1)]
    return np.minimum(before[0], after[0]), np.minimum(np.max(before, axis=0), np.max(after, axis=0))


def _aside(
    rows: np.ndarray, first: np.ndarray, last: np.ndarray, j: np.ndarray, height: np.ndarray, tilt: np.ndarray
) -> np.ndarray:
    """How far [cells] the middle of crests lies from that of their highest cells: towards neighbours that are little lower."""
    aside = np.zeros(len(first))
    for cell, sign in ((last, 1), (first, -1)):
        share = 0.5 * sign
        for k in (1, 2):
            lower = rows[cell + WIDEST, j] + sign * k * tilt - rows[cell + WIDEST + sign * k, j]
            share = share * np.clip(1.0 - lower / (LARGEST * height), 0.0, 1.0)
            aside = aside + share
    return aside


def _between(
    z: np.ndarray, halves: np.ndarray, crest: np.ndarray, row: np.ndarray, column: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points at each of ``steps`` between crests of neighbouring rows, at most :data:`APART` half cells apart, if no gap is there.

    ``halves`` (7, 2 n, m) are the values of :func:`_along`; ``row`` and ``column`` (k,) tell what is a ``crest`` (2 n, m).
    """
    beside = np.pad(crest, ((APART, APART), (0, 1))).ravel()
    apart = np.arange(2 * APART + 1)[:, None]
    which = np.nonzero(beside[(row + apart) * (crest.shape[1] + 1) + column + 1])
    i, j = row[which[1]], column[which[1]]
    here, there = halves[:, i, j], halves[:, i + which[0] - APART, j + 1]
    share = np.arange(1, steps)[:, None] / steps  # of the way
    along = here[[0, 3, 6], None] + share * (there - here)[[0, 3, 6], None]  # (3, steps - 1, k)
    least = np.minimum(here, there)[[1, 2, 4, 5]]
    place, middle = along[2], 0.5 * (here[6] + there[6])
    low = np.clip(middle.astype(np.int64), 0, len(z) - 2)
    beyond = middle - low
    ground = 0.5 * ((1.0 - beyond) * (z[low, j] + z[low, j + 1]) + beyond * (z[low + 1, j] + z[low + 1, j + 1]))
    through = ground >= 0.5 * (here[0] + there[0]) - LARGEST * least[0]
    values = np.stack(np.broadcast_arrays(along[0], least[0], least[1], along[1], least[2], least[3]))[..., through]
    return np.stack([place, np.broadcast_to(j + share, place.shape)])[..., through].reshape(2, -1), values.reshape(len(values), -1)


@dataclass(frozen=True)
class Mass:
    """What is released."""

    thickness: np.ndarray  # (rows, columns): on the cells of the terrain [m]
    angle: float  # smallest friction angle [rad] that acts on any ground, 0 for a fluid


def crest_window(ground: np.ndarray, cell: tuple[float, float], box: Box, top: float, angle: float, most: float = math.inf) -> Box:
    """Cells around all that a mass can reach by the energy line, at most ``most``; see :func:`runout.terrain.prepare.reachable`.

    Where they are more, those nearest to the mass. Simpler than there: distances count from the box of the mass.

    Parameters
    ----------
    ground : ndarray (nx, ny)
        Elevation [m].
    cell : tuple of float
        Size of the cells, east and north [m].
    box : tuple
        Cells that hold the mass.
    top : float
        Its highest elevation [m].
    angle : float
        Smallest angle of the energy line [rad].
    """
    reach = _reached(ground, cell, box, top, angle)
    reach = _within(_grown(reach, MARGIN), ((0, ground.shape[0]), (0, ground.shape[1])))
    if _cells(reach) <= most:
        return reach
    low, high = -max(last - first for first, last in box), max(ground.shape)  # cells by which the box grows: fit, do not fit
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _cells(_within(_grown(box, middle), reach)) <= most else (low, middle)
    return _within(_grown(box, low), reach)


def most_cells(cell: tuple[float, float], spacing: tuple[float, float]) -> float:
    """Most cells [1] of a window, of ``cell`` [m] and on a grid of ``spacing`` [m]."""
    if not needs_table(cell, spacing):
        return LARGEST_WINDOW
    return min(LARGEST_WINDOW, LARGEST_TABLE * spacing[0] * spacing[1] / (cell[0] * cell[1]))


def needs_table(cell: tuple[float, float], spacing: tuple[float, float]) -> bool:
    """Whether crests need corrections on the nodes of a grid of ``spacing`` [m] over cells of ``cell`` [m]."""
    return any(h > FINE * size for h, size in zip(spacing, cell, strict=True))


def _reached(ground: np.ndarray, cell: tuple[float, float], box: Box, top: float, angle: float) -> Box:
    """Box of the cells below the energy line that hang together with the box of the mass."""
    aside = [
        size * np.maximum(np.maximum(first - np.arange(count), np.arange(count) - last + 1), 0)
        for (first, last), size, count in zip(box, cell, ground.shape, strict=True)
    ]
    start = np.zeros(ground.shape, bool)
    start[tuple(slice(*sides) for sides in box)] = True
    distance = np.add.outer(aside[0] ** 2, aside[1] ** 2)
    reach = below_energy_line(ground, start, np.sqrt(distance, out=distance), top, angle, cell)
    cells = [np.flatnonzero(reach.any(axis=axis)) for axis in (1, 0)]
    return (int(cells[0][0]), int(cells[0][-1]) + 1), (int(cells[1][0]), int(cells[1][-1]) + 1)


def _grown(box: Box, by: int) -> Box:
    (west, east), (south, north) = box
    return (west - by, east + by), (south - by, north + by)


def _within(box: Box, limits: Box) -> Box:
    """The part of a box in another one; empty boxes have no cells."""
    sides = []
    for (first, last), (low, high) in zip(box, limits, strict=True):
        start = min(max(first, low), high)
        sides.append((start, max(start, min(last, high))))
    return sides[0], sides[1]


def _cells(box: Box) -> int:
    return math.prod(last - first for first, last in box)
