"""Columns of the plan lattice that hold the particles of a release, with its exact volume."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.io.polygon_coverage import ROUND_OFF, covered_area, covered_centroid, regrid, regrid_within
from runout.model.particles import CHUNK
from runout.model.release import Release
from runout.release import arrangement

THINNEST = 1e-6  # columns thinner than this share of a particle layer get no particle; their volume goes to the others
CLOSE = 1e-9  # share of the volume that regridding may miss by round-off


@dataclass(frozen=True)
class Columns:
    """Particle columns of one release."""

    index: np.ndarray  # (m, 2) int32: on the plan lattice, east and north
    size: tuple[float, float]  # [m]
    layer: float  # nominal height of a layer of particles [m]
    thickness: np.ndarray  # (m,): mean [m]
    cut: np.ndarray  # (m,) of bool: whether the outline cuts the column
    # shifted, shift: (k,): columns whose particles lie around the centre of their covered part, and its distance from theirs, east
    # and north [m]
    shifted: np.ndarray
    shift: np.ndarray

    @classmethod
    def of(cls, release: Release, size: tuple[float, float], layer: float) -> "Columns":
        """Columns that hold enough of a release for particles. Raises ReleaseError if it is too thin for any."""
        _, edges = _occupied(release)
        first = [int(np.floor(e[0] / h + ROUND_OFF)) for e, h in zip(edges, size, strict=True)]
        last = [int(np.ceil(e[-1] / h - ROUND_OFF)) for e, h in zip(edges, size, strict=True)]
        edges_x, edges_y = (np.arange(a, b + 1) * h for a, b, h in zip(first, last, size, strict=True))
        thickness = column_thickness(release, edges_x, edges_y)
        used = thickness > THINNEST * layer
        if not used.any():
            raise ReleaseError(
                f"release {release.name!r} is thinner than {THINNEST * layer:.3g} m everywhere; check the unit of its thickness"
            )
        index = np.stack([(place + start).astype(np.int32) for place, start in zip(np.nonzero(used), first, strict=True)], axis=1)
        cut, shift = np.zeros(len(index), bool), np.zeros((0, 2))
        shifted = np.zeros(0, np.int64)
        if release.outline is not None:
            outline = local_outline(release)
            share = covered_area(outline, edges_x, edges_y)[used] / (size[0] * size[1])
            cut = (share > 0) & (share < 1)
            shift = np.column_stack([by[used] for by in covered_centroid(outline, edges_x, edges_y)])
            shifted = np.flatnonzero(shift.any(axis=1))
        return cls(index, size, layer, thickness[used], cut, shifted, shift[shifted])

    def __len__(self) -> int:
        return len(self.thickness)

    @cached_property
    def rows(self) -> np.ndarray:
        """Layers (m,) of particles in each column."""
        return arrangement.rows(self.thickness, self.layer)

    @property
    def volumes(self) -> np.ndarray:
        """Volume (m,) of a particle in each column [m3], up to round-off of their sum."""
        return self.thickness / self.rows * (self.size[0] * self.size[1])

    def centres(self, part: slice) -> np.ndarray:
        """Local positions (n, 2) [m] around which the particles of some columns lie."""
        centre = (self.index[part] + 0.5) * np.array(self.size)
        here = slice(*np.searchsorted(self.shifted, (part.start, part.stop)))
        centre[self.shifted[here] - part.start] += self.shift[here]
        return centre

    def parts(self) -> Iterator[slice]:
        """Stretches of columns with about :data:`runout.model.particles.CHUNK` particles each."""
        ends = np.cumsum(self.rows)
        cuts = np.unique(np.searchsorted(ends, np.arange(CHUNK, ends[-1], CHUNK)) + 1)
        for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), len(self)], strict=True):
            if first < last:
                yield slice(first, last)


def column_thickness(release: Release, edges_x: np.ndarray, edges_y: np.ndarray) -> np.ndarray:
    """Mean vertical thickness (nx, ny) [m] over the columns of a local lattice.

    The volume of each terrain cell lies on its part inside the outline, or without an outline on the whole cell.
    ``sum(thickness * column area)`` is the release's volume to round-off.

    ``edges_x``, ``edges_y`` (nx + 1,), (ny + 1,): ascending local edges of the columns [m]; they must hold the whole release.
    Raises ReleaseError if part of the release lies outside the lattice.
    """
    thickness, edges = _occupied(release)
    to_edges = (_padded(np.asarray(edges_x, np.float64), edges[0]), _padded(np.asarray(edges_y, np.float64), edges[1]))
    if release.outline is None:
        columns = regrid(thickness, edges, to_edges)
    else:
        columns = regrid_within(local_outline(release), thickness, edges, to_edges)
    columns = columns[1:-1, 1:-1]
    volume = float(np.diff(edges_x) @ columns @ np.diff(edges_y))
    if abs(volume / release.volume - 1.0) > CLOSE:
        raise ReleaseError(
            f"release {release.name!r}: the lattice holds {volume:.6g} of its {release.volume:.6g} m3; make the lattice larger"
        )
    return columns * (release.volume / volume)


def _occupied(release: Release) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Thickness (nx, ny) of the smallest window of terrain cells that holds the release, and its local edges."""
    cells = release.thickness[::-1].T
    window = []
    for axis in (0, 1):
        used = np.flatnonzero(cells.any(axis=1 - axis))
        window.append(slice(used[0], used[-1] + 1))
    edges = tuple(np.arange(w.start, w.stop + 1) * size for w, size in zip(window, release.terrain.cell_size, strict=True))
    return np.ascontiguousarray(cells[window[0], window[1]]), (edges[0], edges[1])


def _padded(edges: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Edges with one more cell on either side that cover those of ``around``."""
    width = edges[-1] - edges[0]
    return np.concatenate(([min(edges[0], around[0]) - width], edges, [max(edges[-1], around[-1]) + width]))


def local_outline(release: Release) -> Any:
    """Outline of a release in local coordinates [m], a shapely polygon."""
    import shapely

    return shapely.transform(release.outline, release.terrain.frame.to_local)
