"""Factor of safety of an infinite slope with sampled strength, thickness and wetness: options, then site.yaml, then defaults."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from runout.config.distributions import Discrete, Distribution, Normal, Triangular, Uniform
from runout.config.document import Document
from runout.config.problems import problems_of
from runout.config.stability import DEGREES, StabilitySettings
from runout.ensemble.design import quantiles
from runout.errors import ConfigError
from runout.model.limits import SOIL_RANGES
from runout.model.scene import STANDARD_GRAVITY
from runout.scores.slope_normal import terrain_slope
from runout.slopes.choices import SAMPLED, PatchChoices, Strength

if TYPE_CHECKING:
    from runout.slopes.drainage import Drainage

WATER_DENSITY = 1000.0  # [kg m-3]
LARGEST_FACTOR = 10.0  # factors of safety are cut there; level ground has no finite one
BLOCK = 16_384  # cells whose samples are held at once
ANGLE = "friction_angle"


@dataclass(frozen=True)
class Stability:
    """Stability of a terrain."""

    slope: np.ndarray  # (rows, columns): slope of the ground [rad]
    factor: np.ndarray  # (rows, columns): median factor of safety over the samples [1], at most :data:`LARGEST_FACTOR`
    probability: np.ndarray  # (rows, columns): share of the samples with a factor of at most 1
    # (rows, columns): mean vertical thickness of the samples that fail [m], 0 where none does. All maps are NaN where unknown
    thickness: np.ndarray


def sampled(soil: StabilitySettings) -> np.ndarray:
    """Samples (4, n) of cohesion [Pa], friction [1], thickness [m] and water, from a scrambled Sobol sequence.

    Water is the saturation [1] where that is stated, else recharge over transmissivity [m-1].
    """
    from scipy.stats import qmc

    probability = qmc.Sobol(4, scramble=True, rng=soil.sample_seed).random(soil.samples).T
    water = soil.transmissivity_recharge if soil.saturation is None else soil.saturation
    entries = (soil.cohesion, soil.friction_angle_deg, soil.soil_thickness, water)
    samples = np.stack([values(one, probability) for one, probability in zip(entries, probability, strict=True)])
    samples[1] = np.tan(np.radians(samples[1]))
    if soil.saturation is None:
        samples[3] = 1.0 / samples[3]
    return samples


def factor_of_safety(slope, cohesion, friction, thickness, wetness, density: float):  # type: ignore[no-untyped-def]
    """Factor of safety of an infinite slope [1].

    F = c / (rho g D sin(theta) cos(theta)) + (1 - w rho_w / rho) tan(phi) / tan(theta), with the vertical thickness D, that is
    h = D cos(theta) normal to the slope in Pack, Tarboton and Goodwin (1998, SINMAP) and in Strauch et al. (2018, Earth Surf.
    Dynam. 6:49), which landlab's LandslideProbability computes.

    Parameters
    ----------
    slope : ndarray
        [rad], above 0.
    cohesion, friction, thickness, wetness : ndarray
        c [Pa], tan(phi) [1], D [m], saturated share w of the thickness [1]; broadcast with ``slope``.
    density : float
        Wet bulk density rho [kg m-3].
    """
    sine, cosine = np.sin(slope), np.cos(slope)
    cohesive = cohesion / (density * STANDARD_GRAVITY * thickness * sine * cosine)
    return cohesive + (1.0 - wetness * (WATER_DENSITY / density)) * friction * cosine / sine


def stability(drained: "Drainage", soil: StabilitySettings) -> Stability:
    """Stability of every cell under all samples; each sample holds for the whole terrain.

    The wetness is w = min(1, R a / (T sin(theta))) with the specific drainage area a (Pack et al. 1998), or the saturation.
    """
    terrain = drained.terrain
    slope = terrain_slope(terrain.elevation, terrain.cell_size)
    known = np.flatnonzero(np.isfinite(slope))
    maps = np.full((3, slope.size), np.nan)
    samples = sampled(soil).astype(np.float32)
    theta, area = slope.ravel(), drained.specific_area.ravel()
    for cells in _blocks(known):
        maps[:, cells] = _of_cells(theta[cells], area[cells], samples, soil)
    factor, probability, thickness = maps.reshape(3, *slope.shape)
    return Stability(slope, factor, probability, thickness)


def _blocks(cells: np.ndarray) -> Iterator[np.ndarray]:
    for start in range(0, len(cells), BLOCK):
        yield cells[start : start + BLOCK]


def _of_cells(slope: np.ndarray, area: np.ndarray, samples: np.ndarray, soil: StabilitySettings) -> np.ndarray:
    """Median factor, probability and mean failing thickness (3, n) of cells (n,)."""
    theta = np.maximum(slope, math.radians(0.01)).astype(np.float32)[:, None]
    cohesion, friction, thickness, water = samples
    wetness = water[None, :]
    if soil.saturation is None:
        wetness = np.minimum(1.0, water * (area.astype(np.float32)[:, None] / np.sin(theta)))
    factors = factor_of_safety(theta, cohesion, friction, thickness, wetness, soil.soil_density)
    fails = factors <= 1.0
    count = fails.sum(axis=1)
    mean = np.divide(fails @ thickness, count, out=np.zeros(len(count)), where=count > 0)
    return np.stack([np.minimum(np.median(factors, axis=1), LARGEST_FACTOR), count / samples.shape[1], mean])


def resolved(
    strength: Strength | None = None, choices: PatchChoices | None = None, settings: StabilitySettings | None = None
) -> StabilitySettings:
    """What holds: options, else what site.yaml states, else the defaults.

    Raises ConfigError with all options whose values site.yaml could not state.
    """
    site = settings or StabilitySettings()
    options = vars(strength or Strength()) | vars(choices or PatchChoices())
    from_options = {_key(name): _sampled(name, value) for name, value in options.items() if value is not None}
    from_site = {name: getattr(site, name) for name in site.model_fields_set}
    if "transmissivity_recharge" in from_options:
        from_site.pop("saturation", None)
    elif "saturation" in from_options:
        from_site.pop("transmissivity_recharge", None)
    try:
        return StabilitySettings(**from_site | from_options)
    except ValidationError as error:
        problems = problems_of(error, Document("options"), whole=StabilitySettings)
        raise ConfigError([replace(one, line=None, key=_option(one.key)) for one in problems]) from error


def _key(name: str) -> str:
    """Key of site.yaml of an option."""
    return name + DEGREES if name == ANGLE else name


def _option(key: str) -> str:
    """The option that states a key of site.yaml or a part of it, such as ``cohesion.low``."""
    return "--" + key.partition(".")[0].removesuffix(DEGREES).replace("_", "-")


def _sampled(name: str, value: Any) -> Any:
    """A range as a distribution; one without extent is a number."""
    if name not in SAMPLED:
        return value
    low, high = value
    return float(low) if low == high else {"distribution": "uniform", "low": low, "high": high}


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
    listed = ", ".join(f"{name.replace('_', ' ')} {_words(getattr(soil, _key(name)), SOIL_RANGES[name].unit)}" for name in assumed)
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
