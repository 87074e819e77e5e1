"""Stiffness of a site's members: which modulus, how fast its waves are, how far its weight strains it, and whether that will do."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from runout.config.release_start import SPEED, key_of
from runout.forecast.stiffness import Stiffness, slowed_by_drag
from runout.model.column_resistance import ground_below
from runout.model.parameters import AUTO
from runout.model.scene import STANDARD_GRAVITY
from runout.terrain.energy_line import largest_speed, speeds_with_drag
from runout.workflow.check_physics import Bases, Sample, bases_of, materials_of, samples_of

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.model.friction import FrictionZones
    from runout.model.ground_friction import GroundFriction
    from runout.model.materials import Material
    from runout.model.release import Release

LEAST_RATIO = 3.0  # speed of pressure waves over that of the flow below which compression shows in run-out and overtopping
LARGEST_STRAIN = 0.03  # by the own weight, above which the stiffness shows in every flow
EXACT = 5  # friction angles at which the energy line is drawn; between them v^2 is nearly linear in the friction
SLID, FEW_POINTS = 9, 4  # members whose points slide against drag; points of each in a rough estimate
VOLUME = "release_volume_factor"


def member_stiffness(
    site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None", samples: "Sequence[Sample]"
) -> list[Stiffness]:
    """Stiffness of members with some sampled parameters, from ``releases`` of unchanged volume.

    Their outlines do not change; a thicker mass counts as fast as the thinner one.

    Raises MaterialError if the parameters of a member make no material.
    """
    bases, drags = bases_of(site, releases, samples), any(law.drags for law in site.friction.laws)
    at_start = [np.array([sample.get(key_of(r.name, SPEED), r.start_speed) for sample in samples], float) for r in releases]
    speeds = np.max([_speeds(r, b.acting(zones), own) for r, b, own in zip(releases, bases, at_start, strict=True)], 0)
    own = materials_of(site, releases, samples)
    if drags:
        speeds = _less_drag(releases, [_ground(bases, k, of, zones) for k, of in enumerate(own)], speeds)
        speeds = np.maximum(speeds, np.max(at_start, 0))
    thickest, found = max(float(r.thickness.max()) for r in releases), []
    for sample, materials, speed in zip(samples, own, speeds.tolist(), strict=True):
        thickness = thickest * float(sample.get(VOLUME, 1.0))
        chosen = tuple(m.chosen(speed, thickness, STANDARD_GRAVITY) for m in materials)
        found.append(Stiffness(chosen, speed, thickness, drags))
    return found


def _ground(bases: "Sequence[Bases]", k: int, materials: "Sequence[Material]", zones: "FrictionZones | None") -> "GroundFriction":
    """Friction of the ground below the releases of member ``k``."""
    strength, effective = [float(b.resting[k]) for b in bases], [b.effective[k] for b in bases]
    return ground_below(materials, [b.frictions[k] for b in bases], strength, zones, effective)


def _less_drag(releases: "Sequence[Release]", grounds: "Sequence[GroundFriction]", speeds: np.ndarray) -> np.ndarray:
    """Largest speeds (members,) [m/s] with drag; of many members those of some, and the others by a rough estimate of all."""
    if len(speeds) <= SLID:
        return slowed_by_drag(releases, grounds, speeds)
    rough = speeds_with_drag(releases, grounds, speeds, FEW_POINTS)
    chosen = np.argsort(rough)[np.linspace(0, len(rough) - 1, SLID).round().astype(int)]
    exact = slowed_by_drag(releases, [grounds[k] for k in chosen], speeds[chosen])
    return np.minimum(speeds, np.interp(rough, rough[chosen], exact))


def _speeds(release: "Release", angles: np.ndarray, at_start: np.ndarray) -> np.ndarray:
    """Largest speed (members,) [m/s] of a release against friction of ``angles`` (members,) [rad], with speeds ``at_start``."""
    distinct = np.unique(angles)
    if len(distinct) > EXACT:
        distinct = np.arctan(np.linspace(math.tan(distinct[0]), math.tan(distinct[-1]), EXACT))
    squares = [largest_speed([release], [angle]) ** 2 - release.start_speed**2 for angle in distinct.tolist()]
    return np.sqrt(np.interp(np.tan(angles), np.tan(distinct), squares) + at_start**2)  # type: ignore[no-any-return]


def site_stiffness(site: "Site", releases: "Sequence[Release]", zones: "FrictionZones | None") -> list[Stiffness]:
    """Stiffness of the site as it is stated, without sampled parameters, then of each member."""
    return member_stiffness(site, releases, zones, [{}, *samples_of(site)])


def warnings(found: "Sequence[Stiffness]") -> Iterator[str]:
    """What is wrong with stated moduli: waves hardly faster than the flow, or a mass that its own weight compresses."""
    soft = min(found, key=lambda s: s.wave_ratio)
    auto = f"youngs_modulus: {AUTO} avoids it"
    if soft.wave_ratio < 0.99 * LEAST_RATIO:
        yield (
            f"pressure waves of {soft.wave_speed:.3g} m/s are only {soft.wave_ratio:.2g} times as fast as the flow may become, "
            f"{soft.flow_speed:.3g} m/s ({_source(soft)}); below {LEAST_RATIO:g} times "
            f"the stiffness affects the run-out; {auto}"
        )
    strained = max(found, key=lambda s: s.weight_strain)
    if strained.weight_strain > LARGEST_STRAIN:
        yield (
            f"the weight of {strained.thickness:.3g} m strains the release by {100 * strained.weight_strain:.1f} %; above "
            f"{100 * LARGEST_STRAIN:g} % the stiffness affects the run-out; {auto}"
        )


def _source(found: Stiffness) -> str:
    """Where the speed of a flow comes from."""
    return "energy line from the centre of the release, least friction" + (", less drag" if found.drag else "")


def lines(materials: "Sequence[Material]", found: "Sequence[Stiffness]", names: "Sequence[str]") -> list[str]:
    """What ``runout check`` says: modulus, waves over flow, strain by the weight; of the site as stated, and of its members.

    ``materials`` are those that releases, by their ``names``, state; a line for each that differs.
    """
    own, *members = found
    said, different = [], {material: k for k, material in reversed(list(enumerate(materials)))}
    for material, k in sorted(different.items(), key=lambda pair: pair[1]):
        of_release = f"{names[k]}: " if len(different) > 1 else ""
        one = replace(own, materials=(own.materials[k],))
        said.append(
            f"stiffness {of_release}youngs_modulus {one.materials[0].modulus:.3g} Pa ({_why(one, material)}): {one.statement()}"
        )
        moduli = [s.materials[k].modulus for s in members]
        if moduli and min(moduli) < max(moduli):
            said.append(f"          {of_release}members: {min(moduli):.3g} to {max(moduli):.3g} Pa")
    if len(different) == 1 and material.youngs_modulus != AUTO:
        chosen = replace(material, youngs_modulus=AUTO).chosen(own.flow_speed, own.thickness, STANDARD_GRAVITY)
        fewer = (own.wave_speed + own.flow_speed) / (chosen.wave_speed + own.flow_speed)
        said.append(f"          auto would take {chosen.modulus:.3g} Pa: {fewer:.2g} times fewer steps")
    return said


def _why(own: Stiffness, material: "Material") -> str:
    """What set the modulus."""
    if material.youngs_modulus != AUTO:
        return "stated"
    if own.wave_ratio > 1.02 * material.wave_ratio:
        return f"auto, set by weight_strain {material.weight_strain:g}"
    return f"auto, set by wave_ratio {material.wave_ratio:g}"
