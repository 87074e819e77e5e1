"""From a raster as its file states it to a terrain: north up, in metres, unknown cells NaN; every change is reported."""

import math
from dataclasses import replace

import numpy as np

from runout.errors import DemError, InputError
from runout.io import crs as coordinate_systems
from runout.io.elevation_raster import ElevationRaster, moved
from runout.io.units import factor_to
from runout.model.arrays import window_of
from runout.model.terrain import Terrain
from runout.terrain.open_edge import filled
from runout.terrain.source import ELEVATION, in_unit_of, north_up

LOWEST, HIGHEST = -500.0, 9000.0  # of land on Earth, with room [m]
NODATA_VALUES = (-9999.0, -99999.0, -999999.0, -32768.0, -32767.0, 32767.0, 65535.0)  # in use without being declared
CLIFF = 10.0  # height over the size of a cell of the cliffs around cells of 0 m that hardly are ground
LARGEST_NUMBER = 1e6  # beyond this a number marks an unknown cell: -3.4e38, 1e20, 9.97e36
RIM = 8  # cells; what lies farther away weighs less than 1e-4 in the spline


def terrain(raster: ElevationRaster) -> Terrain:
    """Terrain of a raster as its file states it.

    Rows are put in order, unknown cells become NaN, units become metres, a rim without any elevation is cut off, and a
    raster that is geographic, in feet or in a system that distorts distances is projected to UTM. DemError for what
    cannot be mended without guessing.
    """
    system_of_file = raster.crs
    raster = north_up(raster)
    raster = in_unit_of(without_marks(raster), ELEVATION)
    require_plausible(raster)
    raster = with_pits_noted(raster)
    raster = on_metric_map(trimmed(raster))
    dx, dy = raster.cell
    if abs(dx - dy) > 1e-6 * dx:
        raster = raster.noted(f"cells are unequal, {dx:.6g} m east-west by {dy:.6g} m north-south; kept as they are")
    west, _, _, north = raster.bounds
    south = north - raster.values.shape[0] * dy  # rounds so that south + rows * dy gives back north to the last bit
    wkt = None if raster.crs is None else raster.crs.to_wkt()
    is_own = raster.crs is None or system_of_file is None or coordinate_systems.same(system_of_file, raster.crs)
    own = None if is_own else coordinate_systems.horizontal(system_of_file).to_wkt()
    height = coordinate_systems.vertical_name(system_of_file)
    return Terrain(raster.values, (dx, dy), west, south, wkt, raster.source, raster.changes, own, height)


def trimmed(raster: ElevationRaster) -> ElevationRaster:
    """The raster without the rows and columns at its rim in which no cell has an elevation: mass that gets there leaves it."""
    rows, columns = window_of(np.isfinite(raster.values))
    values = raster.values[rows, columns]
    less = [before - after for before, after in zip(raster.values.shape, values.shape, strict=True)]
    if not any(less):
        return raster
    sentence = f"the rim has no elevation; cut off by {less[0]} rows, {less[1]} columns"
    return raster.changed(sentence, values=values, transform=moved(raster.transform, rows.start, columns.start))


def known_or_nan(values: np.ndarray, source: str, largest: float = LARGEST_NUMBER) -> tuple[np.ndarray, tuple[str, ...]]:
    """Values with NaN for numbers that usually mark unknown cells though the file does not say so, and what was done."""
    disguised = np.isin(values, NODATA_VALUES) | (np.abs(values) > largest)
    if not disguised.any():
        return values, ()
    numbers = ", ".join(f"{number:g}" for number in np.unique(values[disguised])[:4])
    blank = ElevationRaster(np.where(disguised, np.nan, values), (1, 0, 0, 0, -1, 0), None, None, source)
    blank = blank.changed(f"{int(disguised.sum())} cells hold {numbers}, which is not declared as nodata; taken as unknown")
    return blank.values, blank.changes


def without_marks(raster: ElevationRaster) -> ElevationRaster:
    """The raster without undeclared marks of unknown cells; DemError if only numbers too large for elevations are left."""
    largest = LARGEST_NUMBER / min(factor_to("m", raster.unit) or 1.0, 1.0)
    values, changes = known_or_nan(raster.values, raster.source, largest)
    numbers_of_cells = raster.values[np.isfinite(raster.values) & ~np.isin(raster.values, NODATA_VALUES)]
    if len(numbers_of_cells) and np.abs(numbers_of_cells).min() > largest and np.ptp(numbers_of_cells) > 0:
        remedy = f"state their unit, for example `gdal_edit.py -units mm {raster.source}`, or declare nodata"
        numbers = f"{raster.stored(float(numbers_of_cells.min())):.9g} to {raster.stored(float(numbers_of_cells.max())):.9g}"
        raise DemError(
            f"{raster.source}: all {len(numbers_of_cells)} numbers of its cells are {numbers}, no elevations in metres; {remedy}"
        )
    return replace(raster, values=values, changes=(*raster.changes, *changes))


def require_plausible(raster: ElevationRaster) -> None:
    """DemError if elevations [m] lie outside what the Earth offers."""
    absurd = (raster.values < LOWEST) | (raster.values > HIGHEST)
    if absurd.any():
        row, column = np.argwhere(absurd)[0]
        value = raster.values[row, column]
        number = raster.stored(float(value))
        remedy = f"declare nodata (`gdal_translate -a_nodata {number:.9g}`) or correct the unit (`gdal_edit.py -units ft`)"
        place = f"the first {value:g} at row {row}, column {column}"
        raise DemError(f"{raster.source}: {int(absurd.sum())} elevations outside {LOWEST:g} to {HIGHEST:g} m, {place}; {remedy}")


def with_pits_noted(raster: ElevationRaster) -> ElevationRaster:
    """The raster; a remark counts the cells at exactly 0 m below cliffs on all sides, which often mark unknown ground."""
    zero = raster.values == 0.0
    if not zero.any():
        return raster
    from scipy import ndimage

    groups, count = ndimage.label(zero, np.ones((3, 3)))
    beside = np.where(np.isnan(raster.values) | zero, np.inf, raster.values)
    lowest = ndimage.minimum(ndimage.minimum_filter(beside, 3, mode="nearest"), groups, np.arange(1, count + 1))
    pits = np.isfinite(lowest) & (lowest > CLIFF * max(raster.cell))
    if not pits.any():
        return raster
    cells = int(np.isin(groups, np.flatnonzero(pits) + 1).sum())
    remedy = f"if 0 marks unknown ground, declare it: gdal_edit.py -a_nodata {raster.stored(0.0):.9g} {raster.source}"
    return raster.changed(f"{cells} cells hold 0, {lowest[pits].min():.4g} m or more below all cells around; {remedy}")


def on_metric_map(raster: ElevationRaster) -> ElevationRaster:
    """The raster on a projected map in metres, or in local metres if it states no coordinate system."""
    if raster.crs is None or coordinate_systems.is_local(raster.crs):
        _require_not_degrees(raster)
        return raster.noted("no coordinate system is stated; coordinates are taken as local metres", crs=None)
    system = coordinate_systems.horizontal(raster.crs)
    coordinate_systems.require_east_and_north(system, raster.source)
    raster = replace(raster, crs=system)
    if system.is_geographic:
        return _to_utm(raster, f"geographic coordinates ({system.name})")
    if coordinate_systems.metres_per_unit(system) != 1.0:
        return _to_utm(raster, f"coordinates in {system.axis_info[0].unit_name} ({system.name})")
    error = coordinate_systems.scale_error(system, *raster.centre)
    sentence = f"{system.name} gives distances wrong by {100 * error:.1f} % here"
    if error > coordinate_systems.LARGEST_SCALE_ERROR:
        return _to_utm(raster, sentence)
    return raster.noted(f"{sentence}; kept as it is") if error > coordinate_systems.REMARKABLE_SCALE_ERROR else raster


def require_known(terrain: Terrain, mask: np.ndarray, what: str) -> None:
    """Nothing, if all cells of ``mask`` (rows, columns) have an elevation; else DemError with their number and place.

    ``what`` names the cells in the message, for example "the release 'scar'".
    """
    unknown = np.isnan(terrain.elevation) & mask
    if not unknown.any():
        return
    first = np.argwhere(unknown)[:3]
    places = "; ".join(f"row {r}, column {c} ({terrain.easting[c]:.1f} E, {terrain.northing[r]:.1f} N)" for r, c in first)
    remedy = "fill them, for example `gdal_fillnodata.py`, use another elevation raster, or crop it to the known part"
    count = f"{int(unknown.sum())} of {int(mask.sum())} cells of {what} have no elevation"
    raise DemError(f"{terrain.source}: {count}, first {places}; {remedy}")


def reachable(terrain: Terrain, thickness: np.ndarray, angle: float) -> np.ndarray:
    """Cells (rows, columns) that a mass can reach if it loses height at tan(``angle``) per metre travelled.

    Energy line (Heim 1932; Hsu 1975, GSA Bull. 86:129) from the highest point of the mass, distances counted from the nearest
    cell of the release; of the cells below that line those that hang together with the release. Conservative: a path
    is never shorter than the straight line. No path leads through unknown cells: they are an open edge.

    ``thickness`` (rows, columns): released thickness [m]; the mass starts where it is positive. ``angle``: smallest angle of the
    energy line [rad], 0 <= angle < pi/2: the smallest basal friction angle of the ensemble or less.
    """
    from scipy import ndimage

    released = np.asarray(thickness) > 0
    if released.shape != terrain.shape or not 0 <= angle < np.pi / 2:
        arguments = f"thickness has shape {released.shape} on a terrain of {terrain.shape}, angle is {angle:g} rad"
        raise InputError(f"{terrain.source}: {arguments}; the shapes must agree and 0 <= angle < pi/2")
    if not released.any():
        return released
    dx, dy = terrain.cell_size
    ground = filled(terrain.elevation, terrain.cell_size)
    distance = ndimage.distance_transform_edt(~released, sampling=(dy, dx))
    known = np.where(np.isfinite(terrain.elevation), ground, np.inf)
    return below_energy_line(known, released, distance, (ground + thickness)[released].max(), angle, terrain.cell_size)


def below_energy_line(
    ground: np.ndarray, start: np.ndarray, distance: np.ndarray, top: float, angle: float, cell_size: tuple[float, float]
) -> np.ndarray:
    """Cells (n, m) below the energy line that hang together with those of the ``start``, and these.

    Parameters
    ----------
    ground : ndarray (n, m)
        Elevation [m]; infinite where no path leads.
    start : ndarray (n, m) of bool
    distance : ndarray (n, m)
        From the start [m]; changed.
    top : float
        Elevation [m] from which the line falls.
    angle : float
        Of the line [rad].
    cell_size : tuple of float
        A mass may start at the rim of its cell and needs to touch only the rim of the other [m].
    """
    from scipy import ndimage

    line = distance
    line -= math.hypot(*cell_size)
    np.maximum(line, 0.0, out=line)
    line *= -math.tan(angle)
    line += top
    parts, count = ndimage.label((ground <= line) | start, structure=np.ones((3, 3)))
    own = np.zeros(count + 1, bool)
    own[parts[start]] = True
    return own[parts]


def steepness(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Tangent of the slope (rows, columns) [1] of elevations [m]; NaN beside unknown cells."""
    dx, dy = cell_size
    south, east = np.gradient(elevation, dy, dx)
    return np.hypot(south, east)  # type: ignore[no-any-return]


def _to_utm(raster: ElevationRaster, reason: str) -> ElevationRaster:

    return to_utm(raster, reason)


def _require_not_degrees(raster: ElevationRaster) -> None:
    """A mountain that is higher than its map is wide is a map in degrees."""
    west, south, east, north = raster.bounds
    relief = np.nanmax(raster.values) - np.nanmin(raster.values) if np.isfinite(raster.values).any() else 0.0
    on_globe = max(abs(south), abs(north)) <= 90 and max(abs(west), abs(east)) <= 360
    if on_globe and relief > 5 * max(east - west, north - south):
        extent = f"{raster.values.shape[1]} x {raster.values.shape[0]} cells of {raster.cell[0]:.6g}, {relief:.0f} m of relief"
        reason = f"no coordinate system is stated and the map looks like degrees ({extent})"
        raise DemError(f"{raster.source}: {reason}; state crs: EPSG:4326")


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
    easting, northing = np.meshgrid(transform[2] + (np.arange(columns) + 0.5) * side, transform[5] - (np.arange(rows) + 0.5) * side)
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
