"""Distributions of sampled parameters."""

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from runout.model.limits import LARGEST_RADIANS, LIMITS, Range, looks_like_radians, radians_remedy

FAR_TAIL = 4.0  # standard deviations; one sample in 30,000 lies outside


class Settings(BaseModel):
    """Base of all settings: frozen; it refuses unknown keys and converts no types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def quantity(description: str, default: Any = ..., *, unit: str = "", hint: str = "", **bounds: Any) -> Any:
    """A field of a settings model. ``description`` is the comment in a new site.yaml; ``hint`` ends messages on wrong values."""
    extra: Any = {"unit": unit, "hint": hint}
    return Field(default, description=description, json_schema_extra=extra, **bounds)


def refuse(message: str, fix: str, key: str = "") -> PydanticCustomError:
    """The error that a validator raises: the message, its remedy, and the key within the validated block."""
    context = {"message": message, "fix": fix, "key": key}
    return PydanticCustomError("runout", "{message}; {fix}", context)


def limited(name: str, description: str, default: Any = ..., **more: Any) -> Any:
    """A field of a settings model; unit, range and hint are those of :data:`runout.model.limits.LIMITS`."""
    valid = LIMITS[name]
    return quantity(description, default, unit=valid.unit, hint=valid.hint, **valid.bounds(), **more)


def _require_order(low: float, high: float) -> None:
    if low >= high:
        raise refuse(
            f"low ({low:g}) is not below high ({high:g})", "exchange them, or give a fixed value instead of a distribution", "low"
        )


class Uniform(Settings):
    """Every value between two bounds is equally likely."""

    distribution: Literal["uniform"] = quantity("uniform between low and high")
    low: float = quantity("smallest value")
    high: float = quantity("largest value")

    @model_validator(mode="after")
    def _ordered(self) -> "Uniform":
        _require_order(self.low, self.high)
        return self

    def support(self) -> tuple[float, float]:
        """Smallest and largest value that may be sampled."""
        return self.low, self.high


class Triangular(Settings):
    """Likelihood rises from low to the mode and falls to high."""

    distribution: Literal["triangular"] = quantity("triangular from low over mode to high")
    low: float = quantity("smallest value")
    mode: float = quantity("most likely value")
    high: float = quantity("largest value")

    @model_validator(mode="after")
    def _ordered(self) -> "Triangular":
        _require_order(self.low, self.high)
        if not self.low <= self.mode <= self.high:
            message = f"mode ({self.mode:g}) is not between low ({self.low:g}) and high ({self.high:g})"
            raise refuse(message, "move it between them", "mode")
        return self

    def support(self) -> tuple[float, float]:
        """Smallest and largest value that may be sampled."""
        return self.low, self.high


class Normal(Settings):
    """Normal distribution, cut at low and high where they are given."""

    distribution: Literal["normal"] = quantity("normal with mean and standard_deviation, cut at low and high where they are given")
    mean: float = quantity("mean before cutting")
    standard_deviation: float = quantity("standard deviation before cutting", gt=0)
    low: float | None = quantity("smallest value", None)
    high: float | None = quantity("largest value", None)

    @model_validator(mode="after")
    def _ordered(self) -> "Normal":
        if self.low is not None and self.high is not None:
            _require_order(self.low, self.high)
        low, high = self.support()
        far = FAR_TAIL * self.standard_deviation
        if self.mean - far >= high or self.mean + far <= low:
            which = "high" if self.mean > high else "low"
            far_off = f"the bounds leave only values more than {FAR_TAIL:g} standard deviations from the mean ({self.mean:g})"
            raise refuse(far_off, "move the bounds or the mean", which)
        return self

    def support(self) -> tuple[float, float]:
        """Smallest and largest value that may be sampled in practice."""
        far = FAR_TAIL * self.standard_deviation
        return self.mean - far if self.low is None else self.low, self.mean + far if self.high is None else self.high


SHARES_WITHIN = 0.02  # of 1, by which rounded shares may miss it


class Discrete(Settings):
    """A finite list of values, each with its relative frequency: counts, or shares, which are all below 1 and add up to 1."""

    distribution: Literal["discrete"] = quantity("discrete values with frequencies")
    values: list[float] = quantity("the values", min_length=1)
    frequencies: list[Annotated[float, Field(gt=0)]] = quantity(
        "how often each value occurs: counts, or shares that add up to 1", min_length=1
    )

    @model_validator(mode="after")
    def _paired(self) -> "Discrete":
        if len(self.values) != len(self.frequencies):
            counts = f"{len(self.frequencies)} frequencies for {len(self.values)} values"
            raise refuse(counts, "give every value one frequency", "frequencies")
        if len(set(self.values)) != len(self.values):
            raise refuse("a value is listed twice", "list it once, with the sum of its frequencies", "values")
        total = sum(self.frequencies)
        if max(self.frequencies) < 1.0 and abs(total - 1.0) > SHARES_WITHIN:
            shares = f"shares that add up to {total:.3g}, not to 1"
            raise refuse(shares, "mend them, or state counts such as [5, 3, 2]", "frequencies")
        return self

    def support(self) -> tuple[float, float]:
        """Smallest and largest value that may be sampled."""
        return min(self.values), max(self.values)


DISTRIBUTIONS = {"uniform": Uniform, "triangular": Triangular, "normal": Normal, "discrete": Discrete}


def tag_of(name: str) -> str:
    """Tag of a model in the location of a pydantic error. The angle brackets distinguish it from keys of a file."""
    return f"<{name}>"


def discriminator(key: str, default: str) -> Callable[[Any], str]:
    """Function that selects the model of a block by the value of one key."""

    def tag(block: Any) -> str:
        return tag_of(str(block.get(key, default) if isinstance(block, dict) else getattr(block, key, default)))

    tag.__name__ = key  # pydantic prints this name in its errors
    return tag


def shape(value: Any) -> str:
    """Tag of the kind of a value: text, list, block or number."""
    if isinstance(value, str):
        return "<text>"
    return "<list>" if isinstance(value, list) else "<block>" if isinstance(value, dict | Settings) else "<number>"


Distribution = Annotated[
    Annotated[Uniform, Tag("<uniform>")]
    | Annotated[Triangular, Tag("<triangular>")]
    | Annotated[Normal, Tag("<normal>")]
    | Annotated[Discrete, Tag("<discrete>")],
    Discriminator(discriminator("distribution", "")),
]


def plausible_degrees(value: float) -> float:
    """The angle [deg]; an angle that looks like radians is refused."""
    if looks_like_radians(value):
        raise refuse(f"{value:g} deg is suspiciously small; angles are in degrees here", radians_remedy(value))
    return value


def within_range(valid: Range, distribution: Any) -> Any:
    """The distribution; it is refused if it can give a value outside the valid range of its parameter."""
    low, high = distribution.support()
    if valid.degrees:
        plausible_degrees(high)
    for value in (low, high):
        if not valid.holds(value):
            unit = f" {valid.unit}" if valid.unit else ""
            message = f"it can give {value:.4g}{unit}; {valid.allowed().replace('it', 'the parameter', 1)}"
            fix = "cut it with low: and high:" if distribution.distribution == "normal" else "narrow it"
            raise refuse(message, f"{fix} ({valid.hint})" if valid.hint else fix)
    if valid.degrees:
        _require_no_radians(distribution)
    return distribution


def _require_no_radians(distribution: Any) -> None:
    """Refuse a distribution of angles [deg] whose samples may look like radians."""
    values = distribution.values if isinstance(distribution, Discrete) else [distribution.support()[0] or LARGEST_RADIANS]
    if any(map(looks_like_radians, values)):
        fix = "leave these out" if isinstance(distribution, Discrete) else "cut it with low: 1.6"
        raise refuse(f"it can give angles below {LARGEST_RADIANS:.3g} deg, which are taken for radians", fix)
