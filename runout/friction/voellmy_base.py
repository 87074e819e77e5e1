"""Voellmy friction whose drag acts at the base, on the slip speed there.

The mass above shears where its internal friction cannot pass the drag on: sin(phi) below the tangent of the slope.
"""

from dataclasses import dataclass
from typing import ClassVar

from runout.friction.voellmy import Voellmy, resistance
from runout.model.friction_laws import register_friction


@dataclass(frozen=True, kw_only=True)
class VoellmyBase(Voellmy):
    """Voellmy with drag at the base: flows whose internal friction passes it on and which resolve their shear."""

    law: ClassVar[str] = "voellmy_base"
    drags_column: ClassVar[bool] = False


register_friction(VoellmyBase, resistance)
