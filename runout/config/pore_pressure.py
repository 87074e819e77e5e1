"""Pore pressure of releases: what site.yaml states, and what an ensemble samples of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import Discriminator, Tag, model_validator

from runout.config.distributions import Settings, limited, quantity, refuse, shape
from runout.config.fetch import locate
from runout.config.quantities import Text, within
from runout.model.limits import LIMITS, Range
from runout.model.parameters import Parameter

if TYPE_CHECKING:
    from runout.model.inflow import Inflow
    from runout.model.pore_pressure import PorePressure
    from runout.model.release import Release
    from runout.model.terrain import Terrain

    Mass = TypeVar("Mass", Release, Inflow)

KEY = "pore_pressure"
PREFIX = "pore_pressure_"  # of its numbers among the parameters of an ensemble
NUMBERS = ("saturation", "diffusivity", "decay_time")
RATIO = LIMITS["pore_pressure_ratio"]
SAMPLED: dict[str, Range] = {
    **dict.fromkeys((f"{PREFIX}ratio", f"{PREFIX}ratio_low", f"{PREFIX}ratio_high"), RATIO),
    **{PREFIX + name: LIMITS[name] for name in NUMBERS},
}


class RatioSettings(Settings):
    """Ratios that differ from block to block of the plan."""

    low: float = limited("pore_pressure_ratio", "smallest ratio")
    high: float = limited("pore_pressure_ratio", "largest ratio")
    block: float = limited("pore_pressure_block", "size of the square blocks that get a ratio of their own")

    @model_validator(mode="after")
    def _ordered(self) -> "RatioSettings":
        if self.low > self.high:
            raise refuse(f"low ({self.low:g}) is above high ({self.high:g})", "exchange them", "low")
        return self


Ratio = Annotated[
    Text | Annotated[float, within("pore_pressure_ratio"), Tag("<number>")] | Annotated[RatioSettings, Tag("<block>")],
    Discriminator(shape),
]


class PorePressureSettings(Settings):
    """Pore pressure of a mass."""

    ratio: Ratio = quantity(
        "pore pressure over total normal stress at the start: a number, a raster, or {low, high, block} drawn for blocks of that "
        "size in each member",
        examples=[0.7],
    )
    saturation: float = limited("saturation", "share of the thickness that stands in water; sets the ratio that stays", 0.0)
    diffusivity: float | None = limited(
        "diffusivity", "of pore pressure, which drains through the thickness of the flow", None, examples=[1.0e-3]
    )
    decay_time: float | None = limited(
        "decay_time", "instead of diffusivity: time in which the excess falls to 1/e", None, examples=[20.0]
    )

    @model_validator(mode="after")
    def _drains_once(self) -> "PorePressureSettings":
        if (self.diffusivity is None) == (self.decay_time is None):
            said = (
                "neither diffusivity nor decay_time is given"
                if self.decay_time is None
                else "diffusivity and decay_time are both given"
            )
            raise refuse(said, "give one of them")
        return self


def made(settings: PorePressureSettings, file: Path, terrain: "Terrain") -> "PorePressure":
    """The pore pressure that a site.yaml ``file`` states for a release on a terrain.

    Raises
    ------
    InputError
        If a raster of ratios cannot be used.
    """
    from runout.model.pore_pressure import PorePressure, RatioBlocks

    ratio: Any = settings.ratio
    if isinstance(ratio, RatioSettings):
        ratio = RatioBlocks(**ratio.model_dump())
    elif isinstance(ratio, str):
        from runout.terrain.friction_rasters import sampled_raster

        declared = Parameter("ratio", "pore pressure ratio", RATIO, None, None, None, sampled=False)
        ratio = sampled_raster(Path(locate(ratio, file.parent)), terrain, declared)[0].T[::-1]
    return PorePressure(ratio=ratio, **settings.model_dump(include={*NUMBERS}))


def sampled_pores(releases: "Sequence[Mass]", sample: Mapping[str, float]) -> "list[Mass]":
    """The releases or inflows with sampled numbers of pore pressure in the place of those that they state."""
    if not any(name in sample for name in SAMPLED):
        return list(releases)
    return [replace(r, pore_pressure=_with_sample(r.pore_pressure, sample)) if r.pore_pressure else r for r in releases]


def _with_sample(pore: "PorePressure", sample: Mapping[str, float]) -> "PorePressure":
    numbers = {n: sample[PREFIX + n] for n in NUMBERS if PREFIX + n in sample and getattr(pore, n) is not None}
    ratio = pore.ratio
    if isinstance(ratio, float) and f"{PREFIX}ratio" in sample:
        ratio = sample[f"{PREFIX}ratio"]
    elif not isinstance(ratio, float) and hasattr(ratio, "block"):
        ratio = replace(ratio, **{end: sample.get(f"{PREFIX}ratio_{end}", getattr(ratio, end)) for end in ("low", "high")})
    return replace(pore, ratio=ratio, **numbers)


def unused_samples(releases: Sequence[Mapping[str, Any]], sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled numbers that the pore pressure of no release states: key, message and remedy."""
    pores = [release[KEY] for release in releases if isinstance(release.get(KEY), dict)]
    for key in sampled:
        name = key.removeprefix(PREFIX)
        if key in SAMPLED and not any(_states(pore, name) for pore in pores):
            where = f"ratio: {{{name.removeprefix('ratio_')}: ...}}" if name.startswith("ratio_") else f"{name}: a number"
            yield key, "the pore pressure of no release states it", f"remove it, or give a release {KEY}: {{{where}, ...}}"


def _states(pore: Mapping[str, Any], name: str) -> bool:
    ratio = pore.get("ratio")
    if name.startswith("ratio_"):
        return isinstance(ratio, dict)
    return name == "saturation" or (isinstance(ratio, int | float) if name == "ratio" else pore.get(name) is not None)
