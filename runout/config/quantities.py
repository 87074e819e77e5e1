"""Types of the numbers of a site.yaml, with the ranges of :data:`runout.model.limits.LIMITS`."""

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag

from runout.config.distributions import plausible_degrees, shape
from runout.model.limits import LIMITS


def _range(name: str) -> Any:
    """The bounds of a quantity."""
    bounds: Any = LIMITS[name].bounds()
    return Field(**bounds)


Degrees = Annotated[float, AfterValidator(plausible_degrees)]
Text = Annotated[str, Field(min_length=1), Tag("<text>")]
Angle = Annotated[float, _range("basal_friction_angle"), AfterValidator(plausible_degrees), Tag("<number>")]
FrictionAngle = Annotated[Text | Angle, Discriminator(shape)]
FrictionFactor = Annotated[Text | Annotated[float, _range("friction_factor"), Tag("<number>")], Discriminator(shape)]
Height = Annotated[Text | Annotated[float, _range("obstacle_height"), Tag("<number>")], Discriminator(shape)]
Thickness = Annotated[Text | Annotated[float, _range("thickness"), Tag("<number>")], Discriminator(shape)]
Size = Annotated[float, _range("cell_size")]
CellSize = Annotated[
    Annotated[Size, Tag("<number>")] | Annotated[list[Size], Field(min_length=3, max_length=3), Tag("<list>")], Discriminator(shape)
]
PerAxis = Annotated[int, Field(ge=1, le=8)]
ParticlesPerCell = Annotated[
    Annotated[int, Field(ge=1, le=512), Tag("<number>")]
    | Annotated[list[PerAxis], Field(min_length=3, max_length=3), Tag("<list>")],
    Discriminator(shape),
]
