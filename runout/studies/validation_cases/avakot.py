"""AvaFrame's site avaKot with its own friction: samosAT, and Voellmy with AvaFrame's coefficients, beside com1DFA.

`avakot_com1dfa.json` holds the outlines and numbers of com1DFA (AvaFrame 2.1, default configuration with cells of 5 m, type null:
no entrainment, forest resistance or dam) on the same inputs. `tests/benchmarks/avakot_com1dfa.py` makes it. AvaFrame's standard
test of this site states samosAT, mu = 0.155.
Inputs: AvaFrame (EUPL-1.2), terrain of the Land Tirol.

Runs without basal friction state the energy that the mass loses, beside that of single points that land inelastically. The points
have no grid, size or internal friction. Both take the same ground: the raster, or its means over larger cells. What both lose
alike is lost by landing; what only the mass loses is lost where its parts meet.

samosAT is the friction law of AvaFrame: tau = mu sigma (1 + R_s0 / (R_s0 + R_s)) + rho u^2 / (B + ln(h / R) / kappa)^2 with R_s =
rho u^2 / sigma (Sampl & Granig 2009, Proc. Int. Snow Science Workshop Davos; AvaFrame documentation, theory of com1DFA). The
thickness normal to the slope is taken from the load, h = sigma / (rho g cos(slope)), with the slope as a parameter; the logarithm
hardly depends on it.
"""

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import shapely
from scipy.interpolate import RegularGridInterpolator

import runout
from runout.model.basal_friction import BasalFriction
from runout.model.friction_laws import register_friction
from runout.model.numerics import Scheme
from runout.model.parameters import parameter
from runout.model.scene import STANDARD_GRAVITY
from runout.model.surface import Surface
from runout.model.terrain import Terrain
from runout.physics.tensors import real
from runout.scores import (
    Grid,
    Thalweg,
    contingency,
    outline_shares,
    reached,
    slope_normal_thickness,
    terrain_slope,
    values_at,
    vertical_thickness,
)
from runout.simulation.result import Result
from runout.studies.validation_cases.case import data_folder, outline_of, thalweg_of
from runout.studies.validation_cases.iseesnow import voellmy
from runout.terrain.averaging import averaged
from runout.terrain.sdf import raster_surface

END, STEP = 20.0, 0.01  # [s]: time in which energy is lost, and step of the points
DENSITY, FRICTION_ANGLE = 200.0, 30.0  # [kg/m3], internal [deg]
SOURCE = "github.com/OpenNHM/AvaFrame, folder avaframe/data/avaKot"
OTHER = Path(__file__).with_name("avakot_com1dfa.json")
RELEASED = 1.0  # thickness normal to the slope [m]
STUDIES = ((10.0, 30.0), (4.0, 30.0), (5.0, 12.0), (5.0, 45.0))  # cells [m] and internal friction [deg]
LEVELS = (2, 2, 14)  # particles per cell: four levels through the slab with cells of 5 m
MOVING, EXTENT = 1.0, 0.1  # speed [m/s] of the front and thickness [m] of the area
LEVELS_OF_AREA = (0.5, 4.0)  # thicknesses [m] of further areas
LOOKS = tuple(range(4, 41, 4))  # times [s] at which the mass over the ground is looked at
SHOTS: dict[str, Any] = {"snapshot_times": LOOKS, "snapshot_particles": 10**6}
LIFTED = 5.0  # height over the ground [m] from which mass counts as in flight


@dataclass(frozen=True, kw_only=True)
class SamosAt(BasalFriction):
    """Friction of AvaFrame's samosAT: Coulomb friction that doubles at rest, and drag with a logarithmic profile."""

    law: ClassVar[str] = "samosat"
    coefficients: ClassVar[tuple[str, ...]] = ("mu",)
    uses_area: ClassVar[bool] = True
    drags_column: ClassVar[bool] = True  # as com1DFA means it
    mu: float = parameter("Coulomb friction coefficient", low=0, high=2, typical=0.155)
    fluidization: float = parameter("fluidization factor R_s0", low=0, high=10, default=0.222)
    kappa: float = parameter("constant of the logarithmic profile", low=0.01, high=1, default=0.43)
    offset: float = parameter("constant B of the logarithmic profile", low=0, high=100, default=4.13)
    roughness: float = parameter("roughness R of the logarithmic profile", unit="m", low=1e-6, high=10, default=0.05)
    weight: float = parameter("density times gravity times cosine of the slope", unit="N/m3", low=1, high=1e6, typical=1600.0)

    def numbers(self) -> dict[str, float]:
        """The parameters."""
        return {name: getattr(self, name) for name in ("mu", "fluidization", "kappa", "offset", "roughness", "weight")}

    @classmethod
    def acting(cls, numbers: Mapping[str, Any], mass: Any) -> dict[str, Any]:
        """The numbers, with the density and the strength of the mass."""
        return {**numbers, "density": mass.density, "strength": mass.strength}


def resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """Steady impulse [N s] and drag [kg/m]."""
    load = max(normal / (area * dt), real(1e-3))  # [Pa]
    fluid = basal.density * slip * slip / load
    rising = real(1.0) + basal.fluidization / max(basal.fluidization + fluid, real(1e-12))
    profile = basal.offset + math.log(max(load / (basal.weight * basal.roughness), real(1.0))) / basal.kappa
    return basal.mu * normal * rising, area * basal.density / (profile * profile)


register_friction(SamosAt, resistance)


@dataclass(frozen=True)
class Choice:
    """Size [m] of the cells over which the ground is averaged, cells [m] of the run, particles per cell, and substeps."""

    ground: float
    cell_size: float
    particles_per_cell: tuple[int, int, int]
    substeps: int = Scheme.substeps


FINE, COARSE = (2, 2, 14), (2, 2, 28)  # particles per cell of 5 m and 10 m: the same layers
CHOICES = (
    Choice(5.0, 5.0, FINE),
    Choice(5.0, 5.0, FINE, substeps=1),
    Choice(10.0, 5.0, FINE),
    Choice(10.0, 10.0, COARSE),
    Choice(20.0, 5.0, FINE),
)


def measure_energy(terrain: runout.Terrain, release: Any, choices: Sequence[Choice] = CHOICES) -> list[dict[str, Any]]:
    """Row of each choice: shares [1] of the potential energy that is set free; ``release(terrain)`` makes the mass."""
    return [_lost(chosen, terrain, release) for chosen in choices]


def _lost(chosen: Choice, terrain: runout.Terrain, release: Any) -> dict[str, Any]:
    ground = averaged(terrain, chosen.ground) if chosen.ground > terrain.cell_size[0] else terrain
    mass, snow = release(ground), runout.DruckerPrager(density=DENSITY, friction_angle=FRICTION_ANGLE)
    grid = {"cell_size": chosen.cell_size, "particles_per_cell": chosen.particles_per_cell, "substeps": chosen.substeps}
    result = runout.simulate(ground, mass, snow, basal_friction_angle=0.0, **grid, end_time=END, stop=False, threads=1)  # type: ignore[arg-type]
    energy = {name: float(series[-1] - series[0]) for name, series in result.ledger.items() if series.ndim == 1}
    freed = -energy["potential_energy"]
    return {
        "ground": chosen.ground,
        "cell_size": chosen.cell_size,
        "substeps": chosen.substeps,
        "points": Points.on(mass).slide(END).lost,
        "lost": 1.0 - energy["kinetic_energy"] / freed,
        **{name: energy[f"{name}_dissipation"] / freed for name in ("plastic", "basal", "numerical")},
    }


@dataclass
class Points:
    """Points of equal mass that fall, land without a rebound and slide, each alone."""

    surface: Surface  # the ground
    # place, velocity: (3, n): local [m] and [m/s]
    place: np.ndarray
    velocity: np.ndarray
    start: np.ndarray  # (n,): elevation [m] at the start
    # mu, drag: friction coefficient [1], and drag g / (xi h) [1/m], which acts in flight too
    mu: float = 0.0
    drag: float = 0.0

    @classmethod
    def on(cls, release: runout.Release, mu: float = 0.0, drag: float = 0.0) -> "Points":
        """One at rest in the middle of each cell of a release."""
        terrain = release.terrain
        rows, columns = np.nonzero(release.thickness > 0)
        map_place = np.column_stack([terrain.easting[columns], terrain.northing[rows], np.zeros(len(rows))])
        x, y, _ = terrain.frame.to_local(map_place).T
        surface = raster_surface(terrain, None, terrain.cell_size)
        z = surface.evaluate(x, y)[0]
        return cls(surface, np.array([x, y, z]), np.zeros((3, len(x))), z, mu, drag)

    def slide(self, seconds: float) -> "Points":
        """The same points after a time [s]."""
        for _ in range(round(seconds / STEP)):
            self._step()
        return self

    def _step(self) -> None:
        """Gravity and drag, motion, and a plastic impact of the points that have come below the ground."""
        self.velocity[2] -= STANDARD_GRAVITY * STEP
        self.velocity /= 1.0 + self.drag * STEP * np.linalg.norm(self.velocity, axis=0)
        self.place += STEP * self.velocity
        elevation, normal = self._ground()
        landed = self.place[2] <= elevation
        self.place[2] = np.where(landed, elevation, self.place[2])
        push = np.where(landed, np.maximum(0.0, -(self.velocity * normal).sum(axis=0)), 0.0)
        self.velocity += push * normal
        slip = self.velocity - (self.velocity * normal).sum(axis=0) * normal
        speed = np.maximum(np.linalg.norm(slip, axis=0), np.finfo(float).tiny)
        self.velocity -= slip * np.minimum(1.0, self.mu * push / speed)

    def _ground(self) -> tuple[np.ndarray, np.ndarray]:
        """Elevation (n,) [m] and upward unit normal (3, n) of the ground below."""
        elevation, east, north = self.surface.evaluate(*self.place[:2])
        normal = np.array([-east, -north, np.ones_like(east)])
        return elevation, normal / np.linalg.norm(normal, axis=0)

    @property
    def lost(self) -> float:
        """Share [1] of the potential energy that was set free and is not kinetic."""
        freed = STANDARD_GRAVITY * float((self.start - self.place[2]).sum())
        return 1.0 - 0.5 * float((self.velocity**2).sum()) / freed

    def lifted(self, height: float) -> float:
        """Share [1] of the points more than a height [m] over the ground, normal to it."""
        elevation, normal = self._ground()
        return float(((self.place[2] - elevation) * normal[2] > height).mean())


def friction(law: str, parameters: dict[str, float], slope: float) -> Any:
    """Friction law by its name in AvaFrame; ``slope`` [rad] of the track."""
    if law == "Voellmy":
        return voellmy(parameters["mu"], parameters["xi"], "column")
    named = {"fluidization": "R_s0", "kappa": "kappa", "offset": "B", "roughness": "R"}
    chosen = {name: parameters[key] for name, key in named.items()}
    return SamosAt(mu=parameters["mu"], **chosen, weight=DENSITY * 9.81 * float(np.cos(slope)))


def measure(full: bool) -> dict[str, Any]:
    """Both laws, with one substep as well, Voellmy with other cells and internal frictions, and energies; in CI Voellmy only."""
    case = read()
    runs = [_run(case, law, 5.0) for law in ("samosAT", "Voellmy")] if full else [_run(case, "Voellmy", 10.0)]
    studies = [_run(case, "Voellmy", cells, angle) for cells, angle in STUDIES] if full else []
    single = [_run(case, law, 5.0, substeps=1) for law in ("samosAT", "Voellmy")] if full else []
    for row in (*studies, *single):
        del row["outline"]
    return {
        "runs": runs,
        "studies": studies,
        "one_substep": single,
        "energy": measure_energy(case.terrain, slab) if full else [],
        "points_lifted": _points_lifted(case) if full else None,
        "com1dfa": case.others,
        "volume": float(case.release.thickness.sum() * Grid.of(case.terrain).cell_area),
        "lines": [_line(run, case.others[run["law"]]) for run in (*runs, *studies, *single)],
    }


@dataclass(frozen=True)
class Inputs:
    """Ground, slab, path of the flow, and the results of com1DFA by friction law."""

    terrain: runout.Terrain
    release: runout.Release
    line: Thalweg
    others: dict[str, Any]

    @cached_property
    def slope(self) -> np.ndarray:
        """Of the ground (rows, columns) [rad]."""
        return terrain_slope(self.terrain.elevation, self.terrain.cell_size)


def read() -> Inputs:
    """Inputs of the case, and the record of com1DFA."""
    folder = _folder()
    terrain = runout.Terrain.from_raster(folder / "avaKot.asc", crs="EPSG:31287")
    others = json.loads(OTHER.read_text(encoding="utf-8"))["laws"]
    return Inputs(terrain, slab(terrain), thalweg_of(folder / "LINES" / "path_aimec.shp"), others)


def _run(
    case: Inputs, law: str, cell_size: float, friction_angle: float = FRICTION_ANGLE, substeps: int = Scheme.substeps
) -> dict[str, Any]:
    """Row of a run beside com1DFA with the same friction."""
    other, inside = case.others[law], float(case.slope[case.release.thickness > 0].mean())
    snow = runout.DruckerPrager(density=DENSITY, friction_angle=friction_angle)
    choices = {"basal_friction": friction(law, other["parameters"], inside), "cell_size": cell_size, "substeps": substeps, **SHOTS}
    particles = (*LEVELS[:2], round(LEVELS[2] * cell_size / 5.0))
    started = time.process_time()
    result = runout.simulate(case.terrain, case.release, snow, **choices, particles_per_cell=particles, end_time=120.0, threads=1)
    seconds = time.process_time() - started
    row = {"law": law, "cell_size": cell_size, "friction_angle_deg": friction_angle, "seconds": seconds}
    return {**row, **_scored(result, case, other), "particles": result.n_particles}


def _points_lifted(case: Inputs) -> float:
    """Largest share of single points above :data:`LIFTED` at the times of the snapshots, with Voellmy's friction for a slab."""
    numbers = case.others["Voellmy"]["parameters"]
    points = Points.on(case.release, numbers["mu"], STANDARD_GRAVITY / (numbers["xi"] * RELEASED))
    times = np.diff((0, *LOOKS))
    return max(points.slide(float(seconds)).lifted(LIFTED) for seconds in times)


def _folder() -> Path:
    return data_folder("avaframe/avaKot", SOURCE) / "Inputs"


def slab(terrain: runout.Terrain) -> runout.Release:
    """The slab on a terrain, 1 m thick normal to the slope."""
    slope = terrain_slope(terrain.elevation, terrain.cell_size)
    polygon = runout.Release.from_vector(_folder() / "REL" / "relKot.shp", terrain, thickness=RELEASED, placement="on_surface")
    vertical = vertical_thickness(polygon.thickness, np.nan_to_num(slope))
    return runout.Release.from_array(vertical, terrain, placement="on_surface", name="relKot")


def _scored(result: runout.Result, case: Inputs, other: dict[str, Any]) -> dict[str, Any]:
    """Numbers of a run as those of com1DFA, agreement of the areas, and how the mass moves over the ground."""
    terrain, cell, slope = result.terrain, Grid.of(result.terrain), case.slope
    thickness = slope_normal_thickness(np.nan_to_num(result.maps["max_flow_thickness"].values), np.nan_to_num(slope))
    deposit = np.nan_to_num(result.maps["deposit_thickness"].values)
    speed = np.nan_to_num(result.maps["max_speed"].values)
    s, _ = case.line.coordinates(*np.meshgrid(terrain.easting, terrain.northing))
    covered = outline_shares(shapely.union_all([shapely.Polygon(ring) for ring in other["outline"]]).buffer(0), cell)
    table, outside = contingency(reached(thickness, EXTENT), covered, cell.cell_area), covered < 0.5
    return {
        "front": float(s[speed > MOVING].max()),
        "area": 1e-4 * cell.cell_area * float((thickness > EXTENT).sum()),
        "speed": float(speed.max()),
        "thickest": float(thickness.max()),
        "areas": [1e-4 * cell.cell_area * float((thickness > level).sum()) for level in LEVELS_OF_AREA],
        "lifted": lifted(result, slope),
        "looseness": looseness(result, slope, LEVELS_OF_AREA[1]),
        "peak_outside": float(np.median(thickness[outside & (thickness > EXTENT)])),
        "volume_outside": float(deposit[outside].sum() / deposit.sum()),
        "csi": table.critical_success_index,
        "cells_through_depth": result.depth_resolution.cells_through_depth,
        "stop_reason": result.stop_reason,
        "outline": outline_of(thickness, EXTENT, terrain.easting, terrain.northing, 5.0),
    }


def _line(run: dict[str, Any], other: dict[str, Any]) -> str:
    pairs = (("front", "m", ".0f"), ("area", "ha", ".1f"), ("speed", "m/s", ".1f"))
    words = ", ".join(f"{key} {run[key]:{how}} {unit} (com1DFA {other[key]:{how}})" for key, unit, how in pairs)
    name = f"{run['law']}, cells of {run['cell_size']:g} m, {run['friction_angle_deg']:g} deg"
    return f"  {name}: {words}, CSI {run['csi']:.2f}, {run['seconds']:.0f} s"


def lifted(result: Result, slope: np.ndarray) -> float:
    """Largest share of the particles more than :data:`LIFTED` over the ground, normal to it, over all snapshots."""
    frames = (heights(result.terrain, slope, frame)[1] for frame in result.particle_frames)
    return max(float((height > LIFTED).mean()) for height in frames)


def looseness(result: Result, slope: np.ndarray, thick: float) -> list[float]:
    """Mean height of the mass over half its thickness [1], where it is more than ``thick`` [m], for each snapshot that has such."""
    means = []
    maps = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values)
    for vertical, frame in zip(maps, result.particle_frames, strict=True):
        place, height = heights(result.terrain, slope, frame)
        thickness = values_at(Grid.of(result.terrain), slope_normal_thickness(vertical, np.nan_to_num(slope)), *place)
        there = thickness > thick
        if there.any():
            means.append(float(2 * height[there].mean() / thickness[there].mean()))
    return means


def heights(terrain: Terrain, slope: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place in plan (2, n) and height over the ground (n,) [m], normal to it, of the particles (m, 4) that have not left."""
    x, y, z = terrain.frame.to_map(np.asarray(frame[np.isfinite(frame[:, 0]), :3], np.float64)).T
    ground = np.stack([terrain.elevation, np.cos(np.nan_to_num(slope))], axis=-1)[::-1]
    elevation, cosine = RegularGridInterpolator((terrain.northing[::-1], terrain.easting), ground)((y, x)).T
    return np.array([x, y]), (z - elevation) * cosine
