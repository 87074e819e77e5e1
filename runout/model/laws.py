"""The table of material laws: which functions of physics a law is made of and what its record holds."""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from runout.model.materials import Material
from runout.physics import drucker_prager, elastic, granular_flow


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

    @property
    def depends_on_rate(self) -> bool:
        """Whether the records hold the length of the step [s], ``time_step``, which the backend keeps up to date."""
        return "time_step" in self.fields

    def set_step(self, table: np.ndarray, dt: float) -> None:
        """Put the length of the coming steps [s] into the records of a law that depends on the rate."""
        if self.depends_on_rate:
            table["time_step"] = dt


LAWS = {
    law.name: law
    for law in (
        Law("elastic", elastic, ("lame_lambda", "shear_modulus")),
        Law(
            "drucker_prager",
            drucker_prager,
            ("lame_lambda", "shear_modulus", "cone_slope", "cone_intercept", "volume_correction"),
        ),
        Law(
            "granular_flow",
            granular_flow,
            (
                *("lame_lambda", "shear_modulus", "static_friction", "friction_rise"),
                *("inertial_constant", "grain_inertia", "time_step"),
            ),
        ),
    )
}
