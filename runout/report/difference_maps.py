"""Rasters of the differences of two products, with QGIS styles."""

from pathlib import Path

import numpy as np

from runout.hazard.style import class_edges, qml
from runout.io.atomic import write_text
from runout.io.geotiff import write_cog
from runout.io.netcdf import map_dataset
from runout.scores.comparison import Comparison
from runout.scores.flow import DIFFERENCES
from runout.variables import VARIABLES


def write_differences(found: Comparison, folder: Path) -> list[Path]:
    """Paths of a GeoTIFF and a QGIS style for every quantity that both products have, after writing them."""
    maps = {DIFFERENCES[quantity]: found.difference(quantity) for quantity in found.quantities}
    if not maps:
        return []
    dataset = map_dataset(found.grid.terrain(), maps, title=f"{found.a.path.name} minus {found.b.path.name}")
    paths = []
    for name in maps:
        paths.append(write_cog(dataset, name, folder / f"{name}.tif"))
        paths.append(write_text(difference_style(dataset[name].values, name), folder / f"{name}.qml"))
    return paths


def difference_style(values: np.ndarray, name: str) -> str:
    """QGIS style of a signed map, symmetric about 0."""
    units, divisor = VARIABLES[name].printed
    known = values[np.isfinite(values)] / divisor
    smallest, largest = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return qml(class_edges(name, [], smallest, largest), units, name)
