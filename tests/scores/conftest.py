"""Published maps of peak thickness on one grid."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from runout import scores

settings.register_profile("arrays", deadline=None, suppress_health_check=[HealthCheck.too_slow])  # other work on the machine
settings.load_profile("arrays")


@pytest.fixture(scope="session")
def public_data():
    """Function for the folder of a public data set; skips where it is absent."""

    def folder(name: str) -> Path:
        stated = os.environ.get("RUNOUT_DATA")
        if not stated or not (Path(stated) / name).is_dir():
            pytest.skip(f"the public data {name} are not in the folder of RUNOUT_DATA")
        return Path(stated) / name

    return folder


def read_raster(path: Path) -> tuple[np.ndarray, scores.Grid]:
    """Values of a GeoTIFF, NaN where unknown, and its grid."""
    import rasterio

    with rasterio.open(path) as file:
        values = file.read(1, masked=True).astype(float).filled(np.nan)
        box, place = file.bounds, file.transform
        return values, scores.Grid(box.left, box.bottom, (place.a, -place.e), file.shape, None, path.name)


@pytest.fixture(scope="session")
def iseesnow(public_data):
    """Function for the thickness of all tools of an ISeeSnow case on the grid of the elevations, by name, and that grid."""

    def tools(case: str) -> tuple[dict[str, np.ndarray], scores.Grid]:
        folder = public_data("iseesnow") / case
        _, grid = read_raster(next(folder.glob("DEM_*.tif")))
        found = {}
        for path in sorted((folder / "peers").glob("*_peak_thickness.tif")):
            values, own = read_raster(path)  # unknown where the tool has no flow, or in another window
            found[path.name.removesuffix("_peak_thickness.tif")] = np.nan_to_num(scores.resampled(values.clip(0.0), own, grid))
        return found, grid

    return tools
