"""Pore pressure of releases: what site.yaml states, and what an ensemble samples of it."""

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import Discriminator, Tag, model_validator

from runout.config.distributions import Settings, limited, quantity, refuse, shape
from runout.config.fetch import locate
from runout.config.friction import OF_RELEASE, own_sample
from runout.config.quantities import Text, within
from runout.model.limits import LIMITS, Range
from runout.model.parameters import Parameter
from runout.model.pore_pressure import end_conflicts, zone_conflicts

if TYPE_CHECKING:
    from runout.model.inflow import Inflow
    from runout.model.pore_pressure import PorePressure
    from runout.model.release import Release
    from runout.model.terrain import Terrain

    Mass = TypeVar("Mass", Release, Inflow)

LOGGER = logging.getLogger(__name__)
KEY = "pore_pressure"
PREFIX = "pore_pressure_"  # of its numbers among the parameters of an ensemble
NUMBERS = ("saturation", "diffusivity", "decay_time")
ENDS = ("low", "high", "elsewhere")  # of ratios by blocks or zones
RATIO = LIMITS["pore_pressure_ratio"]
SAMPLED: dict[str, Range] = {
    **dict.fromkeys((f"{PREFIX}ratio", *(f"{PREFIX}ratio_{end}" for end in ENDS)), RATIO),
    **{PREFIX + name: LIMITS[name] for name in NUMBERS},
}


def own_ranges(names: Iterable[str]) -> dict[str, Range]:
    """Range of each number that an ensemble may sample for one of the releases with these names, by its key."""
    return {name + OF_RELEASE + parameter: valid for name in names for parameter, valid in SAMPLED.items()}


def ratio_conflicts(block: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between keys of ratios by blocks or zones: key, what is wrong, remedy."""
    if "block" in block and "polygons" in block:
        yield "", "block and polygons are both given", "give block, or polygons of zones"
    elif "polygons" in block:
        yield from zone_conflicts(block)
    elif "block" not in block:
        yield "", "neither block nor polygons is given", "add block: the size [m] of blocks, or polygons: a file of zones"
    else:
        for key in ("ratio", "elsewhere", "layer"):
            if key in block:
                yield key, "has no meaning without polygons", "remove it, or give polygons of zones in the place of block"
        missing = [end for end in ("low", "high") if end not in block]
        if missing:
            yield missing[0], "required key is missing", "give low and high, between which the ratio of each block is drawn"
        else:
            yield from end_conflicts(block)


class RatioSettings(Settings):
    """Ratios that differ from block to block, or from zone to zone, of the plan."""

    low: float | None = limited("pore_pressure_ratio", "smallest ratio that is drawn for a block or zone", None)
    high: float | None = limited("pore_pressure_ratio", "largest ratio that is drawn", None)
    block: float | None = limited("pore_pressure_block", "size of the square blocks that get a ratio of their own", None)
    polygons: str | None = quantity(
        "instead of block: zones (GeoPackage, Shapefile, GeoJSON), relative to this folder", None, min_length=1
    )
    layer: str | None = quantity("layer of the GeoPackage of zones; not needed when it has one only", None)
    ratio: Annotated[Text | Annotated[float, within("pore_pressure_ratio"), Tag("<number>")], Discriminator(shape)] | None = (
        quantity("ratio inside the zones, or the name of the attribute that holds it, instead of low and high", None)
    )
    elsewhere: float | None = limited("pore_pressure_ratio", "ratio beyond all zones", None)

    @model_validator(mode="after")
    def _fits(self) -> "RatioSettings":
        for key, message, fix in ratio_conflicts(self.model_dump(exclude_none=True)):
            raise refuse(message, fix, key)
        return self


Ratio = Annotated[
    Text | Annotated[float, within("pore_pressure_ratio"), Tag("<number>")] | Annotated[RatioSettings, Tag("<block>")],
    Discriminator(shape),
]


class PorePressureSettings(Settings):
    """Pore pressure of a mass."""

    ratio: Ratio = quantity(
        "pore pressure over total normal stress at the start: a number, a raster, {low, high, block} drawn for blocks of that "
        "size in each member, or {polygons, ratio or low and high, elsewhere} by zones",
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

    Raises InputError if a raster of ratios cannot be used.
    """
    from runout.model.pore_pressure import PorePressure, RatioBlocks

    ratio: Any = settings.ratio
    changes: tuple[str, ...] = ()
    if isinstance(ratio, RatioSettings) and ratio.polygons is not None:
        from runout.terrain.zones import read_ratio_zones

        arguments = ratio.model_dump(include={"ratio", *ENDS, "layer"})
        ratio = read_ratio_zones(Path(locate(ratio.polygons, file.parent)), terrain, **arguments)
        changes = ratio.changes
    elif isinstance(ratio, RatioSettings):
        ratio = RatioBlocks(**ratio.model_dump(include={"low", "high", "block"}))
    elif isinstance(ratio, str):
        from runout.terrain.friction_rasters import sampled_raster

        declared = Parameter("ratio", "pore pressure ratio", RATIO, None, None, None, sampled=False)
        values, sentences, doubts = sampled_raster(Path(locate(ratio, file.parent)), terrain, declared)
        ratio, changes = values.T[::-1], (*sentences, *doubts)
        for change in changes:
            LOGGER.warning("%s", change)
    return PorePressure(ratio=ratio, changes=changes, **settings.model_dump(include={*NUMBERS}))


def sampled_pores(releases: "Sequence[Mass]", sample: Mapping[str, float]) -> "list[Mass]":
    """The releases or inflows with sampled numbers of pore pressure, their own before those of all, in the place of the stated."""
    if not any(name.rpartition(OF_RELEASE)[2] in SAMPLED for name in sample):
        return list(releases)
    own = [{**sample, **own_sample(sample, r.name)} for r in releases]
    pores = [_with_sample(r.pore_pressure, s) if r.pore_pressure else None for r, s in zip(releases, own, strict=True)]
    return [replace(r, pore_pressure=pore) if pore else r for r, pore in zip(releases, pores, strict=True)]


def _with_sample(pore: "PorePressure", sample: Mapping[str, float]) -> "PorePressure":
    numbers: dict[str, Any] = {n: sample[PREFIX + n] for n in NUMBERS if PREFIX + n in sample and getattr(pore, n) is not None}
    ratio = pore.ratio
    if isinstance(ratio, float) and f"{PREFIX}ratio" in sample:
        ratio = sample[f"{PREFIX}ratio"]
    elif not isinstance(ratio, float) and (hasattr(ratio, "block") or hasattr(ratio, "zone")):
        ratio = replace(ratio, **_sampled_ends(ratio, sample))
    return replace(pore, ratio=ratio, **numbers)


def _sampled_ends(ratio: Any, sample: Mapping[str, float]) -> dict[str, float]:
    """Sampled numbers of ratios by blocks or zones, of those that they state."""
    keys = {end: f"{PREFIX}ratio_{end}" for end in ENDS} | ({"ratio": f"{PREFIX}ratio"} if hasattr(ratio, "zone") else {})
    keys_of_numbers = {name: key for name, key in keys.items() if isinstance(getattr(ratio, name, None), float)}
    return {name: sample[key] for name, key in keys_of_numbers.items() if key in sample}


def unused_samples(releases: Sequence[Mapping[str, Any]], sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled numbers that the pore pressure of no release states: key, message and remedy."""
    pores = [release[KEY] for release in releases if isinstance(release.get(KEY), dict)]
    for key in sampled:
        name = key.removeprefix(PREFIX)
        if key in SAMPLED and not any(_states(pore, name) for pore in pores):
            where = f"ratio: {{{name.removeprefix('ratio_')}: ...}}" if name.startswith("ratio_") else f"{name}: a number"
            yield key, "the pore pressure of no release states it", f"remove it, or give a release {KEY}: {{{where}, ...}}"
    named = {str(release.get("name", "release")): release.get(KEY) for release in releases}
    for key in sampled:
        release, _, parameter = key.partition(OF_RELEASE)
        if release in named and parameter in SAMPLED:
            pore, name = named[release], parameter.removeprefix(PREFIX)
            if not isinstance(pore, dict) or not _states(pore, name):
                yield key, f"the pore pressure of release {release} does not state it", f"remove it, or state it in {KEY}"


def _states(pore: Mapping[str, Any], name: str) -> bool:
    ratio = pore.get("ratio")
    if name.startswith("ratio_"):
        return isinstance(ratio, dict) and ratio.get(name.removeprefix("ratio_")) is not None
    inside = ratio.get("ratio") if isinstance(ratio, dict) else ratio
    return name == "saturation" or (isinstance(inside, int | float) if name == "ratio" else pore.get(name) is not None)
