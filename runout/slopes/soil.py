"""Soil and choices of ``runout suggest-release``: options before site.yaml before defaults, and which of them are assumptions."""

from typing import Any

import numpy as np

from runout.config.distributions import Discrete, Distribution, Normal, Triangular, Uniform
from runout.config.stability import DEGREES, StabilitySettings
from runout.ensemble.design import quantiles
from runout.model.soil_limits import RANGES
from runout.slopes.choices import SAMPLED, PatchChoices, Strength

ANGLE = "friction_angle"


def resolved(
    strength: Strength | None = None, choices: PatchChoices | None = None, stated: StabilitySettings | None = None
) -> StabilitySettings:
    """What holds: options, else what site.yaml states, else the defaults."""
    site = stated or StabilitySettings()
    options = vars(strength or Strength()) | vars(choices or PatchChoices())
    from_options = {_key(name): _sampled(name, value) for name, value in options.items() if value is not None}
    from_site = {name: getattr(site, name) for name in site.model_fields_set}
    if "transmissivity_recharge" in from_options:
        from_site.pop("saturation", None)
    elif "saturation" in from_options:
        from_site.pop("transmissivity_recharge", None)
    return StabilitySettings(**from_site | from_options)


def _key(name: str) -> str:
    """Key of site.yaml of an option."""
    return name + DEGREES if name == ANGLE else name


def _sampled(name: str, value: Any) -> Any:
    """A range as a distribution; one without extent is a number."""
    if name not in SAMPLED:
        return value
    low, high = value
    return Uniform(distribution="uniform", low=low, high=high) if low < high else float(low)


def values(entry: "Distribution | float", probability: np.ndarray) -> np.ndarray:
    """Values (n,) of a number or distribution below which it lies with ``probability`` (n,) [1]."""
    if isinstance(entry, int | float):
        return np.full(len(probability), float(entry))
    return quantiles(entry, np.clip(probability, np.finfo(float).eps, 1.0 - np.finfo(float).eps))


def assumptions(soil: StabilitySettings) -> str:
    """Sentence on the properties of the soil that nobody stated; empty if all are."""
    water = "transmissivity_recharge" if soil.saturation is None else "saturation"
    names = ("cohesion", ANGLE, "soil_thickness", "soil_density", water)
    assumed = [name for name in names if _key(name) not in soil.model_fields_set]
    if not assumed:
        return ""
    listed = ", ".join(f"{name.replace('_', ' ')} {_words(getattr(soil, _key(name)), RANGES[name].unit)}" for name in assumed)
    return f"assumed, not values of this place: {listed}; state yours in site.yaml (stability: ...) or as options"


def _words(entry: Any, unit: str) -> str:
    return f"{numbers(entry)} {unit}".rstrip()


def numbers(entry: Any) -> str:
    """A number or distribution in words."""
    match entry:
        case Uniform():
            return f"{entry.low:g} to {entry.high:g}"
        case Triangular():
            return f"{entry.low:g} to {entry.high:g}, most likely {entry.mode:g}"
        case Normal():
            return f"{entry.mean:g} ± {entry.standard_deviation:g}"
        case Discrete():
            return " or ".join(f"{value:g}" for value in entry.values)
        case _:
            return f"{entry:g}"


def record(soil: StabilitySettings) -> dict[str, Any]:
    """For a JSON record: soil and choices by the keys of site.yaml, and which of them are defaults."""
    content = soil.model_dump(mode="json", exclude_none=True)
    return {**content, "defaults": [name for name in content if name not in soil.model_fields_set]}
