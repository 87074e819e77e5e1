"""Inflows: their settings in site.yaml, their sampled parameters, and the reader of their files."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import model_validator

from runout.config import pore_pressure
from runout.config.distributions import Settings, limited, quantity, refuse
from runout.config.document import Document, read_document
from runout.config.fetch import locate
from runout.config.friction import ANGLE, KEY, OwnFriction
from runout.config.material import DEFAULT_LAW, INFLOW_SAMPLED, OwnMaterial
from runout.config.pore_pressure import PorePressureSettings
from runout.config.quantities import Degrees
from runout.config.stated_at import Reading, entry_number, read_each, stated_at, within_site
from runout.errors import ConfigError

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.inflow import Inflow
    from runout.model.terrain import Terrain

INFLOW = "inflow"
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
FACTOR, DELAY = "discharge_factor", "inflow_delay"


def inflow_conflicts(given: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Conflicts between keys of an inflow: key, what is wrong, remedy."""
    line, polygon = "line" in given, "polygon" in given
    if line == polygon:
        yield "", "line and polygon are both given" if line else "neither line nor polygon is given", "give one of them"
    elif polygon and "thickness" in given:
        yield "thickness", "has no meaning with a polygon, over which the surface rises", "remove it"
    if {ANGLE, KEY} <= given.keys():
        yield KEY, f"{ANGLE} is given too", "remove one of the two"


class InflowSettings(Settings):
    """Mass that enters at a line across a channel, or over a polygon, as a hydrograph states it."""

    name: str = quantity("name of the inflow in messages and products", "inflow", pattern=NAME, hint="letters, digits, - and _")
    line: str | None = quantity(
        "line across the channel (GeoPackage, Shapefile, GeoJSON), relative to this folder; mass leaves it downslope, at a right "
        "angle to the chord between its ends",
        None,
        min_length=1,
        examples=["inputs/gauge.gpkg"],
    )
    polygon: str | None = quantity(
        "instead of a line: area on which the mass comes to lie", None, min_length=1, examples=["inputs/spring.gpkg"]
    )
    layer: str | None = quantity("layer of that file; not needed when it has one only", None, examples=["gauge"])
    hydrograph: str = quantity(
        "CSV file with the columns time [s], discharge [m3/s] and, without thickness, velocity [m/s]; linear between its rows",
        min_length=1,
        examples=["inputs/q.csv"],
    )
    thickness: float | None = limited(
        "thickness", "vertical thickness of the flow at the line where the hydrograph has no velocity", None, examples=[1.0]
    )
    basal_friction_angle_deg: Degrees | None = limited(
        "basal_friction_angle", "friction angle under this mass only", None, examples=[15.0]
    )
    basal_friction: OwnFriction | None = quantity(
        "friction under this mass only: some parameters of the law of the site, or a law of its own with all of its parameters",
        None,
        examples=[{"friction_angle_deg": 15.0}],
    )
    material: OwnMaterial | None = quantity(
        "material of this mass only: some parameters of the law of the site, or a law of its own with all of its parameters",
        None,
        examples=[{"law": DEFAULT_LAW, "friction_angle_deg": 28.0}],
    )
    pore_pressure: PorePressureSettings | None = quantity(
        "pore pressure of this mass when it enters: ratio, saturation, and diffusivity or decay_time",
        None,
        examples=[{"ratio": 0.7, "saturation": 1.0, "diffusivity": 1.0e-3}],
    )

    @model_validator(mode="after")
    def _complete(self) -> "InflowSettings":
        for key, message, fix in inflow_conflicts(self.model_dump(exclude_none=True)):
            raise refuse(message, fix, key)
        return self


SETTINGS: Any = quantity(
    "list of inflows, mass that enters while a run goes on: line or polygon, hydrograph, thickness",
    None,
    min_length=1,
    examples=[[{"line": "inputs/gauge.gpkg", "hydrograph": "inputs/q.csv", "thickness": 1.0}]],
)


def foreign_parameters(site: Any, sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled parameters of inflows where a site.yaml has none: key, message and remedy."""
    if isinstance(site, dict) and not site.get(INFLOW):
        for key in sampled:
            if key in INFLOW_SAMPLED:
                yield key, "the site has no inflow", "remove it, or add inflow: [{line: ..., hydrograph: ...}]"


def read_inflows(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "Reading[list[Inflow]]":
    """The inflows on the terrain, in the order of site.yaml, without sampled parameters, and the problems of the others."""
    return read_each(partial(_placed_inflow, entry, file, terrain) for entry in settings.inflow or [])


def _placed_inflow(entry: InflowSettings, file: Path, terrain: "Terrain") -> "Inflow":
    """An inflow; every problem names the line of site.yaml that states its file."""
    from runout.io.hydrographs import read_hydrograph
    from runout.model.inflow import require_one_speed

    with placed(file, entry.name, "hydrograph"):
        series = read_hydrograph(locate(entry.hydrograph, file.parent))
    with placed(file, entry.name, "hydrograph" if entry.thickness is None else "thickness"):
        require_one_speed(series.source, entry.line is not None, entry.thickness is not None, series.velocity is not None)
    with placed(file, entry.name, "line" if entry.line is not None else "polygon"):
        inflow = _inflow(entry, file, terrain, series)
    if entry.pore_pressure is None:
        return inflow
    with stated_at(file, INFLOW, partial(entry_number, file, INFLOW, entry.name), "pore_pressure", "ratio"):
        return replace(inflow, pore_pressure=pore_pressure.made(entry.pore_pressure, file, terrain))


def _inflow(entry: InflowSettings, file: Path, terrain: "Terrain", series: Any) -> "Inflow":
    from runout.release.inlet import read_inflow

    path = locate(entry.line or entry.polygon or "", file.parent)
    common = entry.model_dump(include={"thickness", "layer", "name", "basal_friction_angle_deg"})
    return read_inflow(path, terrain, series, kind="line" if entry.line is not None else "polygon", **common)


@contextmanager
def placed(file: Path, name: str, key: str) -> Iterator[None]:
    """Context that puts line and key of site.yaml before every problem of a file that the inflow of a name states."""
    number = partial(entry_number, file, INFLOW, name)
    try:
        with stated_at(file, INFLOW, number, key):
            yield
    except ConfigError as error:
        document = read_document(file) if file.is_file() else Document(file.name)
        parts = [within_site(str(one), file.parent).partition("; ") for one in (error.problems or (error,))]
        raise ConfigError([document.problem((INFLOW, number(), key), text, fix) for text, _, fix in parts]) from None


def of_member(inflows: "Sequence[Inflow]", sample: Mapping[str, float]) -> "list[Inflow]":
    """The inflows of a member with sampled discharge factor [1] and delay [s]."""
    return [one.changed(float(sample.get(FACTOR, 1.0)), float(sample.get(DELAY, 0.0))) for one in inflows]
