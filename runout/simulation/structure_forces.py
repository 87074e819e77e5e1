"""Forces of the flow on structures: from the impulses on patches to force, moment and pressure of each facade over time."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from runout.model.structures import StructureField, Structures

if TYPE_CHECKING:
    import xarray as xr

PERCENTILE = 95.0  # of the area of a facade
GROUP = "structures"  # of the file of a member, with the series
AXES = ("east", "north", "up")
SERIES = (
    *(f"facade_force_{axis}" for axis in AXES),
    *(f"facade_moment_{axis}" for axis in AXES),
    *("facade_pressure", "facade_high_pressure"),
)


@dataclass(frozen=True)
class StructureForces:
    """Impulses of the flow on the patches of structures, and forces and pressures of facades from them; all float64."""

    structures: Structures  # names, facades and patches
    times: np.ndarray  # (n + 1,): begin of the first interval and end of each [s]
    impulses: np.ndarray  # (n, patches, 3): of the mass on each patch in each interval [N s], in local axes: east, north, up

    @cached_property
    def patch_force(self) -> np.ndarray:
        """Mean force (n, patches, 3) [N] on each patch in each interval."""
        return self.impulses / np.diff(self.times)[:, None, None]

    @cached_property
    def patch_pressure(self) -> np.ndarray:
        """Mean pressure (n, patches) [Pa] on each patch in each interval: the force against its outward normal, by its area."""
        patches = self.structures.field.patches
        return -np.einsum("tpi,pi->tp", self.patch_force, patches.normal) / patches.area  # type: ignore[no-any-return]

    @cached_property
    def force(self) -> np.ndarray:
        """Mean force (n, facades, 3) [N] on each facade in each interval."""
        return self._by_facade(self.patch_force)

    @cached_property
    def moment(self) -> np.ndarray:
        """Mean moment (n, facades, 3) [N m] on each facade in each interval about the foot of its structure, :attr:`foot`."""
        patches = self.structures.field.patches
        arm = patches.centre - self.foot[self.structures.structure[patches.facade]]
        return self._by_facade(np.cross(arm, self.patch_force))

    @cached_property
    def pressure(self) -> np.ndarray:
        """Mean pressure (n, facades) [Pa] by area of each facade in each interval."""
        area = self.structures.field.patches.area
        whole = self._by_facade(np.broadcast_to(area[:, None], (1, len(area), 1)))[:, :, 0]
        force = self._by_facade((self.patch_pressure * area)[:, :, None])[:, :, 0]
        return np.divide(force, whole, out=np.zeros(force.shape), where=whole > 0)

    @cached_property
    def loaded_area(self) -> np.ndarray:
        """Area (n, facades) [m2] of the patches of each facade that the flow presses on in each interval."""
        return self._by_facade(self._loaded[:, :, None])[:, :, 0]

    @cached_property
    def high_pressure(self) -> np.ndarray:
        """Pressure (n, facades) [Pa] that 95 % of the loaded area of a facade does not exceed in each interval; 0 without load."""
        facade, pressure = self.structures.field.patches.facade, np.zeros(self.pressure.shape)
        for k in np.unique(facade):
            of_it = facade == k
            pressure[:, k] = percentile_by_area(self.patch_pressure[:, of_it], self._loaded[:, of_it], PERCENTILE)
        return pressure

    @cached_property
    def _loaded(self) -> np.ndarray:
        """Area (n, patches) [m2] of the patches that are pressed."""
        return np.where(self.patch_pressure > 0.0, self.structures.field.patches.area, 0.0)

    @cached_property
    def foot(self) -> np.ndarray:
        """Foot (structures, 3) [m] of each structure: the middle of its surface in plan, by area, at its lowest patch; local."""
        patches, feet = self.structures.field.patches, np.zeros((len(self.structures.names), 3))
        owner = self.structures.structure[patches.facade]
        for k in np.unique(owner):
            of_it = owner == k
            feet[k] = np.average(patches.centre[of_it], axis=0, weights=patches.area[of_it])
            feet[k, 2] = patches.centre[of_it, 2].min()
        return feet

    def _by_facade(self, values: np.ndarray) -> np.ndarray:
        """Sum of values (n, patches, k) over the patches of each facade: (n, facades, k)."""
        sums = np.zeros((len(self.structures.facades), len(values), values.shape[2]))
        np.add.at(sums, self.structures.field.patches.facade, values.swapaxes(0, 1))
        return sums.swapaxes(0, 1)


def percentile_by_area(values: np.ndarray, area: np.ndarray, percent: float) -> np.ndarray:
    """Least of the ``values`` (n, patches) that ``percent`` of the ``area`` (n, patches) do not exceed, by row; 0 without area."""
    order = np.argsort(values, axis=1, kind="stable")
    covered = np.cumsum(np.take_along_axis(area, order, 1), axis=1)
    whole = covered[:, -1:]
    enough = covered >= (percent / 100.0) * whole * (1.0 - 1e-12)
    least = np.take_along_axis(np.take_along_axis(values, order, 1), enough.argmax(axis=1)[:, None], 1)
    return np.where(whole > 0.0, least, 0.0)[:, 0]  # type: ignore[no-any-return]


def named_structures(structures: Structures | StructureField | None) -> Structures | None:
    """The structures, or one structure of all patches of a field, with numbers as names of its facades."""
    if not isinstance(structures, StructureField):
        return structures
    facades = int(structures.patches.facade.max(initial=-1)) + 1
    return Structures(("structures",), tuple(map(str, range(facades))), np.zeros(facades, np.int64), structures)


def facade_series(forces: StructureForces) -> "xr.Dataset":
    """Force [N], moment [N m], mean pressure and 95 % pressure [Pa] of each facade against ``record_time`` [s].

    The values are means over the interval that ends at that time.
    """
    import xarray as xr

    structures = forces.structures
    area = np.bincount(structures.field.patches.facade, structures.field.patches.area, len(structures.facades))
    names = np.array([structures.names[k] for k in structures.structure], dtype=object)
    along = {f"facade_{what}_{axis}": values[:, :, k] for what, values in (("force", forces.force), ("moment", forces.moment))
             for k, axis in enumerate(AXES)}  # fmt: skip
    series = along | {"facade_pressure": forces.pressure, "facade_high_pressure": forces.high_pressure}
    return xr.Dataset(
        {name: (("record", "facade"), values.astype(np.float32)) for name, values in series.items()}
        | {
            "record_time": ("record", forces.times[1:]),
            "structure_name": ("facade", names),
            "facade_name": ("facade", np.array(structures.facades, dtype=object)),
            "facade_area": ("facade", area),
        }
    )
