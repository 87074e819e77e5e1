"""Relief in reach of a mass: what a grid carries and its filter takes out, what that costs, and whether the raster oscillates.

A flow cannot follow waves of a few cells of its grid: it climbs them and falls on them, which acts as friction, whether the
relief is real or an artefact of the survey.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from runout.model.scene import STANDARD_GRAVITY
from runout.model.terrain import Terrain
from runout.physics import numerical_scales
from runout.terrain.relief import filtered
from runout.terrain.sdf import raster_surface

WAVES = 3.0  # cells of the grid: half-width of the mean from which carried relief is counted; half of waves of six cells counts
LEAST, MOST = 0.6, 2.2  # times the cost of slabs on rough planes that was measured on terrains: docs/theory.md, the ground
SAID = 0.1  # degrees of friction: less is not worth a number

BANDS = ((2.0, 2.2), (2.2, 2.5), (2.5, 3.0), (3.0, 4.0), (4.0, 6.0), (6.0, 10.0))  # wave lengths [cells of the raster]
LINE = 64  # cells of the lines whose spectra are taken
RISE = 1.5  # power of waves over that of longer ones from which on the raster oscillates
STEEP = 0.02  # least slope of such waves, root mean square
SMOOTH = 1e-8  # variance over that of the roughest line: lines with less are lakes and planes

CELLS = 150_000  # of the windows in which relief is measured, and of the points there
GRID_CELLS = 24  # least width of a window, in cells of the grid


@dataclass(frozen=True)
class Roughness:
    """Relief in reach of a mass, root mean squares."""

    carried: float  # relief of about six grid cells or less that the ground of the grid has [m]
    removed: float  # difference of raster and ground: what the filter of the grid takes out [m]
    # by which the carried relief raises the coefficient of friction [1]; on terrains :data:`LEAST` to :data:`MOST` times as much
    friction: float
    wave: float = 0.0  # length [m] of waves in which the raster oscillates, of two to six of its cells; 0 without

    @classmethod
    def recorded(cls, values: Mapping[str, Any]) -> "Roughness | None":
        """That of :meth:`record`; None if there is none."""
        return cls(**values) if values else None

    def record(self) -> dict[str, float]:
        """The values as they are recorded in ``run.json``."""
        return asdict(self)

    def statement(self) -> str:
        """What the grid does with the relief, as a sentence."""
        low, high = (math.degrees(math.atan(times * self.friction)) for times in (LEAST, MOST))
        more = f"{low:.2g} to {high:.2g} degrees" if high >= SAID else f"less than {SAID:g} degrees"
        return (
            f"Relief in reach of the mass: the ground of this grid has {self.carried:.2g} m (rms) in waves of up to six cells, "
            f"which act like {more} of friction more, real or not; the filter of the grid takes {self.removed:.2g} m out"
        )

    def warning(self) -> str:
        """Sentence on a raster that oscillates, with the remedy; empty if it does not."""
        if not self.wave:
            return ""
        return (
            f"The elevations oscillate in waves of {self.wave:.3g} m, as those of resampled or photogrammetric rasters do: "
            f"their power spectrum rises there; if the ground is smoother, terrain.smoothing: {self.wave:.3g} takes them out"
        )


def of_ground(terrain: Terrain, spacing: tuple[float, float], reach: np.ndarray, speed: float) -> Roughness | None:
    """Roughness of a terrain on a grid where a mass may come; None where no such cell has an elevation.

    ``spacing`` is that of the grid, east and north [m]. ``reach`` (rows, columns) of bool are the cells where the mass may come;
    of large areas some windows are taken. ``speed`` is the root mean square of its speed there [m/s]; that of an energy line is
    0.7 times its largest.
    """
    windows = list(_windows(terrain, spacing, reach))
    if not windows:
        return None
    carried, removed, slope, weight = np.array([_relief(part, spacing, inside) for part, inside in windows]).T
    weight = weight / weight.sum()
    h = math.sqrt(spacing[0] * spacing[1])
    friction = float(weight @ [numerical_scales.relief_friction(float(one), speed, STANDARD_GRAVITY, h) for one in slope])
    waves = [_oscillation([(p.elevation, i) for p, i in windows], axis, terrain.cell_size[1 - axis]) for axis in (0, 1)]
    return Roughness(math.sqrt(weight @ carried**2), math.sqrt(weight @ removed**2), friction, max(waves))


def _windows(terrain: Terrain, spacing: tuple[float, float], reach: np.ndarray) -> Iterator[tuple[Terrain, np.ndarray]]:
    """Parts of a terrain with their cells in reach; of many, some that are drawn with a fixed seed."""
    reach = reach & np.isfinite(terrain.elevation)
    sides = [
        min(count, max(LINE, math.ceil(GRID_CELLS * h / cell)))
        for count, h, cell in zip(terrain.shape, spacing[::-1], terrain.cell_size[::-1], strict=True)
    ]
    corners = [np.arange(count // side) * side + (count % side) // 2 for count, side in zip(terrain.shape, sides, strict=True)]
    squares = [(slice(r, r + sides[0]), slice(c, c + sides[1])) for r in corners[0] for c in corners[1]]
    inside = np.array([np.count_nonzero(reach[square]) for square in squares])
    chosen = np.flatnonzero(inside > 0.25 * inside.max()) if inside.any() else np.array([], int)
    most = max(1, CELLS // (sides[0] * sides[1]))
    if len(chosen) > most:
        chosen = np.sort(np.random.default_rng(1).permutation(chosen)[:most])  # an even step would follow the columns
    for k in chosen:
        yield terrain.part(*squares[k]), reach[squares[k]]


def _relief(part: Terrain, spacing: tuple[float, float], inside: np.ndarray) -> tuple[float, float, float, float]:
    """Relief [m] that the ground has and that the filter takes out, mean slope [1] of the first, and number of cells ``inside``."""
    surface, known = raster_surface(part, None, spacing), inside[::-1].T
    step = [min(max(h / 2, extent / math.sqrt(CELLS)), extent / 8) for h, extent in zip(spacing, part.size, strict=True)]
    axes = [np.arange(0.5 * h, extent, h) for h, extent in zip(step, part.size, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    z, *slopes = (values.reshape(x.shape) for values in surface.evaluate(x.ravel(), y.ravel()))
    widths = [min(WAVES * h / one, count - 4.0) for h, one, count in zip(spacing, step, x.shape, strict=True)]
    smooth = filtered(filtered(z, widths[0], np.arange(float(len(z)))).T, widths[1], np.arange(float(z.shape[1]))).T
    fall = np.stack(np.gradient(smooth, *step))
    along = np.abs(((np.stack(slopes) - fall) * fall).sum(0)) / np.maximum(np.sqrt((fall**2).sum(0)), 1e-12)
    cells = [np.minimum((p / d).astype(int), n - 1) for p, d, n in zip((x, y), part.cell_size, known.shape, strict=True)]
    there = known[cells[0], cells[1]]
    at = [(index + 0.5) * size for index, size in zip(np.nonzero(known), part.cell_size, strict=True)]
    lost = part.elevation[::-1].T[known] - surface.evaluate(*at)[0]
    squares = [math.sqrt(float(np.square(one).mean())) for one in ((z - smooth)[there], lost)]
    return squares[0], squares[1], float(along[there].mean()), float(lost.size)


def _oscillation(windows: list[tuple[np.ndarray, np.ndarray]], axis: int, cell: float) -> float:
    """Length [m] of the steepest waves along an axis of ``cell`` [m] that have more power than longer ones; 0 without such."""
    short, long = np.array(BANDS).T
    variance = spectrum(windows, axis)
    power, steep = variance / (1.0 / short - 1.0 / long), 2.0 * math.pi / (short * cell) * np.sqrt(variance)
    longer = np.minimum.accumulate(power[::-1])[::-1]
    steep_bands = [k for k in range(len(BANDS) - 1) if power[k] > RISE * longer[k + 1] and steep[k] > STEEP]
    return cell * BANDS[max(steep_bands, key=lambda k: steep[k])][0] if steep_bands else 0.0


def spectrum(windows: list[tuple[np.ndarray, np.ndarray]], axis: int) -> np.ndarray:
    """Variance (bands,) [m2] of elevations (rows, columns) [m] in waves of :data:`BANDS` along an axis, of lines half in reach.

    Each window comes with its cells in reach. The mean over lines is geometric, so that cliffs hardly count. Spectra are those of
    second differences, without leakage from long waves, divided by what differences do to a wave.
    """
    lines = []
    for z, inside in windows:
        rows, reached = np.moveaxis(z, axis, 1)[:, :LINE], np.moveaxis(inside, axis, 1)[:, :LINE]
        lines.append(rows[np.isfinite(rows).all(axis=1) & (reached.mean(axis=1) >= 0.5)])
    bend = np.diff(np.concatenate(lines), 2, axis=1)
    count = bend.shape[1]
    window, frequency = np.hanning(count + 2)[1:-1], np.fft.rfftfreq(count)[1:]
    power = 2.0 * np.abs(np.fft.rfft(bend * window, axis=1)[:, 1:]) ** 2 / (count * np.square(window).sum())
    power /= (2.0 * np.sin(np.pi * frequency)) ** 4
    bands = np.array([power[:, (frequency >= 1 / long) & (frequency < 1 / short + 1e-9)].sum(axis=1) for short, long in BANDS]).T
    rough = (bands > SMOOTH * bands.sum(axis=1).max(initial=0.0)).any(axis=1) & (bands > 0.0).all(axis=1)
    return np.exp(np.log(bands[rough]).mean(axis=0)) if rough.any() else np.zeros(len(BANDS))
