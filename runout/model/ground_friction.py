"""Friction of the ground on the releases of a scene, as contact reads it: a table of records, and which of them counts where."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction import FrictionZones
from runout.model.friction_laws import FrictionLaw, numbers_of
from runout.model.law_mixtures import NUMBER, friction_law
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
        That all masses follow, or the mixture of their laws (:mod:`runout.model.law_mixtures`).
    law_number : ndarray (releases,) of int
        Place of the law of each mass in ``law.laws``.
    numbers : ndarray (releases, numbers)
        Outside all zones; those of all laws one behind the other, 0 where they are not those of the law of a mass.
    kinds : int
        Kinds of ground; row ``release * kinds + kind`` of the :meth:`table` belongs to a release on one of them.
    kind : ndarray (nx, ny) of int32, or None
        Kind of ground of each cell of the raster; None where there are no zones.
    """

    def __init__(
        self, frictions: Sequence[BasalFriction | float], masses: Sequence[MassAbove], zones: FrictionZones | None,
        effective: Sequence[float] | None = None,
    ):  # fmt: skip
        laws_and_numbers = [numbers_of(friction) for friction in frictions]
        self.law: FrictionLaw = friction_law(law for law, _ in laws_and_numbers)
        self.law_number = np.array([self.law.laws.index(law) for law, _ in laws_and_numbers])
        ends = np.cumsum([len(law.numbers) for law in self.law.laws])
        self._columns = [slice(end - len(law.numbers), end) for law, end in zip(self.law.laws, ends, strict=True)]
        self.numbers = np.zeros((len(laws_and_numbers), len(self.law.numbers)))
        for row, number, (_, numbers) in zip(self.numbers, self.law_number, laws_and_numbers, strict=True):
            row[self._columns[number]] = numbers
        self.masses, self.kinds = np.array(masses, np.float64).reshape(-1, len(MassAbove._fields)), 1
        self.effective = np.ones(len(laws_and_numbers)) if effective is None else np.array(effective, np.float64)
        self.kind: np.ndarray | None = None
        self._factor, self._own = np.ones((1, len(self.law.numbers))), np.zeros((1, len(self.law.numbers)))
        if zones:
            self._take_zones(zones)

    def _take_zones(self, zones: FrictionZones) -> None:
        laws = {law: f"friction law {law.name} has {', '.join(law.numbers)}" for law in self.law.laws}
        several = [law for law in laws if len(law.numbers) > 1]
        if several and zones.coefficient.any():
            fault = f"a zone states a friction angle, and {laws[several[0]]}"
            raise ConfigError(f"{zones.source}: {fault}; state its parameters, or a factor")
        origins = dict.fromkeys(zones.gridded, "a raster states") | dict.fromkeys(zones.replaced, "a zone replaces")
        unknown = [name for name in origins if name not in self.law.numbers]
        if unknown:
            fault = f"{origins[unknown[0]]} {unknown[0]}, and {', and '.join(laws.values())}"
            raise ConfigError(f"{zones.source}: {fault}; state parameters of that law")
        kinds = zones.kinds(*self.law.laws)
        self.kind, self.kinds, self._size = kinds.kind, len(kinds.own), zones.cell_size
        self._factor, self._own = kinds.factor, kinds.own
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
    def limits_start(self) -> np.ndarray:
        """Whether contacts of each mass (releases,) start from the force of the step before up to a speed only.

        So where its law uses ground areas (:func:`runout.physics.contact.fastest_start`).
        """
        return np.array([law.uses_area for law in self.law.laws])[self.law_number]

    @property
    def mixed(self) -> int:
        """How many releases differ in friction: 1 if all are alike, else all of them."""
        return 1 if self.alike else len(self.numbers)

    def table(self, real: Any = np.float64, arithmetic: Any = None) -> np.ndarray:
        """Structured array (releases times kinds,) of the records that contact reads.

        ``real``: NumPy type of the numbers. ``arithmetic``: in which numbers of zones are formed before they are rounded to
        ``real``; that type itself by default. A wider one stands for fused operations.
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
        table = np.zeros(len(changed), [(name, real) for name in self.law.fields])
        for number, (law, columns) in enumerate(zip(self.law.laws, self._columns, strict=True)):
            own = self.law_number[release] == number
            numbers_of_law = dict(zip(law.numbers, changed[own, columns].T, strict=True))
            record = law.friction.acting(numbers_of_law, MassAbove(*(values[own] for values in mass)))
            for name in law.fields:
                table[name][own] = record[name]
        if NUMBER in self.law.fields:
            table[NUMBER] = self.law_number[release]
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
        first = [
            c.start + law.numbers.index(law.friction.coefficients[0]) for law, c in zip(self.law.laws, self._columns, strict=True)
        ]
        number = np.array(first)[self.law_number]
        factor, own = self._factor[:, number].T, self._own[:, number].T
        ground = zone_friction(self.numbers[np.arange(len(number)), number][:, None], factor, own)
        return np.minimum(ground, self.masses[:, :1]).ravel()
