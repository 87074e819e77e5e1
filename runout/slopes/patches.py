"""Release polygons from the cells of a slope that may fail."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.stability import StabilitySettings
from runout.forecast.accuracy import preset
from runout.io.vector import outline
from runout.model.limits import PARTICLES_PER_CELL
from runout.model.numerics import Scheme
from runout.terrain.overlay import covered_part

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.slopes.drainage import Drainage
    from runout.slopes.infinite_slope import Stability

PER_BLOCK = 16 * math.prod(PARTICLES_PER_CELL)  # particles of a layer one cell thick in a block of 4 x 4 x 4 cells
SMOOTHED = 0.75  # of a cell: largest distance of an outline from the cell edges that it follows


@dataclass(frozen=True)
class Patch:
    """A proposed release."""

    outline: Any  # shapely Polygon: in map coordinates
    # `rank` from 1; `thickness_m`, `probability`, `factor_of_safety` (of the medians) and `slope_deg`: means over the covered area;
    # `volume_m3`, `area_m2`; `drainage_area_m2`: the largest of its cells; `cell_size_m`: largest spacing of a grid with one cell
    # through the thickness, and `particles` on it
    attributes: dict[str, float]

    @property
    def expected_volume(self) -> float:
        """Probability of failure times volume [m3]."""
        return self.attributes["probability"] * self.attributes["volume_m3"]


@dataclass(frozen=True)
class Suggestion:
    """Proposed releases, and how many cells each condition left."""

    patches: list[Patch]  # by rank: the largest product of probability and volume first
    proposed: int  # number of releases before the limit on their number
    # number of cells that meet each condition and those before it, and the option that sets it
    left: dict[str, tuple[int, str]] = field(default_factory=dict)
    too_large: int = 0  # number of these that need more memory than the machine has free, and that are left out


def suggest(drained: "Drainage", stable: "Stability", choices: StabilitySettings) -> Suggestion:
    """Releases on the cells that fail often enough, drain little, and hang together over the least area.

    A morphological opening by a cell and its four neighbours removes what is narrower than three cells. Enclosed stable parts
    smaller than the least area are included.
    """
    from scipy import ndimage

    terrain = drained.terrain
    likely = stable.probability >= choices.probability  # false where unknown
    slope_cells = likely & (drained.area <= choices.largest_drainage)
    opened = ndimage.binary_opening(slope_cells, ndimage.generate_binary_structure(2, 1))
    label, count = ndimage.label(_without_small_holes(opened, terrain, choices.least_area))
    cells = np.bincount(label.ravel(), minlength=count + 1)
    large = [k for k in range(1, count + 1) if cells[k] * terrain.cell_area >= choices.least_area]
    patches = sorted(_patches(label, large, drained, stable), key=lambda one: -one.expected_volume)
    affordable = [one for one in patches if fits_memory(one.attributes["particles"], terrain)]
    ranked = [Patch(one.outline, {"rank": k, **one.attributes}) for k, one in enumerate(affordable[: choices.most], 1)]
    left = {
        f"has a probability of failure of {choices.probability:g} or more": (int(likely.sum()), "--probability"),
        f"of these drains {choices.largest_drainage:g} m2 or less": (int(slope_cells.sum()), "--largest-drainage"),
        "of these lies in a strip of three cells or wider": (int(opened.sum()), "--probability"),
        f"of these lies in a patch of {choices.least_area:g} m2 or more": (int(cells[large].sum()), "--least-area"),
    }
    return Suggestion(ranked, len(patches), left, len(patches) - len(affordable))


def fits_memory(particles: float, terrain: "Terrain") -> bool:
    """Whether a run of so many particles, in a layer one cell thick, fits into the memory that is free."""
    from runout.forecast.memory import Extent, available_bytes, expected_memory

    free = available_bytes()
    blocks = math.ceil(particles / PER_BLOCK)
    extent = Extent(math.ceil(particles), blocks, 2 * blocks, 4 * blocks, 4 * blocks)
    return free is None or expected_memory(extent, terrain.elevation.size, Scheme()).total <= free


def _without_small_holes(mask: np.ndarray, terrain: "Terrain", least_area: float) -> np.ndarray:
    """The mask with enclosed parts of known cells that are smaller than ``least_area`` [m2]."""
    from scipy import ndimage

    label, count = ndimage.label(ndimage.binary_fill_holes(mask) & ~mask)
    if count == 0:
        return mask
    unknown = np.bincount(label.ravel(), np.isnan(terrain.elevation).ravel(), count + 1) > 0
    small = (np.bincount(label.ravel()) * terrain.cell_area < least_area) & ~unknown
    small[0] = False
    return mask | small[label]


def _patches(label: np.ndarray, numbers: list[int], drained: "Drainage", stable: "Stability") -> Iterator[Patch]:
    """Patches of the labelled cells; the smoothed outline of a later one leaves out those before it."""
    from scipy import ndimage

    boxes = ndimage.find_objects(label)
    taken: list[Any] = []
    for number in numbers:
        box = boxes[number - 1]
        inside = label[box] == number
        shape = _smooth(outline(inside, drained.terrain.part(*box)), drained.terrain, taken)  # 3 x 3 cells or more, once opened
        taken.append(shape)
        yield _patch(shape, float(drained.area[box][inside].max()), drained, stable)


def _patch(shape: Any, drainage_area: float, drained: "Drainage", stable: "Stability") -> Patch:
    """The patch of an outline with means over the area of the cells that it covers."""
    place, area = covered_part(shape, drained.terrain)
    mean = _Mean(area)
    thickness = mean.of(np.where(stable.thickness[place] > 0, stable.thickness[place], np.nan))
    cell = preset("screening").cell_size(thickness, shape.area)
    attributes = {
        "thickness_m": thickness,
        "volume_m3": thickness * shape.area,
        "area_m2": shape.area,
        "probability": mean.of(stable.probability[place]),
        "factor_of_safety": mean.of(stable.factor[place]),
        "slope_deg": float(np.degrees(mean.of(stable.slope[place]))),
        "drainage_area_m2": drainage_area,
        "cell_size_m": cell,
        "particles": math.prod(PARTICLES_PER_CELL) * thickness * shape.area / cell**3,
    }
    return Patch(shape, attributes)


@dataclass(frozen=True)
class _Mean:
    """Means weighted by the covered area (rows, columns) [m2] of cells."""

    area: np.ndarray

    def of(self, values: np.ndarray) -> float:
        """Mean of the known values (rows, columns)."""
        known = np.isfinite(values) & (self.area > 0)
        return float(np.sum(values[known] * self.area[known]) / np.sum(self.area[known]))


def _smooth(shape: Any, terrain: "Terrain", taken: list[Any]) -> Any:
    """Largest polygon of a shape whose steps along cell edges are cut to diagonals, inside the terrain and outside of others."""
    import shapely

    smooth = shapely.simplify(shape, SMOOTHED * min(terrain.cell_size), preserve_topology=True)
    smooth = smooth.intersection(shapely.box(*terrain.extent))
    near = [other for other in taken if other.intersects(smooth)]
    if near:
        smooth = smooth.difference(shapely.union_all(near))
    parts = [part for part in shapely.get_parts(smooth) if part.geom_type == "Polygon" and part.is_valid]
    largest = max(parts or shape.geoms, key=lambda part: part.area)
    place, area = covered_part(largest, terrain)
    if np.isnan(terrain.elevation[place])[area > 0].any():  # a release needs the elevation of all its cells
        return max(shape.geoms, key=lambda part: part.area)
    return largest
