"""What the error of a map is made of: flows on terrain with one choice of the grid refined at a time.

    RUNOUT_DATA=DIR python -m tests.benchmarks.error_factors OUT [--backend hash --device cuda:0] [--sites NAME ...]

Flows are those of ``error_cases/terrains.py``, 60 s each. Errors are relative L1 of the map of largest thickness and of the
thickness at 60 s against the finest grid. Two rows are no coarse runs: the finest grid on the ground that the coarse grid filters,
and the map of the finest grid under the footprint of the coarse map. Runs are kept in OUT, so that a second call only writes the
record. Writes error_factors.json; copy it to tests/benchmarks/records/, then run ``python -m docs.pages``.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from runout.io.atomic import write_json
from runout.studies.convergence import relative_l1
from runout.studies.work_precision import machine, versions
from runout.terrain.relief import half_width

CELLS = {  # [m], of the coarse grid and of the reference
    "frank_slide": (40.0, 14.0),
    "frank_slide_20": (40.0, 14.0),
    "jacksboro": (40.0, 10.0),
    "jacksboro_25": (40.0, 10.0),
    "coulomb_only": (14.1, 5.0),
}
MAPS = "max_flow_thickness", "deposit_thickness"
FEWEST_ACROSS = 1.5  # grid cells, width of the footprint inside of the flow
FACTORS: dict[str, dict[str, Any]] = {  # what changes of the arguments; sizes are parts of the cell
    "coarse grid": {},
    "half the cells in plan": {"parts": (0.5, 0.5, 1.0)},
    "half the cells upwards": {"parts": (1.0, 1.0, 0.5)},
    "a quarter of the cells upwards": {"parts": (1.0, 1.0, 0.25)},
    "half the cells in all directions": {"parts": (0.5, 0.5, 0.5)},
    "more particles (3 x 3 x 6)": {"particles_per_cell": (3, 3, 6)},
    "half the time step, as many transfers": {"cfl": 0.5, "substeps": 8},
    "up to sixteen substeps of a transfer": {"substeps": 16},
    "another seed": {"seed": 1},
}
GROUND, FOOTPRINT = "reference on the filtered ground", "reference under the footprint"


def run(file: Path, site: str, spacing: tuple[float, ...], changes: dict[str, Any]) -> dict[str, np.ndarray]:
    """Maps of a run, from the file if it is there; ``smoothing`` [m] averages the terrain before."""
    import runout
    from tests.benchmarks.error_cases.terrains import site_arguments

    if not file.is_file():
        arguments = {**site_arguments(site), "cell_size": spacing, **changes}
        if "cfl" in changes:
            arguments["cfl"] = changes["cfl"] * runout.model.limits.CFL
        if smoothing := arguments.pop("smoothing", 0.0):
            arguments["terrain"] = arguments["terrain"].smoothed(smoothing)
        result = runout.simulate(**arguments)
        np.savez_compressed(file, **{name: np.nan_to_num(result.maps[name].values).astype(np.float32) for name in MAPS})
        print(file.stem, result.n_particles, result.steps, f"{result.timing['total']:.1f} s", flush=True)
    return dict(np.load(file))


def under_footprint(thickness: np.ndarray, cell: float, raster_cell: tuple[float, float]) -> np.ndarray:
    """A map (rows, columns) spread as a grid of ``cell`` [m] spreads particles: boxes of a cell, smoothed over one and a half."""
    for axis, size in enumerate(raster_cell[::-1]):
        for width in (cell, FEWEST_ACROSS * cell):
            thickness = box_mean(thickness, width / size, axis)
    return thickness


def box_mean(values: np.ndarray, width: float, axis: int) -> np.ndarray:
    """Mean over ``width`` cells along an axis, by the two odd numbers of cells around that width."""
    narrow = max(1, 2 * int((width - 1) // 2) + 1)
    share = (width**2 - narrow**2) / ((narrow + 2) ** 2 - narrow**2)  # variances add
    means = [uniform_filter1d(values, size, axis=axis, mode="constant") for size in (narrow, narrow + 2)]
    return (1.0 - share) * means[0] + share * means[1] if width > 1 else values  # type: ignore[no-any-return]


def rows_of(site: str, folder: Path, engine: dict[str, str]) -> list[dict[str, Any]]:
    """Errors by factor of a flow."""
    from tests.benchmarks.error_cases.terrains import site_arguments

    cell, finest = CELLS[site]
    exact = run(folder / f"{site}_reference.npz", site, (finest,) * 3, engine)
    maps = {}
    for number, (name, changes) in enumerate(FACTORS.items()):
        spacing = tuple(cell * part for part in changes.get("parts", (1.0, 1.0, 1.0)))
        others = {key: value for key, value in changes.items() if key != "parts"}
        maps[name] = run(folder / f"{site}_{number}.npz", site, spacing, engine | others)
    width, size = half_width((cell, cell))[0], site_arguments(site)["terrain"].cell_size
    if width >= min(size):  # else the coarse grid filters nothing
        maps[GROUND] = run(folder / f"{site}_ground.npz", site, (finest,) * 3, engine | {"smoothing": width})
    maps[FOOTPRINT] = {name: under_footprint(exact[name].astype(float), cell, size) for name in MAPS}
    deep = exact[MAPS[0]][exact[MAPS[0]] > 0.1]
    facts = {"site": site, "cell": cell, "reference": finest, "cells_of_depth": float(np.median(deep)) / cell}
    return [
        facts
        | {
            "factor": name,
            "peak": relative_l1(of_run[MAPS[0]], exact[MAPS[0]]),
            "at_end": relative_l1(of_run[MAPS[1]], exact[MAPS[1]]),
        }
        for name, of_run in maps.items()
    ]


def main() -> None:
    """Run what is missing and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sites", nargs="+", default=list(CELLS))
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--commit", default="unknown")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    engine = {"backend": chosen.backend, "device": chosen.device}
    rows = [row for site in chosen.sites for row in rows_of(site, chosen.out, engine)]
    for row in rows:
        print(f"{row['site']:16} {row['factor']:40} {100 * row['peak']:6.2f} {100 * row['at_end']:6.2f}")
    record = {"versions": versions(), "machine": machine(), "engine": engine, "commit": chosen.commit, "rows": rows}
    print(write_json(record, chosen.out / "error_factors.json"))


if __name__ == "__main__":
    main()
