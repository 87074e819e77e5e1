"""How much of the error of a coarse peak map is that of the map, and how much that of the run: Frank Slide.

    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_map_estimator OUT [--finest 14] [--cells 20 28 40]

Maps of the particles of the finest run are made with the footprints, the least thickness and the observations of coarser grids.
They differ from the maps of the finest run by the estimator alone; the maps of runs on the coarser grids differ from them by the
run. Each line: errors and biases as in ``peak_maps.py``, then the bias of speed in cells that both maps reach. Runs on coarser
grids are kept in OUT.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from runout import simulate
from runout.backends import footprints
from runout.model.numerics import Numerics
from runout.simulation.observers import PeakMaps
from runout.simulation.run import OBSERVATIONS, Run
from runout.simulation.scenario import build_scene
from tests.benchmarks.peak_maps import PEAKS, arguments, maps, row

SITE = "frank_slide"


def box_sums(place: np.ndarray, amounts: np.ndarray, lattice: footprints.Lattice) -> np.ndarray:
    """Sums (lanes, rows, columns) of amounts (lanes, n) over boxes two cells of a lattice wide around places (n, 2) [m]."""
    (columns, rows), count = lattice.shape, len(amounts)
    west = place / np.array(lattice.cell) - np.array(lattice.first) - 1.0
    base = np.floor(west).astype(np.int64)
    part, sums = west - base, np.zeros((count, rows * columns))
    shares = 0.5 * (1.0 - part), np.full_like(part, 0.5), 0.5 * part
    for i, j in np.ndindex(3, 3):
        at, share = (base[:, 1] + j) * columns + base[:, 0] + i, shares[i][:, 0] * shares[j][:, 1]
        for lane, values in zip(sums, amounts, strict=True):
            lane += np.bincount(at, values * share, rows * columns)
    return sums.reshape(count, rows, columns)


class CoarseMaps:
    """Peak maps that a coarser grid makes of the particles of another run, at the times at which it would observe them."""

    def __init__(self, cell: float):
        case = arguments(SITE)
        scene, particles = build_scene(
            case["terrain"], [case["release"]], case["material"], case["basal_friction_angle"], Numerics(cell_size=cell)
        )
        self.scene, self.due, self.density = scene, 0.0, float(scene.densities[0])
        self.particle_volume = particles.sums(scene.densities).mean_volume
        self.peaks = PeakMaps(scene, 0.1, footprints.keep_peaks(scene))

    def observe(self, time: float, run: Run) -> None:
        """Take the particles of a run at one time [s], if the coarser grid would observe now."""
        end, scene = run.control.end_time, self.scene
        if time < min(self.due, end):
            return
        self.due = time + min(end / OBSERVATIONS, scene.observed_length / max(run.engine.max_speed, 1e-3))
        particles = run.engine.particles()
        place = particles.position(np.array(run.scene.spacing))[:, :2]
        node = np.floor(place / np.array(scene.spacing[:2]) - 0.5).astype(np.int64)
        lattice = footprints.Lattice.around(scene, node.min(axis=0), node.max(axis=0) + 3)
        amounts = np.stack([particles.mass / self.density, *(particles.mass * particles.velocity.T)])
        sums = box_sums(place, amounts, lattice)
        columns = footprints.spread(sums, lattice, scene.raster, self.particle_volume, self.density)
        if not self.peaks.on_lattice:
            columns = footprints.on_raster(columns, scene.raster, lattice.cell)
        self.peaks.observe(time, columns)

    def maps(self) -> dict[str, np.ndarray]:
        """The maps on the raster."""
        terrain, maps = arguments(SITE)["terrain"], self.peaks.maps()
        return {name: terrain.where_known(maps[name], 0.0) for name in PEAKS}


class WatchedRun(Run):
    """A run whose particles coarser grids observe as well."""

    coarse: tuple[CoarseMaps, ...] = ()

    def _note(self, time: float, columns: Any) -> None:
        super()._note(time, columns)
        for one in self.coarse:
            one.observe(time, self)


def both_reached(maps: dict[str, np.ndarray], exact: dict[str, np.ndarray]) -> str:
    """Bias [%] of speed where both maps have one."""
    there = (maps["max_speed"] > 0) & (exact["max_speed"] > 0)
    return f"{100 * (maps['max_speed'][there].sum() / exact['max_speed'][there].sum() - 1):+.1f}"


def main() -> None:
    """Run the finest grid once, and the coarser ones, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--finest", type=float, default=14.0)
    parser.add_argument("--cells", type=float, nargs="*", default=[20.0, 28.0, 40.0])
    choices = parser.parse_args()
    WatchedRun.coarse = tuple(CoarseMaps(cell) for cell in choices.cells)
    import runout.simulation.single

    runout.simulation.single.Run = WatchedRun  # type: ignore[misc]
    default_maps = simulate(**{**arguments(SITE), "cell_size": choices.finest, "threads": 1}).maps
    runout.simulation.single.Run = Run  # type: ignore[misc]
    exact = {name: np.nan_to_num(default_maps[name].values) for name in PEAKS}
    print(f"| cell [m] | maps | {' | '.join(PEAKS)} | 0.1 m | 0.5 m | 1 m | speed where both |\n|{'---|' * (len(PEAKS) + 6)}")
    for cell, coarse in zip(choices.cells, WatchedRun.coarse, strict=True):
        own, estimated = maps(choices.out, SITE, cell), coarse.maps()
        for words, one, other in (("run", own, exact), ("estimator", estimated, exact), ("run alone", own, estimated)):
            print(f"| {cell:g} | {words} | {row(one, other)} | {both_reached(one, other)} |", flush=True)


if __name__ == "__main__":
    main()
