"""Block ``stability`` of site.yaml: the soil and the choices of ``runout suggest-release``, equal to its options."""

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from runout.config.distributions import Distribution, Settings, Uniform, plausible_degrees, quantity, refuse, shape, within_range
from runout.model.limits import MOST_SAMPLES, SOIL_RANGES

DEGREES = "_deg"
DENSITY, SAMPLES, SEED = 2000.0, 256, 0
PROBABILITY, DRAINAGE, AREA, MOST = 0.5, 1e5, 500.0, 20


def _bounds(name: str) -> Any:
    bounds: Any = SOIL_RANGES[name].bounds()
    return Field(**bounds)


def _soil(name: str) -> Any:
    """Type of a number, or of a distribution, in the range of a soil parameter."""
    valid = SOIL_RANGES[name]
    number: Any = Annotated[float, _bounds(name), Tag("<number>")]
    if valid.degrees:
        number = Annotated[float, _bounds(name), AfterValidator(plausible_degrees), Tag("<number>")]
    several: Any = Annotated[Distribution, AfterValidator(lambda distribution: within_range(valid, distribution)), Tag("<block>")]
    return Annotated[number | several, Discriminator(shape)]


def _uniform(low: float, high: float) -> Uniform:
    return Uniform(distribution="uniform", low=low, high=high)


def _power_of_two(count: int) -> int:
    """The number of samples; it is refused if it is no power of two."""
    if count & (count - 1):
        raise refuse(f"{count} is no power of two", "such as 256")
    return count


class StabilitySettings(Settings):
    """Soil of a slope that may fail, and which cells make a release; `runout suggest-release` reads it. Members do not use it."""

    cohesion: _soil("cohesion") = quantity(  # type: ignore[valid-type]
        "of soil and roots; a number or a distribution", _uniform(0.0, 4900.0), unit="Pa"
    )
    friction_angle_deg: _soil("friction_angle") = quantity(  # type: ignore[valid-type]
        "internal friction angle; a number or a distribution", _uniform(30.0, 45.0), unit="deg"
    )
    soil_thickness: _soil("soil_thickness") = quantity(  # type: ignore[valid-type]
        "vertical thickness above the failure surface; a number or a distribution", _uniform(0.5, 1.5), unit="m"
    )
    soil_density: Annotated[float, _bounds("soil_density")] = quantity("wet bulk density", DENSITY, unit="kg m-3")
    transmissivity_recharge: _soil("transmissivity_recharge") = quantity(  # type: ignore[valid-type]
        "transmissivity over recharge, small in wet weather; a number or a distribution", _uniform(2000.0, 3000.0), unit="m"
    )
    saturation: _soil("saturation") | None = quantity(  # type: ignore[valid-type]
        "share of the thickness below water, instead of the wetness from drainage area and recharge; a number or a distribution",
        None,
        examples=[0.8],
    )
    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES), AfterValidator(_power_of_two)] = quantity(
        "number of samples, a power of two", SAMPLES
    )
    sample_seed: int = quantity("seed of the samples", SEED, ge=0)
    probability: float = quantity("least probability of failure of the cells of a release", PROBABILITY, gt=0, le=1)
    largest_drainage: float = quantity("largest drainage area of these: larger ones are channels", DRAINAGE, unit="m2", gt=0)
    least_area: float = quantity("least area of a release", AREA, unit="m2", gt=0)
    most: int = quantity("largest number of releases, the first in rank", MOST, ge=1)

    @model_validator(mode="after")
    def _one_wetness(self) -> "StabilitySettings":
        if self.saturation is not None and "transmissivity_recharge" in self.model_fields_set:
            raise refuse("has no meaning with saturation", "remove one of the two", "transmissivity_recharge")
        return self


STABILITY = quantity(
    "soil and choices of `runout suggest-release`; members do not use it",
    None,
    examples=[{"cohesion": {"distribution": "uniform", "low": 0.0, "high": 4900.0}, "friction_angle_deg": 35.0}],
)
