"""Settings of the material and of sampled parameters, derived from the declarations of the laws."""

import re
from collections.abc import Iterator
from functools import cache, partial
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ValidationInfo, create_model, model_validator

from runout.config.declared import declared_fields, sampled_in
from runout.config.distributions import Distribution, Settings, quantity, refuse, within_range
from runout.config.wording import choice_fix, shown
from runout.errors import MaterialError
from runout.model.laws import LAWS, Law
from runout.model.limits import LIMITS, Range
from runout.model.materials import Material

DEFAULT_LAW = "drucker_prager"
_WORDS: Any = Literal
OF_THE_RUN = {"basal_friction_angle_deg": LIMITS["basal_friction_angle"], "release_volume_factor": LIMITS["release_volume_factor"]}


class MaterialSettings(Settings):
    """The material: its law and the parameters of the law."""

    law: str

    def material(self, sample: dict[str, float] | None = None) -> Material:
        """The material; sampled parameters (by key) replace the stated ones."""
        law, values = LAWS.find(self.law), {**self.model_dump(exclude={"law"}), **(sample or {})}
        return law.material(**{p.name: values[p.key] for p in law.parameters})

    @model_validator(mode="after")
    def _fits_together(self) -> "MaterialSettings":
        try:
            self.material()
        except MaterialError as error:
            message, _, fix = _in_keys(str(error), LAWS.find(self.law)).partition("; ")
            raise refuse(message, fix) from None
        return self

    def __reduce__(self) -> Any:
        """Pickle the class of the law as well: importing its module registers the law in the other process."""
        return _restored, (LAWS.find(self.law).material, self.model_dump())


def _restored(material: type[Material], values: dict[str, Any]) -> MaterialSettings:
    return settings_of(LAWS.find(material.law)).model_validate(values)


def _in_keys(text: str, law: Law) -> str:
    """A message in which the keys of site.yaml replace the names of the parameters."""
    for p in law.parameters:
        text = re.sub(rf"\b{p.name}\b", p.key, text)
    return text


@cache
def settings_of(law: Law) -> type[MaterialSettings]:
    """Settings model of a material of this law."""
    names = ", ".join(LAWS.names())
    default = DEFAULT_LAW if law.name == DEFAULT_LAW else ...
    return create_model(
        f"{law.material.__name__}Settings",
        __base__=MaterialSettings,
        __doc__=(law.material.__doc__ or "").splitlines()[0],
        law=(_WORDS[law.name], quantity(f"material law: {names}", default)),
        **declared_fields(law.parameters),
    )


def law_named_in(block: Any) -> str | None:
    """Name of the law in a material block, known or not; None if the value is not a block."""
    return block.get("law", DEFAULT_LAW) if isinstance(block, dict) else None


def known_law(block: Any) -> Law | None:
    """The law that a material block names; None if no such law is known."""
    name = law_named_in(block)
    return LAWS.find(name) if isinstance(name, str) and name in LAWS.names() else None


def validated_material(block: Any) -> MaterialSettings:
    """Settings of a material block, validated by the model of the law that it names."""
    if isinstance(block, MaterialSettings):
        return block
    if not isinstance(block, dict):
        raise refuse(f"{shown(block)}; a block is needed", f"write {{law: {DEFAULT_LAW}, ...}}")
    name, names = law_named_in(block), LAWS.names()
    if name not in names:
        raise refuse(f"{name!r} is not known", choice_fix(name, names), "law")
    try:
        law = LAWS.find(str(name))
    except MaterialError as error:  # the package of the law cannot be imported
        message, _, fix = str(error).partition("; ")
        raise refuse(message, fix, "law") from None
    return settings_of(law).model_validate(block)


def sampled_ranges(law: Law | None = None) -> dict[str, Range]:
    """Range of each parameter that an ensemble may sample, by key, for one law or for all known laws."""
    laws = [law] if law else LAWS.known()
    return OF_THE_RUN | sampled_in(p for each in laws for p in each.parameters)


@cache
def _parameters(law: Law | None, _known: tuple[Law, ...]) -> type[Settings]:
    """Settings model with a distribution for each parameter that may be sampled; ranges are those of the law."""
    ranges = sampled_ranges() | (sampled_ranges(law) if law else {})
    fields: dict[str, Any] = {
        key: (Annotated[Distribution, AfterValidator(partial(within_range, valid))] | None, None) for key, valid in ranges.items()
    }
    return create_model("Parameters", __base__=Settings, **fields)


def parameters_model(law: Law | None = None) -> type[Settings]:
    """Settings of ``ensemble.parameters`` for a law; each field is a distribution."""
    return _parameters(law, LAWS.known())


def sampled_parameters(block: Any, info: ValidationInfo) -> Any:
    """Checked distributions of a block of parameters, by name. A value that is not a block is returned for the next check.

    The context of the validation may hold the ``law`` whose ranges apply.
    """
    if not isinstance(block, dict):
        return block
    checked = parameters_model((info.context or {}).get("law")).model_validate(block)
    return {name: getattr(checked, name) for name in block}


def foreign_parameters(block: Any, sampled: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters that the law of a material block does not have: key, message and remedy."""
    law = known_law(block)
    if law is None:
        return
    for key in sampled:
        others = [other.name for other in LAWS.known() if key in {p.key for p in other.parameters if p.sampled}]
        if others and key not in sampled_ranges(law):
            yield key, f"the law {law.name} has no such parameter", f"remove it, or use law: {' or '.join(others)}"
