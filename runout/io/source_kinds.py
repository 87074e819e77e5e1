"""Kinds of elevation sources, by their names: meshes, and sample rasters that matplotlib ships. No library is imported for it."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

MESHES = (".obj", ".ply", ".stl")


def is_mesh(path: Any) -> bool:
    """Whether a file of elevations is a mesh."""
    return isinstance(path, str | Path) and str(path).lower().endswith(MESHES)


def sample_path(source: str) -> Path | None:
    """File of a sample with a name such as ``matplotlib:jacksboro_fault_dem``; None if matplotlib is not installed."""
    package = find_spec("matplotlib")
    if package is None or package.origin is None:
        return None
    return Path(package.origin).with_name("mpl-data") / "sample_data" / f"{source.partition(':')[2]}.npz"
