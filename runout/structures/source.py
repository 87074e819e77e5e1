"""What is stated of the structures of a file, and what reading it gives."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import StructureError, member_of
from runout.io.boundary import as_path
from runout.structures.readers import reader_of
from runout.structures.solid import Solid

CONCRETE = 20.0  # friction angle [deg] of a smooth wall where none is stated


class Top(StrEnum):
    """How the top of a footprint lies."""

    FLAT = "flat"
    ALONG_GROUND = "along_ground"


@dataclass(frozen=True)
class StructureSource:
    """A file of structures, and what is stated of it.

    Parameters
    ----------
    path : path
        Footprints (GeoPackage, Shapefile, GeoJSON, FlatGeobuf) or a mesh (OBJ, PLY, STL, GLB).
    layer : str, optional
        Of a vector file with several.
    name : str
        Of structures without an attribute ``name``.
    height : float or str, optional
        Of footprints above the ground [m], or the attribute that holds it; by default ``height``.
    base : float or str, optional
        Elevation [m] that the height counts from, or its attribute; by default ``base`` where there is one, else the mean ground.
    clearance : float or str, optional
        Height [m] of the underside above the ground, or its attribute. A mesh that states one may hang above the ground.
    top : str
        "flat", or "along_ground": then top and underside follow the ground.
    friction_angle_deg : float
        Friction angle of the surfaces [deg]; an attribute ``friction_deg`` replaces it.
    units : str, optional
        Of a mesh: m, cm, mm or ft.
    crs : str, optional
        Of a mesh, that of the terrain by default.
    offset : tuple of float
        Added to the coordinates of a mesh: easting, northing, elevation [m].

    Raises
    ------
    StructureError
        With all that is stated wrongly, or has no meaning with the kind of the file.
    """

    path: Path
    layer: str | None = None
    name: str = "structure"
    height: float | str | None = None
    base: float | str | None = None
    clearance: float | str | None = None
    top: Top = Top.FLAT
    friction_angle_deg: float = CONCRETE
    units: str | None = None
    crs: str | None = None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", as_path(self.path, StructureError))
        object.__setattr__(self, "top", member_of(Top, self.top, "top", StructureError))
        faults = [f"{self.path}: {fault}" for fault in self._faults()]
        if faults:
            raise StructureError(faults)

    def _faults(self) -> Iterator[str]:
        for key in ("layer", "name", "units"):
            value = getattr(self, key)
            if not isinstance(value, str) and (value is not None or key == "name"):
                yield f"{key} is {value!r}; give text"
        parts = np.ravel(np.asarray(self.offset, object)).tolist()
        if len(parts) != 3 or not all(isinstance(x, int | float) and np.isfinite(x) for x in parts):
            yield f"offset is {self.offset!r}; give three finite numbers in m: easting, northing, elevation"
        reader = reader_of(self.path)
        defaults: dict[str, Any] = {field.name: field.default for field in fields(self)}
        for key in reader.foreign_keys():
            if not np.array_equal(getattr(self, key), defaults[key]):
                yield f"{key} has no meaning with {reader.kind}; leave it out"


@dataclass(frozen=True)
class Read:
    """Bodies of a file, what is wrong with others, and what was changed or assumed."""

    solids: tuple[Solid, ...]
    problems: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
