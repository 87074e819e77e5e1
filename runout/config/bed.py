"""Erodible bed and bulking: their settings in site.yaml, their sampled parameters, and the reader of the files of a bed."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Discriminator, SerializeAsAny, Tag, model_validator

from runout.config.declared import sampled_in
from runout.config.distributions import Settings, limited, quantity, refuse, shape
from runout.config.fetch import locate
from runout.config.law_block import LawBlock, LawSettings
from runout.config.quantities import Text, within
from runout.config.stated_at import stated_at, stated_place
from runout.model.erosion_laws import DEFAULT_EROSION, EROSIONS, ErosionLaw
from runout.model.limits import LIMITS, Range

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.bed import Bed
    from runout.model.terrain import Terrain

BED, EROSION = "bed", "erosion"
PREFIX = "erosion_"  # of the parameters of the law among those of an ensemble
PORES = "bed_pore_pressure_ratio"  # among the parameters of an ensemble
OF_A_BED = {**{name: LIMITS[name] for name in ("bed_depth_factor", "bed_density")}, PORES: LIMITS["pore_pressure_ratio"]}
WIDE = 0.3  # span of the pore pressure ratio of a bed, over which the eroded volume grew 2.5 times in cascades_2021
Depth = Annotated[Text | Annotated[float, within("bed_depth"), Tag("<number>")], Discriminator(shape)]


class ErosionSettings(LawSettings):
    """Erosion of a bed: its law and the parameters of that."""

    law: str = quantity("law of erosion")

    @classmethod
    def block(cls) -> LawBlock[ErosionLaw]:
        """The block ``bed.erosion``."""
        return BLOCK


BLOCK: LawBlock[ErosionLaw] = LawBlock(EROSIONS, DEFAULT_EROSION, ErosionSettings)


def bed_conflicts(given: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between keys of a bed: key, what is wrong, remedy."""
    if EROSION in given and "depth" not in given:
        yield "depth", "required key is missing: erosion without a depth", "add depth: [m], or remove the bed"
    if "depth" in given and EROSION not in given:
        yield (
            EROSION,
            "required key is missing: a depth without erosion",
            f"add erosion: {{law: {DEFAULT_EROSION}}}, or remove the bed",
        )
    if "layer" in given and "polygons" not in given:
        yield "layer", "has no meaning without polygons", "add polygons, or remove it"


class BedPoreSettings(Settings):
    """Water in a bed."""

    ratio: float = limited("pore_pressure_ratio", "pore pressure in the bed over the total normal stress", examples=[0.5])


class BedSettings(Settings):
    """Material on the ground that the flow may take up."""

    depth: Depth | None = quantity(
        "vertical depth that can be eroded: a number, a raster in m, or with polygons the attribute that holds it",
        None,
        unit="m",
        examples=[1.2],
    )
    polygons: str | None = quantity(
        "where the bed lies (GeoPackage, Shapefile, GeoJSON), relative to this folder; by default everywhere",
        None,
        min_length=1,
        examples=["inputs/channel.gpkg"],
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["channel"])
    density: float | None = limited(
        "bed_density", "density of the bed; by default that of the mass that erodes it", None, examples=[1900.0]
    )
    pore_pressure: BedPoreSettings | None = quantity(
        "water in the bed, {ratio: ...}, with which mass is taken up; it drains as that of the release. By default the ratio to "
        "which that relaxes",
        None,
        examples=[{"ratio": 0.5}],
    )
    erosion: Annotated[SerializeAsAny[ErosionSettings], BeforeValidator(BLOCK.validated)] | None = quantity(
        "law of erosion and its parameters", None, examples=[{"law": DEFAULT_EROSION}]
    )

    @model_validator(mode="after")
    def _complete(self) -> "BedSettings":
        for key, message, fix in bed_conflicts(self.model_dump(exclude_none=True)):
            raise refuse(message, fix, key)
        if self.depth is None:
            raise refuse("states neither depth nor erosion", "add both, or remove the bed")
        return self


SETTINGS: Any = quantity(
    "erodible bed on the ground, which the flow takes up at the rate of a law: depth, polygons, density, pore_pressure, erosion",
    None,
    examples=[{"depth": 1.2, "erosion": {"law": DEFAULT_EROSION}}],
)


def stated_law(site: Any) -> ErosionLaw | None:
    """The law of erosion of a site.yaml as it is stated; None if it states no bed, or names no known law."""
    bed = site.get(BED) if isinstance(site, dict) else None
    return BLOCK.known_law(bed.get(EROSION, {})) if isinstance(bed, dict) else None


def law_of(settings: "SiteSettings") -> ErosionLaw | None:
    """The law of erosion of a site; None without a bed."""
    return EROSIONS.find(settings.bed.erosion.law) if settings.bed and settings.bed.erosion else None


def sampled_ranges(law: ErosionLaw | None = None) -> dict[str, Range]:
    """Range of each parameter of a bed that an ensemble may sample, by its key: of a law, or of all known laws."""
    laws = [law] if law else EROSIONS.known()
    return OF_A_BED | {PREFIX + key: valid for each in laws for key, valid in sampled_in(each.parameters).items()}


def foreign_parameters(site: Any, sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters that the bed of a site.yaml does not have: key, message and remedy."""
    bed, law = site.get(BED) if isinstance(site, dict) else None, stated_law(site)
    for key in sampled:
        if key not in sampled_ranges():
            continue
        if bed is None:
            yield key, "the site has no bed", "remove it, or add bed: {depth: ..., erosion: {...}}"
        elif law and key not in sampled_ranges(law):
            having = [other.name for other in EROSIONS.known() if key in sampled_ranges(other)]
            yield key, f"the erosion law {law.name} has no such parameter", f"remove it, or use law: {' or '.join(having)}"


def read_bed(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "Bed | None":
    """The bed of a site on its terrain, without sampled parameters; None if site.yaml states none.

    Raises InputError with line and key of site.yaml, if a file cannot be used.
    """
    bed = settings.bed
    if bed is None or bed.depth is None or bed.erosion is None:
        return None
    from runout.model.bed import Bed
    from runout.terrain.beds import read_bed_polygons, read_bed_raster

    how: dict[str, Any] = {
        "erosion": bed.erosion.with_values({}),
        "density": bed.density,
        "pore_pressure_ratio": bed.pore_pressure.ratio if bed.pore_pressure else None,
    }
    if bed.polygons is not None:
        with stated_at(file, BED, "polygons"):
            path = locate(bed.polygons, file.parent)
            return read_bed_polygons(path, terrain, bed.depth, layer=bed.layer, **how)
    if isinstance(bed.depth, str):
        with stated_at(file, BED, "depth"):
            return read_bed_raster(locate(bed.depth, file.parent), terrain, **how)
    return Bed(bed.depth, source=stated_place(file, BED, "depth"), **how)


def wide_ratios(settings: "SiteSettings", file: Path) -> Iterator[str]:
    """Sentence on a sampled range of the pore pressure of a bed so wide that it alone decides the eroded volume."""
    low, high = settings.ensemble.parameters[PORES].support() if PORES in settings.ensemble.parameters else (0.0, 0.0)
    if settings.bed is not None and high - low > WIDE:
        yield (
            f"{stated_place(file, 'ensemble', 'parameters', PORES)}: it spans {low:.2g} to {high:.2g}; this ratio decides the "
            f"eroded volume more than any other number, and a span above {WIDE:g} hides the others; narrow it, or read the "
            "volumes as their range over the members"
        )


def bed_ratio(settings: "SiteSettings", sample: Mapping[str, float]) -> float | None:
    """Pore pressure ratio [1] of the bed for a member with sampled parameters; None if site.yaml states none."""
    if settings.bed is None:
        return None
    stated = settings.bed.pore_pressure.ratio if settings.bed.pore_pressure else None
    return sample.get(PORES, stated)


def of_member(settings: "SiteSettings", bed: "Bed | None", sample: Mapping[str, float]) -> dict[str, Any]:
    """Arguments of :func:`runout.simulate` of bed and bulking for a member with sampled parameters, as far as they are stated."""
    arguments: dict[str, Any] = {}
    bulking = sample.get("bulking", settings.bulking)
    if bulking is not None:
        arguments["bulking"] = float(bulking)
    if bed is not None and settings.bed is not None and settings.bed.erosion is not None:
        law = EROSIONS.find(settings.bed.erosion.law)
        own = {p.key: sample[PREFIX + p.key] for p in law.parameters if PREFIX + p.key in sample}
        depth = bed.depth * sample.get("bed_depth_factor", 1.0)
        density, ratio = sample.get("bed_density", bed.density), sample.get(PORES, bed.pore_pressure_ratio)
        erosion = settings.bed.erosion.with_values(own)
        arguments["bed"] = replace(bed, depth=depth, erosion=erosion, density=density, pore_pressure_ratio=ratio)
    return arguments
