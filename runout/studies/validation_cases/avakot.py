"""AvaFrame's site avaKot with its own friction: samosAT, and Voellmy with AvaFrame's coefficients, beside com1DFA.

`avakot_com1dfa.json` holds the outlines and numbers of com1DFA (AvaFrame 2.1, default configuration with cells of 5 m, type null:
no entrainment, forest resistance or dam) on the same inputs. AvaFrame's standard test of this site states samosAT, mu = 0.155.
Inputs: AvaFrame (EUPL-1.2), terrain of the Land Tirol.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import shapely

import runout
from runout.scores import Grid, contingency, outline_shares, reached, slope_normal_thickness, terrain_slope, vertical_thickness
from runout.studies.validation_cases.case import data_folder
from runout.studies.validation_cases.drawing import outline_of
from runout.studies.validation_cases.iseesnow import voellmy
from runout.studies.validation_cases.rasters import thalweg_of

SOURCE = "github.com/OpenNHM/AvaFrame, folder avaframe/data/avaKot"
OTHER = Path(__file__).with_name("avakot_com1dfa.json")
DENSITY, RELEASED = 200.0, 1.0  # [kg/m3], thickness normal to the slope [m]
FRICTION_ANGLE = 30.0  # internal [deg]
LEVELS = (2, 2, 14)  # particles per cell: four levels through the slab with cells of 5 m
MOVING, EXTENT = 1.0, 0.1  # speed [m/s] of the front and thickness [m] of the area
LEVELS_OF_AREA = (0.5, 4.0)  # thicknesses [m] of further areas
LIFTED, LOOKS = 5.0, tuple(range(4, 41, 4))  # height over the ground [m], and times [s] at which the mass above is counted
SHOTS: dict[str, Any] = {"snapshot_times": LOOKS, "snapshot_particles": 10**6}


def friction(law: str, parameters: dict[str, float], slope: float) -> Any:
    """Friction law by its name in AvaFrame; ``slope`` [rad] of the track."""
    if law == "Voellmy":
        return voellmy(parameters["mu"], parameters["xi"], "column")
    from runout.studies.validation_cases.samosat import SamosAt

    named = {"fluidization": "R_s0", "kappa": "kappa", "offset": "B", "roughness": "R"}
    chosen = {name: parameters[key] for name, key in named.items()}
    return SamosAt(mu=parameters["mu"], **chosen, weight=DENSITY * 9.81 * float(np.cos(slope)))


def measure(full: bool) -> dict[str, Any]:
    """Both laws with cells of 5 m; in CI Voellmy with 10 m."""
    folder = data_folder("avaframe/avaKot", SOURCE) / "Inputs"
    terrain = runout.Terrain.from_raster(folder / "avaKot.asc", crs="EPSG:31287")
    slope = terrain_slope(terrain.elevation, terrain.cell_size)
    line = thalweg_of(folder / "LINES" / "path_aimec.shp")
    others = json.loads(OTHER.read_text(encoding="utf-8"))["laws"]
    chosen = [("samosAT", 5.0), ("Voellmy", 5.0)] if full else [("Voellmy", 10.0)]
    release = _release(folder, terrain, slope)
    inside = float(slope[release.thickness > 0].mean())
    runs = []
    for law, cell_size in chosen:
        snow = runout.DruckerPrager(density=DENSITY, friction_angle=FRICTION_ANGLE)
        choices = {"basal_friction": friction(law, others[law]["parameters"], inside), "cell_size": cell_size, **SHOTS}
        particles = LEVELS if cell_size == 5.0 else (2, 2, 28)
        started = time.process_time()
        result = runout.simulate(terrain, release, snow, **choices, particles_per_cell=particles, end_time=120.0, threads=1)
        seconds = time.process_time() - started
        row = _scored(result, slope, line, others[law])
        runs.append({"law": law, "cell_size": cell_size, "seconds": seconds, **row, "particles": result.n_particles})
    lines = [_line(run, others[run["law"]]) for run in runs]
    return {"runs": runs, "com1dfa": others, "volume": float(release.thickness.sum() * Grid.of(terrain).cell_area), "lines": lines}


def _release(folder: Path, terrain: runout.Terrain, slope: np.ndarray) -> runout.Release:
    """The slab, 1 m thick normal to the slope."""
    polygon = runout.Release.from_vector(folder / "REL" / "relKot.shp", terrain, thickness=RELEASED, placement="on_surface")
    vertical = vertical_thickness(polygon.thickness, np.nan_to_num(slope))
    return runout.Release.from_array(vertical, terrain, placement="on_surface", name="relKot")


def _scored(result: runout.Result, slope: np.ndarray, line: Any, other: dict[str, Any]) -> dict[str, Any]:
    """Numbers of a run as those of com1DFA, and agreement of the areas."""
    terrain, cell = result.terrain, Grid.of(result.terrain)
    thickness = slope_normal_thickness(np.nan_to_num(result.maps["max_flow_thickness"].values), np.nan_to_num(slope))
    speed = np.nan_to_num(result.maps["max_speed"].values)
    x, y = np.meshgrid(terrain.easting, terrain.northing)
    s, _ = line.coordinates(x, y)
    covered = outline_shares(shapely.union_all([shapely.Polygon(ring) for ring in other["outline"]]).buffer(0), cell)
    table = contingency(reached(thickness, EXTENT), covered, cell.cell_area)
    return {
        "front": float(s[speed > MOVING].max()),
        "area": 1e-4 * cell.cell_area * float((thickness > EXTENT).sum()),
        "speed": float(speed.max()),
        "thickest": float(thickness.max()),
        "areas": [1e-4 * cell.cell_area * float((thickness > level).sum()) for level in LEVELS_OF_AREA],
        "lifted": max(_lifted(terrain, slope, frame) for frame in result.particle_frames),
        "csi": table.critical_success_index,
        "cells_through_depth": result.depth_resolution.cells_through_depth,
        "stop_reason": result.stop_reason,
        "outline": outline_of(thickness, EXTENT, terrain.easting, terrain.northing, 5.0),
    }


def _lifted(terrain: runout.Terrain, slope: np.ndarray, frame: np.ndarray) -> float:
    """Share of the particles (n, 4) more than :data:`LIFTED` over the ground, normal to it; those that have left do not count."""
    from scipy.interpolate import RegularGridInterpolator

    x, y, z = terrain.frame.to_map(np.asarray(frame[np.isfinite(frame[:, 0]), :3], np.float64)).T
    ground = np.stack([terrain.elevation, np.cos(np.nan_to_num(slope))], axis=-1)[::-1]
    elevation, cosine = RegularGridInterpolator((terrain.northing[::-1], terrain.easting), ground)((y, x)).T
    return float(((z - elevation) * cosine > LIFTED).mean())


def _line(run: dict[str, Any], other: dict[str, Any]) -> str:
    pairs = (("front", "m", ".0f"), ("area", "ha", ".1f"), ("speed", "m/s", ".1f"))
    words = ", ".join(f"{key} {run[key]:{how}} {unit} (com1DFA {other[key]:{how}})" for key, unit, how in pairs)
    return f"  {run['law']}, cells of {run['cell_size']:g} m: {words}, CSI {run['csi']:.2f}, {run['seconds']:.0f} s"
