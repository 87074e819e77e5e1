"""Zones of the ground that change the basal friction: forest, bedrock, snow, a channel."""

import math
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError
from runout.model.terrain import Terrain
from runout.physics.contact import zone_friction


@dataclass(frozen=True)
class FrictionZones:
    """How the ground changes the basal friction coefficient of the mass above it, on the cells of the elevation raster.

    In a cell it is ``factor`` times the coefficient of the release plus ``coefficient``: a zone that replaces friction has the
    factor 0. On cells that its border cuts both are means by area.

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
    """

    factor: np.ndarray
    coefficient: np.ndarray
    cell_size: tuple[float, float]
    zones: tuple[dict[str, Any], ...] = ()
    source: str = ""
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.factor.ndim != 2 or self.factor.shape != self.coefficient.shape:
            raise ConfigError(f"factor is {self.factor.shape} and coefficient {self.coefficient.shape}; both must be (nx, ny)")
        for name, values in (("factor", self.factor), ("coefficient", self.coefficient)):
            wrong = values[~(np.isfinite(values) & (values >= 0))]
            if len(wrong):
                raise ConfigError(f"{name} of a friction zone is {wrong[0]:g}; it must be a number of 0 or more")

    @classmethod
    def from_vector(
        cls,
        path: str | PathLike[str],
        terrain: Terrain,
        factor: float | str | None = None,
        basal_friction_angle_deg: float | str | None = None,
        layer: str | None = None,
    ) -> "FrictionZones":
        """Zones of the polygons of a GeoPackage, Shapefile or GeoJSON.

        Either ``factor`` [1] multiplies the friction of the mass in all of them, or ``basal_friction_angle_deg`` [deg] replaces it;
        each is a number or the name of an attribute. ``layer`` is needed if the file has several.

        Raises
        ------
        ZoneError
            With the place, the value and the remedy.
        """
        from runout.terrain.zones import read_zones

        return read_zones(path, terrain, factor=factor, basal_friction_angle_deg=basal_friction_angle_deg, layer=layer)

    def statement(self) -> str:
        """One sentence on what the zones are."""
        area = sum(zone["geometry"].area for zone in self.zones)
        factors = sorted(zone["factor"] for zone in self.zones if "factor" in zone)
        angles = sorted(math.degrees(math.atan(zone["coefficient"])) for zone in self.zones if "coefficient" in zone)
        said = [f"friction times {factors[0]:.3g} to {factors[-1]:.3g}"] if factors else []
        said += [f"friction angle {angles[0]:.3g} to {angles[-1]:.3g} deg"] if angles else []
        return f"friction zones: {len(self.zones)} on {area:.4g} m2; {', '.join(said)}"

    def at(self, friction: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Coefficients [1] of masses with ``friction`` [1] at local positions x, y [m]; beyond the rim those of the rim."""
        i, j = (
            np.clip(np.floor(place / size).astype(np.int64), 0, count - 1)
            for place, size, count in zip((x, y), self.cell_size, self.factor.shape, strict=True)
        )
        return zone_friction(friction, self.factor[i, j], self.coefficient[i, j])  # type: ignore[no-any-return]

    def least_angle(self, angle: float) -> float:
        """Smallest friction angle [rad] on any cell of a mass with ``angle`` [rad]."""
        return math.atan(self.at_cells(math.tan(angle)).min())

    def at_cells(self, friction: float) -> np.ndarray:
        """Coefficients (n,) [1] of a mass with ``friction`` [1] on cells of every kind there is."""
        factor, own = self._kinds
        return zone_friction(friction, factor, own)  # type: ignore[no-any-return]

    @cached_property
    def _kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Distinct pairs of factor and own coefficient (n,) of the cells."""
        inside = (self.factor != 1.0) | (self.coefficient != 0.0)
        pairs = np.column_stack([self.factor[inside], self.coefficient[inside]])
        if not inside.all():
            pairs = np.concatenate([pairs, [[1.0, 0.0]]])
        kinds = np.unique(pairs, axis=0)
        return kinds[:, 0], kinds[:, 1]
