"""Projection of elevation rasters to UTM."""

import numpy as np

from runout.errors import DemError
from runout.io import crs as coordinate_systems
from runout.io.elevation_raster import ElevationRaster, moved
from runout.terrain.fill import filled

RIM = 8  # cells; what lies farther away weighs less than 1e-4 in the spline


def to_utm(raster: ElevationRaster, reason: str) -> ElevationRaster:
    """The raster in the UTM zone of its middle, on square cells with the area of its own cells.

    Equal areas keep the number of cells, hence neither invent detail nor lose it; square ones because every direction of flow
    then meets the same resolution. Cubic spline through the original cells at the exact place of every new centre (GDAL's
    warper, whose transformation is approximate, errs ten times more on a plane); a cell is unknown where its centre falls
    into an unknown one. The empty wedges that the turned map leaves along its rim are cropped.
    """
    raster = _within_half_turn(raster)
    middle = coordinate_systems.longitude_latitude(raster.crs, *raster.centre)
    _require_one_zone(raster)
    target = coordinate_systems.utm_for(raster.crs, *middle, raster.source)
    width, height = projected_cell(raster, target)
    side = float(f"{np.sqrt(width * height):.3g}")
    values, outside, transform = _resampled(raster, target, side)
    values, transform = _without_empty_rim(values, outside, transform)
    sentence = (
        f"{reason}: projected to {target.name} (EPSG:{target.to_epsg()}), by a cubic spline, on square cells of {side:g} m, "
        f"which have the area of the original cells ({width:.1f} m east-west by {height:.1f} m north-south); "
        f"{raster.values.shape[0]} x {raster.values.shape[1]} cells became {values.shape[0]} x {values.shape[1]}"
    )
    if not coordinate_systems.names_datum(raster.crs):
        sentence += f"; {raster.crs.name} names no datum, so that places on the map may be off by some 100 m"
    elif _is_ballpark(raster, target):
        shift = f"PROJ knows no shift from its datum to {target.geodetic_crs.name} here"
        sentence += f"; {shift}, so that places on the map may be off by some 100 m"
    return raster.changed(sentence, values=values, transform=transform, crs=target)


def _is_ballpark(raster: ElevationRaster, target: object) -> bool:
    """Whether the transformation leaves the shift between the datums out."""
    from pyproj import Transformer

    transformer = Transformer.from_crs(raster.crs, target, always_xy=True)
    transformer.transform(*raster.centre)
    return "Ballpark" in transformer.get_last_used_operation().description


def projected_cell(raster: ElevationRaster, target: object) -> tuple[float, float]:
    """Width and height [m] of the raster's central cell on the target map."""
    from pyproj import Transformer

    x, y = raster.centre
    dx, dy = raster.cell
    project = Transformer.from_crs(raster.crs, target, always_xy=True).transform
    e, n = project([x - dx / 2, x + dx / 2, x, x], [y, y, y - dy / 2, y + dy / 2])
    return float(np.hypot(e[1] - e[0], n[1] - n[0])), float(np.hypot(e[3] - e[2], n[3] - n[2]))


def _within_half_turn(raster: ElevationRaster) -> ElevationRaster:
    """Longitudes from 0 to 360 degrees, brought to -180 to 180; the same in other units."""
    a, b, c, d, e, f = raster.transform
    if not raster.crs.is_geographic:
        return raster
    turn = round(2 * np.pi / raster.crs.axis_info[0].unit_conversion_factor, 9)  # 360 degrees, 400 grads
    if c < turn / 2:
        return raster
    sentence = f"longitudes counted beyond {turn / 2:g}; {turn:g} subtracted"
    return raster.changed(sentence, transform=(a, b, c - turn, d, e, f))


def _require_one_zone(raster: ElevationRaster) -> None:
    west, south, east, north = raster.bounds
    longitudes, _ = coordinate_systems.longitude_latitude(raster.crs, [west, east, west, east], [south, south, north, north])
    span = float(np.ptp(longitudes))
    if not span <= coordinate_systems.WIDEST:
        remedy = "crop it to the slope under study, for example `gdalwarp -te`"
        raise DemError(f"{raster.source}: spans {span:.1f} deg of longitude, more than one UTM zone; {remedy}")


def _resampled(raster: ElevationRaster, target: object, side: float) -> tuple[np.ndarray, np.ndarray, tuple[float, ...]]:
    """Values on cells of ``side`` [m] whose edges are multiples of it, which of them lie outside the original, the transform."""
    from scipy import ndimage

    a, _, c, _, e, f = raster.transform
    transform, x, y = _cell_centres(raster, target, side)
    place = np.stack([(y - f) / e - 0.5, (x - c) / a - 0.5])  # row and column of each new centre, in cells of the original
    unknown = np.isnan(raster.values)
    # continued beyond the rim by point reflection, which keeps slopes
    padded = np.pad(filled(raster.values, raster.cell), RIM, mode="reflect", reflect_type="odd")
    values = ndimage.map_coordinates(padded, place + RIM, order=3, mode="nearest")
    row, column = (np.rint(p).astype(np.int64) for p in place)
    rows, columns = raster.values.shape
    outside = (row < 0) | (row >= rows) | (column < 0) | (column >= columns)
    values[outside | unknown[row.clip(0, rows - 1), column.clip(0, columns - 1)]] = np.nan
    return values, outside, transform


def _cell_centres(raster: ElevationRaster, target: object, side: float) -> tuple[tuple[float, ...], np.ndarray, np.ndarray]:
    """Transform of the new raster, and the positions (rows, columns) of its cell centres on the original map."""
    from pyproj import Transformer

    to_target = Transformer.from_crs(raster.crs, target, always_xy=True)
    west, south, east, north = to_target.transform_bounds(*raster.bounds, densify_pts=51)
    first_column, last_row = np.floor(west / side), np.floor(south / side)
    columns, rows = int(np.ceil(east / side) - first_column), int(np.ceil(north / side) - last_row)
    transform = (side, 0.0, first_column * side, 0.0, -side, (last_row + rows) * side)
    easting, northing = np.meshgrid(
        transform[2] + (np.arange(columns) + 0.5) * side,
        transform[5] - (np.arange(rows) + 0.5) * side,
    )
    x, y = to_target.transform(easting, northing, direction="INVERSE")
    return transform, x, y


def _without_empty_rim(
    values: np.ndarray, outside: np.ndarray, transform: tuple[float, ...]
) -> tuple[np.ndarray, tuple[float, ...]]:
    """The part of the raster that lies inside the original: rows and columns go, from the side with most cells outside."""
    top, bottom, left, right = 0, values.shape[0], 0, values.shape[1]
    while bottom - top > 3 and right - left > 3:
        part = outside[top:bottom, left:right]
        shares = [part[0].mean(), part[-1].mean(), part[:, 0].mean(), part[:, -1].mean()]
        side = int(np.argmax(shares))
        if shares[side] == 0:
            break
        top, bottom, left, right = top + (side == 0), bottom - (side == 1), left + (side == 2), right - (side == 3)
    return values[top:bottom, left:right].copy(), moved(transform, top, left)
