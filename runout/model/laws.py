"""The table of material laws: which functions of physics a law is made of and what its record holds."""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from runout.model.materials import Material
from runout.physics import drucker_prager, elastic


@dataclass(frozen=True)
class Law:
    """One law: its module in :mod:`runout.physics` and the fields of its parameter record."""

    name: str
    module: ModuleType
    fields: tuple[str, ...]

    def table(self, materials: tuple[Material, ...], dtype: type = np.float64) -> np.ndarray:
        """Structured array (materials,) of the records."""
        rows = [tuple(m.record()[f] for f in self.fields) for m in materials]
        return np.array(rows, dtype=[(f, dtype) for f in self.fields])


LAWS = {
    law.name: law
    for law in (
        Law("elastic", elastic, ("lame_lambda", "shear_modulus")),
        Law(
            "drucker_prager",
            drucker_prager,
            ("lame_lambda", "shear_modulus", "cone_slope", "cone_intercept", "volume_correction"),
        ),
    )
}
