"""What the ground sets against a column of mass that slides over it: the resistance of a friction law, without a grid."""

import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction import FrictionZones
from runout.model.ground_friction import GroundFriction
from runout.model.materials import Material
from runout.model.scene import STANDARD_GRAVITY


class Columns(NamedTuple):
    """Columns of mass that slide."""

    # member, release: (n,): that they belong to
    member: np.ndarray
    release: np.ndarray
    # x, y: (n,): local positions [m]
    x: np.ndarray
    y: np.ndarray
    cosine: np.ndarray  # (n,): of the slope below [1]
    speed: np.ndarray  # (n,) [m/s]
    thinness: np.ndarray  # (n,): their thickness over that at the start [1], at most 1


# steady deceleration (n,) [m/s2], and drag (n,) [1/m], the deceleration over the square of the speed
Resistance = Callable[[Columns], tuple[Any, Any]]
LOADS = 4  # cosines squared of the slope at which a law is evaluated, from 0 to 1
SPEEDS = 9  # slip speeds likewise, dense at rest


class ColumnResistance:
    """Deceleration of columns of mass by the law of friction below them.

    The law is evaluated at a few loads and speeds for each kind of ground that a column meets; values between these are linear.
    That is exact for a stress that is linear in the load and a drag with the square of the speed.

    Parameters
    ----------
    grounds : sequence of GroundFriction
        Of members; all follow one law.
    thickness : sequence of float
        Vertical thickness of the mass of each release [m].
    fastest : float
        Speed [m/s] up to which the law is evaluated; above, the resistance is that at this speed.
    """

    def __init__(self, grounds: Sequence[GroundFriction], thickness: Sequence[float], fastest: float) -> None:
        self.grounds, self.law, self.fastest = grounds, grounds[0].law, max(fastest, 1e-6)
        self._areal = [np.asarray(thickness) * ground.masses[:, 1] for ground in grounds]  # [kg/m2] in plan
        self._start = np.cumsum([0, *(len(ground.numbers) * ground.kinds for ground in grounds)])
        self._rows = np.empty(0, np.int64)  # of all members, that have values
        self._values = np.empty((0, 2, LOADS, SPEEDS))

    def __call__(self, columns: Columns) -> tuple[np.ndarray, np.ndarray]:
        """Steady deceleration and drag, see :data:`Resistance`."""
        rows = self._start[columns.member] + self.grounds[0].rows(columns.release, columns.x, columns.y)  # zones of all members
        self._evaluate(np.setdiff1d(rows, self._rows))
        load, a = _between(columns.thinness * columns.cosine**2 * (LOADS - 1), LOADS)
        slip, b = _between(np.cbrt(np.minimum(columns.speed / self.fastest, 1.0)) * (SPEEDS - 1), SPEEDS)
        grid, place, a, b = self._values, np.searchsorted(self._rows, rows), a[:, None], b[:, None]
        low, high = (grid[place, :, load, s] * (1.0 - a) + grid[place, :, load + 1, s] * a for s in (slip, slip + 1))
        by_ground = columns.thinness * columns.cosine  # mass by area of ground, over that by area in plan at the start
        steady, drag = ((low * (1.0 - b) + high * b) / by_ground[:, None]).T
        return steady, drag

    def _evaluate(self, rows: np.ndarray) -> None:
        """Add the values of sorted ``rows`` (n,)."""
        if not len(rows):
            return
        loads, speeds = np.linspace(0.0, 1.0, LOADS), self.fastest * np.linspace(0.0, 1.0, SPEEDS) ** 3
        members = np.searchsorted(self._start, rows, side="right") - 1
        values = []
        for member in np.unique(members).tolist():
            own = rows[members == member] - self._start[member]
            ground, release = self.grounds[member], own // self.grounds[member].kinds
            masses, shares = self._areal[member][release], ground.effective[release]
            for record, mass, share in zip(ground.records(own), masses.tolist(), shares.tolist(), strict=True):
                values.append(self._values_of(record, mass, share * loads, speeds))
        order = np.argsort(rows := np.concatenate([self._rows, rows]))
        self._rows, self._values = rows[order], np.concatenate([self._values, values])[order]

    def _values_of(self, record: np.void, mass: float, loads: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Stress [Pa] and drag [kg/m3] of the ground over the ``mass`` by area in plan [kg/m2], (2, loads, speeds).

        ``loads`` are the normal stresses that grains carry, over that weight by area in plan.
        """
        basal = SimpleNamespace(**dict(zip(self.law.fields, record.tolist(), strict=True)))
        area, resist = float(self.law.uses_area), self.law.limited
        resistances = [[resist(mass * STANDARD_GRAVITY * p, s, area, 1.0, basal) for s in speeds.tolist()] for p in loads.tolist()]
        return np.array(resistances).transpose(2, 0, 1) / mass


def ground_below(
    materials: Sequence[Material],
    frictions: Sequence[BasalFriction | float],
    strengths: Sequence[float],
    zones: FrictionZones | None,
    effective: Sequence[float] | None = None,
) -> GroundFriction:
    """Friction of the ground on releases, in standard gravity.

    Parameters
    ----------
    materials : sequence of Material
        One per release.
    frictions : sequence of BasalFriction or float
        Of each release; a number is a friction angle [rad].
    strengths : sequence of float
        Largest friction coefficient [1] that each mass passes on to the ground.
    zones : FrictionZones or None
    effective : sequence of float, optional
        Least share of the normal stress that the grains of each mass carry [1].
    """
    coefficients = [f if isinstance(f, BasalFriction) else math.tan(f) for f in frictions]
    masses = [MassAbove(s, m.density, STANDARD_GRAVITY) for s, m in zip(strengths, materials, strict=True)]
    return GroundFriction(coefficients, masses, zones, effective)


def resting_resistance(grounds: Sequence[GroundFriction]) -> Resistance:
    """Deceleration by the coefficients at rest of members, as :class:`ColumnResistance` but at any speed; without drag."""
    resting = np.array([ground.at_rest() * np.repeat(ground.effective, ground.kinds) for ground in grounds])

    def resistance(columns: Columns) -> tuple[np.ndarray, float]:
        rows = grounds[0].rows(columns.release, columns.x, columns.y)
        return STANDARD_GRAVITY * resting[columns.member, rows] * columns.cosine, 0.0

    return resistance


def _between(place: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Grid line below a place among ``count``, and the part of the interval above it."""
    low = np.minimum(place.astype(np.int64), count - 2)
    return low, place - low
