"""Observations of a past event: their settings in site.yaml, and their readers."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from runout.config.distributions import Settings, quantity, refuse, shape
from runout.config.fetch import InputFile, locate
from runout.config.stated_at import Reading, read_each, stated_at

if TYPE_CHECKING:
    from runout.config.schema import SiteSettings
    from runout.model.terrain import Terrain
    from runout.scores.grid import Grid
    from runout.scores.observations import Observations
    from runout.scores.reaches import Reaches
    from runout.scores.thalweg import Thalweg

NODATA = "unknown: cells without a value are not scored; zero: nothing happened there, nor beyond the raster"


class OutlineSettings(Settings):
    """Mapped outline of the event."""

    polygons: str = quantity(
        "outline (GeoPackage, Shapefile, GeoJSON), relative to this folder", min_length=1, examples=["inputs/outline.gpkg"]
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["outline"])
    shows: Literal["flow", "deposit"] = quantity("flow: all ground that was reached; deposit: ground with a deposit", "flow")


class DepositSettings(Settings):
    """Measured thickness of the deposit."""

    raster: InputFile = quantity("raster of thickness in m, same forms as terrain.dem", examples=["inputs/deposit.tif"])
    thickness: Literal["vertical", "slope_normal"] = quantity("how it was measured; normal to the slope is converted", "vertical")
    nodata: Literal["unknown", "zero"] = quantity(NODATA, "unknown")


def _ascending(ends: list[float]) -> list[float]:
    wrong = next((pair for pair in pairwise(ends) if pair[0] >= pair[1]), None)
    if wrong:
        raise refuse(f"{wrong[1]:g} m follows {wrong[0]:g} m", "state the lengths along the thalweg in ascending order")
    return ends


MOST_REACHES = 1000
End = Annotated[float, Field(ge=0, allow_inf_nan=False)]
ReachEnds = Annotated[
    Annotated[int, Field(ge=1, le=MOST_REACHES), Tag("<number>")]
    | Annotated[list[End], Field(min_length=2, max_length=MOST_REACHES + 1), AfterValidator(_ascending), Tag("<list>")],
    Discriminator(shape),
]


class DifferenceSettings(Settings):
    """DEM of difference: elevation after the event minus elevation before it."""

    raster: InputFile = quantity("raster in m, same forms as terrain.dem; negative: ground was lost", examples=["inputs/dod.tif"])
    detection_limit: float = quantity("smaller changes count as 0", 0.0, unit="m", ge=0, le=100)
    reaches: ReachEnds | None = quantity(
        "reaches of observations.thalweg whose volumes are scored: how many of equal length, or the lengths along the line between "
        "which they lie, from its upper end",
        None,
        unit="m",
        examples=[[0.0, 250.0, 400.0, 800.0]],
    )
    nodata: Literal["unknown", "zero"] = quantity(NODATA, "unknown")


class GaugeSettings(Settings):
    """Points at which the event was observed."""

    points: str = quantity(
        "points (GeoPackage, Shapefile, GeoJSON), relative to this folder", min_length=1, examples=["inputs/gauges.gpkg"]
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["gauges"])
    arrival_time: str | None = quantity("attribute with the arrival time in s after the release", None, examples=["arrival_s"])
    thickness: str | None = quantity("attribute with the largest thickness in m, vertical", None, examples=["depth_m"])
    speed: str | None = quantity("attribute with the largest speed in m/s", None, examples=["speed_ms"])

    @model_validator(mode="after")
    def _complete(self) -> "GaugeSettings":
        if not self.attributes:
            raise refuse("no attribute is named", "name that of arrival_time, thickness or speed")
        return self

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes by the quantity that they hold."""
        return self.model_dump(include={"arrival_time", "thickness", "speed"}, exclude_none=True)


class ThalwegSettings(Settings):
    """Line that the flow followed."""

    line: str = quantity(
        "line from above the release to beyond the front, relative to this folder", min_length=1, examples=["inputs/thalweg.gpkg"]
    )
    layer: str | None = quantity("layer of the GeoPackage; not needed when it has one only", None, examples=["thalweg"])


class ObservationSettings(Settings):
    """What was observed of the event. The maps are scored against it; members do not depend on it."""

    outline: OutlineSettings | None = quantity(
        "mapped outline, which scores the area reached", None, examples=[{"polygons": "inputs/outline.gpkg"}]
    )
    deposit: DepositSettings | None = quantity(
        "thickness of the deposit, which scores where the mass came to rest", None, examples=[{"raster": "inputs/deposit.tif"}]
    )
    difference: DifferenceSettings | None = quantity(
        "DEM of difference, which scores volumes lost and gained", None, examples=[{"raster": "inputs/dod.tif"}]
    )
    gauges: GaugeSettings | None = quantity(
        "points with arrival time, thickness or speed, which score the motion",
        None,
        examples=[{"points": "inputs/gauges.gpkg", "arrival_time": "time_s"}],
    )
    thalweg: ThalwegSettings | None = quantity(
        "line along which fronts and reaches are measured", None, examples=[{"line": "inputs/thalweg.gpkg"}]
    )

    @model_validator(mode="after")
    def _with_a_line(self) -> "ObservationSettings":
        if self.difference is not None and self.difference.reaches is not None and self.thalweg is None:
            fix = "add thalweg: {line: FILE} to observations, or remove reaches"
            raise refuse("reaches need the line along which they lie", fix, "difference")
        return self


OBSERVATIONS = quantity(
    "what was observed of the event, for scores: outline, deposit, difference (DEM of difference), gauges, thalweg",
    None,
    examples=[{"outline": {"polygons": "inputs/outline.gpkg"}, "thalweg": {"line": "inputs/thalweg.gpkg"}}],
)

Parts = tuple[dict[str, Any], tuple[str, ...]]  # attributes of Observations, and what was changed or assumed


def read_observations(settings: "SiteSettings", file: Path, terrain: "Terrain") -> "Reading[Observations | None]":
    """The observations on the cells of the terrain, None without any, and the problems of those that cannot be used."""
    if settings.observations is None:
        return Reading(None)
    from runout.scores.grid import Grid
    from runout.scores.observations import Observations

    named = ((name, getattr(settings.observations, name)) for name in READERS)
    reading = read_each(partial(_read, name, one, file, terrain) for name, one in named if one is not None)
    parts = {key: value for part, _ in reading.content for key, value in part.items()}
    changes = tuple(change for _, changes in reading.content for change in changes)
    grid, problems = Grid.of(terrain), reading.problems
    if "change" in parts and "thalweg" in parts:
        of_reaches = read_each([partial(_reaches, settings.observations, file, parts["thalweg"], grid)])
        parts["reaches"], problems = next(iter(of_reaches.content), None), (*problems, *of_reaches.problems)
    return Reading(Observations(grid, **parts, changes=changes) if parts else None, problems)


def _reaches(settings: ObservationSettings, file: Path, thalweg: "Thalweg", grid: "Grid") -> "Reaches | None":
    from runout.scores.reaches import Reaches

    ends = settings.difference.reaches if settings.difference else None
    if ends is None or settings.thalweg is None:
        return None
    with stated_at(file, "observations", "difference", "reaches"):
        return Reaches.of(thalweg, ends, grid)


def _read(name: str, settings: Any, file: Path, terrain: "Terrain") -> Parts:
    with stated_at(file, "observations", name):
        key, read = READERS[name]
        return read(settings, Path(locate(getattr(settings, key), file.parent)), terrain)


def _outline(settings: Any, path: Path, terrain: "Terrain") -> Parts:
    from runout.scores.read import read_outline

    outline, changes = read_outline(path, terrain, settings.layer)
    return {"outline": outline, "outline_shows": settings.shows}, changes


def _deposit(settings: Any, path: Path, terrain: "Terrain") -> Parts:
    from runout.scores.slope_normal import terrain_slope, vertical_thickness

    values, changes = _raster(settings, path, terrain)
    if settings.thickness == "slope_normal":
        values = vertical_thickness(values, terrain_slope(terrain.elevation, terrain.cell_size))
    return {"deposit": values}, changes


def _difference(settings: Any, path: Path, terrain: "Terrain") -> Parts:
    values, changes = _raster(settings, path, terrain)
    return {"change": values, "detection_limit": settings.detection_limit}, changes


def _raster(settings: DepositSettings | DifferenceSettings, path: Path, terrain: "Terrain") -> tuple[np.ndarray, tuple[str, ...]]:
    """Values on the cells of the terrain, NaN where unknown or without elevation."""
    from runout.scores.grid import Grid, placed
    from runout.scores.observations import on_grid
    from runout.scores.read import Nodata, read_map

    nodata, quantity = Nodata(settings.nodata), "change" if isinstance(settings, DifferenceSettings) else "thickness"
    values, own, changes = read_map(path, nodata, quantity=quantity)
    grid = Grid.of(terrain)
    sentences = placed(own, grid).sentences
    on_terrain = on_grid(values, own, grid, 0.0 if nodata == Nodata.ZERO else np.nan)
    return terrain.where_known(on_terrain), (*changes, *sentences)


def _gauges(settings: Any, path: Path, terrain: "Terrain") -> Parts:
    from runout.scores.read import read_gauges

    gauges, changes = read_gauges(path, terrain, settings.attributes, settings.layer)
    return {"gauges": gauges}, changes


def _thalweg(settings: Any, path: Path, terrain: "Terrain") -> Parts:
    from runout.scores.read import read_thalweg

    thalweg, changes = read_thalweg(path, terrain, settings.layer)
    return {"thalweg": thalweg}, changes


READERS: dict[str, tuple[str, Callable[[Any, Path, "Terrain"], Parts]]] = {  # key of the file of each observation, and its reader
    "outline": ("polygons", _outline),
    "deposit": ("raster", _deposit),
    "difference": ("raster", _difference),
    "gauges": ("points", _gauges),
    "thalweg": ("line", _thalweg),
}
