"""``maps/``: GeoTIFFs for any GIS, each with its QGIS style; the main maps in front, the others in a folder for each kind."""

from pathlib import Path

from runout.hazard.maps import GROUPS, OWN_MAP, write_maps
from runout.hazard.writers import Products

FOLDER = "maps"


def write(products: Products) -> list[Path]:
    """Paths of rasters and styles."""
    return write_maps(products.hazard, products.results)


def earlier(results: Path) -> set[Path]:
    """Maps of earlier runs, whether they ended or not, with what a GIS noted of them."""
    folders = [results / FOLDER / group for group in ("", *GROUPS)]
    return {path for folder in folders for path in folder.glob("*") if OWN_MAP.fullmatch(path.name)}
