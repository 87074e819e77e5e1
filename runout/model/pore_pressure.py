"""Pore pressure of a released mass: ratio at the start, the one that stays, how it drains (:mod:`runout.physics.pore_pressure`)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.arrays import real_array
from runout.model.limits import checked
from runout.model.readers import reader
from runout.model.terrain import Terrain
from runout.physics import pore_pressure as formulas

FIELDS = ("equilibrium", "closure", "decay_rate", "diffusion")  # of a record, see runout.physics.pore_pressure
BLOCKS = ("low", "high", "block")
FIRST_TERM = 4.0 / np.pi  # of Terzaghi's series
STREAM = 48  # of the seed of a release, beside that of its particles


@dataclass(frozen=True, kw_only=True)
class RatioBlocks:
    """Ratios drawn for square blocks of the plan, uniform from ``low`` to ``high`` [1]; ``block`` is their size [m].

    The draw follows the seed of the run and the number of the release.
    """

    low: float
    high: float
    block: float

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            checked("pore_pressure_ratio", getattr(self, name), key=f"pore_pressure: ratio: {name}", error=ReleaseError)
        checked("pore_pressure_block", self.block, key="pore_pressure: ratio: block", error=ReleaseError)
        if self.low > self.high:
            raise ReleaseError(f"pore_pressure: ratio: low is {self.low:g}, above high {self.high:g}; exchange them")

    def at(self, x: np.ndarray, y: np.ndarray, seed: Sequence[int]) -> np.ndarray:
        """Ratios (n,) [1] at local positions (n,) [m]; blocks are counted from the origin, each has its own draw."""
        place = np.stack([np.floor(x / self.block), np.floor(y / self.block)], axis=1).astype(np.int64)
        blocks, own = np.unique(place, axis=0, return_inverse=True)
        drawn = [np.random.default_rng([*seed, STREAM, *(block & 0xFFFFFFFF)]).random() for block in blocks]
        return self.low + (self.high - self.low) * np.array(drawn)[own.ravel()]


@dataclass(frozen=True, kw_only=True, eq=False)
class RatioZones:
    """Ratios by zones of the plan: stated for each zone, or drawn for each.

    Parameters
    ----------
    zone : ndarray (rows, columns) of int
        Number of the zone of each cell of the terrain, the north-west corner first; -1 where there is none.
    ratio : float or ndarray (zones,), optional
        Pore pressure ratio [1], 0 to 0.97, of all zones or of each.
    low, high : float, optional
        Instead: each zone has a ratio of its own [1], uniform from ``low`` to ``high``, which the seed of a run draws.
    elsewhere : float, optional
        Ratio [1] beyond all zones. Without it mass beyond them is refused.
    changes : tuple of str
        Assumptions of the reader, one sentence each.

    Raises
    ------
    ReleaseError
        If a number is out of its range, or not exactly one of ``ratio`` and the pair of ``low`` and ``high`` is given.
    """

    zone: np.ndarray
    ratio: float | np.ndarray | None = None
    low: float | None = None
    high: float | None = None
    elsewhere: float | None = None
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        zone = np.array(real_array(self.zone, "pore_pressure: ratio: zone", ReleaseError), np.int32)
        if zone.ndim != 2 or (zone < 0).all():
            raise ReleaseError(
                f"pore_pressure: ratio: zone has shape {zone.shape}; give the number of the zone of each cell of the terrain, from "
                "0, -1 where there is none"
            )
        zone.setflags(write=False)
        object.__setattr__(self, "zone", zone)
        for key, message, fix in zone_conflicts(
            {n: getattr(self, n) for n in ("ratio", "low", "high") if getattr(self, n) is not None}
        ):
            raise ReleaseError(f"pore_pressure: ratio: {key}{': ' if key else ''}{message}; {fix}")
        for name in ("low", "high", "elsewhere"):
            if getattr(self, name) is not None:
                checked("pore_pressure_ratio", getattr(self, name), key=f"pore_pressure: ratio: {name}", error=ReleaseError)
        if self.ratio is not None:
            ratios = np.broadcast_to(np.asarray(self.ratio, np.float64), (self.count,)) if np.ndim(self.ratio) == 0 else self.ratio
            if np.shape(ratios) != (self.count,):
                raise ReleaseError(
                    f"pore_pressure: ratio: there are {np.size(ratios)} ratios for {self.count} zones; give one for each"
                )
            for ratio in np.asarray(ratios).tolist():
                checked("pore_pressure_ratio", ratio, key="pore_pressure: ratio: ratio", error=ReleaseError)

    @classmethod
    def from_vector(
        cls, path: str | PathLike[str], terrain: Terrain, ratio: float | str | None = None, **choices: Any
    ) -> "RatioZones":
        """Zones of the polygons of a vector file; a cell of the terrain belongs to the zone that covers half of it or more.

        ``ratio`` [1] is that of all zones, or the name of the attribute that holds it; ``choices`` are ``low``, ``high``,
        ``elsewhere`` and ``layer``.

        Raises
        ------
        InputError
            With the place, the value and the remedy.
        """
        zones: RatioZones = reader("RatioZones.from_vector")(path, terrain, ratio, **choices)
        return zones

    @property
    def count(self) -> int:
        """Number of zones."""
        return int(self.zone.max()) + 1

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest ratio [1] that is stated or may be drawn."""
        ratios = [self.low, self.high, self.elsewhere] if self.ratio is None else [*np.ravel(self.ratio).tolist(), self.elsewhere]
        known = [ratio for ratio in ratios if ratio is not None]
        return min(known), max(known)

    def of_zones(self, seed: Sequence[int]) -> np.ndarray:
        """Ratio (zones,) [1] of each zone; ``seed`` of the draw."""
        if self.ratio is not None:
            return np.broadcast_to(np.asarray(self.ratio, np.float64), (self.count,))
        assert self.low is not None
        assert self.high is not None
        drawn = [np.random.default_rng([*seed, STREAM, number]).random() for number in range(self.count)]
        return self.low + (self.high - self.low) * np.array(drawn)

    def on_cells(self, seed: Sequence[int]) -> np.ndarray:
        """Ratios (rows, columns) [1] on the cells of the terrain; NaN where there is neither a zone nor a ratio elsewhere."""
        beyond = np.nan if self.elsewhere is None else self.elsewhere
        return np.append(self.of_zones(seed), beyond)[self.zone]


def zone_conflicts(block: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between ratio, low and high in a block of zones: key, what is wrong, remedy."""
    ends = [name for name in ("low", "high") if name in block]
    if "ratio" in block and ends:
        yield ends[0], "ratio is given too", "give ratio, or low and high, which each member draws for each zone"
    elif "ratio" not in block and len(ends) < 2:
        said = "neither ratio nor low and high are given" if not ends else f"{ends[0]} is given alone"
        yield "", said, "give ratio, or low and high, which each member draws for each zone"
    else:
        yield from end_conflicts(block)


def end_conflicts(block: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflict between low and high, which may still be of a wrong type: key, what is wrong, remedy."""
    low, high = block.get("low"), block.get("high")
    if isinstance(low, int | float) and isinstance(high, int | float) and low > high:
        yield "low", f"low ({low:g}) is above high ({high:g})", "exchange them"


@dataclass(frozen=True, kw_only=True, eq=False)
class PorePressure:
    """Pore pressure of a mass: the share of the total normal stress that water carries at the start, and how it drains.

    It relaxes to the hydrostatic ratio, saturation times the density of water over that of the mass. Friction at the ground and
    strength of the material act on the rest of the stress.

    Parameters
    ----------
    ratio : float, ndarray (rows, columns), mapping or RatioZones
        Pore pressure over total normal stress at the start [1], 0 to 0.97: one number; numbers on the cells of the terrain, the
        north-west corner first; ``{"low": ..., "high": ..., "block": ...}`` for random numbers by blocks of that size [m]; or
        zones, each with its ratio.
    saturation : float
        Share of the thickness that stands in water [1], 0 to 1.
    diffusivity : float, optional
        Of pore pressure [m2/s], above 0: it drains through the thickness of the flow, faster where this is thin (Terzaghi).
    decay_time : float, optional
        Instead: time [s], above 0, in which the excess falls to 1/e everywhere.
    changes : tuple of str
        Assumptions of the reader of the ratios, one sentence each.

    Raises
    ------
    ReleaseError
        If a number is out of its range, or not exactly one of ``diffusivity`` and ``decay_time`` is given.
    """

    ratio: Any
    saturation: float = 0.0
    diffusivity: float | None = None
    decay_time: float | None = None
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.diffusivity is None) == (self.decay_time is None):
            said = (
                "neither diffusivity nor decay_time is given"
                if self.diffusivity is None
                else "diffusivity and decay_time are both given"
            )
            raise ReleaseError(f"pore_pressure: {said}; give one of them")
        for name in ("saturation", "diffusivity", "decay_time"):
            if getattr(self, name) is not None:
                checked(name, getattr(self, name), key=f"pore_pressure: {name}", error=ReleaseError)
        object.__setattr__(self, "ratio", _checked_ratio(self.ratio))

    @property
    def highest(self) -> float:
        """Largest ratio at the start [1] that is stated; with random ratios the largest that may be drawn."""
        if isinstance(self.ratio, RatioZones):
            return self.ratio.ends[1]
        return self.ratio.high if isinstance(self.ratio, RatioBlocks) else float(np.nanmax(self.ratio))

    @property
    def lowest(self) -> float:
        """Smallest ratio likewise [1]."""
        if isinstance(self.ratio, RatioZones):
            return self.ratio.ends[0]
        return self.ratio.low if isinstance(self.ratio, RatioBlocks) else float(np.nanmin(self.ratio))

    def equilibrium(self, density: float) -> float:
        """Ratio [1] to which that of a mass with a ``density`` [kg/m3] relaxes."""
        return float(formulas.equilibrium_ratio(self.saturation, density))

    def record(self, density: float) -> tuple[float, ...]:
        """The numbers of :data:`FIELDS` for a mass with a ``density`` [kg/m3]."""
        if self.decay_time is not None:
            return self.equilibrium(density), 1.0, 1.0 / self.decay_time, 0.0
        assert self.diffusivity is not None
        return self.equilibrium(density), FIRST_TERM, 0.0, float(formulas.diffusion_rate(self.diffusivity))

    def require_fits(self, thickness: np.ndarray, density: float, what: str) -> None:
        """Nothing, if the ratios of a release with a ``thickness`` (rows, columns) [m] are known and those of a mass that stands.

        Raises
        ------
        ReleaseError
            If a raster has another shape or no number where mass is released, or the hydrostatic ratio is above 0.97.
        """
        rest = self.equilibrium(density)
        if rest > formulas.LARGEST_RATIO:
            raise ReleaseError(
                f"{what}: pore_pressure: saturation is {self.saturation:g} and the density {density:g} kg/m3: water carries "
                f"{rest:.3g} of the weight, at most {formulas.LARGEST_RATIO:g} can be computed; lower saturation, or raise density"
            )
        self.require_known(thickness, what)

    def require_known(self, thickness: np.ndarray, what: str) -> None:
        """Nothing, if the ratios are known where a release with a ``thickness`` (rows, columns) [m] has mass.

        Raises
        ------
        ReleaseError
            If a raster or zones have another shape, or no number where mass is released.
        """
        zoned = isinstance(self.ratio, RatioZones)
        cells = self.ratio.on_cells((0,)) if zoned else self.ratio
        if not isinstance(cells, np.ndarray):
            return
        if cells.shape != thickness.shape:
            raise ReleaseError(
                f"{what}: pore_pressure: ratio has shape {cells.shape}, the terrain {thickness.shape}; give it on its cells"
            )
        missing = np.argwhere((thickness > 0) & np.isnan(cells))
        if len(missing):
            row, column = missing[0]
            fix = "give elsewhere, the ratio beyond all zones, or extend the polygons" if zoned else "fill the raster there"
            raise ReleaseError(
                f"{what}: pore_pressure: ratio has no value at row {row}, column {column}, {len(missing)} cells of the release in "
                f"all; {fix}"
            )

    def doubt(self, density: float, what: str) -> str:
        """Sentence on a ratio below the one to which that of a mass with a ``density`` [kg/m3] relaxes; empty if there is none."""
        rest = self.equilibrium(density)
        if self.lowest >= rest * (1.0 - 1e-9):
            return ""
        return (
            f"{what}: pore_pressure: ratio is {self.lowest:.3g}, below the hydrostatic {rest:.3g} of saturation "
            f"{self.saturation:g} and {density:g} kg/m3: the pressure rises while the mass flows; state a higher ratio, or a lower "
            "saturation"
        )

    def at(self, x: np.ndarray, y: np.ndarray, cell_size: tuple[float, float], seed: Sequence[int]) -> np.ndarray:
        """Ratios (n,) [1] at local positions (n,) [m]; ``cell_size`` [m] of the terrain, ``seed`` of the draw."""
        if isinstance(self.ratio, RatioBlocks):
            return self.ratio.at(x, y, seed)
        ratio = self.ratio.on_cells(seed) if isinstance(self.ratio, RatioZones) else self.ratio
        if not isinstance(ratio, np.ndarray):
            return np.full(len(x), float(ratio))
        rows, columns = ratio.shape
        column = np.clip(np.floor(x / cell_size[0]).astype(np.int64), 0, columns - 1)
        row = np.clip(rows - 1 - np.floor(y / cell_size[1]).astype(np.int64), 0, rows - 1)
        own_ratio = ratio[row, column]
        return np.where(np.isnan(own_ratio), np.nanmean(ratio), own_ratio)  # a particle that the jitter moved off the release

    def content(self) -> list[np.ndarray]:
        """All that particles depend on, as arrays."""
        numbers = np.array([self.saturation, self.diffusivity or 0.0, self.decay_time or 0.0])
        if isinstance(self.ratio, RatioZones):
            ends = [np.nan if end is None else end for end in (self.ratio.low, self.ratio.high, self.ratio.elsewhere)]
            zone_ratios = np.nan if self.ratio.ratio is None else self.ratio.ratio
            return [self.ratio.zone, np.asarray(zone_ratios, np.float64), np.array(ends), numbers]
        ratio = [self.ratio.low, self.ratio.high, self.ratio.block] if isinstance(self.ratio, RatioBlocks) else self.ratio
        return [np.asarray(ratio, np.float64), numbers]


def unused(pore: PorePressure, thickness: np.ndarray, terrain: Terrain) -> Iterator[str]:
    """What is stated of the pore pressure of a mass with a ``thickness`` (rows, columns) [m], and cannot act.

    Zones that hold none of it, blocks larger than it, and a pressure that is gone before gravity moves it by its thickness.
    """
    from runout.model.scene import STANDARD_GRAVITY  # that imports this module

    covered = thickness > 0.0
    if isinstance(pore.ratio, RatioZones) and not (covered & (pore.ratio.zone >= 0)).any():
        yield f"no zone of the ratio lies on this mass; all of it has elsewhere, {pore.ratio.elsewhere:g}"
    if isinstance(pore.ratio, RatioBlocks) and covered.any():
        sides = [np.ptp(np.nonzero(covered)[axis]) + 1 for axis in (0, 1)]
        extent = max(side * size for side, size in zip(sides, terrain.cell_size[::-1], strict=True))
        if pore.ratio.block >= extent:
            yield (
                f"ratio: block is {pore.ratio.block:g} m, the mass {extent:.4g} m: one or few ratios are "
                "drawn for all of it; state smaller blocks"
            )
    deepest = float(thickness.max(initial=0.0))
    drained = pore.decay_time if pore.decay_time is not None else deepest**2 / (pore.diffusivity or math.inf)
    falling = math.sqrt(2.0 * deepest / STANDARD_GRAVITY)
    if 0.0 < drained < 0.1 * falling:
        key = "decay_time" if pore.decay_time is not None else "diffusivity"
        yield (
            f"{key} drains the mass within {drained:.2g} s, before it moves (a fall by its thickness of "
            f"{deepest:.3g} m takes {falling:.2g} s); the ratio has no effect; check the unit"
        )


def _checked_ratio(ratio: Any) -> Any:
    """A ratio as a number, an array with NaN where it is not known, or blocks; ReleaseError if it is out of range."""
    if isinstance(ratio, RatioBlocks | RatioZones):
        return ratio
    if isinstance(ratio, Mapping):
        if set(ratio) != set(BLOCKS):
            raise ReleaseError(f"pore_pressure: ratio has {', '.join(map(str, ratio)) or 'no keys'}; give {', '.join(BLOCKS)}")
        return RatioBlocks(**ratio)
    if np.ndim(ratio) == 0:
        return checked("pore_pressure_ratio", ratio, key="pore_pressure: ratio", error=ReleaseError)
    values = real_array(ratio, "pore_pressure: ratio", ReleaseError)
    wrong = np.argwhere((values < 0.0) | (values > formulas.LARGEST_RATIO))
    if values.ndim != 2 or np.isnan(values).all():
        raise ReleaseError(
            f"pore_pressure: ratio has shape {values.shape}; give numbers on the cells of the terrain (rows, columns)"
        )
    if len(wrong):
        row, column = wrong[0]
        said = f"pore_pressure: ratio is {values[row, column]:g} at row {row}, column {column}, {len(wrong)} cells in all"
        raise ReleaseError(f"{said}; it must be at least 0 and at most {formulas.LARGEST_RATIO:g}")
    values.setflags(write=False)
    return values


def pore_table(pore_pressure: Sequence[PorePressure | None], densities: np.ndarray, real: Any = np.float64) -> np.ndarray:
    """Structured array (releases,) of the records; a mass without pore pressure has zeros."""
    rows = [p.record(d) if p else (0.0, 0.0, 0.0, 0.0) for p, d in zip(pore_pressure, densities.tolist(), strict=True)]
    return np.array(rows, [(name, real) for name in FIELDS])


def doubts(pore_pressure: Sequence[PorePressure | None], densities: np.ndarray, names: Sequence[str]) -> list[str]:
    """:meth:`PorePressure.doubt` of releases by their ``names``, where there is one."""
    said = [p.doubt(d, name) for p, d, name in zip(pore_pressure, densities.tolist(), names, strict=True) if p]
    return [sentence for sentence in said if sentence]
