"""Hencky elasticity without failure (:mod:`runout.physics.elastic`)."""

from dataclasses import dataclass
from typing import ClassVar

from runout.model.laws import register_law
from runout.model.materials import Material


@dataclass(frozen=True, kw_only=True)
class Elastic(Material):
    """A material that never fails; for tests."""

    law: ClassVar[str] = "elastic"


register_law(Elastic)
