"""``hazard.nc``: all maps in one file of the CF conventions, for xarray, Panoply, GDAL and QGIS; the main maps come first."""

from pathlib import Path

from runout.hazard.maps import HEADLINE_MAPS, LEVEL
from runout.hazard.writers import Products
from runout.io import netcdf


def write(products: Products) -> list[Path]:
    """Path of the file; the main maps, of two dimensions, come first, so that a program that opens the first one shows it."""
    hazard = products.hazard
    first = [name for name in (LEVEL, *HEADLINE_MAPS) if name in hazard]
    others = [str(name) for name in hazard.data_vars if name not in first]
    return [netcdf.write(hazard[[*first, *others]], products.results / "hazard.nc")]
