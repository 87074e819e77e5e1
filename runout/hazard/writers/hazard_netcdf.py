"""``hazard.nc``: all maps in one file of the CF conventions."""

from pathlib import Path

from runout.hazard.writers import Products
from runout.io import netcdf


def write(products: Products) -> list[Path]:
    """Path of the file."""
    return [netcdf.write(products.hazard, products.results / "hazard.nc")]
