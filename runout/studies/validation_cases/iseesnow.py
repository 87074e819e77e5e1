"""ISeeSnow: idealised snow avalanches beside the published peak maps of 12 and 13 tools.

Model intercomparison ISeeSnow (EGUsphere-2025-6053; github.com/avaframe/ISeeSnow). Thickness of the tools is normal to the slope,
that of runout vertical; here everything is normal to the slope.

The surge of IdealizedTopo comes from runs that end on the slope: how far the mass slides and stretches, and its pressure along the
flow.
"""

import csv
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import runout
from runout.materials.drucker_prager import DruckerPrager
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import FRICTIONS
from runout.model.scene import STANDARD_GRAVITY
from runout.scores import (
    Grid,
    Thalweg,
    contingency,
    field_errors,
    reached,
    slope_normal_thickness,
    terrain_slope,
    values_at,
    vertical_thickness,
)
from runout.simulation.result import Result
from runout.studies.validation_cases.case import ValidationCase, data_folder, on_cells, outline_of, rounded, thalweg_of

SOURCE = "github.com/avaframe/ISeeSnow, commit 290f4d9, folder data (maps of each tool as peers/TOOL_peak_thickness.tif and _speed)"
MOVING, EXTENT = 1.0, 0.1  # speed [m/s] of the front and thickness [m] of the area
LEVELS = (0.001, 0.1, 0.5, 1.0, 1.5)  # thicknesses [m] of the table of areas
END, STATION = 200.0, 20.0  # [s], [m]

PeakMaps = tuple[np.ndarray, np.ndarray]  # peak thickness normal to the slope [m] and peak speed [m/s], (rows, columns)
WIDTH, OUTER = 10.0, 0.1  # width of columns [m]; share of the particles that counts as the rim
EARLY = 5.0  # [s], before the slab has left its place


@dataclass(frozen=True)
class Variant:
    """One run: cells [m], particles per cell, internal friction angle [deg], release by polygon, drag at base or column.

    ``same_mass``: the polygon has the volume of the raster, else its mean thickness.
    """

    cell_size: float | tuple[float, float, float]
    particles_per_cell: tuple[int, int, int] | None = None
    friction_angle: float = 30.0
    polygon: bool = False
    drag: str = ""
    same_mass: bool = False

    @property
    def snow(self) -> runout.DruckerPrager:
        """The material, with the default stiffness."""
        return runout.DruckerPrager(density=200.0, friction_angle=self.friction_angle)

    @property
    def name(self) -> str:
        """The choices in words."""
        cells = self.cell_size if isinstance(self.cell_size, tuple) else (self.cell_size,)
        words = [" x ".join(f"{c:g}" for c in cells) + " m"]
        if self.particles_per_cell:
            words.append(" x ".join(map(str, self.particles_per_cell)) + " particles")
        words += [f"{self.friction_angle:g} deg", "polygon" if self.polygon else "raster"]
        words += ["mass of the raster"] * self.same_mass
        return ", ".join([*words, f"drag: {self.drag}"] if self.drag else words)


LEVELLED = (2, 2, 12)  # particles per cell: at 5 m four levels through the slab, as by default
ONE_LEVEL = (2, 2, 4)
COARSE = (Variant(10.0, (2, 2, 24)),)
COULOMB_FULL = (
    Variant(5.0, LEVELLED),
    Variant(5.0, LEVELLED, polygon=True),
    Variant(5.0, LEVELLED, polygon=True, same_mass=True),
    Variant(5.0, ONE_LEVEL),
    Variant((5.0, 5.0, 2.5)),
    Variant(2.5),
    Variant(10.0, (2, 2, 24)),
    Variant(10.0, ONE_LEVEL),
)
TOPO_FULL = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(5.0, LEVELLED, polygon=True, drag="column"),
    Variant(5.0, LEVELLED, 40.0, drag="column"),
    Variant(10.0, (2, 2, 24), drag="column"),
    Variant(5.0, LEVELLED, drag="base"),
    Variant(5.0, LEVELLED, 43.0, drag="base"),
)
TOPO_COARSE = (Variant(10.0, (2, 2, 24), drag="column"),)
SURGES = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(10 / 3, (2, 2, 8), drag="column"),
    Variant((5.0, 5.0, 2.5), (2, 2, 6), drag="column"),
    Variant(5.0, LEVELLED, 24.0, drag="column"),
)

COULOMB_ONLY = ValidationCase(
    "coulomb_only",
    "ISeeSnow CoulombOnly: a slab with Coulomb friction beside 13 tools",
    lambda full: measure("CoulombOnly", COULOMB_FULL if full else COARSE),
)
IDEALIZED_TOPO = ValidationCase(
    "idealized_topo",
    "ISeeSnow IdealizedTopo: a slab with Voellmy friction beside 12 tools",
    lambda full: measure("IdealizedTopo", TOPO_FULL) | measure_surges(SURGES) if full else measure("IdealizedTopo", TOPO_COARSE),
)
START, SLID, STRETCHED = 0.0, 20.0, 60.0  # times [s] of the start, of the way of the mass and of the stretched surge


@dataclass(frozen=True)
class Inputs:
    """A case of ISeeSnow: ground, release, friction coefficients mu [1] and xi [m/s2] (None: Coulomb), and the tools' maps."""

    terrain: runout.Terrain
    folder: Path
    mu: float
    xi: float | None
    peers: Mapping[str, PeakMaps]
    thalweg: Thalweg

    @property
    def slope(self) -> np.ndarray:
        """Slope of the ground (rows, columns) [rad]."""
        return terrain_slope(self.terrain.elevation, self.terrain.cell_size)

    def friction(self, drag: str) -> dict[str, Any]:
        """Choices of :func:`runout.simulate`, with ``drag`` of the base or the column."""
        if self.xi is None:
            return {"basal_friction_angle": math.degrees(math.atan(self.mu))}
        return {"basal_friction": voellmy(self.mu, self.xi, drag)}

    def release(self, polygon: bool, same_mass: bool = False) -> runout.Release:
        """The slab: the raster of the case, or its polygon with the mean of the vertical thickness or the same volume."""
        normal = np.nan_to_num(on_cells(next(self.folder.glob("rel*Field5m.tif")), self.terrain)).clip(0.0)
        vertical = np.where(normal > 0, vertical_thickness(normal, np.nan_to_num(self.slope)), 0.0)
        if not polygon:
            return runout.Release.from_array(vertical, self.terrain, placement="on_surface", name="slab")
        mean = float(vertical[vertical > 0].mean())
        outline = next(self.folder.glob("release*.shp"))
        release = runout.Release.from_vector(outline, self.terrain, thickness=mean, placement="on_surface")
        if not same_mass:
            return release
        thickness = mean * float(vertical.sum()) * self.terrain.cell_area / release.volume
        return runout.Release.from_vector(outline, self.terrain, thickness=thickness, placement="on_surface")

    def simulated(self, variant: Variant, end_time: float = END, **looks: Any) -> runout.Result:
        """The run of a variant on one thread; ``looks`` state its snapshots."""
        grid = {"cell_size": variant.cell_size, "particles_per_cell": variant.particles_per_cell}
        choices = {**grid, **self.friction(variant.drag), **looks}
        release = self.release(variant.polygon, variant.same_mass)
        return runout.simulate(self.terrain, release, variant.snow, **choices, end_time=end_time, threads=1)

    def peak_maps(self, result: runout.Result) -> PeakMaps:
        """Peak maps of a run as the tools have them."""
        vertical, speed = (np.nan_to_num(result.maps[name].values) for name in ("max_flow_thickness", "max_speed"))
        return slope_normal_thickness(vertical, np.nan_to_num(self.slope)), speed


def voellmy(mu: float, xi: float, drag: str) -> BasalFriction:
    """The law Voellmy with its coefficients mu [1] and xi [m/s2], and ``drag`` of the base or the column."""
    law: Any = FRICTIONS.find("voellmy" if drag == "column" else "voellmy_base").friction
    return law(mu=mu, xi=xi)  # type: ignore[no-any-return]


def read(case: str) -> Inputs:
    """Inputs of a case by its name in ISeeSnow, such as "CoulombOnly"."""
    folder = data_folder(f"iseesnow/{case}", SOURCE)
    terrain = runout.Terrain.from_raster(next(folder.glob("DEM_*.tif")))
    with open(folder / f"simulationParameterValues_{case}.csv", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    peers = {}
    for path in sorted(folder.glob("peers/*_peak_thickness.tif")):
        speed = path.with_name(path.name.replace("thickness", "speed"))
        peers[path.name.removesuffix("_peak_thickness.tif")] = tuple(
            np.nan_to_num(on_cells(p, terrain)).clip(0.0) for p in (path, speed)
        )
    thalweg = thalweg_of(folder / "LINES" / "path_aimec.shp")
    return Inputs(terrain, folder, float(row["mu"]), float(row["xi"]) if row["xi"] else None, peers, thalweg)  # type: ignore[arg-type]


def scored(maps: PeakMaps, others: Sequence[PeakMaps], terrain: runout.Terrain) -> dict[str, float]:
    """Numbers of a flow, and medians of its scores against others: CSI at 0.1 and 0.5 m, relative L1 of thickness.

    ``front`` is the farthest easting [m] with a speed above :data:`MOVING`, ``area`` [ha] that of more than :data:`EXTENT`.
    """
    thickness, speed = maps
    columns = np.flatnonzero((speed > MOVING).any(axis=0))
    cell = terrain.cell_size[0] * terrain.cell_size[1]

    def agreement(level: float) -> float:
        tables = (contingency(reached(thickness, level), reached(other, level)) for other, _ in others)
        return float(np.median([table.critical_success_index for table in tables]))

    return {
        "front": float(terrain.easting[columns[-1]]),
        "area": 1e-4 * cell * float((thickness > EXTENT).sum()),
        "speed": float(speed.max()),
        "csi_0.1": agreement(0.1),
        "csi_0.5": agreement(0.5),
        "l1": float(np.median([field_errors(thickness, other).relative_l1 for other, _ in others])),
    }


def areas(thickness: np.ndarray, terrain: runout.Terrain) -> list[float]:
    """Areas [ha] with more than each of :data:`LEVELS`."""
    cell = terrain.cell_size[0] * terrain.cell_size[1]
    return [1e-4 * cell * float((thickness > level).sum()) for level in LEVELS]


def measure(case: str, variants: Sequence[Variant]) -> dict[str, Any]:
    """Runs of all variants beside the tools; the first variant is the one that figures and lines show."""
    inputs = read(case)
    inputs.simulated(variants[0], 0.01)  # compiles
    everyone, rows, runs, shown = list(inputs.peers.values()), [], [], None
    for name, maps in inputs.peers.items():
        others = [other for key, other in inputs.peers.items() if key != name]
        rows.append({"tool": name, **scored(maps, others, inputs.terrain), "areas": areas(maps[0], inputs.terrain)})
    for variant in variants:
        row, maps = _run(inputs, variant, everyone)
        shown = shown or maps
        runs.append(row)
    assert shown is not None
    return {
        "mu": inputs.mu,
        "xi": inputs.xi,
        "tools": rows,
        "runs": runs,
        "outlines": _outlines({**inputs.peers, "runout": shown}, inputs.terrain),
        "profile": _profiles(inputs, shown),
        "lines": [_line(row) for row in (*runs, *rows)],
    }


def _run(inputs: Inputs, variant: Variant, tools: Sequence[PeakMaps]) -> tuple[dict[str, Any], PeakMaps]:
    """Row of a variant, and its peak maps."""
    started = time.process_time()
    result = inputs.simulated(variant)
    seconds, maps = time.process_time() - started, inputs.peak_maps(result)
    axis = float(inputs.thalweg.points[0, 1])
    row = {
        "tool": f"runout, {variant.name}",
        **scored(maps, tools, inputs.terrain),
        "areas": areas(maps[0], inputs.terrain),
        "rim_pressure": rim_pressure(inputs.simulated(variant, EARLY), variant.snow, axis, inputs.slope),
        "volume": inputs.release(variant.polygon, variant.same_mass).volume,
        "particles": result.n_particles,
        "steps": result.steps,
        "seconds": seconds,
        "cells_through_depth": result.depth_resolution.cells_through_depth,
        "stop_reason": result.stop_reason,
    }
    return row, maps


def _outlines(flows: Mapping[str, PeakMaps], terrain: runout.Terrain) -> dict[str, Any]:
    place = terrain.easting, terrain.northing
    return {name: outline_of(thickness, EXTENT, *place, terrain.cell_size[0]) for name, (thickness, _) in flows.items()}


def _profiles(inputs: Inputs, own: PeakMaps) -> dict[str, Any]:
    """Peaks along the thalweg: of the run, and least, median and most of the tools."""
    grid, stations = Grid.of(inputs.terrain), np.arange(0.0, inputs.thalweg.length, STATION)
    x, y = inputs.thalweg.at(stations).T
    profiles: dict[str, Any] = {"station": rounded(stations, 0)}
    for k, (name, digits) in enumerate((("thickness", 2), ("speed", 1))):
        peers = np.array([values_at(grid, maps[k], x, y) for maps in inputs.peers.values()])
        bands = {"least": peers.min(axis=0), "median": np.median(peers, axis=0), "most": peers.max(axis=0)}
        profiles[name] = {key: rounded(v, digits) for key, v in {"runout": values_at(grid, own[k], x, y), **bands}.items()}
    return profiles


def _line(row: Mapping[str, Any]) -> str:
    cost = f"  {row['seconds']:.1f} s" if "seconds" in row else ""
    return (
        f"  {row['tool']}: front {row['front']:.0f} m, area {row['area']:.1f} ha, speed {row['speed']:.1f} m/s, "
        f"CSI {row['csi_0.1']:.3f} and {row['csi_0.5']:.3f}, L1 {row['l1']:.2f}{cost}"
    )


def rim_pressure(result: Result, snow: DruckerPrager, axis: float, slope: np.ndarray) -> float:
    """Mean pressure of the outer tenth of a mass over the hydrostatic one, rho g H cos(slope)^2 / 2 with the thickness H [1].

    The run has just begun; its modulus counts, not that of ``snow``. The mass is symmetric about the northing ``axis`` [m].
    ``slope`` (rows, columns) is that of the ground [rad].
    """
    p, terrain = result.state, result.terrain
    bulk = result.start["youngs_modulus"][0] / (3 - 6 * snow.poisson_ratio)
    east, north = (result.particles[name].values for name in ("easting", "northing"))
    volume = p.mass / snow.density
    pressure = -bulk * p.strain[:, :3].sum(axis=1) / 2  # small elastic strain: tr B = 2 ln J
    cosine = np.cos(values_at(Grid.of(terrain), slope, east, north))
    hydrostatic = layer_pressure(east, north, volume, snow.density) * cosine**2
    away = np.abs(north - axis)
    rim = away > np.quantile(away, 1 - OUTER)
    return float((volume * pressure)[rim].sum() / (volume * hydrostatic)[rim].sum())


def layer_pressure(east: np.ndarray, north: np.ndarray, volume: np.ndarray, density: float) -> np.ndarray:
    """Mean hydrostatic pressure [Pa] over the depth, on level ground, of the columns of particles (n,) of a volume [m3]."""
    _, column = np.unique(np.floor(np.column_stack([east, north]) / WIDTH), axis=0, return_inverse=True)
    thickness = np.bincount(column.ravel(), volume)[column.ravel()] / WIDTH**2
    return density * STANDARD_GRAVITY * thickness / 2  # type: ignore[no-any-return]


def measure_surges(variants: Sequence[Variant]) -> dict[str, Any]:
    """``surges``: a row a variant; ``slab``: way in plan [m] of a rigid slab in :data:`SLID`."""
    inputs = read("IdealizedTopo")
    return {"surges": [_surge(inputs, variant) for variant in variants], "slab": slab_way(inputs)}


def _surge(inputs: Inputs, variant: Variant) -> dict[str, Any]:
    """Row of a variant: largest cross-section [m2], way of the median of the mass [m], pressure over the hydrostatic one [1]."""
    looks = {"snapshot_times": (START, SLID, STRETCHED), "snapshot_particles": 10**6}
    result = inputs.simulated(variant, STRETCHED, **looks)
    thickness = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values[-1])
    normal = slope_normal_thickness(thickness, np.nan_to_num(inputs.slope))
    east = [float(np.nanmedian(frame[:, 0])) for frame in result.particle_frames]
    front, rear = pressures_along(result, variant.snow, inputs.slope)
    cells = variant.cell_size if isinstance(variant.cell_size, tuple) else (variant.cell_size,)
    return {
        "cells": [round(size, 2) for size in cells],
        "friction_angle_deg": variant.friction_angle,
        "section": float(normal.sum(axis=0).max()) * inputs.terrain.cell_size[1],
        "way": east[1] - east[0],
        "front_pressure": front,
        "rear_pressure": rear,
        "particles": result.n_particles,
    }


def pressures_along(result: Result, snow: DruckerPrager, slope: np.ndarray) -> tuple[float, float]:
    """Mean pressure towards the east along the ground over the hydrostatic one, of the front and the rear half of the mass."""
    p, east, north = result.state, *(result.particles[name].values for name in ("easting", "northing"))
    angle = values_at(Grid.of(result.terrain), slope, east, north)
    modulus, volume = result.start["youngs_modulus"][0], p.mass / snow.density
    shear, bulk = modulus / (2 + 2 * snow.poisson_ratio), modulus / (3 - 6 * snow.poisson_ratio)
    cosine, sine, strain = np.cos(angle), np.sin(angle), p.strain / 2  # small elastic strain: B = I + 2 e
    along = cosine**2 * strain[:, 0] + sine**2 * strain[:, 2] - 2 * sine * cosine * strain[:, 5]
    change = strain[:, :3].sum(axis=1)
    pressure = -2 * shear * (along - change / 3) - bulk * change
    hydrostatic = layer_pressure(east, north, volume, snow.density) * cosine**2
    eastern = east > np.median(east)
    front, rear = (float((volume * pressure)[half].sum() / (volume * hydrostatic)[half].sum()) for half in (eastern, ~eastern))
    return front, rear


def slab_way(inputs: Inputs) -> float:
    """Way in plan [m] of a rigid slab with Voellmy friction from rest: v^2 ln cosh(a t / v) / a along the slope, v at its end."""
    release = inputs.release(polygon=False).thickness
    angle = float(inputs.slope[release > 0].mean())
    normal = float(slope_normal_thickness(release, np.nan_to_num(inputs.slope))[release > 0].mean())
    surplus = math.sin(angle) - inputs.mu * math.cos(angle)
    fastest, gain = math.sqrt((inputs.xi or math.inf) * normal * surplus), STANDARD_GRAVITY * surplus
    return fastest**2 / gain * math.log(math.cosh(gain * SLID / fastest)) * math.cos(angle)
