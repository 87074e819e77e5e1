"""Voellmy friction whose drag slows the whole column of mass, as depth-averaged models mean it.

tau = mu sigma + tau_c at the base, as in :mod:`runout.friction.voellmy`; the drag rho U^2 (g / xi + c) with the mean velocity U of
the column acts on all of its mass alike. No internal friction has to pass it on to the base.
"""

from dataclasses import dataclass
from typing import ClassVar

from runout.friction.voellmy import Voellmy, resistance
from runout.model.friction_laws import register_friction


@dataclass(frozen=True, kw_only=True)
class VoellmyColumn(Voellmy):
    """Voellmy with drag over the column: comparisons with RAMMS, AvaFrame and other depth-averaged models."""

    law: ClassVar[str] = "voellmy_column"
    drags_column: ClassVar[bool] = True


register_friction(VoellmyColumn, resistance)
