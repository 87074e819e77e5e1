"""Settings of the material and of sampled parameters, derived from the declarations of the laws."""

from collections.abc import Iterator, Mapping
from functools import cache, partial
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, SerializeAsAny, ValidationInfo, create_model

from runout.config import bed, pore_pressure, release_start
from runout.config import friction as basal
from runout.config.declared import sampled_in
from runout.config.distributions import Distribution, Settings, within_range
from runout.config.law_block import LawBlock, LawSettings
from runout.model.erosion_laws import EROSIONS, ErosionLaw
from runout.model.friction_laws import FRICTIONS, FrictionLaw
from runout.model.laws import LAWS, Law
from runout.model.limits import LIMITS, Range
from runout.model.materials import Material

DEFAULT_LAW = "drucker_prager"
INFLOW_SAMPLED: dict[str, Range] = {name: LIMITS[name] for name in ("discharge_factor", "inflow_delay")}
OF_THE_RUN = {name: LIMITS[name] for name in ("release_volume_factor", "bulking")} | pore_pressure.SAMPLED | INFLOW_SAMPLED


class MaterialSettings(LawSettings):
    """The material: its law and the parameters of the law."""

    @classmethod
    def block(cls) -> LawBlock[Law]:
        """The block ``material``."""
        return BLOCK

    def material(self, sample: dict[str, float] | None = None) -> Material:
        """The material; sampled parameters (by key) replace the stated ones."""
        material: Material = self.with_values(sample or {})
        return material


BLOCK: LawBlock[Law] = LawBlock(LAWS, DEFAULT_LAW, MaterialSettings)
KEY = "material"
settings_of, known_law, validated_material = BLOCK.settings_of, BLOCK.known_law, BLOCK.validated


def sampled_ranges(
    law: Law | None = None, friction: FrictionLaw | None = None, erosion: ErosionLaw | None = None
) -> dict[str, Range]:
    """Range of each parameter that an ensemble may sample, by its key: of some laws, or of all known ones where none is given."""
    laws = [law] if law else LAWS.known()
    of_material = sampled_in(p for each in laws for p in each.parameters)
    return basal.sampled_ranges(friction) | OF_THE_RUN | bed.sampled_ranges(erosion) | of_material


def own_material(block: Any, info: ValidationInfo) -> Any:
    """Check of the material of a release or inflow: :meth:`LawBlock.own_settings`; the context may hold the ``law`` of the site."""
    return BLOCK.own_settings(block, (info.context or {}).get("law"))


OwnMaterial = Annotated[SerializeAsAny[MaterialSettings] | dict[str, float | bool | str], BeforeValidator(own_material)]


@cache
def _parameters(
    law: Law | None, friction: FrictionLaw | None, erosion: ErosionLaw | None, own: tuple[tuple[str, Range], ...],
    _known: tuple[Any, ...],
) -> type[Settings]:  # fmt: skip
    """Settings model with a distribution for each parameter that may be sampled; ranges are those of the laws."""
    ranges = sampled_ranges() | sampled_ranges(law, friction, erosion) | dict(own)
    fields: dict[str, Any] = {
        key: (Annotated[Distribution, AfterValidator(partial(within_range, valid))] | None, None) for key, valid in ranges.items()
    }
    return create_model("Parameters", __base__=Settings, **fields)


def parameters_model(
    law: Law | None = None, friction: FrictionLaw | None = None, erosion: ErosionLaw | None = None,
    own: Mapping[str, Range] | None = None,
) -> type[Settings]:  # fmt: skip
    """Settings of ``ensemble.parameters`` for laws of material, friction and erosion; each field is a distribution.

    ``own`` are the ranges of parameters of one release (:mod:`runout.config.release_laws`).
    """
    return _parameters(law, friction, erosion, tuple((own or {}).items()), (*LAWS.known(), *FRICTIONS.known(), *EROSIONS.known()))


def sampled_parameters(block: Any, info: ValidationInfo) -> Any:
    """Checked distributions of a block of parameters, by name. A value that is not a block is returned for the next check.

    The context of the validation may hold the ``law``, the ``friction`` law and the ``erosion`` law whose ranges apply, and the
    ranges of those of single releases, ``own``; without these, any known law has a parameter of a release.
    """
    if not isinstance(block, dict):
        return block
    context, known = info.context or {}, sampled_ranges() | release_start.RANGES
    own = {key: context.get("own", {}).get(key) or known.get(str(key).partition(basal.OF_RELEASE)[2]) for key in block}
    of_releases = {key: valid for key, valid in own.items() if valid and basal.OF_RELEASE in key}
    laws = context.get("law"), context.get("friction"), context.get("erosion")
    checked = parameters_model(*laws, of_releases).model_validate(block)
    return {name: getattr(checked, name) for name in block}


def foreign_parameters(block: Any, friction: FrictionLaw | None, sampled: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters that neither the law of a material block nor the friction law has: key, message and remedy."""
    law = known_law(block)
    for key in sampled:
        of_material = [other.name for other in LAWS.known() if key in sampled_in(other.parameters)]
        if law and of_material and key not in sampled_ranges(law):
            yield key, f"the law {law.name} has no such parameter", f"remove it, or use law: {' or '.join(of_material)}"
        of_friction = [other.name for other in FRICTIONS.known() if key in basal.sampled_ranges(other)]
        if friction and of_friction and friction.name not in of_friction:
            fix = f"remove it, or use basal_friction: {{law: {' or '.join(of_friction)}}}"
            yield key, f"the friction law {friction.name} has no such parameter", fix
