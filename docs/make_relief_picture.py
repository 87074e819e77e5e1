"""Make the picture of relief in docs/guide/choosing: ``python docs/make_relief_picture.py``. It runs for some minutes.

Run-out against cell size on a made raster with relief at all wave lengths and an oscillation of two cells, as it is and with two
lengths of ``terrain.smoothing``. Above, what ``runout check`` states of the relief.
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from runout import DruckerPrager, Release, Terrain, simulate
from runout.terrain.energy_line import largest_speed
from runout.terrain.roughness import LEAST, MOST, of_ground

PICTURE = Path(__file__).parent / "images" / "relief.png"
CELL, SHAPE, FRICTION = 5.0, (260, 420), 18.0  # [m], rows and columns, [deg]
SIZES, LENGTHS = (20.0, 17.0, 14.14, 12.5, 10.0, 8.5), (0.0, 10.0, 30.0)  # of grid cells, of smoothing [m]
COLOURS = ("#444444", "#c2702d", "#2d6fa3")


def ground() -> np.ndarray:
    """Elevation (rows, columns) [m]: a slope that flattens, 4 m of relief at all wave lengths, 1 m of oscillation."""
    random = np.random.default_rng(3)
    row, column = np.indices(SHAPE)
    z = 900.0 * np.exp(-column * CELL / 900.0) + 60.0 * ((row - SHAPE[0] / 2) * CELL / 600.0) ** 2
    f = np.hypot(np.fft.fftfreq(SHAPE[0], CELL)[:, None], np.fft.fftfreq(SHAPE[1], CELL)[None, :])
    f[0, 0] = 1.0
    waves = np.fft.ifft2(np.fft.fft2(random.standard_normal(SHAPE)) * np.where(f < 1 / 800, 0, f**-1.6)).real
    return z + 4.0 * waves / waves.std() + np.where((row + column) % 2, 1, -1) * random.uniform(0.5, 1.5, SHAPE)


def measured(terrain: Terrain, size: float) -> tuple[float, float]:
    """Run-out of the centre of the mass [m], and what relief adds to the friction coefficient [1]."""
    thickness = np.zeros(terrain.shape)
    thickness[110:150, 20:60] = 15.0
    release = Release.from_array(thickness, terrain, placement="on_surface")
    sand = DruckerPrager(density=2000.0, friction_angle=32.0)
    maps = simulate(terrain, release, sand, basal_friction_angle=FRICTION, cell_size=size, end_time=90.0, threads=1).maps
    deposit, x = np.nan_to_num(maps.deposit_thickness.values), (np.arange(terrain.shape[1]) + 0.5) * CELL
    reach = np.nan_to_num(maps.max_flow_thickness.values) > 0.1
    speed = math.sqrt(0.5) * largest_speed([release], [math.radians(FRICTION)])
    relief = of_ground(terrain, (size, size), reach, speed)
    return float((deposit.sum(0) * x).sum() / deposit.sum()) - 40 * CELL, relief.friction if relief else 0.0


def main() -> None:
    """Write :data:`PICTURE`."""
    figure = Figure(figsize=(7.2, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 3))
    raster = Terrain.from_array(ground(), CELL)
    for length, colour in zip(LENGTHS, COLOURS, strict=True):
        terrain = raster.smoothed(length) if length else raster
        distance, cost = np.array([measured(terrain, size) for size in SIZES]).T
        print(length, distance.round(), np.degrees(cost).round(2))
        low, high = (np.degrees(np.arctan(times * cost)) for times in (LEAST, MOST))
        above.fill_between(SIZES, low, high, color=colour, alpha=0.3, linewidth=0)
        above.plot(SIZES, np.degrees(np.arctan(cost)), color=colour)
        label = f"terrain.smoothing: {length:g}" if length else "raster as it is"
        below.plot(SIZES, distance, "o-", color=colour, label=label)
    above.set(ylabel="relief acts like\ndegrees of friction", ylim=(0, None))
    below.set(xlabel="cell size of the grid [m]; raster cells of 5 m", ylabel="run-out of the centre [m]")
    below.legend(frameon=False)
    figure.savefig(PICTURE, dpi=150)
    print(f"wrote {PICTURE}")


if __name__ == "__main__":
    main()
