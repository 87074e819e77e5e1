"""Zones of the ground that change the basal friction: forest, bedrock, snow, a channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FrictionLaw, numbers_of
from runout.model.limits import checked_coefficient
from runout.model.readers import reader
from runout.model.terrain import Terrain
from runout.physics.contact import zone_friction


@dataclass(frozen=True)
class FrictionZones:
    """How the ground changes the basal friction coefficient of the mass above it, on the cells of the elevation raster.

    In a cell it is ``factor`` times the coefficient of the release plus ``coefficient``: a zone that replaces friction has the
    factor 0. On cells that its border cuts both are means by area. A factor multiplies all friction coefficients of a law; other
    numbers of a law are ``replaced`` by name.

    Parameters
    ----------
    factor : ndarray (nx, ny)
        [1], first index east, second north, from the south-west corner; 1 outside all zones.
    coefficient : ndarray (nx, ny)
        [1]; 0 outside all zones.
    cell_size : tuple of float
        Size of the cells east and north [m].
    zones : tuple of dict
        What the zones are, for maps and tables: ``geometry`` (shapely, map coordinates), and ``factor`` [1] or ``coefficient`` [1].
    source : str
        Where they come from.
    changes : tuple of str
        What was changed on the way in, one sentence each.
    replaced : dict of str to pair of ndarray (nx, ny)
        For each number of a law of friction (:meth:`BasalFriction.numbers`) that zones replace, the part [1] that is left of that
        of the mass, and what zones add.
    gridded : dict of str to pair of ndarray (nx, ny)
        The same for numbers that rasters state; zones change these in place of those of the mass.
    warnings : tuple of str
        Those of the ``changes`` that ask whether a value is meant.
    """

    factor: np.ndarray
    coefficient: np.ndarray
    cell_size: tuple[float, float]
    zones: tuple[dict[str, Any], ...] = ()
    source: str = ""
    changes: tuple[str, ...] = ()
    replaced: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    gridded: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    _kinds: dict[str, Kinds] = field(default_factory=dict, init=False, repr=False, compare=False)  # by laws, once asked for

    def __post_init__(self) -> None:
        if self.factor.ndim != 2 or self.factor.shape != self.coefficient.shape:
            raise ConfigError(f"factor is {self.factor.shape} and coefficient {self.coefficient.shape}; both must be (nx, ny)")
        for name, values in (("factor", self.factor), ("coefficient", self.coefficient)):
            wrong = values[~(np.isfinite(values) & (values >= 0))]
            if len(wrong):
                raise ConfigError(f"{name} of a friction zone is {wrong[0]:g}; it must be a number of 0 or more")
        checked_coefficient(float(self.coefficient.max(initial=0.0)), "coefficient of a friction zone", error=ConfigError)

    @classmethod
    def from_vector(
        cls,
        path: str | PathLike[str],
        terrain: Terrain,
        factor: float | str | None = None,
        basal_friction_angle_deg: float | str | None = None,
        layer: str | None = None,
        *,
        basal_friction: Mapping[str, float | str] | None = None,
        law: str | None = None,
    ) -> FrictionZones:
        """Zones of the polygons of a GeoPackage, Shapefile or GeoJSON.

        Either ``factor`` [1] multiplies the friction of the mass in all of them, or ``basal_friction_angle_deg`` [deg] replaces
        it, or ``basal_friction`` replaces parameters of the friction ``law``, by their keys in site.yaml. Each value is a number or
        the name of an attribute. ``layer`` is needed if the file has several.

        Raises
        ------
        ZoneError
            With the place, the value and the remedy.
        """
        replaced = {"basal_friction_angle_deg": basal_friction_angle_deg, "basal_friction": basal_friction}
        zones: FrictionZones = reader("FrictionZones.from_vector")(path, terrain, factor=factor, layer=layer, law=law, **replaced)
        return zones

    @classmethod
    def from_rasters(cls, paths: Mapping[str, str | PathLike[str]], terrain: Terrain, *, law: str | None = None) -> FrictionZones:
        """Parameters of a friction ``law`` from rasters, by their keys in site.yaml: ``{"xi": "xi.tif"}``.

        A cell of the terrain takes the value of the raster cell that holds its centre; where there is none, the parameter of the
        mass stays.

        Raises
        ------
        ZoneError
            With the place, the value and the remedy.
        """
        zones: FrictionZones = reader("FrictionZones.from_rasters")(paths, terrain, law=law)
        return zones

    def statement(self) -> str:
        """One sentence on what the zones are."""
        if not self.zones:
            return f"friction from rasters: {self.source}"
        area = sum(zone["geometry"].area for zone in self.zones)
        factors = sorted(zone["factor"] for zone in self.zones if "factor" in zone)
        angles = sorted(math.degrees(math.atan(zone["coefficient"])) for zone in self.zones if "coefficient" in zone)
        own = [(key, value) for zone in self.zones for key, value in zone.get("parameters", {}).items()]
        parts = [f"friction times {factors[0]:.3g} to {factors[-1]:.3g}"] if factors else []
        parts += [f"friction angle {angles[0]:.3g} to {angles[-1]:.3g} deg"] if angles else []
        for name in dict.fromkeys(key for key, _ in own):
            values = [value for key, value in own if key == name]
            parts.append(f"{name} {min(values):.3g} to {max(values):.3g}")
        return f"friction zones: {len(self.zones)} on {area:.4g} m2; {', '.join(parts)}"

    def at(self, friction: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Coefficients [1] of masses with ``friction`` [1] at local positions x, y [m]; beyond the rim those of the rim."""
        i, j = (
            np.clip(np.floor(place / size).astype(np.int64), 0, count - 1)
            for place, size, count in zip((x, y), self.cell_size, self.factor.shape, strict=True)
        )
        return zone_friction(friction, self.factor[i, j], self.coefficient[i, j])  # type: ignore[no-any-return]

    def changes_of(self, law: FrictionLaw, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Factor and own value (nx, ny) of a number of a law in each cell."""
        is_coefficient = name in law.friction.coefficients
        factor, own = (self.factor, self.coefficient) if is_coefficient else (np.ones_like(self.factor), np.zeros_like(self.factor))
        if name in self.replaced:
            share, value = self.replaced[name]
            factor, own = np.maximum(factor + (share - 1.0), 0.0), own + value
        if name in self.gridded:
            share, value = self.gridded[name]
            factor, own = factor * share, factor * value + own
        return factor, own

    def kinds(self, *laws: FrictionLaw) -> Kinds:
        """The kinds of ground that there are for laws of friction; numbers of several laws are one behind the other."""
        key = " ".join(law.name for law in laws)
        if key not in self._kinds:
            self._kinds[key] = Kinds.of([self.changes_of(law, name) for law in laws for name in law.numbers])
        return self._kinds[key]

    def coefficients(self, friction: BasalFriction | float) -> np.ndarray:
        """Friction coefficients (kinds, n) [1], those at rest first, of a mass on cells of every kind there is."""
        law, numbers = numbers_of(friction)
        kinds = self.kinds(law)
        values = zone_friction(np.array(numbers), kinds.factor, kinds.own)[kinds.first :]
        return values[:, [law.numbers.index(name) for name in law.friction.coefficients]]  # type: ignore[no-any-return]

    def least_angle(self, friction: BasalFriction | float) -> float:
        """Smallest friction angle [rad] on any cell of a mass with a friction, or with a friction angle [rad]."""
        return math.atan(self.coefficients(math.tan(friction) if isinstance(friction, float) else friction).min())


@dataclass(frozen=True)
class Kinds:
    """Kinds of ground: cells in which a zone changes the numbers of a law alike."""

    kind: np.ndarray  # (nx, ny) of int32: of each cell; 0 outside all zones
    # factor, own: (kinds, numbers): what multiplies each number of a law, and what is added then
    factor: np.ndarray
    own: np.ndarray

    @classmethod
    def of(cls, changes: Sequence[tuple[np.ndarray, np.ndarray]]) -> Kinds:
        """The kinds of cells with the factors and own values (nx, ny) of each number."""
        inside = np.logical_or.reduce([(factor != 1.0) | (own != 0.0) for factor, own in changes])
        columns = np.array([pair[k][inside] for k in range(2) for pair in changes]).reshape(2 * len(changes), -1)
        code = np.zeros(columns.shape[1], np.int64)
        for column in columns:
            _, number = np.unique(column, return_inverse=True)
            _, code = np.unique(code * (number.max(initial=0) + 1) + number, return_inverse=True)
        _, first = np.unique(code, return_index=True)
        kind = np.zeros(inside.shape, np.int32)
        kind[inside] = 1 + code
        factor, own = columns[:, first].T.reshape(-1, 2, len(changes)).transpose(1, 0, 2)
        return cls(kind, np.vstack([np.ones(len(changes)), factor]), np.vstack([np.zeros(len(changes)), own]))

    @property
    def first(self) -> int:
        """Number of the first kind that a cell has."""
        return int(self.kind.min())
