import numpy as np
import pyproj
import pytest

from runout.model.terrain import Terrain


@pytest.fixture(params=["EPSG:32616", "EPSG:2056", None], ids=["UTM", "LV95", "local"])
def terrain(request: pytest.FixtureRequest) -> Terrain:
    """Terrain with unequal cells, wider than one chunk, with one unknown cell, in three kinds of system."""
    elevation = 500.0 + np.add.outer(-np.arange(270.0), np.arange(30.0))
    elevation[7, 3] = np.nan
    wkt = pyproj.CRS(request.param).to_wkt() if request.param else None
    return Terrain(elevation, (10.0, 12.5), 2_600_000.25, 1_199_990.5, wkt)


@pytest.fixture
def maps(terrain: Terrain) -> dict[str, np.ndarray]:
    """Two maps with a marker in the north-west corner."""
    thickness = np.zeros(terrain.shape)
    thickness[0, 0] = 7.5
    arrival = np.full(terrain.shape, np.nan)
    arrival[0, 0] = 12.0
    return {"max_flow_thickness": thickness, "arrival_time": arrival, "elevation": terrain.elevation}
