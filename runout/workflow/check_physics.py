"""Checks the physics of the members of a site: basal friction in effect, and wave speed relative to flow speed."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.model.basal_strength import least_angle, sentence, strengths

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.friction import FrictionZones
    from runout.model.materials import Material
    from runout.model.release import Release

WAVES_OVER_FLOW = 10.0  # ratio of wave speed to flow speed below which the stiffness affects the run-out
AT_BASE = "basal_friction_angle_deg"


@dataclass(frozen=True)
class Bases:
    """Basal friction of the ground and strength of the mass under one release, each (members,) [1]."""

    name: str
    ground: np.ndarray
    strength: np.ndarray


def warnings(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None") -> Iterator[str]:
    """Warnings of a site whose inputs have been read.

    Raises
    ------
    MaterialError
        If the sampled parameters of a member are not a valid material.
    """
    if not releases:
        return
    materials = _materials(site)
    bases = _bases(site, releases, materials)
    for base in bases:
        yield from _stronger_ground(base, zones)
    materials += [r.material for r in releases if r.material]
    yield from _slow_waves(min(materials, key=lambda m: m.wave_speed), releases, _least(bases, zones))


def least_friction(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None" = None) -> float:
    """Smallest friction angle [rad] that acts at the base of any release in any member and zone."""
    if not releases:
        return math.radians(site.settings.basal_friction_angle_deg)
    return _least(_bases(site, releases, _materials(site)), zones)


def _least(bases: list[Bases], zones: "FrictionZones | None") -> float:
    return min(least_angle(np.arctan(base.ground).tolist(), base.strength.tolist(), zones) for base in bases)


def _bases(site: "Site", releases: "Sequence[Release]", materials: "list[Material]") -> list[Bases]:
    """Friction and strength at the base of each release for all members with these ``materials``."""
    height = float(np.broadcast_to(np.asarray(site.grid(releases)["cell_size"], float), 3)[2])
    angles = [float(sample.get(AT_BASE, site.settings.basal_friction_angle_deg)) for sample in _samples(site)]
    ground, own = np.tan(np.radians(angles)), np.array(strengths(materials, height))
    bases = []
    for r in releases:
        friction = ground if r.basal_friction_angle is None else np.full_like(ground, math.tan(r.basal_friction_angle))
        strength = own if r.material is None else np.full_like(own, strengths([r.material], height)[0])
        bases.append(Bases(r.name, friction, strength))
    return bases


def _samples(site: "Site") -> list[dict[str, float]]:
    from runout.ensemble.design import member_table

    table = member_table(site.settings.ensemble)
    return table.drop(columns=["weight", "seed"]).to_dict("records")  # type: ignore[no-any-return]


def _materials(site: "Site") -> "list[Material]":
    """Material of each member; one object if none of its parameters is sampled."""
    samples = _samples(site)
    if samples and not set(samples[0]) - {AT_BASE, "release_volume_factor"}:
        return [site.material()] * len(samples)
    return [site.material(sample) for sample in samples]


def _stronger_ground(base: Bases, zones: "FrictionZones | None") -> Iterator[str]:
    """Sentence on the friction in effect if the ground is stronger than the mass of a release in some members."""
    ground = np.array([zones.at_cells(f).max() for f in base.ground.tolist()]) if zones else base.ground
    limited = np.flatnonzero(ground > base.strength)
    if not len(limited):
        return
    k = limited[np.argmax(ground[limited] / base.strength[limited])]
    said = sentence(base.name, float(ground[k]), float(base.strength[k]), in_zones=bool(ground[k] > base.ground[k]))
    yield said if len(ground) == 1 else f"{said} (member {k}; so in {len(limited)} of {len(ground)} members)"


def _slow_waves(softest: "Material", releases: "Sequence[Release]", angle: float) -> Iterator[str]:
    """Warn of pressure waves less than ten times as fast as the flow may become at the friction ``angle``."""
    from runout.terrain.energy_line import largest_speed

    speed = largest_speed(releases, angle)
    times = softest.wave_speed / speed if speed > 0 else math.inf
    if times < WAVES_OVER_FLOW:
        stiff = softest.youngs_modulus * (WAVES_OVER_FLOW / times) ** 2
        yield (
            f"pressure waves of {softest.wave_speed:.3g} m/s are only {times:.2g} times as fast as the flow may become, "
            f"{speed:.3g} m/s (energy line from the centre of the release, least friction); below {WAVES_OVER_FLOW:g} times "
            f"the stiffness may affect the run-out; youngs_modulus >= {stiff:.2g} Pa avoids it"
        )
