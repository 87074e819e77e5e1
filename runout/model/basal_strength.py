"""Ground that is stronger than the mass on it: which friction acts, and what is said about it."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from runout.model.basal_friction import BasalFriction
from runout.model.friction import FrictionZones
from runout.model.friction_laws import numbers_of
from runout.model.materials import Material
from runout.model.release import Release
from runout.model.scene import STANDARD_GRAVITY, Scene
from runout.physics import geostatic


def strengths(materials: Sequence[Material], height: float) -> tuple[float, ...]:
    """Largest friction coefficient [1] that each material passes on to the ground in layers of a cell ``height`` [m] or more.

    Cohesion counts with the weight of one cell: it carries a larger share of a thinner layer, which no grid resolves, and a
    smaller one of a thicker layer, which resolves its own shear.
    """
    return tuple(m.shear_strength(m.density * STANDARD_GRAVITY * height) for m in materials)


def forecast_strengths(materials: Sequence[Material], releases: Sequence[Release], height: float) -> tuple[float, ...]:
    """Those of :func:`strengths` for forecasts: a fluid flows on ground that holds it, where its yield stress does not.

    The yield stress counts with the weight of the mean thickness of each release; mass that spreads is thinner and stands on
    steeper ground. So forecasts state too long a run-out rather than too short a one.
    """
    passed = zip(materials, releases, strengths(materials, height), strict=True)
    return tuple(min(most, resting_strength(m, r)) for m, r, most in passed)


def resting_strength(material: Material, release: Release, factor: float = 1.0) -> float:
    """Friction coefficient [1] at which a yield stress holds a release of ``factor`` times its mean thickness."""
    return material.resting_strength(material.density * STANDARD_GRAVITY * factor * release.mean_thickness)


def effective_shares(releases: Sequence[Release], bed_ratio: float | None = None) -> list[float]:
    """Least share [1] of the normal stress that the grains of each release carry, with mass of a bed of a pore pressure ratio.

    Mass that a dry release takes up is dry.
    """
    wettest = 1.0 if bed_ratio is None else 1.0 - bed_ratio
    return [min(r.least_effective, wettest) if r.pore_pressure else r.least_effective for r in releases]


def frictions_under(releases: Sequence[Release], basal: BasalFriction | float) -> list[BasalFriction | float]:
    """Basal friction under each release, or its friction angle [rad]; ``basal`` is that of the run."""
    return [r.friction_on(basal) for r in releases]


def least_angle(
    frictions: Sequence[BasalFriction | float], strength: Sequence[float], zones: FrictionZones | None = None,
    effective: Sequence[float] | None = None,
) -> float:  # fmt: skip
    """Smallest friction angle [rad] that acts on any cell at any speed, of masses with basal ``frictions`` and ``strength`` [1].

    A number is a friction angle [rad]. ``effective`` are the least shares [1] of the normal stress that the grains of each mass
    carry; all of it by default.
    """
    ground = [zones.least_angle(f) if zones else math.atan(f.least) if isinstance(f, BasalFriction) else f for f in frictions]
    acting = [min(g, math.atan(s)) for g, s in zip(ground, strength, strict=True)]
    shares = effective or [1.0] * len(acting)
    return min(a if e == 1.0 else math.atan(e * math.tan(a)) for a, e in zip(acting, shares, strict=True))


def sentences(scene: Scene, names: Sequence[str]) -> Iterator[str]:
    """Which friction acts, for each release (by ``names``) that meets ground stronger than its material."""
    zones = scene.friction_zones
    for name, friction, resting, strength in zip(names, scene.friction, scene.resting_friction, scene.strengths, strict=True):
        strongest = float(zones.coefficients(friction)[:, 0].max()) if zones else resting
        if strongest > strength:
            yield sentence(name, strongest, strength, in_zones=strongest > resting)


def unchanged(frictions: Sequence[BasalFriction | float], names: Sequence[str], zones: FrictionZones | None) -> Iterator[str]:
    """For each release, by ``names``, which parameters of zones and rasters its law of friction does not have.

    ``frictions`` are those of the releases; a number stands for the default law.
    """
    laws = [numbers_of(f)[0] for f in frictions]
    keys = {number: p.key for law in laws for number, p in zip(law.numbers, law.parameters, strict=True)}
    ground_keys = dict.fromkeys([*zones.replaced, *zones.gridded]) if zones else {}
    for name, law in zip(names, laws, strict=True):
        foreign = ", ".join(keys.get(number, number) for number in ground_keys if number not in law.numbers)
        if foreign:
            fault = f"the ground states {foreign}, which its friction law {law.name} does not have"
            yield f"{name}: {fault}; it has no effect on it"


def sentence(name: str, ground: float, strength: float, *, in_zones: bool = False) -> str:
    """Which friction acts where ``ground`` [1] is stronger than the mass of a release passes on, ``strength`` [1]."""
    where = "the ground of a friction zone" if in_zones else "the ground"
    acting = geostatic.acting_friction(ground, strength)
    return (
        f"{name}: {where} ({_words(ground)}) is stronger than the material; {_words(acting)} acts at the base, "
        "the most that the material passes on in steady shear"
    )


def _words(friction: float) -> str:
    return f"friction {friction:.3f}, {np.degrees(math.atan(friction)):.1f} deg"
