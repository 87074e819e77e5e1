"""Basal friction: settings that are made from the declarations of its laws, and what a site states of it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import ValidationInfo, create_model

from runout.config.declared import declared_fields, sampled_in
from runout.config.distributions import Settings, quantity, refuse
from runout.config.law_block import LawBlock, LawSettings
from runout.config.wording import shown
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw
from runout.model.limits import Range

if TYPE_CHECKING:
    from runout.config.inflow import InflowSettings
    from runout.config.schema import ReleaseSettings, SiteSettings
    from runout.model.inflow import Inflow
    from runout.model.release import Release

    Mass = TypeVar("Mass", Release, Inflow)

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


def stated_law(site: Any) -> FrictionLaw | None:
    """The law of friction of a site.yaml as it is stated; None if it names none that is known."""
    block = site.get(KEY) if isinstance(site, dict) else None
    return BLOCK.known_law({} if block is None else block)


def sampled_ranges(law: FrictionLaw | None = None) -> dict[str, Range]:
    """Range of each parameter of friction that an ensemble may sample, by its key: of a law, or of all known laws."""
    laws = [law] if law else FRICTIONS.known()
    return {PREFIX + key: valid for each in laws for key, valid in sampled_in(each.parameters).items()}


@cache
def own_model(law: FrictionLaw) -> type[Settings]:
    """Settings of parameters that a release or a zone states in the place of those of the site; each may be left out."""
    fields: dict[str, Any] = {}
    for key, (kind, field) in declared_fields(law.parameters).items():
        fields[key] = (Annotated[kind | None, field], None)
    return create_model(f"Own{law.friction.__name__}", __base__=Settings, **fields)


def own_parameters(attributes: bool) -> Callable[[Any, ValidationInfo], Any]:
    """Check of a block of own parameters; with ``attributes`` a value may be the name of one.

    The context of the validation may hold the ``friction`` law; that of the parameters counts otherwise.
    """

    def checked(block: Any, info: ValidationInfo) -> Any:
        if not isinstance(block, dict):
            raise refuse(f"{shown(block)}; a block is needed", "write {parameter: value, ...}")
        if not block:
            raise refuse("states no parameter", "add one of its law, or remove it")
        law = (info.context or {}).get("friction") or _law_with(block)
        fields = own_model(law).model_fields
        named = {key for key, value in block.items() if attributes and isinstance(value, str) and key in fields}
        numbers = own_model(law).model_validate({key: value for key, value in block.items() if key not in named})
        empty = next((key for key, value in block.items() if value is None), None)
        if empty is not None:
            raise refuse("has no value; a number is needed", "write it, or remove the key", empty)
        return {key: value if key in named else getattr(numbers, key) for key, value in block.items()}

    return checked


def _law_with(block: Mapping[str, Any]) -> FrictionLaw:
    """The known law that has the parameters of a block; the default where none has."""
    having = (law for law in FRICTIONS.known() if set(block) <= {p.key for p in law.parameters})
    return next(having, FRICTIONS.find(DEFAULT_FRICTION))


@dataclass(frozen=True)
class SiteFriction:
    """What site.yaml says of basal friction."""

    settings: "SiteSettings"

    @property
    def law(self) -> FrictionLaw:
        """The law."""
        block = self.settings.basal_friction
        return FRICTIONS.find(DEFAULT_FRICTION if block is None else block.law)

    @property
    def _block(self) -> FrictionSettings:
        """The block of the law; made of the angle where site.yaml states only that."""
        stated = self.settings.basal_friction
        angle = {ANGLE.removeprefix(PREFIX): self.settings.basal_friction_angle_deg}
        return stated or BLOCK.settings_of(self.law).model_validate(angle)  # type: ignore[no-any-return]

    def arguments(self, sample: Mapping[str, float]) -> dict[str, Any]:
        """Arguments of :func:`runout.simulate` for a member with sampled parameters."""
        if self.settings.basal_friction is not None:
            return {"basal_friction": self.settings.basal_friction.sampled_friction(sample)}
        return {"basal_friction_angle": float(sample.get(ANGLE, self.settings.basal_friction_angle_deg))}  # type: ignore[arg-type]

    def of_run(self, sample: Mapping[str, float]) -> "BasalFriction | float":
        """Friction of a member under the releases that state none, or its angle [rad]."""
        found = self.arguments(sample)
        return found["basal_friction"] if "basal_friction" in found else math.radians(found["basal_friction_angle"])

    def under(self, releases: "Sequence[Mass]", sample: Mapping[str, float]) -> "list[Mass]":
        """The releases or inflows with what site.yaml states for each; the other parameters of the law are those of a member."""
        stated: list[ReleaseSettings | InflowSettings] = [*self.settings.release, *(self.settings.inflow or [])]
        own = {r.name: r.basal_friction for r in stated if r.basal_friction}
        if not own or not {ANGLE, KEY} & self.settings.model_dump(include={ANGLE, KEY}, exclude_none=True).keys():
            return list(releases)  # of a file that states no friction yet nothing more can be said
        made = {name: self._block.sampled_friction(sample, values) for name, values in own.items()}
        return [replace(r, basal_friction=made[r.name]) if r.name in made else r for r in releases]

    def of_releases(self, releases: "Sequence[Release]", sample: Mapping[str, float]) -> "list[BasalFriction | float]":
        """Friction under each release of a member, or its angle [rad]."""
        return [r.friction_on(self.of_run(sample)) for r in self.under(releases, sample)]
