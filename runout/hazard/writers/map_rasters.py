"""``maps/``: a GeoTIFF and a QGIS style of each map."""

from pathlib import Path

from runout.hazard.maps import OWN_MAP, write_maps
from runout.hazard.writers import Products

FOLDER = "maps"


def write(products: Products) -> list[Path]:
    """Paths of rasters and styles."""
    return write_maps(products.hazard, products.results / FOLDER)


def earlier(results: Path) -> set[Path]:
    """Maps of earlier runs, whether they ended or not, with what a GIS noted of them."""
    return {path for path in (results / FOLDER).glob("*") if OWN_MAP.fullmatch(path.name)}
