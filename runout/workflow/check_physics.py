"""Checks the physics of the members of a site: basal friction in effect, and thicknesses that the grid can show."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.config.bed import bed_ratio
from runout.config.friction import sampled_ranges
from runout.config.material import OF_THE_RUN
from runout.config.member_arguments import grid_spacing
from runout.config.pore_pressure import sampled_pores
from runout.model.basal_strength import effective_shares, least_angle, resting_strength, sentence, strengths, unchanged
from runout.model.depth_resolution import SHARING
from runout.model.friction_laws import numbers_of

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.basal_friction import BasalFriction
    from runout.model.friction import FrictionZones
    from runout.model.materials import Material
    from runout.model.release import Release

STEEP = 90  # percentile of the slopes within reach
Sample = Mapping[str, float]  # sampled parameters of a member, by name


@dataclass(frozen=True)
class Bases:
    """Friction under one release in all members, coefficient of the ground at rest and strength of the mass, (members,) [1].

    A number in place of a friction is its angle [rad]. ``effective`` (members,) is the least share [1] of the normal stress that
    grains carry at the start, of mass from a wet bed too; ``resting`` (members,) the strength [1] of the mass in forecasts, which
    that of a yield stress limits.
    """

    name: str
    frictions: "list[BasalFriction | float]"
    ground: np.ndarray
    strength: np.ndarray
    effective: list[float]
    resting: np.ndarray

    def acting(self, zones: "FrictionZones | None") -> np.ndarray:
        """Smallest friction angle (members,) [rad] that acts on it on any ground, with the pore pressure at the start."""
        bases = zip(self.frictions, self.resting.tolist(), self.effective, strict=True)
        return np.array([least_angle([friction], [strength], zones, [share]) for friction, strength, share in bases])


def warnings(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None") -> Iterator[str]:
    """Warnings of a site whose inputs have been read.

    Raises MaterialError if the sampled parameters of a member are not a valid material.
    """
    if not releases:
        return
    if {release.name for release in releases} == site.friction.masses.keys():  # the particles of a cell depend on all masses
        yield from _thinner_than_the_grid_shows(site, least_thickness(site, releases, zones))
    yield from _pressures_that_rise(site, releases)
    yield from unchanged(site.friction.of_releases(releases, {}), [r.name for r in releases], zones)
    for base, release in zip(bases_of(site, releases), releases, strict=True):
        yield from _stronger_ground(base, zones)
        law = numbers_of(base.frictions[0])[0]
        if law.drags and not law.drags_column:
            yield from _sheared_by_drag(base, release, zones)


def _pressures_that_rise(site: "Site", releases: "Sequence[Release]") -> Iterator[str]:
    """Sentence on each release whose pore pressure starts below the hydrostatic one in some members."""
    samples = samples_of(site)
    for k, release in enumerate(releases):
        if release.pore_pressure is None:
            continue
        doubts = []
        for sample, own in zip(samples, (materials[k] for materials in materials_of(site, releases, samples)), strict=True):
            pore = sampled_pores(releases, sample)[k].pore_pressure
            pore.require_fits(release.thickness, own.density, release.name)  # type: ignore[union-attr]
            doubts.append(pore.doubt(own.density, release.name))  # type: ignore[union-attr]
        found = [(number, doubt) for number, doubt in enumerate(doubts) if doubt]
        if found:
            number, doubt = found[0]
            yield doubt if len(samples) == 1 else f"{doubt} (member {number}; so in {len(found)} of {len(samples)} members)"


def wet_masses(site: "Site", releases: "Sequence[Release]") -> Iterator[str]:
    """What each mass with pore pressure stands on at the start, and once its pressure has drained, in a site as stated."""
    for release, base in zip(releases, bases_of(site, releases, [{}]), strict=True):
        pore = release.pore_pressure
        if pore is None:
            continue
        ground = min(float(base.ground[0]), float(base.strength[0]))
        rest = pore.equilibrium((release.material or site.material()).density)
        acting, left = (math.degrees(math.atan((1.0 - ratio) * ground)) for ratio in (pore.highest, rest))
        carried = f"{pore.highest:.3g}" if pore.lowest == pore.highest else f"{pore.lowest:.3g} to {pore.highest:.3g}"
        yield (
            f"{release.name}: water carries {carried} of its weight at the start; the ground, of "
            f"{math.degrees(math.atan(ground)):.1f} deg, acts like {acting:.1f} deg, and like {left:.1f} deg once the pressure has "
            f"drained to {rest:.3g}"
        )


def standing_layers(site: "Site", releases: "Sequence[Release]") -> Iterator[str]:
    """On which slopes the yield stress of a fluid holds each release, in a site as stated.

    A layer of vertical thickness H on a slope of angle a stands where rho g H sin(a) cos(a) is at most the yield stress.
    """
    for release in releases:
        material, mean = release.material or site.material(), release.mean_thickness
        held = resting_strength(material, release)  # of the weight
        if math.isinf(held):
            continue
        slope = "on any slope" if held >= 0.5 else f"on slopes below {math.degrees(0.5 * math.asin(2.0 * held)):.2g} deg"
        yield (
            f"{release.name}: its yield stress holds a layer of {mean:.3g} m, its mean thickness, {slope}; steeper, it "
            "flows until it is thinner, on ground that holds it too"
        )


def least_thickness(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None" = None) -> float:
    """Least thickness [m] that the maps of a site as stated can show (:mod:`runout.physics.numerical_scales`)."""
    from runout.physics.numerical_scales import least_thickness as of_particles

    x, y, _ = grid_spacing(site.settings, releases)
    return float(of_particles(particle_volume(site, releases, zones), x * y, SHARING))


def particle_volume(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None" = None) -> float:
    """Volume [m3] of a particle of a site as stated, from those of its masses that could be read."""
    from runout.release.arrangement import default_particles

    spacing = grid_spacing(site.settings, releases)
    stated, basal = site.settings.simulation.particles_per_cell, site.friction.of_run({})
    count = stated or default_particles(releases, site.material(), basal, spacing[2], zones)
    return math.prod(spacing) / (count if isinstance(count, int) else math.prod(count))


def _thinner_than_the_grid_shows(site: "Site", least: float) -> Iterator[str]:
    """Warn of thresholds of thickness below the ``least`` [m] that the maps can show."""
    simulation, hazard = site.settings.simulation, site.settings.hazard
    stated = {
        "simulation.arrival_threshold": [simulation.arrival_threshold],
        "hazard.thickness_thresholds": hazard.thickness_thresholds, "hazard.deposit_thresholds": hazard.deposit_thresholds,
    }  # fmt: skip
    low = {name: [f"{value:g}" for value in values if value < least] for name, values in stated.items()}
    told = ", ".join(f"{name} {', '.join(values)} m" for name, values in low.items() if values)
    if told:
        yield (
            f"{told}: below {least:.2g} m, the least thickness that this grid can show (4 particles on 2.5 by 2.5 cells); areas "
            "and probabilities over these thresholds are those over that thickness: use smaller cells, or larger thresholds"
        )


def least_friction(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None" = None) -> float:
    """Smallest friction angle [rad] that acts at the base of any release in any member and zone."""
    if not releases:
        return least_angle([site.friction.of_run({})], [math.inf])
    return min(float(base.acting(zones).min()) for base in bases_of(site, releases))


def bases_of(site: "Site", releases: "Sequence[Release]", samples: "Sequence[Sample] | None" = None) -> list[Bases]:
    """Friction and strength at the base of each release, for members with these parameters; for all members by default."""
    samples = samples_of(site) if samples is None else samples
    height = grid_spacing(site.settings, releases)[2]
    own_materials = materials_of(site, releases, samples)
    own = np.array([strengths(materials, height) for materials in own_materials])
    members = [site.friction.of_releases(releases, sample) for sample in samples]
    wet = [effective_shares(sampled_pores(releases, sample), bed_ratio(site.settings, sample)) for sample in samples]
    bases = []
    for k, (r, frictions) in enumerate(zip(releases, map(list, zip(*members, strict=True)), strict=True)):
        ground = np.array([math.tan(f) if isinstance(f, float) else f.at_rest for f in frictions])
        volumes = [float(sample.get("release_volume_factor", 1.0)) for sample in samples]
        held = [resting_strength(of[k], r, factor) for of, factor in zip(own_materials, volumes, strict=True)]
        bases.append(Bases(r.name, frictions, ground, own[:, k], [shares[k] for shares in wet], np.minimum(own[:, k], held)))
    return bases


def samples_of(site: "Site") -> list[dict[str, float]]:
    """Sampled parameters of all members."""
    from runout.ensemble.design import Design

    return Design.of(site.settings.ensemble).samples()


def materials_of(site: "Site", releases: "Sequence[Release]", samples: "Sequence[Sample]") -> "list[list[Material]]":
    """Material of each release in each member; the same objects if none of their parameters is sampled."""
    if not {name for sample in samples for name in sample} - {*sampled_ranges(site.friction.law), *OF_THE_RUN}:
        return [site.materials(releases)] * len(samples)
    return [site.materials(releases, sample) for sample in samples]


def _stronger_ground(base: Bases, zones: "FrictionZones | None") -> Iterator[str]:
    """Sentence on the friction in effect if the ground is stronger than the mass of a release in some members."""
    ground = np.array([_strongest(f, zones) for f in base.frictions]) if zones else base.ground
    limited = np.flatnonzero(ground > base.strength)
    if not len(limited):
        return
    k = limited[np.argmax(ground[limited] / base.strength[limited])]
    said = sentence(base.name, float(ground[k]), float(base.strength[k]), in_zones=bool(ground[k] > base.ground[k]))
    yield said if len(ground) == 1 else f"{said} (member {k}; so in {len(limited)} of {len(ground)} members)"


def _sheared_by_drag(base: Bases, release: "Release", zones: "FrictionZones | None") -> Iterator[str]:
    """Sentence if drag at the base needs more shear than the mass passes on, where a steady flow has the shear of the slope."""
    from runout.terrain.open_edge import filled
    from runout.terrain.prepare import reachable, steepness

    terrain = release.terrain
    slope = steepness(filled(terrain.elevation, terrain.cell_size), terrain.cell_size)
    reached = slope[reachable(terrain, release.thickness, float(base.acting(zones).min()))]
    steep, strength = float(np.percentile(reached, STEEP)), float(base.strength.min())
    if steep <= strength:
        return
    remedy = f"friction_angle_deg of {math.degrees(math.asin(steep)):.0f} passes that on" if steep < 1.0 else "no material does"
    yield (
        f"{base.name}: on the steepest {100 - STEEP} % of the ground within reach a steady flow needs a shear stress of "
        f"{steep:.2f} times the normal stress, and the material passes on {strength:.2f}: where cells resolve the shear, the mass "
        f"slides too fast over a slow base; {remedy}"
    )


def _strongest(friction: "BasalFriction | float", zones: "FrictionZones") -> float:
    """Largest coefficient at rest [1] in any zone of a friction, or of a friction angle [rad]."""
    return float(zones.coefficients(math.tan(friction) if isinstance(friction, float) else friction)[:, 0].max())
