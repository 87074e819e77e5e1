"""Formats of the hazard maps: each file of this folder writes one, and no other file lists them.

A file has a function ``write``, which takes :class:`Products` and returns the paths that it wrote, each whole or not at all. If it
writes other names for other settings, it also has ``earlier``, which takes the results folder and returns what runs left there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runout.hazard.members import Ensemble
from runout.hazard.structure_products import StructureProducts
from runout.model.registry import parts_of
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.scores.observations import Observations

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site


@dataclass(frozen=True)
class Products:
    """What an ensemble gives, before it is written.

    Attributes
    ----------
    hazard : xarray.Dataset
        All maps over the members, with coordinates, units and attributes as in ``hazard.nc``.
    ensemble : Ensemble
    site : Site
    terrain : Terrain
    releases : sequence of Release
    observed : Observations or None
    built : StructureProducts
    results : Path
        Folder for the files.
    """

    hazard: "xr.Dataset"
    ensemble: Ensemble
    site: "Site"
    terrain: Terrain
    releases: Sequence[Release]
    observed: Observations | None
    built: StructureProducts
    results: Path


def write_all(products: Products) -> list[Path]:
    """Paths of the files of all formats, after writing them."""
    return [path for part in parts_of(__name__) for path in part.write(products)]


def earlier(results: Path) -> set[Path]:
    """Files that earlier runs wrote with names that these settings may not give; no files of other names."""
    return {path for part in parts_of(__name__) if hasattr(part, "earlier") for path in part.earlier(results)}
