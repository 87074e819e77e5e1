"""Release: the mass that starts to move, as thickness on the cells of the terrain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ReleaseError, member_of, require_kind
from runout.model.arrays import real_array
from runout.model.basal_friction import FRICTION_REMEDY, BasalFriction
from runout.model.facts import as_html, as_text, short
from runout.model.limits import LIMITS, checked, checked_radians
from runout.model.materials import MATERIAL_REMEDY, Material
from runout.model.pore_pressure import PorePressure
from runout.model.readers import reader
from runout.model.release_start import Arrival, StartVelocity, checked_velocity
from runout.model.terrain import Terrain


class Placement(StrEnum):
    """Where the released mass lies."""

    EXCAVATED = "excavated"  # below the surface: the elevation minus the thickness is the sliding surface
    ON_SURFACE = "on_surface"  # on top of the elevation

    @classmethod
    def of(cls, value: "Placement | str") -> "Placement":
        """Placement with this name; ReleaseError if there is none."""
        return member_of(cls, value, "placement", ReleaseError)


class Edge(StrEnum):
    """Thickness of a polygon release at its outline."""

    TAPERED = "tapered"  # it thins out; if excavated, its sliding surface leads out of the scar
    VERTICAL = "vertical"  # the stated thickness up to the outline

    @classmethod
    def of(cls, value: "Edge | str | None", placement: Placement) -> "Edge":
        """Edge with this name, by default that of the placement; ReleaseError if there is none."""
        if value is None:
            return cls.TAPERED if placement is Placement.EXCAVATED else cls.VERTICAL
        return member_of(cls, value, "edge", ReleaseError)


@dataclass(frozen=True)
class Release:
    """Vertical thickness of a released mass on the cells of a terrain.

    Parameters
    ----------
    thickness : ndarray (rows, columns)
        Mean vertical thickness over each cell of the terrain [m], >= 0; cells cut by the outline carry
        the covered fraction. ``sum(thickness) * cell_area`` is the volume.
    terrain : Terrain
        The terrain it lies on.
    outline : shapely geometry or None
        Polygon or multipolygon in map coordinates; sharpens the edge when particles are sampled.
    placement : Placement
        Below the surface or on top of it.
    basal_friction_angle : float or None
        Replaces the friction angle of the run for this mass [rad].
    basal_friction : BasalFriction or None
        Replaces the basal friction of the run for this mass.
    material : Material or None
        Replaces the material of the run for this mass.
    name, source : str
        For messages and products.
    changes : tuple of str
        Assumptions and changes of the reader, one sentence each.
    edge : Edge
        Shape at the outline: tapered or vertical.
    body : TaperedMass or None
        Data of a tapered mass, used by :meth:`scaled`.
    deepest : ndarray (rows, columns) or None
        Largest depth of an excavated mass below the surface [m]; additional thickness stands above the surface. None: no limit.
    pore_pressure : PorePressure or None
        Pore pressure of this mass; None: it is dry.
    start_time : float
        Time at which this mass starts to move [s]. Until then an excavated mass is ground; one on the surface is not there.
    velocity : float, StartVelocity, (east, north, up) or None
        Velocity at the start [m/s]: a speed down the slope, one with an azimuth, or three components; None: at rest.
    starts_when : Arrival or None
        The mass starts when the flow of another release arrives, instead of at a time. If it never does, the mass stays out.
    """

    thickness: np.ndarray
    terrain: Terrain
    outline: Any = None
    placement: Placement = Placement.EXCAVATED
    basal_friction_angle: float | None = None
    material: Material | None = None
    name: str = "release"
    source: str = "array"
    changes: tuple[str, ...] = ()
    edge: Edge = Edge.VERTICAL
    body: Any = None
    deepest: np.ndarray | None = None
    basal_friction: BasalFriction | None = None
    pore_pressure: PorePressure | None = None
    start_time: float = 0.0
    velocity: StartVelocity | float | tuple[float, float, float] | None = None
    starts_when: Arrival | None = None

    def __post_init__(self) -> None:
        t = real_array(self.thickness, f"{self.source}: thickness", ReleaseError)
        if t.shape != self.terrain.shape:
            raise ReleaseError(
                f"{self.source}: thickness has shape {t.shape}, the terrain {self.terrain.shape}; give it on the terrain's cells"
            )
        if not np.isfinite(t).all():
            count = int((~np.isfinite(t)).sum())
            raise ReleaseError(f"{self.source}: {count} cells have no thickness; write 0 where nothing is released")
        if t.min() < 0:
            raise ReleaseError(
                f"{self.source}: {int((t < 0).sum())} cells have a negative thickness (smallest {t.min():g} m); it must be >= 0"
            )
        if t.max() == 0:
            raise ReleaseError(f"{self.source}: the release is empty; its thickness is 0 everywhere")
        self._require_in_limits(t)
        t.setflags(write=False)
        object.__setattr__(self, "thickness", t)
        object.__setattr__(self, "placement", Placement.of(self.placement))
        self._require_laws()
        self._require_start()

    def _require_start(self) -> None:
        """Raise ReleaseError if start time, velocity or trigger are of another kind or out of range."""
        own = f"{self.source}: release {self.name}"
        object.__setattr__(self, "start_time", checked("start_time", self.start_time, place=own, error=ReleaseError))
        object.__setattr__(self, "velocity", checked_velocity(self.velocity, f"{own}: velocity"))
        if self.starts_when is not None:
            remedy = "give runout.Arrival('NAME OF A RELEASE', thickness=0.1)"
            require_kind(Arrival, self.starts_when, f"{own}: starts_when", remedy, ReleaseError)
            if self.start_time:
                raise ReleaseError(f"{own}: start_time and starts_when are both given; remove one of them")

    @property
    def waits(self) -> bool:
        """Whether this mass starts later than the run."""
        return self.starts_when is not None or self.start_time > 0.0

    def _require_laws(self) -> None:
        """Raise ReleaseError if material, friction law or friction angle of its own are of another kind or out of range."""
        own = f"{self.source}: release {self.name}"
        if self.material is not None:
            require_kind(Material, self.material, f"{own}: material", MATERIAL_REMEDY, ReleaseError)
        if self.basal_friction is not None:
            remedy = f"{FRICTION_REMEDY}, or basal_friction_angle=math.radians(20)"
            require_kind(BasalFriction, self.basal_friction, f"{own}: basal_friction", remedy, ReleaseError)
        if self.pore_pressure is not None:
            remedy = "give runout.PorePressure(ratio=0.7, decay_time=20.0)"
            require_kind(PorePressure, self.pore_pressure, f"{own}: pore_pressure", remedy, ReleaseError)
        if self.basal_friction_angle is not None:
            what = f"{own}: basal_friction_angle"
            angle = checked_radians("basal_friction_angle", self.basal_friction_angle, what, error=ReleaseError)
            object.__setattr__(self, "basal_friction_angle", angle)

    def _require_in_limits(self, thickness: np.ndarray) -> None:
        """Raise ReleaseError if thickness [m] or volume are outside their limits; names the first cell."""
        most, whole = LIMITS["thickness"], LIMITS["volume"]
        beyond = np.argwhere(thickness > most.high)
        if len(beyond):
            row, column = beyond[0]
            east, north = self.terrain.easting[column], self.terrain.northing[row]
            raise ReleaseError(
                f"{self.source}: thickness is {thickness[row, column]:g} m at row {row}, column {column} (easting {east:.2f}, "
                f"northing {north:.2f}), {len(beyond)} cells in all; {most.allowed()}; {most.hint}"
            )
        if thickness.max() < most.low:
            raise ReleaseError(f"{self.source}: thickness is {thickness.max():g} m at most; {most.allowed()}; {most.hint}")
        volume = float(thickness.sum() * self.terrain.cell_area)
        if not whole.holds(volume):
            raise ReleaseError(f"{self.source}: volume is {volume:g} m3; {whole.allowed()}; check thickness and area")

    @staticmethod
    def _read(name: str, *of: Any, choices: dict[str, Any], **more: Any) -> "Release":
        """What a reader makes of its arguments, with the start that ``choices`` state."""
        start = {key: choices.pop(key) for key in ("start_time", "velocity", "starts_when") if key in choices}
        release: Release = reader(name)(*of, **more, **choices)
        return replace(release, **start) if start else release

    @classmethod
    def from_vector(
        cls,
        path: str | PathLike[str],
        terrain: Terrain,
        thickness: float | str | None = None,
        volume: float | None = None,
        placement: Placement | str = Placement.EXCAVATED,
        **choices: Any,
    ) -> "Release":
        """Release of the polygons of a GeoPackage, Shapefile or GeoJSON.

        ``thickness`` [m] is a number or the name of an attribute; ``volume`` [m3] sets the thickness instead, or is
        checked against it (1 %). ``choices`` are ``edge`` ("tapered" or "vertical"), ``layer``, ``name``, ``material``,
        ``basal_friction_angle_deg``, ``pore_pressure``, ``start_time`` [s], ``velocity``, ``starts_when``.
        """
        more = {"thickness": thickness, "volume": volume, "placement": placement}
        return cls._read("Release.from_vector", path, terrain, choices=choices, **more)

    @classmethod
    def from_raster(
        cls,
        path: str | PathLike[str],
        terrain: Terrain,
        volume: float | None = None,
        placement: Placement | str = Placement.EXCAVATED,
        **choices: Any,
    ) -> "Release":
        """Release of a thickness raster [m] on any grid in any known coordinate system, resampled conservatively.

        ``choices`` are ``sign`` ("negative" for a raster of elevation loss), ``name``, ``material``, ``basal_friction_angle_deg``,
        ``pore_pressure``, ``start_time`` [s], ``velocity``, ``starts_when``.
        """
        return cls._read("Release.from_raster", path, terrain, choices=choices, volume=volume, placement=placement)

    @classmethod
    def from_array(
        cls, thickness: np.ndarray, terrain: Terrain, placement: Placement | str = Placement.EXCAVATED, **choices: Any
    ) -> "Release":
        """Release of a thickness array [m] on the cells of the terrain, north-west corner first.

        ``choices`` are ``volume``, ``name``, ``material``, ``basal_friction_angle_deg``, ``pore_pressure``, ``source``,
        ``start_time`` [s], ``velocity``, ``starts_when``.
        """
        return cls._read("Release.from_array", thickness, terrain, choices=choices, placement=placement)

    @property
    def start_speed(self) -> float:
        """Speed [m/s] at the start; 0 at rest."""
        if isinstance(self.velocity, StartVelocity):
            return self.velocity.speed
        return math.hypot(*self.velocity) if isinstance(self.velocity, tuple) else 0.0

    def friction_on(self, otherwise: BasalFriction | float) -> BasalFriction | float:
        """Basal friction under this mass, or its friction angle [rad]: its own, or that of the run."""
        if self.basal_friction is not None:
            return self.basal_friction
        return otherwise if self.basal_friction_angle is None else self.basal_friction_angle

    @property
    def least_effective(self) -> float:
        """Least share [1] of the normal stress that grains carry at the start: 1 without pore pressure."""
        return 1.0 - self.pore_pressure.highest if self.pore_pressure else 1.0

    def scaled(self, factor: float) -> "Release":
        """Release with the same outline and ``factor`` times the volume.

        The scar is never deeper than that of the stated volume: a larger mass is thicker in proportion, and its additional
        thickness stands above the ground. A smaller one is thinner; with a tapered edge, its sliding surface is steeper.
        """
        deepest = self.thickness if self.deepest is None else self.deepest
        body = None if self.body is None else self.body.scaled(factor)
        thickness = self.thickness * factor if body is None else body.thickness()
        try:
            return replace(self, thickness=thickness, body=body, deepest=deepest)
        except ReleaseError as error:
            raise ReleaseError(f"with {factor:g} times the volume (release_volume_factor): {error}") from error

    def plot(self, *, title: str | None = None) -> Any:
        """Axes of matplotlib with a map of the thickness over hillshade, on a new figure of pyplot."""
        return reader("Release.plot")(self, title=title)

    def _facts(self) -> dict[str, str]:
        thins = "; thins out to its outline and keeps its volume" if self.edge is Edge.TAPERED else ""
        return {
            "name": self.name,
            "volume": short(self.volume, "m3"),
            "area": short(self.area, "m2"),
            "thickness": f"{short(self.mean_thickness)} m on average, {short(self.thickness.max())} m at most",
            "placement": str(self.placement),
            "edge": f"{self.edge}{thins}",
            "source": self.source,
        }

    def __repr__(self) -> str:
        return as_text("Release", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Release", self._facts())

    @property
    def excavation(self) -> np.ndarray:
        """Depth of the mass below the surface (rows, columns) [m]; 0 for a mass on the surface."""
        if self.placement is Placement.ON_SURFACE:
            return np.zeros(self.terrain.shape)
        return self.thickness if self.deepest is None else np.minimum(self.thickness, self.deepest)

    @property
    def heap(self) -> np.ndarray:
        """Height of the mass above the surface (rows, columns) [m]."""
        return self.thickness - self.excavation

    @property
    def volume(self) -> float:
        """Released volume [m3]."""
        return float(self.thickness.sum() * self.terrain.cell_area)

    @property
    def mean_thickness(self) -> float:
        """Volume over area [m]: the stated thickness of polygons, whatever their edge."""
        return self.volume / self.area

    @property
    def area(self) -> float:
        """Plan area [m2] of the outline, or without an outline of the cells with thickness."""
        if self.outline is not None:
            return float(self.outline.area)
        return float((self.thickness > 0).sum() * self.terrain.cell_area)


def thickness_of(releases: Sequence[Release], terrain: Terrain) -> np.ndarray:
    """Thickness (rows, columns) [m] of all releases on a terrain together; 0 without any."""
    return np.sum([np.zeros(terrain.shape), *(release.thickness for release in releases)], axis=0)  # type: ignore[no-any-return]
