"""Sites whose rasters are far larger than the scene, whose extent is odd, or whose NetCDF points elsewhere."""

import base64
import sys
import zlib
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from odd_values import FLOATS, SYSTEMS, mutated, scalar

sys.path.append(str(Path(__file__).parent.parent / "security"))
from hdf5_files import ELSEWHERE

SIDE = 40_000  # cells of a huge raster along a side


def write_sparse(path: Path, patch: np.ndarray, transform: Any, crs: Any, place: tuple[int, int], random: Random) -> None:
    """A sparse GeoTIFF of 1.6e9 cells that holds a patch at a row and column."""
    import rasterio
    from rasterio.windows import Window

    shape = {"width": SIDE, "height": SIDE, "count": 1, "dtype": random.choice(["float32", "float32", "int16"]), "crs": crs}
    layout = random.choice([{"tiled": True, "blockxsize": 512, "blockysize": 512}] * 3 + [{"tiled": False, "blockysize": 64}])
    more = {"sparse_ok": True, "bigtiff": "yes", "nodata": random.choice([None, -9999.0, 0.0])}
    with rasterio.open(path, "w", driver="GTiff", transform=rasterio.Affine(*transform), **shape, **layout, **more) as file:
        file.write(
            np.nan_to_num(patch).clip(-9e3, 9e3).astype(shape["dtype"]), 1, window=Window(place[1], place[0], *patch.shape[::-1])
        )


def odd_huge(folder: Path, random: Random, slope: np.ndarray, corner: tuple[float, float], cell: float) -> None:
    """The elevation or the thickness in a huge raster, in its place, or nearly."""
    row, column = random.choice([(20_000, 20_000), (0, 0), (SIDE - slope.shape[0], 3), (random.randrange(39_000), 77)])
    west, north = corner
    transform = [cell, 0.0, west - column * cell, 0.0, -cell, north + row * cell]
    if random.random() < 0.2:
        transform[random.choice([0, 2, 4, 5])] = random.choice([*FLOATS, 1.0, 0.001, 30.0])
    if random.random() < 0.1:
        transform[4] *= -1.0
    name = random.choice(["dem.tif", "dem.tif", "thickness.tif"])
    crs = "EPSG:32632" if random.random() < 0.7 else random.choice(SYSTEMS)
    values = slope if name == "dem.tif" else np.where(np.arange(slope.size).reshape(slope.shape) % 7 == 0, 2.0, 0.0)
    write_sparse(folder / "inputs" / name, values, transform, crs, (row, column), random)
    if random.random() < 0.4:
        odd_extent(folder, random)
    if random.random() < 0.3:
        site = folder / "site.yaml"
        angle = random.choice(["0", "3", "12", "59"])
        sampled = f"{{distribution: discrete, values: [{angle}], frequencies: [1]}}"
        text = site.read_text(encoding="utf-8").replace("{distribution: uniform, low: 12, high: 22}", sampled)
        site.write_text(text.replace("basal_friction_angle_deg: 20", f"basal_friction_angle_deg: {angle}"), encoding="utf-8")


def odd_extent(folder: Path, random: Random) -> None:
    """An extent that is somewhat off, or no extent."""
    edges = [500_000.0, 5_000_000.0, 500_160.0, 5_000_120.0]
    if random.random() < 0.6:
        for _ in range(random.choice([1, 1, 2, 4])):
            at = random.randrange(4)
            edges[at] = random.choice([edges[at] + random.choice([-1e7, -500.0, -5.0, 3.0, 95.0, 1e5]), *FLOATS])
        stated = repr(edges)
    else:
        stated = random.choice([scalar(random), "[1, 2, 3]", "[a, b, c, d]", "[5, 5, 5, 5]", "[1, 2, 3, 4, 5]"])
    site = folder / "site.yaml"
    text = site.read_text(encoding="utf-8").replace("  crs: EPSG", f"  extent: {stated}\n  crs: EPSG", 1)
    site.write_text(text, encoding="utf-8")


def odd_hdf5(folder: Path, random: Random) -> None:
    """Elevation in an HDF5 file that names others, damaged or not."""
    content = zlib.decompress(base64.b85decode(ELSEWHERE[random.choice(list(ELSEWHERE))]))
    other = folder / "inputs" / "dem.nc"
    other.write_bytes(mutated(content, random) if random.random() < 0.7 else content)
    site = folder / "site.yaml"
    name = random.choice(["inputs/dem.nc", "inputs/dem.nc", "'NETCDF:\"inputs/dem.nc\":elevation'"])
    site.write_text(site.read_text(encoding="utf-8").replace("inputs/dem.tif", name), encoding="utf-8")
