"""Forces on the facades of structures over time as a dataset: a group of the file of a member."""

from typing import TYPE_CHECKING

import numpy as np

from runout.structure_forces import StructureForces

if TYPE_CHECKING:
    import xarray as xr

GROUP = "structures"
AXES = ("east", "north", "up")
SERIES = (
    *(f"facade_force_{axis}" for axis in AXES),
    *(f"facade_moment_{axis}" for axis in AXES),
    *("facade_pressure", "facade_high_pressure"),
)


def facade_series(forces: StructureForces) -> "xr.Dataset":
    """Force [N], moment [N m], mean pressure and 95 % pressure [Pa] of each facade against ``record_time`` [s].

    The values are means over the interval that ends at that time.
    """
    import xarray as xr

    made = forces.structures
    area = np.bincount(made.field.patches.facade, made.field.patches.area, len(made.facades))
    names = np.array([made.names[k] for k in made.structure], dtype=object)
    along = {f"facade_{what}_{axis}": values[:, :, k] for what, values in (("force", forces.force), ("moment", forces.moment))
             for k, axis in enumerate(AXES)}  # fmt: skip
    series = along | {"facade_pressure": forces.pressure, "facade_high_pressure": forces.high_pressure}
    return xr.Dataset(
        {name: (("record", "facade"), values.astype(np.float32)) for name, values in series.items()}
        | {
            "record_time": ("record", forces.times[1:]),
            "structure_name": ("facade", names),
            "facade_name": ("facade", np.array(made.facades, dtype=object)),
            "facade_area": ("facade", area),
        }
    )
