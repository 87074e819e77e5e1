"""Landslide of December 2021 near Mount St. Helens: the change of the ground against the observed DEM of difference.

Inputs are those of `sites/cascades_2021`; the observation and the site are from landlab, whose MassWastingRunout runs beside.
"""

import time
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

import runout
from runout.scores import Grid, Reaches, Thalweg, change_errors, elevation_change, reach_errors, resampled
from runout.studies.validation_cases.case import on_cells, public_file

LANDLAB = "https://raw.githubusercontent.com/landlab/landlab/33b6215/docs/source/tutorials/mass_wasting_runout"
FILES = {
    "pre_runout_DEM": (86530, "00f7d207b456e86fa7b8e1ce718b9164cbe2b87027281abdd2716977d9b1187c"),
    "landslide_depth": (58807, "dd2d78f9c89e20b9d714a21f6a063d16a0907a240295db0d0faf7c2566317d8d"),
    "DEM_of_Difference": (59545, "64857b5dac09d3885ae2775b75979bbbacf6fe3c20c1a88990a69edd0670b2d4"),
}
DENSITY = 1900.0  # [kg/m3]
DETECTED = 0.25  # smallest change that counts [m]
COMPARED = 0.5  # smallest change of the areas that are compared with landlab's [m]
REACH_ROWS = (34, 43, 54, 62, 80, 102, 122)  # of the raster, which the channel goes down from north to south
BED = 1.2  # [m], as landlab's tutorial has it
BEDS = tuple((14.0, cell_size, bed) for cell_size in (5.0, 3.0) for bed in (0.0, BED))  # friction [deg], cells [m], bed [m]
END = 150.0  # [s]


@dataclass(frozen=True)
class Event:
    """Ground before the landslide, its source and the observed change of the ground (rows, columns) [m]."""

    terrain: runout.Terrain
    release: runout.Release
    observed: np.ndarray

    @property
    def reaches(self) -> Reaches:
        """Bands of rows of the raster."""
        west, south, east, north = self.terrain.extent
        line = Thalweg(np.array([(0.5 * (west + east), end) for end in (north, south)]))
        return Reaches(line, tuple(row * self.terrain.cell_size[1] for row in REACH_ROWS), Grid.of(self.terrain))

    def wet_release(self, pressure: runout.PorePressure) -> runout.Release:
        """The source with a pore pressure."""
        return replace(self.release, pore_pressure=pressure)

    def simulated(self, angle: float, cell_size: float, end_time: float = END, bed: float = 0.0) -> runout.Result:
        """Run with a basal friction angle [deg] and a depth of erodible bed [m]."""
        soil = runout.DruckerPrager(density=DENSITY, friction_angle=32.0)
        choices = {"basal_friction_angle": angle, "cell_size": cell_size, "end_time": end_time}
        below = runout.Bed(bed) if bed else None
        return runout.simulate(self.terrain, self.release, soil, bed=below, **choices, threads=1)  # type: ignore[arg-type]


def read() -> Event:
    """The event's rasters, from RUNOUT_DATA or fetched."""
    paths = {
        name: public_file(f"{LANDLAB}/{name}.asc", f"cascades_2021_landlab/{name}.asc", size, digest)
        for name, (size, digest) in FILES.items()
    }
    terrain = runout.Terrain.from_raster(paths["pre_runout_DEM"])
    release = runout.Release.from_raster(paths["landslide_depth"], terrain, sign="negative")
    observed = np.nan_to_num(on_cells(paths["DEM_of_Difference"], terrain))
    return Event(terrain, release, observed)


def scored(event: Event, angle: float, cell_size: float) -> tuple[dict[str, Any], np.ndarray]:
    """Scores of a run, and its change of the ground (rows, columns) [m]."""
    started = time.process_time()
    result = event.simulated(angle, cell_size)
    seconds = time.process_time() - started
    change = elevation_change(np.nan_to_num(result.maps["deposit_thickness"].values), event.release.thickness)
    cell = Grid.of(event.terrain).cell_area
    errors = change_errors(change, event.observed, cell, DETECTED)
    row = {
        "basal_friction_deg": angle,
        "cell_size": cell_size,
        "particles": result.n_particles,
        "seconds": seconds,
        "cells_through_depth": result.depth_resolution.cells_through_depth,
        "depth": result.depth_resolution.depth,
        "stop_reason": result.stop_reason,
        "erosion_csi": errors.erosion_area.critical_success_index,
        "deposition_csi": errors.deposition_area.critical_success_index,
        "erosion_volume": errors.erosion.modelled_sum,
        "deposition_volume": errors.deposition.modelled_sum,
        "rmse": errors.change.rmse,
        "reach": reach(event, change),
        "fall": fall(event, np.maximum(change, 0.0)),
    }
    return row, change


def with_bed(event: Event, angle: float, cell_size: float, bed: float) -> dict[str, Any]:
    """Scores of a run with a depth of erodible bed [m], of the law `ramms`."""
    started = time.process_time()
    result = event.simulated(angle, cell_size, bed=bed)
    if bed:
        change = result.maps["elevation_change"].values
    else:
        change = elevation_change(result.maps["deposit_thickness"].values, event.release.thickness)
    entrained = float(result.ledger["entrained_mass"][-1]) / DENSITY if bed else 0.0
    row = {"model": "runout", "basal_friction_deg": angle, "cell_size": cell_size, "bed": bed, "entrained_volume": entrained}
    return row | {"seconds": time.process_time() - started} | compared(event, np.nan_to_num(change))


def of_landlab(event: Event) -> dict[str, Any]:
    """Scores of landlab's MassWastingRunout with the parameters of its tutorial, which are fitted to this event."""
    from runout.slopes.choices import MassWasting
    from runout.slopes.mass_wasting import mass_wasting

    started = time.process_time()
    baseline = mass_wasting(event.terrain, [event.release], MassWasting(erodible_thickness=BED))
    change = resampled(baseline.change, Grid.of(baseline.terrain), Grid.of(event.terrain))
    row = {"model": "landlab", "bed": BED}
    return row | {"seconds": time.process_time() - started} | compared(event, np.nan_to_num(change))


def compared(event: Event, change: np.ndarray) -> dict[str, Any]:
    """Volumes [m3] of a change of the ground (rows, columns) [m] and its scores; areas: changes of :data:`COMPARED` or more."""
    cell = Grid.of(event.terrain).cell_area
    area = change_errors(change, event.observed, cell, COMPARED).changed_area
    by_reach = reach_errors(change, event.observed, event.reaches)
    return {
        "erosion_volume": float(-np.minimum(change, 0.0).sum() * cell),
        "deposition_volume": float(np.maximum(change, 0.0).sum() * cell),
        "csi": area.critical_success_index,
        "agreement": area.agreement_within_one_cell,
        "reach_error": by_reach.error,
        "reach_volumes": by_reach.modelled.tolist(),
    }


def reach(event: Event, change: np.ndarray) -> float:
    """Distance [m] in plan from the highest released cell to the farthest cell of deposition."""
    top = np.unravel_index(np.argmax(np.where(event.release.thickness > 0, event.terrain.elevation, -np.inf)), change.shape)
    x, y = np.meshgrid(event.terrain.easting, event.terrain.northing)
    there = change >= DETECTED
    return float(np.hypot(x[there] - x[top], y[there] - y[top]).max())


def fall(event: Event, deposit: np.ndarray) -> float:
    """Height [m] between the centroids of the release and of a deposit (rows, columns) [m]."""
    ground, release = np.nan_to_num(event.terrain.elevation), event.release.thickness
    return float((ground * release).sum() / release.sum() - (ground * deposit).sum() / deposit.sum())


def measure(full: bool) -> dict[str, Any]:
    """Runs over the range of frictions of the site, with other cells and with a bed; in CI one with cells of 5 m, and one bed."""
    event = read()
    event.simulated(15.0, 5.0, 0.1)  # compiles
    chosen = [*((angle, 3.0) for angle in (10.0, 15.0, 20.0)), (15.0, 2.0), (12.0, 5.0), (12.0, 3.0)] if full else [(12.0, 5.0)]
    rows, maps = [], {}
    for angle, cell_size in chosen:
        row, change = scored(event, angle, cell_size)
        rows.append(row)
        maps[angle, cell_size] = change
    best = chosen[-1]
    beds = [with_bed(event, *one) for one in (BEDS if full else BEDS[1:2])] + ([of_landlab(event)] if full else [])
    observed = {
        **compared(event, event.observed),
        "reach": reach(event, event.observed),
        "fall": fall(event, np.maximum(event.observed, 0.0)),
        "lowered_area": float((event.observed <= -DETECTED).sum() * Grid.of(event.terrain).cell_area),
        "source_area": float((event.release.thickness >= DETECTED).sum() * Grid.of(event.terrain).cell_area),
    }
    return {
        "runs": rows,
        "beds": beds,
        "reach_rows": [[first, behind - 1] for first, behind in pairwise(REACH_ROWS)],
        "observed": observed,
        "shown": {"basal_friction_deg": best[0], "cell_size": best[1], "change": _sparse(maps[best])},
        "observed_change": _sparse(event.observed),
        "shape": list(event.observed.shape),
        "lines": [*map(_line, rows), *map(_bed_line, beds)],
    }


def _sparse(change: np.ndarray) -> list[list[float]]:
    """Row, column and value [m] of the cells that changed by :data:`DETECTED` or more."""
    rows, columns = np.nonzero(np.abs(change) >= DETECTED)
    return [[int(i), int(j), round(float(change[i, j]), 2)] for i, j in zip(rows, columns, strict=True)]


def _line(row: dict[str, Any]) -> str:
    return (
        f"  basal {row['basal_friction_deg']:g} deg, cells of {row['cell_size']:g} m: reach {row['reach']:.0f} m, CSI of erosion "
        f"{row['erosion_csi']:.2f} and deposition {row['deposition_csi']:.2f}, RMSE {row['rmse']:.2f} m, {row['seconds']:.0f} s"
    )


def _bed_line(row: dict[str, Any]) -> str:
    cells = f", basal {row['basal_friction_deg']:g} deg, cells of {row['cell_size']:g} m" if "cell_size" in row else ""
    return (
        f"  {row['model']}{cells}, bed of {row['bed']:g} m: eroded {row['erosion_volume']:.0f} m3, CSI {row['csi']:.2f}, agreement "
        f"within a cell {row['agreement']:.2f}, reach error {row['reach_error']:.0f} m3"
    )
