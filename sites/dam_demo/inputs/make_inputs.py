"""Makes the synthetic inputs of this site: `python sites/dam_demo/inputs/make_inputs.py [DAM_HEIGHT]` writes them beside it.

A slope of 25, 16 and 6 degrees with a channel in it. A road crosses the channel on a level bench under a gallery, whose roof
carries the flow on. Three houses stand in its way to a dam. Nothing of it exists.
"""

import sys
from pathlib import Path

import geopandas
import numpy as np
import rasterio
from rasterio.transform import from_origin
from shapely.geometry import Polygon, box

WEST, NORTH, CRS = 600000.0, 5200160.0, "EPSG:32632"
CELL, COLUMNS, ROWS = 2.0, 200, 80  # [m]
BREAKS, SLOPES = (0.0, 180.0, 250.0), (25.0, 16.0, 6.0)  # distance from the west [m], slope from there on [deg]
TOP, AXIS = 1100.0, 80.0  # elevation in the west, distance of the channel from the south [m]
DEPTH, HALF_WIDTH, FADES = 4.0, 14.0, (240.0, 290.0)  # of the channel, and where it ends [m]
ROAD = (150.0, 168.0)  # bench of the road [m]
ROOF = 4.0  # thickness of the gallery [m]
DAM_HEIGHT = 4.0  # [m]
SMOOTH, ROUGH = 8.0, 20.0  # friction angles of the roof of the gallery and of the others [deg]
RELEASE = (20.0, 70.0, 69.0, 91.0)  # west, east, south, north [m]
THICKNESS = 3.0  # [m]


def profile(x: np.ndarray) -> np.ndarray:
    """Elevation [m] of the banks at distances from the west [m]."""
    z = np.full(np.shape(x), TOP)
    for start, end, slope in zip(BREAKS, (*BREAKS[1:], np.inf), SLOPES, strict=True):
        z = z - np.clip(x - start, 0.0, end - start) * np.tan(np.radians(slope))
    return z


def bed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Elevation [m] without the road."""
    fades = np.clip((FADES[1] - x) / (FADES[1] - FADES[0]), 0.0, 1.0)
    return profile(x) - DEPTH * fades * np.clip(1.0 - ((y - AXIS) / HALF_WIDTH) ** 2, 0.0, 1.0)


def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Elevation [m]: the road is level with the bed of the channel on its lower side."""
    on_road = (x > ROAD[0]) & (x < ROAD[1])
    return np.where(on_road, np.minimum(bed(x, y), bench()), bed(x, y))


def bench() -> float:
    """Elevation of the road [m]."""
    return float(bed(np.array(ROAD[1]), np.array(AXIS)))


def write_dem(path: Path) -> None:
    """Write the elevations."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * CELL, (ROWS - np.arange(ROWS) - 0.5) * CELL)
    profile_of_file = {"driver": "GTiff", "height": ROWS, "width": COLUMNS, "count": 1, "dtype": "float32", "compress": "deflate"}
    with rasterio.open(path, "w", crs=CRS, transform=from_origin(WEST, NORTH, CELL, CELL), **profile_of_file) as file:
        file.write(np.round(ground(x, y), 3).astype("float32"), 1)


def structures(dam_height: float) -> geopandas.GeoDataFrame:
    """Gallery, dam and buildings with their heights above ground or above a stated elevation."""
    over_road = float(bed(np.array(ROAD[0]), np.array(AXIS))) - bench()  # the roof begins level with the bed above the road
    rows = [
        ("gallery", box(ROAD[0], 56, ROAD[1], 104), over_road, bench(), over_road - ROOF, SMOOTH),
        ("dam", box(286, 36, 292, 124), dam_height, None, None, ROUGH),
        ("house north", box(262, 93, 274, 103), 7.0, None, None, ROUGH),
        ("house west", box(236, 97, 247, 108), 7.0, None, None, ROUGH),
        ("house south", Polygon([(262, 60), (273, 56), (277, 67), (266, 71)]), 9.0, None, None, ROUGH),
    ]
    names, shapes, heights, bases, clearances, frictions = zip(*rows, strict=True)
    columns = {"name": names, "height": heights, "base": bases, "clearance": clearances, "friction_deg": frictions}
    return geopandas.GeoDataFrame(columns, geometry=list(shapes), crs=CRS)


def write_layer(frame: geopandas.GeoDataFrame, path: Path) -> None:
    """Write polygons, given in distances from the south-west corner, in map coordinates."""
    path.unlink(missing_ok=True)
    frame.set_geometry(frame.translate(WEST, NORTH - ROWS * CELL)).to_file(path, driver="GeoJSON")


def main(folder: Path, dam_height: float = DAM_HEIGHT) -> None:
    """Write all inputs to a folder."""
    remark = ["SYNTHETIC: drawn for a software example"]
    write_dem(folder / "dem.tif")
    release = geopandas.GeoDataFrame(
        {"thickness": [THICKNESS], "remark": remark}, geometry=[box(RELEASE[0], RELEASE[2], RELEASE[1], RELEASE[3])], crs=CRS
    )
    write_layer(release, folder / "release.geojson")
    every = structures(dam_height)
    write_layer(every[every.name == "dam"].drop(columns=["base", "clearance"]), folder / "dam.geojson")
    write_layer(every[every.name != "dam"], folder / "structures.geojson")
    behind = geopandas.GeoDataFrame({"remark": remark}, geometry=[box(292, 44, 400, 116)], crs=CRS)
    write_layer(behind, folder / "behind_dam.geojson")


if __name__ == "__main__":
    main(Path(__file__).parent, float(sys.argv[1]) if len(sys.argv) > 1 else DAM_HEIGHT)
