"""The basal friction of a site: of its members and of its releases."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from runout.config.friction import ANGLE, BLOCK, KEY, PREFIX, FrictionSettings
from runout.config.schema import SiteSettings
from runout.model.friction_laws import DEFAULT_FRICTION, FRICTIONS, FrictionLaw

if TYPE_CHECKING:
    from runout.model.basal_friction import BasalFriction
    from runout.model.release import Release


@dataclass(frozen=True)
class SiteFriction:
    """What site.yaml says of basal friction."""

    settings: SiteSettings

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

    def under(self, releases: "Sequence[Release]", sample: Mapping[str, float]) -> "list[Release]":
        """The releases with what site.yaml states for each; the other parameters of the law are those of a member."""
        own = {r.name: r.basal_friction for r in self.settings.release if r.basal_friction}
        if not own or not {ANGLE, KEY} & self.settings.model_dump(include={ANGLE, KEY}, exclude_none=True).keys():
            return list(releases)  # of a file that states no friction yet nothing more can be said
        made = {name: self._block.sampled_friction(sample, values) for name, values in own.items()}
        return [replace(r, basal_friction=made[r.name]) if r.name in made else r for r in releases]

    def of_releases(self, releases: "Sequence[Release]", sample: Mapping[str, float]) -> "list[BasalFriction | float]":
        """Friction under each release of a member, or its angle [rad]."""
        return [r.friction_on(self.of_run(sample)) for r in self.under(releases, sample)]
