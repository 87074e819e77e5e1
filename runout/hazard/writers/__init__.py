"""Formats of the hazard maps: each file of this folder writes one, and no other file lists them.

Its docstring names what it writes and says how to open that, for ``README.txt``. It has a function ``write``, which takes
:class:`Products` and returns the paths that it wrote, each whole or not at all. If it writes other names for other settings, it
also has ``earlier``, which takes the results folder and returns what runs left there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runout.config.hazard import written_alone
from runout.hazard.members import Ensemble
from runout.hazard.structure_products import StructureProducts
from runout.model.registry import parts_of
from runout.model.release import Release
from runout.model.terrain import Terrain
from runout.scores.observations import Observations

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site

NETCDF = "hazard_netcdf"  # the format that every site has


@dataclass(frozen=True)
class Products:
    """What an ensemble gives, before it is written: ``hazard`` has all maps, with coordinates, units and attributes of files.

    ``representative`` is the valid member with the median run-out, ``snapshots`` are the times [s] that its file keeps.
    """

    hazard: "xr.Dataset"
    ensemble: Ensemble
    site: "Site"
    terrain: Terrain
    releases: Sequence[Release]
    observed: Observations | None
    built: StructureProducts
    results: Path
    representative: int
    snapshots: tuple[float, ...] = ()


def write_all(products: Products) -> dict[str, list[Path]]:
    """Paths of the files of the formats that the site asks for, after writing them, by the docstring of the format."""
    alone = written_alone(products.site)
    parts = [part for part in parts_of(__name__) if not alone or part.__name__.rpartition(".")[2] == NETCDF]
    return {str(part.__doc__): list(part.write(products)) for part in parts}


def earlier(results: Path) -> set[Path]:
    """Files that earlier runs wrote with names that these settings may not give; no files of other names."""
    return {path for part in parts_of(__name__) if hasattr(part, "earlier") for path in part.earlier(results)}
