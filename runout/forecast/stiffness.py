"""Stiffness of a run whose Young's modulus is auto: that of pressure waves a few times as fast as its flow, and no stiffer."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.model.basal_friction import BasalFriction
from runout.model.basal_strength import effective_shares, least_angle
from runout.model.column_resistance import ground_below
from runout.model.friction import FrictionZones
from runout.model.ground_friction import GroundFriction
from runout.model.materials import Material
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY

LOGGER = logging.getLogger(__name__)
RECORDED = ("youngs_modulus", "wave_speed")  # by release, among the attributes of a run


@dataclass(frozen=True)
class Stiffness:
    """Stiffness of the materials of a run, and what it is measured by."""

    materials: tuple[Material, ...]  # one per release, each with a number as Young's modulus
    # largest speed that the flow may reach [m/s], by the energy line and the drag of the ground; 0 where every modulus was stated
    flow_speed: float
    thickness: float  # largest thickness of the releases [m]
    drag: bool = False  # whether drag of the ground counts in the speed

    @property
    def wave_speed(self) -> float:
        """Speed of pressure waves in the softest material [m/s]."""
        return min(m.wave_speed for m in self.materials)

    @property
    def wave_ratio(self) -> float:
        """:attr:`wave_speed` over that of the flow [1]; infinite for a mass that does not move."""
        return self.wave_speed / self.flow_speed if self.flow_speed > 0 else float("inf")

    @property
    def weight_strain(self) -> float:
        """Largest elastic strain of the releases under their own weight [1]."""
        return max(m.weight_strain_of(self.thickness, STANDARD_GRAVITY) for m in self.materials)

    def statement(self) -> str:
        """Waves, flow and strain in a sentence without a beginning and an end."""
        source = "energy line, less drag" if self.drag else "energy line"
        flow = f"{self.wave_ratio:.2g} times the flow of {self.flow_speed:.3g} m/s ({source})"
        return f"pressure waves of {self.wave_speed:.3g} m/s, {flow}, strain by weight {100 * self.weight_strain:.2g} %"


def stiffness(
    materials: Sequence[Material],
    releases: Sequence[Release],
    frictions: Sequence[BasalFriction | float],
    strength: Sequence[float],
    zones: FrictionZones | None = None,
    bed_ratio: float | None = None,
) -> Stiffness:
    """Stiffness of a run, with the moduli that are auto chosen (:meth:`runout.model.materials.Material.chosen`).

    The speed of the flow is that of :func:`runout.terrain.energy_line.largest_speed`: by the energy line from the centre of each
    mass against the least friction that acts on it anywhere, less what drag takes. The fastest of the releases counts for all of
    them, and so does the thickest.

    Parameters
    ----------
    materials : sequence of Material
        One per release.
    releases : sequence of Release
    frictions : sequence of BasalFriction or float
        Basal friction of each release, or its angle [rad].
    strength : sequence of float
        Largest friction coefficient [1] that each mass passes on to the ground.
        For a fluid at most that of its yield stress (:func:`runout.model.basal_strength.forecast_strengths`).
    zones : FrictionZones, optional
    bed_ratio : float, optional
        Pore pressure ratio [1] of mass from an erodible bed.
    """
    from runout.terrain.energy_line import largest_speed

    effective = effective_shares(releases, bed_ratio)
    bases = zip(frictions, strength, effective, strict=True)
    acting = [least_angle([friction], [s], zones, [share]) for friction, s, share in bases]
    line = largest_speed(releases, acting)
    ground = ground_below(materials, frictions, strength, zones, effective)
    (speed,) = slowed_by_drag(releases, [ground], np.array([line])).tolist()
    speed = max(speed, *(r.start_speed for r in releases))
    thickness = max(float(r.thickness.max()) for r in releases)
    return Stiffness(tuple(m.chosen(speed, thickness, STANDARD_GRAVITY) for m in materials), speed, thickness, ground.law.drags)


def slowed_by_drag(releases: Sequence[Release], grounds: Sequence[GroundFriction], speeds: np.ndarray) -> np.ndarray:
    """Largest ``speeds`` (members,) [m/s] by the energy line, less what drag takes (:mod:`runout.terrain.energy_line`).

    Laws without drag leave them as they are.
    """
    from runout.terrain.energy_line import speeds_with_drag

    return speeds_with_drag(releases, grounds, speeds) if grounds[0].law.drags and speeds.any() else speeds


def chosen_moduli(
    materials: Sequence[Material],
    releases: Sequence[Release],
    frictions: Sequence[BasalFriction | float],
    strength: Sequence[float],
    zones: FrictionZones | None = None,
    bed_ratio: float | None = None,
) -> tuple[Material, ...]:
    """The ``materials`` with numbers as moduli, as in :func:`stiffness`; nothing is computed where all are stated."""
    if all(not isinstance(m.youngs_modulus, str) for m in materials):
        return tuple(materials)
    stiffness_of_run = stiffness(materials, releases, frictions, strength, zones, bed_ratio)
    moduli = ", ".join(dict.fromkeys(f"{m.modulus:.3g}" for m in stiffness_of_run.materials))
    LOGGER.info("youngs_modulus %s Pa: %s", moduli, stiffness_of_run.statement())
    return stiffness_of_run.materials


def extremes(runs: Iterable[Mapping[str, Any]]) -> dict[str, list[float]]:
    """Smallest and largest Young's modulus [Pa] and speed of pressure waves [m/s] of the attributes of runs; empty without any."""
    told = [attributes for attributes in runs if set(RECORDED) <= set(attributes)]
    values = {name: np.concatenate([np.atleast_1d(np.asarray(a[name], float)) for a in told]) for name in RECORDED if told}
    return {name: [float(v.min()), float(v.max())] for name, v in values.items()}


def sentence_of(recorded: Mapping[str, Sequence[float]]) -> str:
    """What :func:`extremes` has found, in words."""
    modulus, speed = (" to ".join(f"{x:.3g}" for x in dict.fromkeys(recorded[name])) for name in RECORDED)
    return f"Young's modulus {modulus} Pa, pressure waves of {speed} m/s"
