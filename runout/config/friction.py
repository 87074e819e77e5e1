"""Basal friction: settings that are made from the declarations of its laws, and what a site states of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BeforeValidator, SerializeAsAny, ValidationInfo

from runout.config.declared import sampled_in
from runout.config.distributions import quantity
from runout.config.law_block import LawBlock, LawSettings
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw
from runout.model.limits import Range

if TYPE_CHECKING:
    from runout.config.inflow import InflowSettings
    from runout.config.schema import ReleaseSettings, SiteSettings
    from runout.model.inflow import Inflow
    from runout.model.release import Release

    Mass = TypeVar("Mass", Release, Inflow)

OF_RELEASE = "."  # between the name of a release and the key of a parameter that is sampled for it; names have none
PREFIX = "basal_"  # of the parameters of friction among those of an ensemble
ANGLE = "basal_friction_angle_deg"  # short form of the parameter of the default law
KEY = "basal_friction"


class FrictionSettings(LawSettings):
    """Basal friction: its law and the parameters of that."""

    law: str = quantity("law of friction")

    @classmethod
    def block(cls) -> LawBlock[FrictionLaw]:
        """The block ``basal_friction``."""
        return BLOCK

    def sampled_friction(self, sample: Mapping[str, float] | None = None, own: Mapping[str, float] | None = None) -> BasalFriction:
        """The friction, with sampled parameters of an ensemble and then ``own`` ones in the place of the stated ones."""
        law, sample = FRICTIONS.find(self.law), sample or {}
        sampled = {p.key: sample[PREFIX + p.key] for p in law.parameters if PREFIX + p.key in sample}
        friction: BasalFriction = self.with_values({**sampled, **(own or {})})
        return friction


BLOCK: LawBlock[FrictionLaw] = LawBlock(FRICTIONS, DEFAULT_FRICTION, FrictionSettings)


def own_sample(sample: Mapping[str, float], release: str) -> dict[str, float]:
    """What a member samples for one release alone, by the keys of its laws."""
    start = release + OF_RELEASE
    return {key.removeprefix(start): value for key, value in sample.items() if key.startswith(start)}


def stated_law(site: Any) -> FrictionLaw | None:
    """The law of friction of a site.yaml as it is stated; None if it names none that is known."""
    block = site.get(KEY) if isinstance(site, dict) else None
    return BLOCK.known_law({} if block is None else block)


def sampled_ranges(law: FrictionLaw | None = None) -> dict[str, Range]:
    """Range of each parameter of friction that an ensemble may sample, by its key: of a law, or of all known laws."""
    laws = [law] if law else FRICTIONS.known()
    return {PREFIX + key: valid for each in laws for key, valid in sampled_in(each.parameters).items()}


own_model = BLOCK.own_model


def own_friction(attributes: bool) -> Callable[[Any, ValidationInfo], Any]:
    """Check of the friction of a release, or with ``attributes`` of a zone: :meth:`LawBlock.own_settings`.

    The context of the validation may hold the ``friction`` law of the site.
    """
    return lambda block, info: BLOCK.own_settings(block, (info.context or {}).get("friction"), attributes=attributes)


OwnFriction = Annotated[SerializeAsAny[FrictionSettings] | dict[str, float], BeforeValidator(own_friction(attributes=False))]


@dataclass(frozen=True)
class SiteFriction:
    """What site.yaml says of basal friction."""

    settings: "SiteSettings"

    @property
    def law(self) -> FrictionLaw:
        """The law of the releases that have none of their own."""
        block = self.settings.basal_friction
        return FRICTIONS.find(DEFAULT_FRICTION if block is None else block.law)

    @property
    def laws(self) -> tuple[FrictionLaw, ...]:
        """The laws that releases and inflows follow."""
        own = [mass.basal_friction for mass in self.masses.values()]
        names = [f.law if isinstance(f, FrictionSettings) else self.law.name for f in own]
        return tuple(FRICTIONS.find(name) for name in dict.fromkeys(names or [self.law.name]))

    @property
    def _block(self) -> FrictionSettings:
        """The block of the law; made of the angle where site.yaml states only that."""
        block = self.settings.basal_friction
        angle = {ANGLE.removeprefix(PREFIX): self.settings.basal_friction_angle_deg}
        return block or BLOCK.settings_of(self.law).model_validate(angle)  # type: ignore[no-any-return]

    def arguments(self, sample: Mapping[str, float]) -> dict[str, Any]:
        """Arguments of :func:`runout.simulate` for a member with sampled parameters."""
        if self.settings.basal_friction is not None:
            return {"basal_friction": self.settings.basal_friction.sampled_friction(sample)}
        return {"basal_friction_angle": float(sample.get(ANGLE, self.settings.basal_friction_angle_deg))}  # type: ignore[arg-type]

    def of_run(self, sample: Mapping[str, float]) -> "BasalFriction | float":
        """Friction of a member under the releases that state none, or its angle [rad]."""
        arguments = self.arguments(sample)
        return arguments["basal_friction"] if "basal_friction" in arguments else math.radians(arguments["basal_friction_angle"])

    @property
    def masses(self) -> "dict[str, ReleaseSettings | InflowSettings]":
        """What site.yaml states of releases and inflows, by name."""
        masses: list[ReleaseSettings | InflowSettings] = [*self.settings.release, *(self.settings.inflow or [])]
        return {mass.name: mass for mass in masses}

    def under(self, releases: "Sequence[Mass]", sample: Mapping[str, float]) -> "list[Mass]":
        """The releases or inflows with what site.yaml states and a member samples for each; the rest is that of the site."""
        masses = self.masses
        own = [self.own(masses[r.name], sample) if r.name in masses else None for r in releases]
        return [r if friction is None else replace(r, basal_friction=friction) for r, friction in zip(releases, own, strict=True)]

    def own(self, release: Any, sample: Mapping[str, float]) -> BasalFriction | None:
        """Friction that a release or inflow of the settings has in a member; None if it is that of the site."""
        block, sampled = release.basal_friction, own_sample(sample, release.name)
        if isinstance(block, FrictionSettings):
            return block.sampled_friction(sampled)
        own = {key.removeprefix(PREFIX): value for key, value in sampled.items() if key.startswith(PREFIX)}
        of_site = self.settings.model_dump(include={ANGLE, KEY}, exclude_none=True)
        if not (block or own) or not of_site:  # of a file that states no friction yet nothing more can be said
            return None
        return self._block.sampled_friction(sample, {**(block or {}), **own})

    def of_releases(self, releases: "Sequence[Release]", sample: Mapping[str, float]) -> "list[BasalFriction | float]":
        """Friction under each release of a member, or its angle [rad]."""
        return [r.friction_on(self.of_run(sample)) for r in self.under(releases, sample)]
