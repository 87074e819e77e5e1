"""Scenarios of an ensemble: what distinguishes them, and how often each happens.

A scenario is a class of events, such as the releases of 1,000 to 10,000 m3. Its annual rate is that of the class alone, so that the
rates of all scenarios add up. A magnitude-frequency relation states how often a volume is reached or exceeded; the rate of a class
between two volumes is the difference of the rates at both::

    rate = N(>= low) - N(>= high)
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from runout.config.distributions import Distribution, Normal, Settings, limited, quantity, refuse
from runout.config.friction import OF_RELEASE
from runout.config.material import sampled_parameters
from runout.config.wording import choice_fix
from runout.errors import ConfigError
from runout.model.limits import is_number

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings

NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
VOLUME = "release_volume_factor"
FAILS = "fails"  # of a release, as RELEASE.fails: 1 in the members in which it fails, 0 in the others
RATES = ("return_period", "annual_rate", "exceedance_return_period", "power_law")
LONGEST_PERIOD, HIGHEST_RATE = 1e7, 1e3  # [a], [1/a]
Conflict = tuple[tuple[Any, ...], str, str]  # place within the ensemble or the site, what is wrong, remedy


class PowerLaw(Settings):
    """Part of the relation N(>= V) = coefficient V^-exponent of the annual rate of events of a volume V [m3] or more."""

    coefficient: float = quantity("annual rate of events of 1 m3 or more by that relation", unit="1/a", gt=0)
    exponent: float = quantity("exponent of the volume", gt=0, le=5)
    low: float = limited("volume", "smallest volume of the class")
    high: float | None = limited("volume", "largest volume of the class; without it all larger events belong to the class", None)

    @model_validator(mode="after")
    def _ordered(self) -> "PowerLaw":
        if self.high is not None and self.high <= self.low:
            raise refuse(f"low ({self.low:g}) is not below high ({self.high:g})", "exchange them", "low")
        return self

    @property
    def rate(self) -> float:
        """Annual rate of the class [1/a]."""
        ends = [self.low] if self.high is None else [self.low, self.high]
        above = [self.coefficient * volume**-self.exponent for volume in ends]
        return above[0] - (above[1] if self.high else 0.0)


def fixed_or_distributed(block: Any, info: ValidationInfo) -> Any:
    """Distributions of a scenario, in which a number stands for a parameter with this value in all members."""
    return sampled_parameters(with_fixed(block), info)


def with_fixed(block: Any) -> Any:
    """A block of parameters whose numbers are distributions of one value."""
    if not isinstance(block, Mapping):
        return block
    return {key: _only(value) if is_number(value) else value for key, value in block.items()}


def _only(value: Any) -> dict[str, Any]:
    return {"distribution": "discrete", "values": [value], "frequencies": [1.0]}


class ScenarioSettings(Settings):
    """A class of events, and how often it happens: one of return_period, annual_rate, exceedance_return_period, power_law."""

    name: str = quantity("name of the scenario", pattern=NAME, hint="letters, digits, - and _")
    return_period: float | None = quantity(
        "return period of this class alone; its rate is 1 / return_period",
        None,
        unit="a",
        gt=0,
        le=LONGEST_PERIOD,
        examples=[300.0],
    )
    annual_rate: float | None = quantity(
        "rate of this class alone, expected events in a year", None, unit="1/a", gt=0, le=HIGHEST_RATE, examples=[0.01]
    )
    exceedance_return_period: float | None = quantity(
        "return period of events as large as the smallest of this class or larger; its rate is that of these events less that "
        "of the next scenario of the same releases",
        None,
        unit="a",
        gt=0,
        le=LONGEST_PERIOD,
        examples=[30.0],
    )
    power_law: PowerLaw | None = quantity(
        "class of volumes of a relation N(>= V) = coefficient V^-exponent [1/a]: coefficient, exponent, low, high",
        None,
        examples=[{"coefficient": 3.0, "exponent": 0.6, "low": 1000.0, "high": 10000.0}],
    )
    releases: Annotated[list[str], Field(min_length=1)] | None = quantity(
        "names of the releases and inflows that fail; all without it", None, examples=[["upper"]]
    )
    parameters: Annotated[dict[str, Distribution], BeforeValidator(fixed_or_distributed)] = quantity(
        "values or distributions that replace or complete those of ensemble.parameters", {}
    )
    members: int | None = quantity("members of this scenario; ensemble.members without it", None, ge=1, le=100_000, examples=[16])

    @model_validator(mode="after")
    def _one_rate(self) -> "ScenarioSettings":
        keys = [key for key in RATES if getattr(self, key) is not None]
        if len(keys) != 1:
            raise refuse(f"{' and '.join(keys)} are both given" if keys else "no rate is given", f"give one of {', '.join(RATES)}")
        return self


def scenario_rates(scenarios: Sequence[ScenarioSettings]) -> list[float]:
    """Annual rate [1/a] of each scenario.

    Raises ConfigError if return periods of exceedance do not rise within scenarios of the same releases.
    """
    rates = []
    for k, one in enumerate(scenarios):
        rate = one.power_law.rate if one.power_law else one.annual_rate or 0.0
        if period := one.return_period or one.exceedance_return_period:
            rate = 1.0 / period
        if one.exceedance_return_period:
            later = next((s for s in scenarios[k + 1 :] if _same_relation(one, s)), None)
            rate -= 1.0 / later.exceedance_return_period if later else 0.0  # type: ignore[operator]
        rates.append(rate)
    if any(rate <= 0 for rate in rates):
        raise ConfigError("ensemble.scenarios: the exceedance_return_period of a relation must rise from each scenario to the next")
    return rates


def _same_relation(a: ScenarioSettings, b: ScenarioSettings) -> bool:
    """Whether two scenarios are classes of one relation of return periods of exceedance."""
    return bool(a.exceedance_return_period and b.exceedance_return_period) and _sources(a) == _sources(b)


def _sources(scenario: ScenarioSettings) -> frozenset[str] | None:
    return frozenset(scenario.releases) if scenario.releases else None


def scenario_conflicts(settings: "SiteSettings") -> Iterator[Conflict]:
    """Scenarios of a site that contradict each other or its releases: place in site.yaml, what is wrong, remedy."""
    scenarios, place = settings.ensemble.scenarios or [], ("ensemble", "scenarios")
    if scenarios and settings.ensemble.tolerance is not None:
        yield ("ensemble", "tolerance"), "an ensemble with scenarios does not grow by itself", "remove it; state members of each"
    for k, one in enumerate(scenarios):
        if one.name in [other.name for other in scenarios[:k]]:
            yield (*place, k, "name"), f"two scenarios are called {one.name!r}", "give each its own name"
        yield from (((*place, k, *key), message, fix) for key, message, fix in _of_releases(one, settings))
    yield from (((*place, k, *key), message, fix) for k, key, message, fix in _of_relations(scenarios))


def _of_releases(scenario: ScenarioSettings, settings: "SiteSettings") -> Iterator[Conflict]:
    """What the releases of a scenario contradict."""
    names = [mass.name for mass in (*settings.release, *(settings.inflow or ()))]
    failing = scenario.releases or names
    for name in failing:
        if name not in names:
            yield ("releases",), f"no release is called {name!r}", choice_fix(name, names)
    if len(set(failing)) < len(failing):
        yield ("releases",), "a release is listed twice", "list it once"
    for release in settings.release:
        trigger = release.starts_when
        if release.name in failing and trigger is not None and trigger.arrives in names and trigger.arrives not in failing:
            message = f"release {release.name} waits for the flow of {trigger.arrives}, which does not fail in this scenario"
            yield ("releases",), message, f"add {trigger.arrives}, or leave {release.name} out"
    for key in scenario.parameters:
        name = key.partition(OF_RELEASE)[0]
        if OF_RELEASE in key and name in names and name not in failing:
            yield ("parameters", key), f"release {name} does not fail in this scenario", "remove it, or list the release"


def _of_relations(scenarios: Sequence[ScenarioSettings]) -> Iterator[tuple[int, tuple[str, ...], str, str]]:
    """Return periods that do not rise and classes of volume that overlap, within scenarios of the same releases."""
    for k, one in enumerate(scenarios):
        for other in scenarios[:k]:
            a, b = other.power_law, one.power_law
            overlap = a and b and _sources(one) == _sources(other) and min(_high(a), _high(b)) > max(a.low, b.low)
            if overlap:
                message = f"its volumes overlap with those of scenario {other.name}, so that their events would count twice"
                yield k, ("power_law",), message, "let each class begin where the one before it ends"
        before = next((s for s in reversed(scenarios[:k]) if _same_relation(s, one)), None)
        if before and one.exceedance_return_period <= before.exceedance_return_period:  # type: ignore[operator]
            message = f"{one.exceedance_return_period:g} a is not longer than that of scenario {before.name} before it"
            fix = "list the classes of the same releases from the most frequent to the rarest"
            yield k, ("exceedance_return_period",), message, fix
        elif before and _has_smaller(one, before):
            message = f"it has volumes below the largest of scenario {before.name}, whose events are more frequent"
            yield k, ("parameters", VOLUME), message, "let each class begin where the one before it ends"


def _has_smaller(scenario: ScenarioSettings, before: ScenarioSettings) -> bool:
    """Whether a scenario has volumes below the largest of another one, of two that state volumes with ends."""
    own, other = (one.parameters.get(VOLUME) for one in (scenario, before))
    stated = own is not None and other is not None and not any(isinstance(one, Normal) for one in (own, other))
    return stated and own.support()[0] < other.support()[1]  # type: ignore[union-attr]


def _high(law: PowerLaw) -> float:
    return float("inf") if law.high is None else law.high


def volume_conflicts(scenario: ScenarioSettings, common: Mapping[str, Any], volumes: Mapping[str, float]) -> Iterator[str]:
    """Sentence if the members of a class of volumes have other ones; ``volumes`` [m3] of the releases by name, of factor 1."""
    law = scenario.power_law
    released = sum(volume for name, volume in volumes.items() if not scenario.releases or name in scenario.releases)
    if law is None or released == 0.0:
        return
    factor = {**common, **scenario.parameters}.get(VOLUME)
    low, high = (released * end for end in (factor.support() if factor else (1.0, 1.0)))
    if low < 0.999 * law.low or high > 1.001 * _high(law):
        yield (
            f"ensemble.scenarios, {scenario.name}: its members have {low:.4g} to {high:.4g} m3, but its rate is that of "
            f"{law.low:.4g} to {_high(law):.4g} m3; sample release_volume_factor from {law.low / released:.3g} to "
            f"{_high(law) / released:.3g}, or change the class"
        )


def ordered(values: list[float]) -> list[float]:
    """Return periods [a]; refused if they do not rise."""
    if any(b <= a for a, b in pairwise(values)):
        raise refuse(f"{values} does not rise", "list every return period once, the shortest first")
    return values
