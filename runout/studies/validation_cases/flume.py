"""Gate releases at the USGS debris-flow flume: arrival, thickness and deposit of 8 to 10 m3 of wet sand, gravel and mud.

Geometry of flume and reservoir: D-Claw's example (github.com/geoflows/dclaw-apps, commit a5067fb,
USGSFlume/gate_release_example/setinit.py). Material: George & Iverson 2014, Proc. R. Soc. A 470:20130820, table 2.

Observations: sensors of 24 and 25 May 2017 (Iverson & Obryk 2019, doi 10.5066/P9NAFXW7), and the mean of eight releases (Iverson
et al. 2010, J. Geophys. Res. 115:F03005, data set ds03). The raw files were not at hand; arrivals and peaks are those that
github.com/youryugi/dclaw reduced from them (commit 51f0c4e, validation/usgs_flume_2017; commit 89964d5,
validation/usgs_flume_2010_paper2014). All distances are along the bed from the gate.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import runout
from runout.structures.build import build_structures
from runout.structures.solid import Solid
from runout.studies.validation_cases.case import rounded

SLOPE, PAD_SLOPE = np.radians(31.0), np.radians(2.5)
BEND, RADIUS = 78.0, 10.0  # distance [m] at which the bed starts to turn into the pad, and radius of that curve [m]
MOUTH, WIDTH, WALL_HEIGHT = 82.5, 2.0, 1.6  # end of the side walls, distance between them, their height [m]
RESERVOIR = ((-4.03, 0.0), (-3.156, 0.968), (0.0, 1.9))  # horizontal distance to the gate, vertical depth [m]: 9.9 m3
SOLIDS, GRAINS, FLUID = 0.62, 2700.0, 1100.0  # solid volume fraction [1], densities [kg/m3]
DENSITY = SOLIDS * GRAINS + (1.0 - SOLIDS) * FLUID
BASAL_DEG = 40.7
PASSED_ON_DEG = float(np.degrees(np.arcsin(np.tan(np.radians(BASAL_DEG)))))  # inner friction that passes this basal friction on
WALL = 0.364  # friction coefficient of the side walls, concrete of 20 deg; not measured
HYDROSTATIC = FLUID / DENSITY  # pore pressure ratio behind the gate that the paper states
MEASURED_2017 = 0.38  # 8.1 kPa below 1.197 m on 25 May: 0.625 of the hydrostatic pressure without the cosine of the slope
DIFFUSIVITY = 5.0e-9 / (0.005 * 2.0e-6)  # [m2/s]: permeability over viscosity and compressibility
STAYS = 1.0e6  # decay time [s] of a ratio that stays
WEST, EAST, HALF, CELL = -6.0, 131.0, 8.0, 0.25  # of the terrain [m]
FINE, COARSE = 0.125, 0.25  # cells [m] of the measured numbers, and of the other runs
END, EVERY = 30.0, 0.05  # of a run, and from one value of a series to the next [s]
ARRIVED = 0.02  # thickness [m] normal to the bed from which the flow has arrived, as in the reduction of the sensors
GAUGES = (2.5, 31.7, 65.4, 80.0, 90.0)
OBSERVED: dict[str, Any] = {
    "2017-05-24": {"volume": 8.0, "arrival": [0.833, 3.906, 7.573, 10.092, None], "peak": [0.359, 0.166, 0.136, 0.420, None]},
    "2017-05-25": {"volume": 10.0, "arrival": [0.987, 4.116, 7.822, 10.970, None], "peak": [0.360, 0.283, 0.341, 0.168, None]},
    "mean of eight": {"volume": 9.73, "arrival": [None] * 5, "peak": [None, 0.211, 0.186, None, 0.208]},  # at 32, 66 and 90 m
}
DEPOSIT = {"front": 112.0, "end": 120.0, "thickest_at": 106.0}  # [m], of ten cubic metres (George & Iverson 2014, figs 15 and 16)


def bed() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distance along the bed, easting, elevation [m] and slope [rad] of its points (n,), from the gate."""
    s = np.linspace(-12.0, 150.0, 16201)
    slope = np.where(s <= BEND, SLOPE, np.maximum(PAD_SLOPE, SLOPE - (s - BEND) / RADIUS))
    step, middle, gate = np.diff(s), 0.5 * (slope[1:] + slope[:-1]), int(np.abs(s).argmin())
    x, z = (np.concatenate([[0.0], np.cumsum(step * of(middle))]) for of in (np.cos, lambda a: -np.sin(a)))
    return s, x - x[gate], z - z[gate], slope


def side_wall(x: np.ndarray, z: np.ndarray, south: float, north: float, name: str) -> Solid:
    """Upright wall on the ground of elevations (n,) at eastings (n,), between two northings [m]."""
    heights = -0.5, WALL_HEIGHT
    vertices = np.array([(a, y, b + up) for a, b in zip(x, z, strict=True) for y in (south, north) for up in heights])
    ring = (0, 1, 3, 2)  # south below, south above, north above, north below: around a section
    edges = [(a, 4 + a, 4 + b, b) for a, b in zip(ring, (*ring[1:], ring[0]), strict=True)]
    sides = [tuple(4 * section + corner for corner in edge) for section in range(len(x) - 1) for edge in edges]
    squares = [*sides, ring, tuple(4 * (len(x) - 1) + corner for corner in ring[::-1])]
    faces = np.array([face for a, b, c, d in squares for face in ((a, b, c), (a, c, d))])
    return Solid(name, vertices, faces, np.zeros(len(faces), int), ("surface",), WALL, name)


@dataclass(frozen=True)
class Variant:
    """One run: what differs from the measured numbers, and the spacing of its grid [m]."""

    name: str
    cell_size: float
    ratio: float = HYDROSTATIC  # pore pressure over total normal stress [1], which stays
    inner_deg: float = PASSED_ON_DEG
    volume: float = 1.0  # of that of the reservoir
    diffusivity: float | None = None  # [m2/s], with which the pore pressure relaxes to that of clear water; otherwise it stays

    def simulated(self) -> tuple[runout.Result, np.ndarray]:
        """Result, and the horizontal places (gauges,) [m] of the gauges."""
        s, x, z, _ = bed()
        middles = WEST + CELL * (np.arange(round((EAST - WEST) / CELL)) + 0.5)
        across = CELL * (np.arange(round(2 * HALF / CELL)) + 0.5) - HALF
        ground = np.tile(np.interp(middles, x, z), (len(across), 1))
        terrain = runout.Terrain.from_array(ground, CELL, origin=(WEST, -HALF))
        from_gate, filled = np.array(RESERVOIR).T
        depth = np.where(middles < 0.0, np.interp(middles, from_gate, filled, left=0.0), 0.0) * self.volume
        thickness = np.where(np.abs(across)[:, None] < WIDTH / 2, depth, 0.0)
        drains = {"diffusivity": self.diffusivity, "saturation": 1.0} if self.diffusivity else {"decay_time": STAYS}
        wet = runout.PorePressure(ratio=self.ratio, **drains)
        release = runout.Release.from_array(thickness, terrain, "on_surface", pore_pressure=wet)
        places = np.interp(GAUGES, s, x)
        points = {f"{gauge:g} m": (float(place), 0.0) for gauge, place in zip(GAUGES, places, strict=True)}
        result = runout.simulate(
            terrain, release, runout.DruckerPrager(density=DENSITY, friction_angle=self.inner_deg), basal_friction_angle=BASAL_DEG,
            structures=build_structures(self._walls(), terrain, (self.cell_size,) * 3), cell_size=self.cell_size, end_time=END,
            probes=runout.Probes(points, interval=EVERY), arrival_threshold=ARRIVED, backend="auto", device="auto",
        )  # fmt: skip
        return result, places

    def _walls(self) -> list[Solid]:
        """Both side walls, three cells thick, in local metres."""
        s, x, z, _ = bed()
        at = np.concatenate([[np.interp(WEST + 0.5, x, s), BEND], np.linspace(BEND, MOUTH, 8)[1:]])
        line, thick = (np.interp(at, s, x) - WEST, np.interp(at, s, z)), 3.0 * self.cell_size
        south, north = HALF - WIDTH / 2, HALF + WIDTH / 2
        return [side_wall(*line, south - thick, south, "south wall"), side_wall(*line, north, north + thick, "north wall")]


def measured(variant: Variant) -> dict[str, Any]:
    """Arrival, peak and series at the gauges, and the deposit, of one run."""
    started = time.process_time()
    result, places = variant.simulated()
    seconds = time.process_time() - started
    s, x, _, slope = bed()
    assert result.probes is not None
    normal = result.probes.points["flow_thickness"] * np.cos(np.interp(places, x, slope))[:, None]
    times = result.probes.time
    wet = normal > ARRIVED
    return {
        "name": variant.name, "cell": variant.cell_size, "ratio": round(variant.ratio, 3),
        "inner_deg": round(variant.inner_deg, 1), "particles": result.n_particles, "steps": result.steps,
        "seconds": round(seconds, 1), "stop": result.stop_reason,
        "arrival": [round(float(times[row.argmax()]), 2) if row.any() else None for row in wet],
        "peak": rounded(normal.max(axis=1), 3),
        "duration": rounded(wet.sum(axis=1) * EVERY, 2),
        "time": rounded(times, 2), "thickness": [rounded(row, 4) for row in normal],
        "deposit": _deposit(result, s, x),
    }  # fmt: skip


def _deposit(result: runout.Result, s: np.ndarray, x: np.ndarray) -> dict[str, float] | None:
    """Where the deposit lies along the bed [m]: its ends, its middle, its thickest place; None where all left the terrain."""
    thickness = np.nan_to_num(result.maps["deposit_thickness"].values)
    along = np.interp(result.terrain.easting, x, s)
    volume = thickness.sum(axis=0) * result.terrain.cell_area
    if not volume.sum() > 0.0:
        return None
    covered = along[thickness.max(axis=0) > ARRIVED]
    first, middle, last = np.interp((0.05, 0.5, 0.95), np.cumsum(volume) / volume.sum(), along)
    thickest = int(thickness.max(axis=0).argmax())
    return {
        "front": round(float(covered.max()), 1), "first": round(float(first), 1), "middle": round(float(middle), 1),
        "last": round(float(last), 1), "thickest_at": round(float(along[thickest]), 1),
        "thickest": round(float(thickness.max()), 3), "volume": round(float(volume.sum()), 2),
    }  # fmt: skip


def variants(full: bool) -> list[Variant]:
    """The measured numbers first; then finer cells, other pore pressure, other strength and the smaller volume."""
    if not full:
        return [Variant("measured numbers", 0.4)]
    return [
        Variant("measured numbers", FINE),
        Variant(f"cells of {COARSE:g} m", COARSE),
        Variant("pore pressure of 25 May 2017", COARSE, ratio=MEASURED_2017),
        Variant("pore pressure 0.7", COARSE, ratio=0.7),
        Variant("pore pressure 0.9", COARSE, ratio=0.9),
        Variant("drains, 0.5 m2/s, water of 1000 kg/m3", COARSE, diffusivity=DIFFUSIVITY),
        Variant("inner friction 40.7 deg", COARSE, inner_deg=BASAL_DEG),
        Variant("8 m3", COARSE, volume=0.8),
    ]


def measure(full: bool) -> dict[str, Any]:
    """Runs beside the observations; in CI the first alone, in coarse cells."""
    runs = [measured(variant) for variant in variants(full)]
    for run in runs[1:]:
        del run["time"], run["thickness"]
    return {"gauges": list(GAUGES), "observed": OBSERVED, "deposit": DEPOSIT, "runs": runs, "lines": _lines(runs)}


def _lines(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Rows to print."""
    names = ", ".join(f"{gauge:g}" for gauge in GAUGES)
    return [f"  {run['name']}: arrival at {names} m: {run['arrival']} s, peak {run['peak']} m" for run in runs]
