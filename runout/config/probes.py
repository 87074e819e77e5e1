"""Probes in site.yaml: points and cross-sections at which every member records time series."""

from typing import Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from runout.config.distributions import Settings, quantity, refuse, shape
from runout.config.quantities import Text


class PointSettings(Settings):
    """One point."""

    name: str = quantity("name in files and figures", min_length=1)
    x: float = quantity("easting in the coordinates of the terrain", unit="m")
    y: float = quantity("northing in the coordinates of the terrain", unit="m")


PointList = Annotated[list[PointSettings], Field(min_length=1), Tag("<list>")]
Points = Annotated[Text | PointList, Discriminator(shape)]


class ProbeSettings(Settings):
    """Points and cross-sections at which every member records time series. A change of them runs the members anew."""

    points: Points | None = quantity(
        "points: a file (GeoPackage, Shapefile, GeoJSON) relative to this folder, or a list of {name, x, y}",
        None,
        examples=["inputs/probes.gpkg"],
    )
    points_layer: str | None = quantity("layer of that file; not needed when it has one only", None, examples=["points"])
    cross_sections: str | None = quantity(
        "lines across the flow: a file relative to this folder", None, min_length=1, examples=["inputs/sections.gpkg"]
    )
    cross_sections_layer: str | None = quantity("layer of that file; not needed when it has one only", None, examples=["sections"])
    interval: float | None = quantity("time between two values of a series; default: end_time / 200", None, unit="s", gt=0)

    @model_validator(mode="after")
    def _complete(self) -> "ProbeSettings":
        if self.points is None and self.cross_sections is None:
            raise refuse("neither points nor cross_sections are given", "add one of them, or remove probes")
        for layer, key in ((self.points_layer, "points"), (self.cross_sections_layer, "cross_sections")):
            if layer is not None and not isinstance(getattr(self, key), str):
                raise refuse(f"{layer!r} without a file of {key}", "remove it", f"{key}_layer")
        return self

    def files(self) -> list[str]:
        """Files that are named."""
        return [stated for stated in (self.points, self.cross_sections) if isinstance(stated, str)]


PROBES = quantity(
    "points and cross-sections at which every member records time series; a change of them runs the members anew",
    None,
    examples=[{"points": "inputs/probes.gpkg", "cross_sections": "inputs/sections.gpkg", "interval": 1.0}],
)
