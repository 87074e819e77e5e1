"""Finds the sample rasters that matplotlib ships, without importing it."""

from importlib.util import find_spec
from pathlib import Path


def sample_path(source: str) -> Path | None:
    """File of a sample with a name such as ``matplotlib:jacksboro_fault_dem``; None if matplotlib is not installed."""
    package = find_spec("matplotlib")
    if package is None or package.origin is None:
        return None
    return Path(package.origin).with_name("mpl-data") / "sample_data" / f"{source.partition(':')[2]}.npz"
