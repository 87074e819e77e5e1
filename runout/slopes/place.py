"""What the commands on slopes start from: a site, or an elevation raster alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runout.io.references import file_in
from runout.model.terrain import Terrain

if TYPE_CHECKING:
    from runout.config.site import Site


@dataclass(frozen=True)
class Place:
    """A terrain with its name and the folder of its results."""

    name: str
    terrain: Terrain
    results: Path  # `results` of the site, or `NAME_results` in the working folder for a raster, unless another folder is stated
    site: "Site | None" = None  # None of a raster


def is_raster(path: Path) -> bool:
    """Whether a path names an elevation raster or a mesh, whose reading says what it needs, and not a site or its site.yaml."""
    text = str(path)
    if text.startswith("matplotlib:") or file_in(text) != text:
        return True
    if path.is_dir():
        return (path / "hdr.adf").is_file()
    return path.suffix.lower() not in ("", ".yaml", ".yml")


def read_place(path: Path, out: Path | None) -> Place:
    """The place of a site folder, a site.yaml or an elevation raster.

    Raises ConfigError or DemError if the site or the raster cannot be used.
    """
    if is_raster(path):
        name = path.stem.removeprefix("matplotlib:")
        return Place(name, Terrain.from_raster(str(path)), out or Path(f"{name}_results"))
    from runout.config.site import read_site

    site = read_site(path)
    return Place(site.name, site.terrain(), out or site.folder / "results", site)
