"""Scene: everything a backend needs besides the particles."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from runout.errors import ConfigError, StabilityError
from runout.model.basal_friction import BasalFriction, MassAbove
from runout.model.friction import FrictionZones
from runout.model.ground_friction import GroundFriction
from runout.model.law_mixtures import material_law
from runout.model.laws import Law, law_of
from runout.model.limits import checked
from runout.model.materials import Material
from runout.model.nodal_surface import NodalSurface
from runout.model.numerics import Scheme
from runout.model.pore_pressure import PorePressure, pore_table
from runout.model.structures import StructureField
from runout.model.surface import Surface
from runout.physics import geostatic, substeps, timestep

STANDARD_GRAVITY = 9.81
RESERVE = 0.95  # of the Courant number that an isolated particle bears, in steps that runout chooses
STEP_TOLERANCE = 1.02  # a step that was chosen some steps ago may be so much longer than a limit: the flow has sped up


@dataclass(frozen=True)
class Raster:
    """Cells of the elevation raster in local coordinates: where observers put what they see.

    ``rows`` count from the north, ``columns`` from the west; the outer south-west corner is the local origin.
    """

    rows: int
    columns: int
    cell_size: tuple[float, float]


@dataclass(frozen=True)
class Scene(Scheme):
    """A runout scene on a grid of uniform spacing; its further arguments are those of :class:`runout.model.numerics.Scheme`.

    Parameters
    ----------
    spacing : tuple of float
        Grid spacing (dx, dy, dz) [m].
    surface : Surface, NodalSurface or None
        Sliding surface, or that on the nodes of the grid; None for no ground at all. Contact takes :attr:`ground`.
    raster : Raster
        Cells of the elevation raster. Its outline and its ``unknown`` cells bound the domain: what leaves it is booked as escaped.
    materials : tuple of Material
        One per release; each follows its own law.
    friction : tuple of float or BasalFriction
        Basal friction per release, each of its own law; a number is a Coulomb coefficient tan(angle) [1].
    strength : tuple of float
        Largest friction coefficient that the mass of each release passes on to the ground [1], see
        :meth:`runout.model.materials.Material.shear_strength`; empty for no limit.
    initial_stress : str
        Initial stress of the particles, at_rest or none; for the record.
    gravity : tuple of float
        Acceleration [m/s2].
    friction_zones : FrictionZones or None
        Zones where the ground changes the friction, or None.
    unknown : ndarray (columns, rows) of bool or None
        Cells of the raster without elevation, first index east, second north, from the south-west corner: an open edge, as the
        outline is. None where every cell has one.
    structures : StructureField or None
        Structures that the flow meets; without them nothing of their contact runs.
    pore_pressure : tuple of PorePressure or None
        Per release; empty if no mass has pore pressure, so that nothing of it runs.
    """

    spacing: tuple[float, float, float]
    surface: Surface | NodalSurface | None
    raster: Raster
    materials: tuple[Material, ...]
    friction: tuple[BasalFriction | float, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -STANDARD_GRAVITY)
    contact_band: float = field(default=0.001)  # a particle closer than this [cells] is in contact
    friction_zones: FrictionZones | None = None
    unknown: np.ndarray | None = None
    strength: tuple[float, ...] = ()
    initial_stress: str = "none"
    structures: StructureField | None = None
    pore_pressure: tuple[PorePressure | None, ...] = ()

    def __post_init__(self) -> None:
        if len(self.spacing) != 3:
            raise ConfigError(f"cell_size is {self.spacing}; give one number or (dx, dy, dz)")
        for h in self.spacing:
            checked("cell_size", h, error=ConfigError)
        if isinstance(self.surface, NodalSurface) and self.surface.spacing != self.spacing[:2]:
            apart = f"{self.surface.spacing} m apart, the grid has them {self.spacing[:2]} m apart"
            raise ConfigError(f"the ground is made for nodes {apart}; make it for this grid")
        super().__post_init__()
        if not self.materials:
            raise ConfigError("no material is given; give one for each release")
        if len(self.friction) != len(self.materials):
            raise ConfigError(f"{len(self.friction)} friction coefficients for {len(self.materials)} releases")
        if len(self.strength) not in (0, len(self.materials)):
            raise ConfigError(f"{len(self.strength)} strengths for {len(self.materials)} releases; give one each, or none")
        if len(self.pore_pressure) not in (0, len(self.materials)):
            raise ConfigError(
                f"{len(self.pore_pressure)} pore pressures for {len(self.materials)} releases; give one each, or none"
            )
        zones, raster = self.friction_zones, self.raster
        if zones and (zones.factor.shape, zones.cell_size) != ((raster.columns, raster.rows), raster.cell_size):
            cells = f"{zones.factor.shape} of {zones.cell_size} m"
            raise ConfigError(f"friction zones have cells {cells}, the terrain {raster}; read them on the same terrain")
        _ = self.basal  # refuses what does not fit together
        if len({m.law for m in self.materials}) > 1:
            _ = self.law  # likewise
        if self.unknown is not None and self.unknown.shape != (raster.columns, raster.rows):
            raise ConfigError(f"unknown cells have shape {self.unknown.shape}; {(raster.columns, raster.rows)} are needed")
        if self.structures:
            self.structures.require_fits(self.spacing)

    @cached_property
    def law(self) -> Law:
        """The law that all materials follow, or the mixture of their laws (:mod:`runout.model.law_mixtures`)."""
        return material_law(map(law_of, self.materials))

    @property
    def observed_length(self) -> float:
        """Length [m] that maps tell apart between two observations: a cell of the grid, or of the raster if that is longer."""
        return max(min(self.raster.cell_size), min(self.spacing[:2]))

    @cached_property
    def ground(self) -> NodalSurface | None:
        """The sliding surface on the nodes of the grid, which every backend takes for contact."""
        return NodalSurface(self.surface, self.spacing[:2]) if isinstance(self.surface, Surface) else self.surface

    @cached_property
    def isolated_cfl(self) -> float:
        """Courant number above which an isolated particle would gain energy."""
        return min(timestep.isolated_limit(m.lame_lambda, m.shear_modulus) for m in self.materials)

    @property
    def largest_cfl(self) -> float:
        """Courant number above which steps are refused: :attr:`isolated_cfl`, at most that of the materials."""
        return min(self.isolated_cfl, *(m.largest_cfl for m in self.materials))

    @cached_property
    def wave_speed(self) -> float:
        """Largest speed of pressure waves [m/s]."""
        return max(m.wave_speed for m in self.materials)

    @property
    def densities(self) -> np.ndarray:
        """Density (releases,) [kg/m3]."""
        return np.array([m.density for m in self.materials], np.float64)

    @property
    def strengths(self) -> tuple[float, ...]:
        """:attr:`strength` of every release, infinite where there is no limit."""
        return self.strength or (math.inf,) * len(self.friction)

    @cached_property
    def basal(self) -> GroundFriction:
        """Friction of the ground on the releases, as contact reads it."""
        g = math.sqrt(sum(a * a for a in self.gravity))
        masses = [MassAbove(s, m.density, g) for s, m in zip(self.strengths, self.materials, strict=True)]
        return GroundFriction(self.friction, masses, self.friction_zones)

    @property
    def is_wet(self) -> bool:
        """Whether any mass has pore pressure."""
        return any(self.pore_pressure)

    def pore_table(self, real: Any = np.float64) -> np.ndarray:
        """Records (releases,) of pore pressure (:func:`runout.model.pore_pressure.pore_table`)."""
        return pore_table(self.pore_pressure or (None,) * len(self.materials), self.densities, real)

    def structure_friction(self) -> np.ndarray:
        """Friction coefficients (releases, patches) [1] of the structures: of the surface, at most what each mass passes on.

        Patches that state none have the friction of the ground at rest in their place, zones included.
        """
        strengths = np.array(self.strengths, np.float64)[:, None]
        if self.structures is None:
            return np.minimum(np.zeros(0), strengths)
        patches = self.structures.patches
        x, y = patches.centre[:, 0], patches.centre[:, 1]
        releases = np.arange(len(self.friction))
        of_ground = np.stack([self.friction_at(np.full(len(x), release), x, y) for release in releases])
        return np.minimum(np.where(np.isnan(patches.friction), of_ground, patches.friction), strengths)

    @property
    def resting_friction(self) -> tuple[float, ...]:
        """Friction coefficient of the ground at rest per release [1], outside all zones."""
        return tuple(f.at_rest if isinstance(f, BasalFriction) else float(f) for f in self.friction)

    @property
    def acting_friction(self) -> tuple[float, ...]:
        """Friction coefficient at rest per release [1] that acts outside all zones: of the ground, at most that of the mass."""
        return tuple(map(geostatic.acting_friction, self.resting_friction, self.strengths))

    def start_attributes(self) -> dict[str, Any]:
        """What a run starts with, for the record.

        Initial stress; by release friction coefficients at rest [1], stated and acting outside all zones, Young's modulus [Pa],
        stated or chosen, and speed of pressure waves [m/s].
        """
        return {
            "initial_stress": str(self.initial_stress),
            "basal_friction": list(self.resting_friction),
            "acting_basal_friction": [float(f) for f in self.acting_friction],
            "youngs_modulus": [m.modulus for m in self.materials],
            "wave_speed": [m.wave_speed for m in self.materials],
        }

    def friction_at(self, release: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Friction coefficients at rest (n,) [1] that act on masses of a ``release`` (n,) at local positions (n,) [m]."""
        return self.basal.at_rest()[self.basal.rows(release, x, y)]

    def holds(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Whether local positions (n,) [m] lie in the domain: on a cell of the raster that has an elevation."""
        raster = self.raster
        limits = np.multiply((raster.columns, raster.rows), raster.cell_size)
        inside = (x >= 0.0) & (x <= limits[0]) & (y >= 0.0) & (y <= limits[1])
        if self.unknown is None:
            return inside
        i, j = (
            np.clip(np.floor(place / size).astype(np.int64), 0, count - 1)
            for place, size, count in zip((x, y), raster.cell_size, self.unknown.shape, strict=True)
        )
        return inside & ~self.unknown[i, j]

    def stable_step(self, speed: float) -> float:
        """Time step [s] to take while the fastest particle moves at ``speed`` [m/s]: that of ``cfl``, if this keeps a reserve."""
        return min(self._limits(speed, min(self.cfl, RESERVE * self.isolated_cfl, self.largest_cfl)).values())

    def bears(self, dt: float, speed: float) -> bool:
        """Whether a step of ``dt`` [s] can be stable while the fastest particle moves at ``speed`` [m/s]."""
        return 0 < dt <= STEP_TOLERANCE * min(self._limits(speed, self.largest_cfl).values())

    def require_stable(self, dt: float, speed: float, step: int) -> None:
        """Nothing, if step number ``step`` of ``dt`` [s] can be stable while the fastest particle moves at ``speed`` [m/s].

        The limits are those of the scheme: that of a scene is lower where its ``cfl`` is.

        Raises
        ------
        StabilityError
            If ``dt`` is not positive or above a limit; names the limit and its reason.
        """
        if self.bears(dt, speed):
            return
        if not dt > 0:
            raise StabilityError(f"step {step} is {dt:g} s long; it must be positive")
        limits = self._limits(speed, self.largest_cfl)
        reason = min(limits, key=lambda name: limits[name])
        most = self.largest_cfl if reason == "acoustic" else 0.5
        what = f"a pressure wave of {self.wave_speed:.4g} m/s" if reason == "acoustic" else f"a particle of {speed:.4g} m/s"
        raise StabilityError(
            f"{what} would cross {most * dt / limits[reason]:.3g} cells in step {step} of {dt:.4g} s; the {reason} limit is "
            f"{limits[reason]:.4g} s ({most:g} cells of {min(self.spacing):g} m): take {self.stable_step(speed):.4g} s or less "
            "(stable_step)"
        )

    def substep_count(self, dt: float, speed: float) -> int:
        """Substeps of ``dt`` [s] in the next transfer, while the fastest particle moves at ``speed`` [m/s]."""
        h = min(self.spacing)
        if self.substeps == 1 or substeps.is_slow(speed, dt, h):
            return 1
        fitting = int(substeps.longest_transfer(speed, math.hypot(*self.gravity), h) / dt + 1e-9)
        return max(1, min(self.substeps, fitting))

    def require_substeps(self, count: int) -> None:
        """Nothing, if a transfer of ``count`` substeps is within :attr:`substeps`.

        Raises
        ------
        ConfigError
            If it is not: kernels and memory are made for that number.
        """
        if not 1 <= count <= self.substeps:
            raise ConfigError(f"a transfer of {count} substeps; the scene has {self.substeps} at most (Scene.substeps)")

    def _limits(self, speed: float, cfl: float) -> dict[str, float]:
        """Limits of the time step [s] by name."""
        h = min(self.spacing)
        acoustic = timestep.acoustic_limit(cfl, h, self.wave_speed, speed)
        return {"acoustic": acoustic, "particle": timestep.particle_limit(h, speed) if speed > 0 else math.inf}

    @property
    def dtype(self) -> Any:
        """NumPy type of the state."""
        return np.float32 if self.precision == "float32" else np.float64
