"""Settings of the maps over the members; thresholds are those of the table of map quantities."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, create_model, model_validator

from runout.config.distributions import Settings, quantity, refuse
from runout.config.quantities import Text
from runout.config.scenarios import LONGEST_PERIOD, ordered
from runout.config.stated_at import stated_place
from runout.errors import ConfigError
from runout.quantities import ALL_QUANTITIES, BED_QUANTITIES, QUANTITIES, MapQuantity


def rising(values: list[float]) -> list[float]:
    """The values; refused unless each is above the one before."""
    if any(b <= a for a, b in pairwise(values)):
        raise refuse(f"{values} does not rise", "list every value once, the smallest first")
    return values


def _percent(values: list[float]) -> list[float]:
    if max(values) < 1:
        raise refuse(f"{values} are suspiciously small; percentiles are in percent here", "write 5 for 0.05")
    return rising(values)


def limit(q: MapQuantity) -> Any:
    """A threshold of a quantity."""
    return Annotated[float, Field(ge=q.least_threshold) if q.least_threshold else Field(gt=0)]


def _thresholds(q: MapQuantity) -> tuple[Any, Any]:
    """The field of the thresholds of a quantity; inundation needs one of the thickness."""
    needed = q.name == "thickness"
    text = f"probability of at least this {q.words}" + ("" if needed else "; [] for none")
    values: Any = Annotated[list[limit(q)], Field(min_length=int(needed)), AfterValidator(rising)]  # type: ignore[misc]
    if q.of_bed:
        default = f"; of sites with a bed, [{', '.join(map(str, q.thresholds))}] by default"
        return values | None, quantity(text + default, None, unit=q.units, hint=q.hint, examples=[list(q.thresholds)])
    return values, quantity(text, list(q.thresholds), unit=q.units, hint=q.hint)


def _part(q: MapQuantity) -> tuple[Any, Any]:
    """The field of the threshold of a quantity in a joint condition."""
    return limit(q) | None, quantity(f"at least this {q.extreme}", None, unit=q.units, hint=q.hint)


def require_numbers(thresholds: Settings) -> None:
    """Refuse a threshold that is named and has no number: without it the others would count alone."""
    for name in sorted(thresholds.model_fields_set):
        if getattr(thresholds, name) is None:
            raise refuse("a threshold without a number", "state the number, or remove the key", name)


class _JointSettings(Settings):
    """Thresholds of two or more quantities that a member reaches together."""

    @model_validator(mode="after")
    def _several(self) -> "_JointSettings":
        require_numbers(self)
        thresholds = list(self.model_dump(exclude_none=True))
        if len(thresholds) < 2:
            said = f"only {thresholds[0]} has a threshold" if thresholds else "no quantity has a threshold"
            raise refuse(said, f"give two or more of {', '.join(QUANTITIES)}")
        return self


def _distinct(conditions: list[Any]) -> list[Any]:
    if any(a == b for k, a in enumerate(conditions) for b in conditions[:k]):
        raise refuse("a condition is listed twice", "list it once")
    return conditions


Percentiles = Annotated[list[Annotated[float, Field(gt=0, lt=100)]], Field(min_length=1), AfterValidator(_percent)]
ReturnPeriods = Annotated[list[Annotated[float, Field(gt=0, le=LONGEST_PERIOD)]], AfterValidator(ordered)]
RETURN_PERIODS = (30.0, 100.0, 300.0)  # [a]
JointSettings = create_model("JointSettings", __base__=_JointSettings, **{name: _part(q) for name, q in ALL_QUANTITIES.items()})  # type: ignore[call-overload]
_Thresholds: Any = create_model("_Thresholds", __base__=Settings, **{q.setting: _thresholds(q) for q in ALL_QUANTITIES.values()})  # type: ignore[call-overload]


class HazardSettings(_Thresholds):  # type: ignore[misc]
    """What the maps show."""

    joint: Annotated[list[JointSettings], AfterValidator(_distinct)] | None = quantity(  # type: ignore[valid-type]
        "list of joint conditions, each with thresholds of two or more quantities: probability that a member reaches all of them, "
        "those of the flow at one time",
        None,
        min_length=1,
        examples=[[{"thickness": 1.0, "speed": 1.0}]],
    )
    percentiles: Percentiles = quantity(
        "percentiles over the members: 50 is the middle, 95 is passed by one in twenty", [5.0, 50.0, 95.0], unit="%"
    )
    scheme: Text | None = quantity(
        "scheme of danger classes: one that `runout schemes` lists, or a .yaml file of your own; needs ensemble.scenarios",
        None,
        examples=["swiss_debris_flow"],
    )
    return_periods: ReturnPeriods | None = quantity(
        f"return periods of the maps of thickness, speed and pressure; of ensembles with annual rates, {list(RETURN_PERIODS)} by "
        "default; others have no such maps",
        None,
        unit="a",
        examples=[list(RETURN_PERIODS)],
    )
    formats: Literal["all", "netcdf"] = quantity(
        "files of the maps: all, or netcdf for hazard.nc and members.nc alone, without rasters, outlines, project and report", "all"
    )


def stated_conditions(hazard: Any) -> list[dict[str, float]]:
    """Joint conditions in the settings ``hazard`` of a site."""
    return [{name: limit for name, limit in dict(one).items() if limit is not None} for one in hazard.joint or ()]


def written_alone(site: Any) -> bool:
    """Whether a site asks for ``hazard.nc`` without the other formats of the maps."""
    return getattr(site.settings.hazard, "formats", "all") == "netcdf"


def require_outlines(site: Any) -> None:
    """Raise ConfigError if the site asks for no outlines, which its report shows."""
    if written_alone(site):
        where = stated_place(site.file, "hazard", "formats")
        raise ConfigError(f"{where}: netcdf leaves out the outlines and rasters that the report shows; write `formats: all`")


def without_a_bed(hazard: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Settings of the maps of a bed in a site.yaml without one: key, what is wrong, remedy."""
    fix = "remove it, or add bed: {depth: ..., erosion: {...}}"
    for q in BED_QUANTITIES.values():
        if hazard.get(q.setting):
            yield q.setting, "the site has no bed", fix
    joint = hazard.get("joint")
    for k, condition in enumerate(joint if isinstance(joint, list) else ()):
        for name in BED_QUANTITIES:
            if isinstance(condition, dict) and condition.get(name) is not None:
                yield "joint", f"condition {k + 1} has a threshold of {name}, but the site has no bed", fix
