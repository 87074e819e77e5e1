"""Observations of a past event in site.yaml."""

from typing import Literal

from pydantic import model_validator

from runout.config.distributions import Settings, quantity, refuse
from runout.config.remote import InputFile

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


class DifferenceSettings(Settings):
    """DEM of difference: elevation after the event minus elevation before it."""

    raster: InputFile = quantity("raster in m, same forms as terrain.dem; negative: ground was lost", examples=["inputs/dod.tif"])
    detection_limit: float = quantity("smaller changes count as 0", 0.0, unit="m", ge=0, le=100)
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

    outline: OutlineSettings | None = quantity("mapped outline", None, examples=[{"polygons": "inputs/outline.gpkg"}])
    deposit: DepositSettings | None = quantity("thickness of the deposit", None, examples=[{"raster": "inputs/deposit.tif"}])
    difference: DifferenceSettings | None = quantity("DEM of difference", None, examples=[{"raster": "inputs/dod.tif"}])
    gauges: GaugeSettings | None = quantity(
        "points with arrival time, thickness or speed", None, examples=[{"points": "inputs/gauges.gpkg", "arrival_time": "time_s"}]
    )
    thalweg: ThalwegSettings | None = quantity(
        "line along which fronts are measured", None, examples=[{"line": "inputs/thalweg.gpkg"}]
    )


OBSERVATIONS = quantity(
    "what was observed of the event, for scores: outline, deposit, difference (DEM of difference), gauges, thalweg",
    None,
    examples=[{"outline": {"polygons": "inputs/outline.gpkg"}, "thalweg": {"line": "inputs/thalweg.gpkg"}}],
)
FILE_KEYS = {"outline": "polygons", "deposit": "raster", "difference": "raster", "gauges": "points", "thalweg": "line"}
