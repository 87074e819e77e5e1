"""Frank Slide, 1903: every frame beside the depth-averaged code SHALTOP, with Coulomb friction of 15 and 20 deg.

Runs of SHALTOP (Mangeney et al. 2007, J. Geophys. Res. 112:F02017) that come with tilupy, 11 frames from 0 to 100 s. Their
thickness is normal to the bed; here everything is vertical. `rho.bin` holds thickness, its rows from the south.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import runout
from runout.scores import Thalweg, contingency, reached, terrain_slope, vertical_thickness
from runout.studies.validation_cases.case import outline_of, public_file, rounded

TILUPY = "https://raw.githubusercontent.com/marcperuz/tilupy/62c76bc"
RASTERS = {
    "topography": (363702, "4c1b6f1e620deb025d7fcca0626249ae68f85ff6765a9523debc2733bab61f02"),
    "pile": (244005, "6c4b6ddbd110380faf355801de46206fbd464451b2d5cc553504c67b5f3cd69d"),
}
FRAMES = {
    15: "8b167d4571113b8cd413cada51fff689f0657335b38f8b1ca006d94d38d998b1",
    20: "4c35f1b123dd2834b0fe5098b9ed508b3048b0da1f83e616836359832846a037",
}
FRAME_BYTES, TIMES = 1_777_644, tuple(10.0 * k for k in range(11))  # [s]
# kinetic energy over density [m5 s-2] at 0 to 50 s, from `ek.d` beside the frames; that of 20 deg is not published
SHALTOP_ENERGY = {15: (0.0, 2.9012e10, 6.9665e10, 5.8440e10, 1.9209e10, 7.2132e8)}
LEVELS = (1.0, 5.0, 10.0)  # [m]
FRONT, BEYOND = 5.0, 3000.0  # thickness of the front [m]; length of the flow line beyond the centroids [m]
SHOWN = (20.0, 40.0, 100.0)  # times of the outlines [s]


@dataclass(frozen=True)
class Slide:
    """Ground without the failed mass, and the mass."""

    terrain: runout.Terrain
    release: runout.Release

    @cached_property
    def cell_area(self) -> float:
        """[m2]."""
        return self.terrain.cell_size[0] * self.terrain.cell_size[1]

    def shaltop(self, angle: int) -> np.ndarray:
        """Vertical thickness [m] of the frames (frame, rows, columns) with a friction angle [deg]."""
        path = public_file(
            f"{TILUPY}/examples/postprocessing/shaltop_frankslide/delta_{angle}p00/rho.bin",
            f"frank_slide_1903/shaltop_ref/delta_{angle}/rho.bin",
            FRAME_BYTES,
            FRAMES[angle],
        )
        normal = np.fromfile(path, "<f4").reshape(len(TIMES), *self.terrain.shape)[:, ::-1]
        slope = terrain_slope(self.terrain.elevation, self.terrain.cell_size)
        return vertical_thickness(normal, slope)  # type: ignore[no-any-return]

    def simulated(self, angle: float, cell_size: float, friction_angle: float, end_time: float = TIMES[-1]) -> runout.Result:
        """Run with a basal and an internal friction angle [deg]; its snapshots are the frames up to ``end_time`` [s]."""
        rock = runout.DruckerPrager(density=2000.0, friction_angle=friction_angle)
        times = [t for t in TIMES if t <= end_time]
        return runout.simulate(
            self.terrain,
            self.release,
            rock,
            basal_friction_angle=angle,
            cell_size=cell_size,
            end_time=end_time,
            snapshot_times=times,
            stop=False,
            threads=1,
        )

    def flow_line(self, frames: np.ndarray) -> Thalweg:
        """Line through the centroids of frames (frame, rows, columns), straight on for :data:`BEYOND` at both ends."""
        x, y = np.meshgrid(self.terrain.easting, self.terrain.northing)
        places = np.array([[(h * x).sum() / h.sum(), (h * y).sum() / h.sum()] for h in frames])
        ends = [BEYOND * (a - b) / np.hypot(*(a - b)) + a for a, b in ((places[0], places[1]), (places[-1], places[-2]))]
        return Thalweg(np.vstack([ends[0], places, ends[1]]))

    def path(self, frames: np.ndarray, line: Thalweg) -> dict[str, list[float | None]]:
        """Along the line from the first centroid [m]: front and rear at :data:`FRONT`, centroid; largest thickness; energy lost.

        The potential energy over density [m5 s-2] counts from the first frame.
        """
        x, y = np.meshgrid(self.terrain.easting, self.terrain.northing)
        s = line.coordinates(x, y)[0] - BEYOND
        ground = self.terrain.elevation
        height = [9.81 * self.cell_area * float((h * (ground + h / 2)).sum()) for h in frames]
        return {
            "front": [float(s[h >= FRONT].max()) for h in frames],
            "rear": [float(s[h >= FRONT].min()) for h in frames],
            "centroid": [float((h * s).sum() / h.sum()) for h in frames],
            "thickest": [float(h.max()) for h in frames],
            "fallen": [height[0] - e for e in height],
        }


def read() -> Slide:
    """The slide's rasters, from RUNOUT_DATA or fetched."""
    paths = {
        name: public_file(
            f"{TILUPY}/data/frankslide/rasters/Frankslide_{name}.asc", f"frank_slide_1903/Frankslide_{name}.asc", *RASTERS[name]
        )
        for name in RASTERS
    }
    terrain = runout.Terrain.from_raster(paths["topography"])
    return Slide(terrain, runout.Release.from_raster(paths["pile"], terrain, placement="on_surface"))


def agreement(own: np.ndarray, other: np.ndarray) -> list[float]:
    """CSI of two maps of thickness at each of :data:`LEVELS`."""
    return [contingency(reached(own, level), reached(other, level)).critical_success_index for level in LEVELS]


def compared(slide: Slide, angle: int, cell_size: float, friction_angle: float, end_time: float = TIMES[-1]) -> dict[str, Any]:
    """A run beside the frames of SHALTOP: scores by frame, paths along the flow line, energies."""
    started = time.process_time()
    result = slide.simulated(angle, cell_size, friction_angle, end_time)
    seconds = time.process_time() - started
    own = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values)
    other = slide.shaltop(angle)
    line, other = slide.flow_line(other[:5]), other[: len(own)]
    moving = result.ledger["kinetic_energy"] / 2000.0
    return {
        "basal_friction_deg": angle,
        "friction_angle_deg": friction_angle,
        "cell_size": cell_size,
        "particles": result.n_particles,
        "steps": result.steps,
        "seconds": seconds,
        "cells_through_depth": result.depth_resolution.cells_through_depth,
        "times": list(TIMES[: len(own)]),
        "csi": [agreement(h, o) for h, o in zip(own, other, strict=True)],
        "csi_of_peak": agreement(own.max(axis=0), other.max(axis=0)),
        "runout": slide.path(own, line),
        "shaltop": slide.path(other, line),
        "kinetic_energy": rounded(np.interp(TIMES[: len(own)], moving["time"], moving.values), 0),
        "outlines": _outlines(slide, own, other),
    }


def _outlines(slide: Slide, own: np.ndarray, other: np.ndarray) -> dict[str, Any]:
    place, shown = (slide.terrain.easting, slide.terrain.northing), [t for t in SHOWN if t < 10.0 * len(own) - 5.0]
    return {
        f"{t:g}": {
            name: outline_of(frames[TIMES.index(t)], FRONT, *place, 10.0) for name, frames in (("runout", own), ("shaltop", other))
        }
        for t in shown
    }


def measure(full: bool) -> dict[str, Any]:
    """Both angles; in full with cells of 20 m and 14 m and with other internal frictions, in CI one of 40 m."""
    slide = read()
    slide.simulated(15.0, 40.0, 34.0, 0.1)  # compiles
    if full:
        runs = [compared(slide, angle, 20.0, 34.0) for angle in (15, 20)]
        studies: Sequence[Mapping[str, Any]] = [
            *(compared(slide, 15, 20.0, inner, 50.0) for inner in (28.0, 16.0)),
            compared(slide, 15, 14.0, 34.0, 50.0),
        ]
    else:
        runs, studies = [compared(slide, 15, 40.0, 34.0, 60.0)], []
    rows = [{key: value for key, value in run.items() if key != "outlines"} for run in studies]
    return {"runs": runs, "studies": rows, "lines": [_line(run) for run in (*runs, *studies)]}


def _line(run: Mapping[str, Any]) -> str:
    last, own = run["csi"][-1], run["runout"]
    return (
        f"  basal {run['basal_friction_deg']:g} deg, internal {run['friction_angle_deg']:g} deg, {run['cell_size']:g} m: "
        f"CSI of the last frame {', '.join(f'{v:.3f}' for v in last)} at 1, 5 and 10 m, front {own['front'][-1]:.0f} m (SHALTOP "
        f"{run['shaltop']['front'][-1]:.0f} m), {run['seconds']:.0f} s"
    )
