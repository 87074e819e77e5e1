"""Material and friction of each release: laws that site.yaml states for one, and parameters that an ensemble samples for one.

A block of a release that names a law is whole. A block without a law has some parameters, which replace those of the site. An
ensemble samples a parameter of one release under the key ``RELEASE.parameter``; it replaces what the release would have.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from runout.config import material, pore_pressure, release_start
from runout.config.declared import sampled_in
from runout.config.friction import BLOCK as FRICTION_BLOCK
from runout.config.friction import KEY as FRICTION
from runout.config.friction import OF_RELEASE, SiteFriction, own_sample, stated_law
from runout.config.friction import sampled_ranges as friction_ranges
from runout.config.material import KEY as MATERIAL
from runout.config.wording import choice_fix
from runout.model.friction_laws import FRICTIONS, FrictionLaw
from runout.model.laws import LAWS, Law
from runout.model.limits import Range
from runout.model.registry import Registry

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.basal_friction import BasalFriction
    from runout.model.inflow import Inflow
    from runout.model.materials import Material
    from runout.model.release import Release

    Mass = TypeVar("Mass", Release, Inflow)

Laws = tuple[Law | None, FrictionLaw | None]
VOLUME = "release_volume_factor"


def laws_of(settings: "SiteSettings") -> dict[str, tuple[Law, FrictionLaw]]:
    """Laws of the material and of friction that each release or inflow follows, by its name."""
    of_material, of_friction = settings.material.law, SiteFriction(settings).law.name
    return {
        name: (_law_of(mass, MATERIAL, of_material, LAWS), _law_of(mass, FRICTION, of_friction, FRICTIONS))
        for name, mass in SiteFriction(settings).masses.items()
    }


def _law_of(mass: Any, key: str, otherwise: str, laws: Registry[Any]) -> Any:
    """The law that a block of a release or inflow names, or that of the site."""
    return laws.find(getattr(getattr(mass, key, None), "law", otherwise))


def several_laws(settings: "SiteSettings") -> bool:
    """Whether the releases follow more than one law of the material, or of friction."""
    return any(len(set(laws)) > 1 for laws in zip(*laws_of(settings).values(), strict=True))


def stated_laws(site: Any) -> dict[str, Laws]:
    """The same of a site.yaml as it is stated; None for a law that is not known."""
    site = site if isinstance(site, dict) else {}
    of_site = (material.known_law(site.get(MATERIAL)), stated_law(site))
    laws_by_name: dict[str, Laws] = {}
    for name, mass in _stated_masses(site):
        own = mass.get(MATERIAL), mass.get(FRICTION)
        blocks: tuple[Any, Any] = material.BLOCK, FRICTION_BLOCK
        pairs = zip(own, of_site, blocks, strict=True)
        laws: list[Any] = [block.known_law(one) if names_law(one) else law for one, law, block in pairs]
        laws_by_name[name] = (laws[0], laws[1])
    return laws_by_name


def _stated_masses(site: Any) -> list[tuple[str, dict[str, Any]]]:
    """Name and block of every release and inflow of a site.yaml as it is stated; what is no block is left out."""
    keys = [key for key in ("release", "inflow") if isinstance(site, dict) and isinstance(site.get(key), list)]
    return [(str(mass.get("name", key)), mass) for key in keys for mass in site[key] if isinstance(mass, dict)]


def names_law(block: Any) -> bool:
    """Whether a block of a release names a law, so that it is whole."""
    return isinstance(block, dict) and "law" in block


def own_ranges(laws: Mapping[str, Laws]) -> dict[str, Range]:
    """Range of each parameter that an ensemble may sample for one release, by its key ``RELEASE.parameter``."""
    ranges_by_key: dict[str, Range] = {}
    for name, (of_material, of_friction) in laws.items():
        ranges = sampled_in(of_material.parameters) if of_material else {}
        ranges |= friction_ranges(of_friction) if of_friction else {}
        ranges_by_key |= {name + OF_RELEASE + key: valid for key, valid in ranges.items()}
    return ranges_by_key | pore_pressure.own_ranges(laws)


def unknown_own(site: Any, sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters of one release that it does not have: key, message and remedy."""
    laws = stated_laws(site)
    for key in sampled:
        name, dot, parameter = str(key).partition(OF_RELEASE)
        if not dot or parameter in release_start.RANGES:
            continue
        if name not in laws:
            yield key, f"no release or inflow is called {name!r}", choice_fix(name, list(laws))
        elif None not in laws[name] and key not in own_ranges({name: laws[name]}):
            names = " and ".join(law.name for law in laws[name] if law)
            own = [one.partition(OF_RELEASE)[2] for one in own_ranges({name: laws[name]})]
            yield key, f"the laws of {name}, {names}, have no such parameter", choice_fix(parameter, own)


def idle_parameters(site: Any, sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters that no release and no inflow has a use of: key, message and remedy.

    Those of the site's material or friction where every mass has one of its own, and a volume of releases where there are none.
    """
    site = site if isinstance(site, dict) else {}
    masses = [mass for _, mass in _stated_masses(site)]
    if VOLUME in sampled and masses and not site.get("release"):
        yield VOLUME, "the site has no release", "remove it, or sample discharge_factor, which multiplies all inflows"
    law, friction = material.known_law(site.get(MATERIAL)), stated_law(site)
    of_kinds = (MATERIAL, sampled_in(law.parameters) if law else {}), (FRICTION, friction_ranges(friction) if friction else {})
    for block, ranges in of_kinds:
        if masses and all(names_law(mass.get(block)) for mass in masses):
            for key in ranges.keys() & sampled.keys():
                fix = f"write NAME{OF_RELEASE}{key} for one of them, or remove it"
                yield key, f"every release and inflow has a {block} of its own, so that this changes nothing", fix


@dataclass(frozen=True)
class OwnLaws:
    """Materials and frictions of the releases of members, from what site.yaml states and a member samples."""

    settings: "SiteSettings"

    def under(self, releases: "Sequence[Mass]", sample: Mapping[str, float]) -> "list[Mass]":
        """The releases or inflows with the materials and frictions of a member; one that has none of its own stays as it is.

        Raises MaterialError or ConfigError if parameters of a member make no material or friction.
        """
        friction = SiteFriction(self.settings)
        masses, made = friction.masses, []
        for release in friction.under(releases, sample):
            own = self.material_of(masses[release.name], sample) if release.name in masses else None
            made.append(release if own is None else replace(release, material=own))
        return made

    def friction_of(self, release: Any, sample: Mapping[str, float]) -> "BasalFriction | None":
        """Friction under a release of the settings in a member; None if it is that of the site."""
        return SiteFriction(self.settings).own(release, sample)

    def material_of(self, release: Any, sample: Mapping[str, float]) -> "Material | None":
        """Material of a release of the settings in a member; None if it is that of the site."""
        block, sampled = getattr(release, MATERIAL, None), own_sample(sample, release.name)
        if isinstance(block, material.MaterialSettings):
            return block.material(sampled)
        site = getattr(self.settings, MATERIAL, None)  # of a file with an invalid material block there is none
        if site is None or not (block or sampled.keys() & sampled_in(LAWS.find(site.law).parameters).keys()):
            return None
        return site.material({**sample, **(block or {}), **sampled})  # type: ignore[no-any-return]
