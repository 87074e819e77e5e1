"""Scalars of an observed event and of a member that models it: area, run-out, boundary, volume, distance, values at gauges.

One function makes the scalars of both, so that they are defined alike. A scalar has a name such as ``outline.area``, whose first
part is the observation, and a standard error: 10 % of an area, 20 % of a volume, a cell of the grid for a length, and so on
(:data:`KINDS`).

The boundary of a modelled area has a mean distance from each part of the observed outline. The outline is cut into parts of equal
length, of which the first one has the front in its middle. A cell belongs to the part that its centre is nearest to. The distance
of a part is the area that the model reaches beyond the outline, less the area that it does not reach inside of it, over the length
of the part. It changes smoothly with the parameters, unlike the critical success index or the symmetric difference, which have a
kink where the areas agree. The sum of distance times length is the difference of the areas.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.calibration.sobol_indices import LEAST_Q2
from runout.errors import ConfigError
from runout.hazard.reach import Reach
from runout.scores.assessment import values_at_gauges
from runout.scores.elevation_change import detected
from runout.scores.flow import Flow
from runout.scores.observations import Observations

if TYPE_CHECKING:
    from runout.hazard.reach import Reach
    from runout.model.terrain import Terrain

PARTS = 8
FRONT = 0.95  # share of the largest distance from the release from which a point belongs to the front
STEPS = 64  # points along each part, from which the distances of cells are taken
Scalars = dict[str, float]


@dataclass(frozen=True)
class OutlineParts:
    """Parts of an observed outline on the cells of a grid."""

    nearest: np.ndarray  # (rows, columns) of int: part that each cell belongs to, from 0
    observed: np.ndarray  # (rows, columns): share of each cell inside the outline [1]
    length: float  # length of each part [m]
    cell_area: float  # [m2]

    @classmethod
    def of(cls, outline: Any, observed: np.ndarray, reach: "Reach") -> "OutlineParts":
        """Parts of an outline (Polygon or MultiPolygon in map coordinates); holes have no part of their own."""
        from scipy.spatial import KDTree

        points, length = _along(outline)
        front = _front(_distances(points, reach))
        part = ((np.arange(len(points)) - front + STEPS // 2) // STEPS) % PARTS
        easting, northing = np.meshgrid(reach.easting, reach.northing)
        nearest = KDTree(points).query(np.column_stack([easting.ravel(), northing.ravel()]))[1]
        return cls(part[nearest].reshape(easting.shape), np.nan_to_num(observed), length / PARTS, reach.cell_area)

    def distances(self, shares: np.ndarray) -> np.ndarray:
        """Mean distance (parts,) [m] of the boundary of reached shares (rows, columns) from the outline, positive beyond it."""
        difference = np.nan_to_num(shares) - self.observed
        areas = np.bincount(self.nearest.ravel(), difference.ravel(), PARTS) * self.cell_area
        return areas / self.length  # type: ignore[no-any-return]


def _along(outline: Any) -> tuple[np.ndarray, float]:
    """Equally spaced points (parts times steps, 2) along the exterior rings of an outline, and the length of the rings [m]."""
    import shapely
    from shapely.geometry.polygon import orient

    rings = [shapely.get_exterior_ring(orient(part)) for part in shapely.get_parts(outline).tolist()]
    ends = np.cumsum([ring.length for ring in rings])
    places = (np.arange(PARTS * STEPS) + 0.5) / (PARTS * STEPS) * ends[-1]
    of_ring = np.searchsorted(ends, places, side="right").clip(max=len(rings) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    points = [shapely.line_interpolate_point(rings[k], s - starts[k]) for k, s in zip(of_ring, places, strict=True)]
    return shapely.get_coordinates(points), float(ends[-1])


def _front(distances: np.ndarray) -> int:
    """Place among points (n,) along rings in the middle of those that are nearly as far from the release as the farthest one."""
    places = np.flatnonzero(distances >= FRONT * distances.max())
    turns = np.exp(2j * np.pi * places / len(distances))
    return round(float(np.angle(turns.mean())) / (2.0 * np.pi) * len(distances)) % len(distances)


def _distances(points: np.ndarray, reach: "Reach") -> np.ndarray:
    """Distance [m] from the release at points (n, 2): that of their cells; beyond the grid, of the cells at its edge."""
    columns = np.abs(points[:, :1] - reach.easting).argmin(axis=1)
    rows = np.abs(points[:, 1:] - reach.northing).argmin(axis=1)
    return reach.distance[rows, columns]  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Kind:
    """Unit and default standard error of a kind of scalar."""

    units: str  # UDUNITS unit
    relative: float  # standard error over the observed value [1]; 0 where it is a cell of the grid
    meaning: str
    least_q2: float = LEAST_Q2  # held-out Q2 of the emulator below which a scalar does not count [1]


KINDS = {
    "area": Kind("m2", 0.1, "area in which the flow or deposit reaches the smallest thickness threshold"),
    "runout": Kind("m", 0.0, "farthest place of that area along the thalweg; without a thalweg, its distance from the release"),
    "position": Kind("m", 0.0, "mean distance of the boundary of that area from a part of the outline, positive beyond it", 0.5),
    "volume": Kind("m3", 0.2, "volume of the deposit in the cells that the observation knows"),
    "distance": Kind("m", 0.0, "mean distance of the deposit from the release, or place along the thalweg, by volume"),
    "erosion": Kind("m3", 0.2, "volume by which the ground is lower"),
    "deposition": Kind("m3", 0.2, "volume by which the ground is higher"),
    "thickness": Kind("m", 0.3, "largest thickness at a gauge"),
    "speed": Kind("m s-1", 0.2, "largest speed at a gauge"),
    "arrival_rate": Kind("s-1", 0.1, "1 / arrival time at a gauge; 0 where the flow does not arrive"),
}


@dataclass(frozen=True)
class ObservedScalar:
    """An observed value with its standard error, both in the unit of its kind."""

    name: str
    value: float
    error: float

    @property
    def group(self) -> str:
        """The observation that it belongs to."""
        return self.name.partition(".")[0]

    @property
    def units(self) -> str:
        """UDUNITS unit."""
        return kind_of(self.name).units


def kind_of(name: str) -> Kind:
    """Kind of a scalar by its name."""
    return KINDS[name.split(".")[1]]


@dataclass(frozen=True)
class Measure:
    """Measures scalars on the cells of observations."""

    observed: Observations
    reach: Reach  # distance of the cells from the release
    threshold: float  # thickness [m] that bounds the area of a modelled flow or deposit
    # parts of the outline, whose distances take the place of its area: their sum is that of the area; None for the area
    parts: OutlineParts | None = None

    @classmethod
    def of(
        cls, observed: Observations, terrain: "Terrain", released: np.ndarray, threshold: float, boundary: bool = False
    ) -> "Measure":
        """The measure on a terrain with thickness ``released`` (rows, columns) [m]; ``boundary`` for parts of the outline."""
        reach = Reach.on(released > 0, terrain.easting, terrain.northing, terrain.elevation)
        has_parts = boundary and observed.outline is not None
        parts = OutlineParts.of(observed.outline, observed.shares, reach) if has_parts else None
        return cls(observed, reach, threshold, parts)

    def of_event(self) -> Scalars:
        """Scalars of the event."""
        scalars: Scalars = {}
        if self.observed.outline is not None:
            scalars |= self._area(self.observed.shares)
        if self.observed.deposit is not None:
            scalars |= self._deposit(self.observed.deposit)
        if self.observed.change is not None:
            scalars |= self._change(self.observed.change)
        if self.observed.gauges is not None:
            for name, values in self.observed.gauges.values.items():
                scalars |= dict(_at_gauges(name, values, values))
        return scalars

    def of_member(self, flow: Flow, change: np.ndarray) -> Scalars:
        """The same scalars of a member, from its maps and its change of elevation (rows, columns) [m]."""
        scalars: Scalars = {}
        if self.observed.outline is not None:
            quantity = "deposit" if self.observed.outline_shows == "deposit" else "thickness"
            scalars |= self._area(flow.area(quantity, self.threshold))
        if self.observed.deposit is not None:
            scalars |= self._deposit(np.where(np.isnan(self.observed.deposit), np.nan, flow.maps["deposit"]))
        if self.observed.change is not None:
            scalars |= self._change(np.where(np.isnan(self.observed.change), np.nan, change))
        if self.observed.gauges is not None:
            for name, values in values_at_gauges(flow, self.observed.gauges).items():
                scalars |= dict(_at_gauges(name, values, self.observed.gauges.values[name]))
        return scalars

    def _area(self, shares: np.ndarray) -> Scalars:
        """Run-out of reached shares (rows, columns) [1], and their area or their distances from the parts of the outline."""
        reached = np.nan_to_num(shares) >= 0.5
        thalweg = self.observed.thalweg
        if thalweg is None:
            runout = self.reach.runout(reached)[0]
        else:  # the release counts, so that a flow that stays has a place
            rows, columns = np.nonzero(reached | self.reach.released)
            runout = float(thalweg.coordinates(self.reach.easting[columns], self.reach.northing[rows])[0].max())
        if self.parts is None:
            return {"outline.area": float(np.nansum(shares)) * self.reach.cell_area, "outline.runout": runout}
        distances = self.parts.distances(shares)
        return {f"outline.position.{k}": float(distance) for k, distance in enumerate(distances, 1)} | {"outline.runout": runout}

    def _deposit(self, thickness: np.ndarray) -> Scalars:
        known = np.nan_to_num(thickness)
        return {"deposit.volume": float(known.sum()) * self.reach.cell_area, "deposit.distance": self._mean_distance(known)}

    def _change(self, change: np.ndarray) -> Scalars:
        moved = np.nan_to_num(detected(change, self.observed.detection_limit))
        raised, lowered = np.maximum(moved, 0.0), np.maximum(-moved, 0.0)
        return {
            "difference.erosion": float(lowered.sum()) * self.reach.cell_area,
            "difference.deposition": float(raised.sum()) * self.reach.cell_area,
            "difference.distance": self._mean_distance(raised),
        }

    def _mean_distance(self, thickness: np.ndarray) -> float:
        """Mean distance [m] of a thickness (rows, columns) from the release, or place along the thalweg; 0 without any."""
        rows, columns = np.nonzero(thickness > 0)
        if not rows.size:
            return 0.0
        thalweg, weights = self.observed.thalweg, thickness[rows, columns]
        distance = self.reach.distance[rows, columns]
        if thalweg is not None:
            distance = thalweg.coordinates(self.reach.easting[columns], self.reach.northing[rows])[0]
        return float(np.average(distance, weights=weights))


def _at_gauges(name: str, values: np.ndarray, observed: np.ndarray) -> Iterator[tuple[str, float]]:
    """Scalars of a quantity at the gauges (n,) at which it was observed; gauges count from 1.

    An arrival before a tenth of the observed time counts as that tenth: a gauge on the release would have an infinite rate.
    """
    for k in np.flatnonzero(np.isfinite(observed) & ~np.isnan(values)):
        if name != "arrival_time":
            yield f"gauges.{name}.{k + 1}", float(values[k])
        elif observed[k] > 0:
            yield f"gauges.arrival_rate.{k + 1}", 1.0 / max(float(values[k]), 0.1 * float(observed[k]))


def observed_scalars(values: Scalars, cell: float) -> list[ObservedScalar]:
    """Scalars of an event with their default standard errors; ``cell`` [m] is the largest spacing of grid and raster."""
    shares = {name: kind_of(name).relative for name in values}
    return [ObservedScalar(name, value, shares[name] * abs(value) if shares[name] else cell) for name, value in values.items()]


def with_errors(scalars: Sequence[ObservedScalar], errors: Sequence[str], without: Sequence[str]) -> list[ObservedScalar]:
    """Scalars with stated standard errors, less those that are left out.

    ``errors``: ``NAME=ERROR`` with a name or its first parts (``outline.area``, ``gauges.speed``, ``deposit``), and a standard
    error in percent of the observed value (``5%``) or in the unit of the scalar (``30``). ``without``: names, or their first
    parts, of scalars that do not count. Raises ConfigError if a name is not among the scalars, an error is no number above 0, or
    nothing is left.
    """
    by_name = {one.name: one for one in scalars}
    for text in errors:
        name, _, error = text.partition("=")
        for one in _named(name, by_name, f"--error {text}"):
            by_name[one.name] = replace(one, error=_read_error(error, one, text))
    for name in without:
        for one in _named(name, by_name, f"--without {name}"):
            del by_name[one.name]
    zero = [one.name for one in by_name.values() if not one.error > 0]
    if zero:
        raise ConfigError(f"{zero[0]}: observed is 0, of which a share is no standard error; state it: --error {zero[0]}=NUMBER")
    if not by_name:
        raise ConfigError("--without leaves no observation; leave out fewer")
    return list(by_name.values())


def concerns(text: str, scalars: Sequence[ObservedScalar]) -> bool:
    """Whether ``NAME`` or ``NAME=ERROR`` names one of the scalars."""
    name = text.partition("=")[0]
    return any(f"{one.name}.".startswith(f"{name}.") for one in scalars)


def _named(name: str, scalars: Mapping[str, ObservedScalar], option: str) -> list[ObservedScalar]:
    chosen = [one for key, one in scalars.items() if f"{key}.".startswith(f"{name}.")]
    if not chosen:
        raise ConfigError(f"{option}: no observation has this name; the site has {', '.join(scalars)}")
    return chosen


def _read_error(written: str, scalar: ObservedScalar, text: str) -> float:
    number, share = written.removesuffix("%"), written.endswith("%")
    try:
        error = float(number) * (abs(scalar.value) / 100.0 if share else 1.0)
    except ValueError:
        error = math.nan
    if not (math.isfinite(error) and error > 0):
        raise ConfigError(f"--error {text}: this is no standard error above 0; write NAME=5% or NAME=30, in {scalar.units}")
    return error
