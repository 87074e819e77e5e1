"""Friction of the ground on the releases of a scene, as contact reads it: a table of records, and which of them counts where."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction import FrictionZones
from runout.model.friction_laws import FrictionLaw, numbers_of
from runout.physics.contact import zone_friction

MOST_ROWS = 2**24  # of the table: single precision counts them exactly


class GroundFriction:
    """Friction of some masses on each kind of ground.

    Parameters
    ----------
    frictions : sequence of BasalFriction or float
        Of each mass; a number is a Coulomb coefficient [1].
    masses : sequence of MassAbove
    zones : FrictionZones or None
    effective : sequence of float, optional
        Share of the normal stress that the grains of each mass carry [1], for forecasts (:mod:`runout.model.column_resistance`);
        all of it by default. Records and :meth:`at_rest` do not contain it: contact has that of each particle.

    Attributes
    ----------
    law : FrictionLaw
        That all masses follow.
    numbers : ndarray (releases, numbers)
        Of the law, outside all zones.
    kinds : int
        Kinds of ground; row ``release * kinds + kind`` of the :meth:`table` belongs to a release on one of them.
    kind : ndarray (nx, ny) of int32, or None
        Kind of ground of each cell of the raster; None where there are no zones.
    """

    def __init__(
        self, frictions: Sequence[BasalFriction | float], masses: Sequence[MassAbove], zones: FrictionZones | None,
        effective: Sequence[float] | None = None,
    ):  # fmt: skip
        found = [numbers_of(friction) for friction in frictions]
        if len({law.name for law, _ in found}) != 1:
            raise ConfigError("basal friction of all releases of a run must follow one law; give every release the same kind")
        self.law: FrictionLaw = found[0][0]
        self.numbers = np.array([numbers for _, numbers in found])
        self.masses, self.kinds = np.array(masses, np.float64).reshape(-1, len(MassAbove._fields)), 1
        self.effective = np.ones(len(found)) if effective is None else np.array(effective, np.float64)
        self.kind: np.ndarray | None = None
        self._factor, self._own = np.ones((1, len(self.law.numbers))), np.zeros((1, len(self.law.numbers)))
        if zones:
            self._take_zones(zones)

    def _take_zones(self, zones: FrictionZones) -> None:
        said = f"friction law {self.law.name} has {', '.join(self.law.numbers)}"
        if len(self.law.numbers) > 1 and zones.coefficient.any():
            raise ConfigError(f"{zones.source}: a zone states a friction angle, and {said}; state its parameters, or a factor")
        unknown = [name for name in zones.replaced if name not in self.law.numbers]
        if unknown:
            raise ConfigError(f"{zones.source}: a zone replaces {unknown[0]}, and {said}; state parameters of that law")
        found = zones.kinds(self.law)
        self.kind, self.kinds, self._size = found.kind, len(found.own), zones.cell_size
        self._factor, self._own = found.factor, found.own
        rows = self.kinds * len(self.numbers)
        if rows > MOST_ROWS:
            raise ConfigError(f"{zones.source}: {rows} different values, at most {MOST_ROWS} fit; round the values of the rasters")

    @property
    def size(self) -> np.ndarray:
        """Size of the cells of :attr:`kind`, east and north [m]."""
        return np.array(self._size)

    @cached_property
    def alike(self) -> bool:
        """Whether all releases have the same friction on each kind of ground."""
        by_release = self.table().reshape(-1, self.kinds)
        return bool((by_release == by_release[:1]).all())

    @property
    def mixed(self) -> int:
        """How many releases differ in friction: 1 if all are alike, else all of them."""
        return 1 if self.alike else len(self.numbers)

    def table(self, real: Any = np.float64, arithmetic: Any = None) -> np.ndarray:
        """Structured array (releases times kinds,) of the records that contact reads.

        Parameters
        ----------
        real : type
            NumPy type of the numbers.
        arithmetic : type, optional
            In which numbers of zones are formed before they are rounded to ``real``; that type itself by default. A wider one
            stands for fused operations.
        """
        return self.records(np.arange(len(self.numbers) * self.kinds), real, arithmetic)

    def records(self, rows: np.ndarray, real: Any = np.float64, arithmetic: Any = None) -> np.ndarray:
        """Records of some ``rows`` (n,) of the :meth:`table`, structured array (n,)."""
        release, kind = np.divmod(rows, self.kinds)
        numbers, factor, own = (
            a.astype(real).astype(arithmetic or real) for a in (self.numbers[release], self._factor[kind], self._own[kind])
        )
        changed = zone_friction(numbers, factor, own).astype(real)
        mass = MassAbove(*self.masses[release].astype(real).T)
        record = self.law.friction.acting(dict(zip(self.law.numbers, changed.T, strict=True)), mass)
        table = np.zeros(len(changed), [(name, real) for name in self.law.fields])
        for name in self.law.fields:
            table[name] = record[name]
        return table

    def rows(self, release: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Rows (n,) of the table of masses of a ``release`` (n,) at local positions (n,) [m]; beyond the rim those of the rim."""
        if self.kind is None:
            return np.asarray(release, np.int64)
        i, j = (
            np.clip(np.floor(place / size).astype(np.int64), 0, count - 1)
            for place, size, count in zip((x, y), self.size, self.kind.shape, strict=True)
        )
        return np.asarray(release, np.int64) * self.kinds + self.kind[i, j]

    def at_rest(self) -> np.ndarray:
        """Coefficients at rest (releases times kinds,) [1], at most what each mass passes on."""
        name = self.law.numbers.index(self.law.friction.coefficients[0])
        ground = zone_friction(self.numbers[:, None, name], self._factor[:, name], self._own[:, name])
        return np.minimum(ground, self.masses[:, :1]).ravel()
