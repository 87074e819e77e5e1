"""Measure what relief costs: ``python docs/measure_relief.py [EVERY]``; with 5, every fifth slab. All take some minutes.

``RUNOUT_DATA=DIR python docs/measure_relief.py rasters`` prints the two-cell shares of real and made rasters instead, and
``... terrains [PROCESSES]`` the friction that smoothing takes away on terrains, measured and by the law: the run-out of the
smoothed terrain is that of the terrain as it is with so much less friction.

Slabs slide down planes with and without made relief, in a shallow channel that keeps them together. The loss of speed against the
smooth plane is the extra friction; the law is :func:`runout.physics.numerical_scales.relief_friction` (docs/theory, the ground).
"""

import math
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy import ndimage

from runout import DruckerPrager, Release, Terrain, simulate
from runout.model.scene import STANDARD_GRAVITY
from runout.terrain.read import read_terrain
from runout.terrain.relief import AROUND, two_cell_share
from runout.terrain.roughness import of_ground

H, ROWS = 10.0, 66  # cells of the grid [m]; rows of the raster, whose cells are a third as large
CELL = H / 3


@dataclass(frozen=True)
class Slab:
    """Slope and friction [deg], thickness and wave length [cells] (0: all), slope of the raster's relief [1], seed, end [s]."""

    slope: float
    friction: float
    thickness: float
    wave: float
    rough: float
    seed: int
    end: float = 36.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the raster; fast slabs need a long one."""
        return ROWS, 390 if self.end > 30.0 else 660

    def relief(self) -> np.ndarray:
        """Relief (rows, columns) [m]."""
        if not self.rough:
            return np.zeros(self.shape)
        white = np.random.default_rng(self.seed).standard_normal(self.shape)
        f = np.hypot(np.fft.fftfreq(self.shape[0], CELL)[:, None], np.fft.fftfreq(self.shape[1], CELL)[None, :])
        f[0, 0] = 1.0
        length = self.wave * H
        share = (f > 0.8 / length) & (f < 1.25 / length) if length else np.where(f < 1 / 300, 0.0, f**-1.6)
        waves = np.fft.ifft2(np.fft.fft2(white) * share).real
        return waves * self.rough / math.sqrt(float((np.gradient(waves, CELL)[1] ** 2).mean()))

    def measured(self) -> tuple[float, float]:
        """Extra friction coefficient [1] of the run, and that of the law."""
        smooth = Slab(self.slope, self.friction, self.thickness, 3, 0.0, 0, self.end)
        (_, *even), (terrain, *rough) = slide(smooth), slide(self)
        time = np.linspace(0.0, min(even[0][-1], rough[0][-1], 30.0), 400)
        fast, slow = (np.interp(time, *run) for run in (even, rough))
        there = (time > 4.0) & (np.cumsum(fast) * time[1] < (700.0 if self.end > 30.0 else 1500.0))
        lost = (fast - slow)[there] / (STANDARD_GRAVITY * math.cos(math.radians(self.slope)))
        reach = np.zeros(self.shape, bool)
        reach[6:60, 30:300] = True
        law = of_ground(terrain, (H, H), reach, math.sqrt(np.mean(slow[there] ** 2)))
        return float(lost @ time[there] / (time[there] @ time[there])), law.friction if law else 0.0


@cache
def slide(slab: Slab) -> tuple[Terrain, np.ndarray, np.ndarray]:
    """Ground, times [s] and velocity down the plane [m/s]."""
    angle, (row, column) = math.radians(slab.slope), np.indices(slab.shape)
    z = 2000.0 - math.tan(angle) * column * CELL + 30.0 * ((row - 32.5) * CELL / 110.0) ** 2 + slab.relief()
    terrain, thickness = Terrain.from_array(z, CELL), np.zeros(slab.shape)
    thickness[15:51, 15:87] = slab.thickness * H
    release = Release.from_array(thickness, terrain, placement="on_surface")
    sand = DruckerPrager(density=2000.0, friction_angle=32.0)
    run = simulate(terrain, release, sand, basal_friction_angle=slab.friction, cell_size=H, end_time=slab.end, threads=1).ledger
    down = (run.momentum_x.values * math.cos(angle) - run.momentum_z.values * math.sin(angle)) / run.mass.values
    return terrain, run.time.values, down


def slabs() -> list[Slab]:
    """All of them."""
    found = [Slab(25, 20, 2, wave, rough, 1) for rough in (0.1, 0.2) for wave in (2, 3, 4, 6)]
    found += [Slab(25, 20, 4, wave, 0.2, 1) for wave in (2, 4)] + [Slab(25, 20, 2, 3, 0.2, seed) for seed in (2, 3)]
    kinds = [(2, 0.2), (3, 0.1), (4, 0.05), (4, 0.1), (6, 0.1), (6, 0.2), (10, 0.1), (10, 0.2), (0, 0.05), (0, 0.1), (0, 0.2)]
    found += [Slab(*plane, 3, *kind, 5) for plane in ((30, 20), (20, 15), (30, 25)) for kind in kinds]
    found += [Slab(25, 20, 2, 0, 0.1, 1), Slab(25, 20, 2, 0, 0.1, 2), Slab(25, 20, 2, 10, 0.1, 2)]
    found += [Slab(25, 20, 4, 0, rough, 1) for rough in (0.1, 0.2)]
    kinds = [(0, 0.05), (0, 0.1), (0, 0.2), (3, 0.05), (3, 0.1), (6, 0.1)]
    found += [Slab(35, 18, thickness, *kind, 7, 26.0) for thickness in (1, 2, 4) for kind in kinds]
    return found + [Slab(35, 18, t, *kind, 7, 26.0) for t in (0.5, 0.25) for kind in ((0, 0.05), (0, 0.1), (3, 0.05))]


TERRAINS = (  # site, cells of the grid [m] and lengths of smoothing [m]
    *(("made", 10.0, (20.0, 30.0)), ("avakot", 10.0, (20.0, 30.0))),
    *(("frank_slide", 20.0, (40.0, 80.0)), ("frank_slide", 28.0, (40.0,))),
)
LESS = (0.0, 1.0, 2.0, 3.5)  # friction [deg]


def run_on_terrain(task: tuple[str, float, float, float]) -> tuple[float, float]:
    """Way of the centre of mass [m] on a smoothed terrain, with so much less friction [deg], and the friction of the law."""
    from tests.benchmarks.one_answer import scenario

    site, cell, length, less = task
    arguments = scenario(site)
    terrain, thickness = arguments["terrain"], np.asarray(arguments["release"][0].thickness)
    terrain = terrain.smoothed(length) if length else terrain
    release = Release.from_array(thickness, terrain, placement="on_surface")
    changed = {"terrain": terrain, "release": release, "basal_friction_angle": arguments["basal_friction_angle"] - less}
    maps = simulate(**{**arguments, **changed}, cell_size=cell, threads=1).maps
    deposit, speed = (np.nan_to_num(maps[name].values) for name in ("deposit_thickness", "max_speed"))
    places = np.indices(deposit.shape) * np.array(terrain.cell_size[::-1])[:, None, None]
    start, end = ((mass * places).sum((1, 2)) / mass.sum() for mass in (thickness, deposit))
    reach = speed > 0
    law = of_ground(terrain, (cell, cell), reach, math.sqrt(np.mean(speed[reach] ** 2)))
    return float(np.hypot(*(end - start))), law.friction if law else 0.0


def print_terrains(processes: int) -> None:
    """Print change of run-out and friction, measured and by the law, of each terrain, size of cells and length."""
    tasks = [(site, cell, 0.0, less) for site, cell, _ in TERRAINS for less in LESS]
    tasks += [(site, cell, length, 0.0) for site, cell, lengths in TERRAINS for length in lengths]
    with ProcessPoolExecutor(processes) as pool:
        found = dict(zip(tasks, pool.map(run_on_terrain, tasks), strict=True))
    for site, cell, lengths in TERRAINS:
        ways = [found[site, cell, 0.0, less][0] for less in LESS]
        for length in lengths:
            (way, left), (plain, all_of_it) = found[site, cell, length, 0.0], found[site, cell, 0.0, 0.0]
            measured, law = np.interp(way, ways, LESS), math.degrees(math.atan(all_of_it) - math.atan(left))
            print(
                f"{site}, {cell:g} m, {length:g} m: {100 * (way / plain - 1):+.1f} %, {measured:.1f} deg, law {law:.1f} deg",
                flush=True,
            )


RASTERS = {
    "frank_slide": "frank_slide_1903/Frankslide_topography.asc", "cascades_2021": "cascades_2021_landlab/pre_runout_DEM.asc",
    "avaKot": "avaframe/avaKot/Inputs/avaKot.asc", "avaPfa": "avaframe/avaPfa/Inputs/avaPfa.asc",
    "maipo": "maipo_debrisflow_runoptGPP/elev_12_5m.tif",
}  # fmt: skip


def rasters() -> Iterator[tuple[str, np.ndarray]]:
    """Name and elevations [m] of six real rasters, of white noise, an oscillation and a raster of repeated cells."""
    for name, path in RASTERS.items():
        yield name, read_terrain(Path(os.environ["RUNOUT_DATA"]) / path).elevation
    jacksboro = read_terrain("matplotlib:jacksboro_fault_dem").elevation
    yield "jacksboro", jacksboro
    row, column = np.indices((200, 200))
    yield "white noise", np.random.default_rng(1).standard_normal((200, 200))
    yield "oscillation", 5.0 * (-1.0) ** (row + column) - 3.0 * column
    yield "jacksboro, cells repeated", np.repeat(np.repeat(jacksboro, 2, axis=0), 2, axis=1)


def print_shares() -> None:
    """Print the median two-cell share of each raster, over windows without unknown cells."""
    for name, elevation in rasters():
        known = np.isfinite(elevation)
        inner = ndimage.binary_erosion(known, np.ones((AROUND + 4, AROUND + 4)))
        share = two_cell_share(np.where(known, elevation, np.nanmean(elevation)))[inner]
        print(f"{name}: {np.median(share):.2f}, of nine tenths of the cells below {np.quantile(share, 0.9):.2f}", flush=True)


def main() -> None:
    """Print every slab, and the table of docs/theory."""
    if sys.argv[1:] == ["rasters"]:
        return print_shares()
    if sys.argv[1:2] == ["terrains"]:
        return print_terrains(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    chosen = slabs()[:: int(sys.argv[1]) if len(sys.argv) > 1 else 1]
    ratios = []
    for slab in chosen:
        measured, law = slab.measured()
        ratios.append(math.log(law / measured))
        print(f"{slab}: measured {measured:.4f}, law {law:.4f}", flush=True)
    for words, of_all in (("all wave lengths", True), ("single wave lengths", False)):
        one = np.array([ratio for slab, ratio in zip(chosen, ratios, strict=True) if (slab.wave == 0) == of_all])
        share = np.mean(np.abs(one) < math.log(2.0))
        print(f"{words}: {len(one)} slabs, mean {np.exp(one.mean()):.2f}, factor {np.exp(one.std()):.2f}, within 2: {share:.0%}")


if __name__ == "__main__":
    main()
