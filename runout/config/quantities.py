"""Types of the numbers of a site.yaml, with the ranges of :data:`runout.model.limits.LIMITS`."""

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag

from runout.config.distributions import plausible_degrees, refuse, shape
from runout.model.limits import LIMITS


def within(name: str) -> Any:
    """The bounds of a quantity."""
    bounds: Any = LIMITS[name].bounds()
    return Field(**bounds)


Degrees = Annotated[float, AfterValidator(plausible_degrees)]
Text = Annotated[str, Field(min_length=1), Tag("<text>")]
Angle = Annotated[float, within("basal_friction_angle"), AfterValidator(plausible_degrees), Tag("<number>")]
FrictionAngle = Annotated[Text | Angle, Discriminator(shape)]
FrictionFactor = Annotated[Text | Annotated[float, within("friction_factor"), Tag("<number>")], Discriminator(shape)]
Height = Annotated[Text | Annotated[float, within("obstacle_height"), Tag("<number>")], Discriminator(shape)]
Thickness = Annotated[Text | Annotated[float, within("thickness"), Tag("<number>")], Discriminator(shape)]
Size = Annotated[float, within("cell_size")]


def _in_order(edges: list[float]) -> list[float]:
    if edges[0] >= edges[2] or edges[1] >= edges[3]:
        raise refuse(f"{edges} is not west, south, east, north with west < east and south < north", "put the edges in this order")
    return edges


Edge = Annotated[float, Field(allow_inf_nan=False)]
Extent = Annotated[list[Edge], Field(min_length=4, max_length=4), AfterValidator(_in_order)]
CellSize = Annotated[
    Annotated[Size, Tag("<number>")] | Annotated[list[Size], Field(min_length=3, max_length=3), Tag("<list>")], Discriminator(shape)
]
PerAxis = Annotated[int, Field(ge=1, le=32)]  # thin releases take many levels
ParticlesPerCell = Annotated[
    Annotated[int, Field(ge=1, le=512), Tag("<number>")]
    | Annotated[list[PerAxis], Field(min_length=3, max_length=3), Tag("<list>")],
    Discriminator(shape),
]
