"""Pore pressure of a released mass: ratio at the start, the one that stays, how it drains (:mod:`runout.physics.pore_pressure`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.arrays import real_array
from runout.model.limits import checked
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
class PorePressure:
    """Pore pressure of a mass: the share of the total normal stress that water carries at the start, and how it drains.

    It relaxes to the hydrostatic ratio, saturation times the density of water over that of the mass. Friction at the ground and
    strength of the material act on the rest of the stress.

    Parameters
    ----------
    ratio : float, ndarray (rows, columns) or mapping
        Pore pressure over total normal stress at the start [1], 0 to 0.97: one number; numbers on the cells of the terrain, the
        north-west corner first; or ``{"low": ..., "high": ..., "block": ...}`` for random numbers by blocks of that size [m].
    saturation : float
        Share of the thickness that stands in water [1], 0 to 1.
    diffusivity : float, optional
        Of pore pressure [m2/s], above 0: it drains through the thickness of the flow, faster where this is thin (Terzaghi).
    decay_time : float, optional
        Instead: time [s], above 0, in which the excess falls to 1/e everywhere.

    Raises
    ------
    ReleaseError
        If a number is out of its range, or not exactly one of ``diffusivity`` and ``decay_time`` is given.
    """

    ratio: Any
    saturation: float = 0.0
    diffusivity: float | None = None
    decay_time: float | None = None

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
        return self.ratio.high if isinstance(self.ratio, RatioBlocks) else float(np.nanmax(self.ratio))

    @property
    def lowest(self) -> float:
        """Smallest ratio likewise [1]."""
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
        if not isinstance(self.ratio, np.ndarray):
            return
        if self.ratio.shape != thickness.shape:
            raise ReleaseError(
                f"{what}: pore_pressure: ratio has shape {self.ratio.shape}, the terrain {thickness.shape}; give it on its cells"
            )
        missing = np.argwhere((thickness > 0) & np.isnan(self.ratio))
        if len(missing):
            row, column = missing[0]
            raise ReleaseError(
                f"{what}: pore_pressure: ratio has no value at row {row}, column {column}, {len(missing)} cells of the release in "
                "all; fill the raster there"
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
        if not isinstance(self.ratio, np.ndarray):
            return np.full(len(x), float(self.ratio))
        rows, columns = self.ratio.shape
        column = np.clip(np.floor(x / cell_size[0]).astype(np.int64), 0, columns - 1)
        row = np.clip(rows - 1 - np.floor(y / cell_size[1]).astype(np.int64), 0, rows - 1)
        found = self.ratio[row, column]
        return np.where(np.isnan(found), np.nanmean(self.ratio), found)  # a particle that the jitter moved off the release

    def content(self) -> list[np.ndarray]:
        """All that particles depend on, as arrays."""
        ratio = [self.ratio.low, self.ratio.high, self.ratio.block] if isinstance(self.ratio, RatioBlocks) else self.ratio
        numbers = [self.saturation, self.diffusivity or 0.0, self.decay_time or 0.0]
        return [np.asarray(ratio, np.float64), np.array(numbers)]


def _checked_ratio(ratio: Any) -> Any:
    """A ratio as a number, an array with NaN where it is not known, or blocks; ReleaseError if it is out of range."""
    if isinstance(ratio, RatioBlocks):
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
    said = [p.doubt(d, f"release {name}") for p, d, name in zip(pore_pressure, densities.tolist(), names, strict=True) if p]
    return [sentence for sentence in said if sentence]
