"""Draws the hypothetical release of this site: `python sites/jacksboro/inputs/make_release.py` writes release.gpkg beside it.

Nothing is known to have failed here. The outline is an egg-shaped patch on the steepest broad slope of the elevation
sample that has room below it: about 25 degrees over 600 m, under a ridge at 1040 m, above a basin at 450 m.
"""

import os
from pathlib import Path

import geopandas
import numpy as np
from shapely.geometry import Polygon

CREST = (749300.0, 4009380.0)  # uphill end of the outline: easting, northing [m], UTM zone 16N
AZIMUTH = 131.0  # direction of the slope, clockwise from north [deg]
LENGTH, WIDTH = 500.0, 420.0  # along and across the slope, in plan [m]
THICKNESS = 35.0  # vertical [m]
CORNERS = 48


def egg() -> Polygon:
    """Outline in map coordinates: blunt at the crest, narrower at the foot."""
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    along = 0.5 * LENGTH * (1.0 - np.cos(angle))
    across = 0.5 * WIDTH * np.sin(angle) * (1.0 + 0.15 * np.cos(angle))
    azimuth = np.radians(AZIMUTH)
    easting = CREST[0] + along * np.sin(azimuth) + across * np.cos(azimuth)
    northing = CREST[1] + along * np.cos(azimuth) - across * np.sin(azimuth)
    return Polygon(np.round(np.column_stack([easting, northing]), 1))


def main() -> None:
    """Write release.gpkg."""
    attributes = {
        "name": ["hypothetical_slope"],
        "thickness": [THICKNESS],
        "remark": ["HYPOTHETICAL: drawn for a software example; nothing is known to have failed here"],
    }
    frame = geopandas.GeoDataFrame(attributes, geometry=[egg()], crs="EPSG:32616")
    os.environ["OGR_CURRENT_DATE"] = "2024-01-01T00:00:00.000Z"  # so that the file is the same whenever it is made
    path = Path(__file__).with_name("release.gpkg")
    path.unlink(missing_ok=True)
    frame.to_file(path, layer="release", driver="GPKG")


if __name__ == "__main__":
    main()
