"""Scene and particles of a scenario: terrain, releases and material as a backend takes them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any

import numpy as np

from runout.errors import ConfigError, ReleaseError, require_kind
from runout.forecast.memory import Extent, expected_extent
from runout.model import basal_strength
from runout.model.basal_friction import FRICTION_REMEDY, USUAL_ANGLE, BasalFriction
from runout.model.bed import Bed
from runout.model.friction import FrictionZones
from runout.model.friction_laws import numbers_of
from runout.model.inflow import Inflow
from runout.model.law_mixtures import friction_law
from runout.model.limits import checked
from runout.model.materials import MATERIAL_REMEDY, Material
from runout.model.nodal_surface import NodalSurface
from runout.model.numerics import Numerics
from runout.model.particle_source import gathered
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY, Raster, Scene
from runout.model.structures import StructureField, Structures
from runout.model.terrain import Terrain
from runout.simulation.waiting_release import WaitingRelease, hold_back


def build_scene(
    terrain: Terrain,
    release: Release | Sequence[Release],
    material: Material,
    basal_friction_angle: float,
    numerics: Numerics,
    *,
    basal_friction: BasalFriction | None = None,
    friction_zones: FrictionZones | None = None,
    structures: Structures | StructureField | None = None,
    inflow: Inflow | Sequence[Inflow] = (),
    bed: Bed | None = None,
    accept: Callable[[Extent], None] | None = None,
    in_chunks: bool = False,
    waiting: list[WaitingRelease] | None = None,
) -> tuple[Scene, Any]:
    """Scene and particles of a scenario; ``numerics`` are its choices of the run, the others as in :func:`runout.simulate`.

    Inflows are masses of the scene behind the releases; their particles are born later. Of a ``bed`` the pore pressure counts, in
    the choice of the stiffness and in what the mass may reach.

    ``accept`` is called before the particles are made; it raises an error if the scene is too large. With ``in_chunks`` the
    particles are made when a backend loads them (:class:`runout.model.particle_source.ParticleSource`). The list ``waiting`` gets
    the releases that start later: the scene has ground in their place, and they are not among the particles. Without the list all
    releases lie in the scene.
    """
    from runout.backends.initial_stress import InitialStress, launched_by, pressed_by, wetted_by
    from runout.backends.resting_particles import ReleaseParticles, settled_in
    from runout.release.arrangement import default_particles
    from runout.release.sample import Sampling, particles_per_axis
    from runout.terrain import open_edge, prepare
    from runout.terrain.crests import Mass

    there, releases = _masses(release, inflow)
    basal = _checked_friction(material, basal_friction, basal_friction_angle, friction_zones, structures)
    frictions = basal_strength.frictions_under(releases, basal)
    spacing, particles_per_cell = numerics.spacing, numerics.particles_per_cell
    if particles_per_cell is None:
        particles_per_cell = default_particles(releases, material, basal, spacing[2], friction_zones)
    prepare.require_known(terrain, np.sum([r.thickness for r in releases], axis=0) > 0, "the release")
    stated_materials = [r.material or material for r in releases]
    strength = basal_strength.strengths(stated_materials, spacing[2])
    materials, least = _forecast(stated_materials, releases, frictions, spacing[2], friction_zones, bed)
    _require_bearing(releases, materials)
    ground = partial(_ground_dug, terrain, spacing[:2], Mass(np.sum([r.thickness for r in releases], axis=0), least))
    surface = ground([r.excavation for r in releases])
    per_axis = particles_per_axis(particles_per_cell)
    friction = tuple(math.tan(f) if isinstance(f, float) else f for f in frictions)
    if accept:
        extent = expected_extent(releases, surface.surface, spacing, per_axis)
        accept(replace(extent, mixed=_mixed(frictions, strength), friction=friction_law(numbers_of(f)[0] for f in friction)))
    scene = Scene(
        spacing, surface, Raster(*terrain.shape, terrain.cell_size), materials, friction, strength=strength,
        friction_zones=friction_zones, unknown=open_edge.unknown_cells(terrain), **numerics.scheme(),
        initial_stress=InitialStress.of(numerics.initial_stress), pore_pressure=tuple(r.pore_pressure for r in releases),
        structures=structures.field if isinstance(structures, Structures) else structures,
    )  # fmt: skip
    how = Sampling(spacing, per_axis, numerics.seed)
    press, wet, launch = pressed_by(scene, releases), wetted_by(scene, releases, numerics.seed), launched_by(scene, there)
    own = materials[: len(there)]
    particles = ReleaseParticles(there, own, surface, how, press=press, wet=wet, settle=settled_in(scene), launch=launch)
    scene, particles = hold_back(scene, particles, there, ground, waiting)
    return scene, particles if in_chunks else gathered(particles)


def _masses(release: Release | Sequence[Release], inflow: Any) -> tuple[list[Release], list[Release]]:
    """The releases, and all masses of a scene: these and those of inflows at their lines; ReleaseError without any."""
    from runout.release.inlet import mass_at

    there = [release] if isinstance(release, Release) else list(release)
    masses = [*there, *map(mass_at, inflows_of(inflow))]
    if not masses:
        raise ReleaseError("neither a release nor an inflow is given; at least one is needed")
    return there, masses


def _ground_dug(terrain: Terrain, spacing: tuple[float, float], mass: Any, dug: Sequence[np.ndarray]) -> NodalSurface:
    """Sliding surface below some excavations (rows, columns) [m]."""
    from runout.terrain import sdf

    return sdf.sliding_surface(terrain, np.sum(dug, axis=0) if np.any(dug) else None, spacing, mass)


def _require_bearing(releases: Sequence[Release], materials: Sequence[Material]) -> None:
    """Raise an error unless the masses carry their own weight, and their pore pressure leaves them some of it to stand on."""
    for release, material in zip(releases, materials, strict=True):
        material.require_carries(float(release.thickness.max()), STANDARD_GRAVITY)
        if release.pore_pressure:
            release.pore_pressure.require_fits(release.thickness, material.density, release.name)


def inflows_of(inflow: Any) -> list[Inflow]:
    """The inflows of an argument that is one of them or a sequence.

    Raises ConfigError if it is something else.
    """
    inflows = [inflow] if isinstance(inflow, Inflow) else list(inflow)
    for one in inflows:
        require_kind(Inflow, one, "inflow", "give runout.Inflow(...), or a list of them", ConfigError)
    return inflows


def _forecast(
    materials: Sequence[Material], releases: Sequence[Release], frictions: Sequence[BasalFriction | float], height: float,
    zones: FrictionZones | None, bed: Bed | None,
) -> tuple[tuple[Material, ...], float]:  # fmt: skip
    """The materials with numbers as moduli, and the least friction angle [rad] that acts, on cells of a ``height`` [m]."""
    from runout.forecast import stiffness

    ratio = bed.pore_pressure_ratio if bed else None
    resting = basal_strength.forecast_strengths(materials, releases, height)
    moduli = stiffness.chosen_moduli(materials, releases, frictions, resting, zones, ratio)
    return moduli, basal_strength.least_angle(frictions, resting, zones, basal_strength.effective_shares(releases, ratio))


def scene_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of :func:`build_scene` from those of :func:`runout.simulate`; arguments that it does not take are left out."""
    chosen = {name: arguments[name] for name in signature(build_scene).parameters if name in arguments}
    return {"basal_friction_angle": USUAL_ANGLE, **chosen, "numerics": Numerics.of(arguments)}


def _checked_friction(
    material: Any, basal_friction: Any, angle_deg: Any, friction_zones: Any, structures: Any
) -> BasalFriction | float:
    """Basal friction of the run, or its angle [rad]; ConfigError for another kind of argument or an angle out of range."""
    require_kind(Material, material, "material", MATERIAL_REMEDY, ConfigError)
    angle = f"{FRICTION_REMEDY}, or leave it out and write basal_friction_angle=20.0 in degrees"
    require_kind(BasalFriction | None, basal_friction, "basal_friction", angle, ConfigError)
    zones = "give runout.FrictionZones.from_vector(FILE, terrain, ...)"
    require_kind(FrictionZones | None, friction_zones, "friction_zones", zones, ConfigError)
    bodies = "give the structures of runout.Structures.from_file(FILE, terrain, ...)"
    require_kind(Structures | StructureField | None, structures, "structures", bodies, ConfigError)
    return basal_friction or math.radians(checked("basal_friction_angle", angle_deg, error=ConfigError))  # type: ignore[no-any-return]


def _mixed(frictions: Sequence[float | BasalFriction], strengths: Sequence[float]) -> int:
    """How many releases differ in friction: 1 if all are alike, else all of them."""
    first, *others = zip(frictions, strengths, strict=True)
    return 1 if all(other == first for other in others) else len(frictions)
