"""Run-out, area and numerical dissipation by grid spacing and by the place of the grid: one answer whatever the grid.

    RUNOUT_DATA=DIR python -m tests.benchmarks.one_answer OUT [--backend hash --device cuda:0] [--processes 4]
        [--substeps 4] [--half-width 0.7]

Nine spacings between 0.7 and 4 cells of the raster, and at two of them four places of the grid: the raster loses 0 to 3 columns in
the west and rows in the south. Sites: Frank Slide (20 m), avaKot (5 m, 12 m of rock in place of snow), and the made raster of
`error_bar_coverage.py` (5 m). Writes one_answer.json; copy it to tests/benchmarks/records/, then run `python -m docs.pages`.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from runout.io.atomic import write_json
from runout.model.numerics import Scheme
from runout.studies.work_precision import machine, versions
from runout.terrain import relief

RATIOS = (0.7, 1.0, 1.4, 1.7, 2.0, 2.4, 2.83, 3.4, 4.0)  # cells of the raster
PLACES = {1.7: (1, 2, 3), 2.4: (1, 2, 3)}
SITES = ("frank_slide", "avakot", "made")
LEVEL = 1.0  # [m] of the area


def scenario(site: str) -> dict[str, Any]:
    """Arguments of ``runout.simulate`` but for the grid; the release has one part."""
    import runout
    from tests.benchmarks.error_bar_coverage import made_site

    data = Path(os.environ["RUNOUT_DATA"])
    if site == "made":
        return {**made_site(), "basal_friction_angle": 18.0, "end_time": 90.0}
    rock = runout.DruckerPrager(density=2000.0, friction_angle=34.0)
    if site == "avakot":
        inputs = data / "avaframe" / "avaKot" / "Inputs"
        terrain = runout.Terrain.from_raster(inputs / "avaKot.asc", crs="EPSG:31287")
        release = runout.Release.from_vector(inputs / "REL" / "relKot.shp", terrain, thickness=12.0, placement="on_surface")
        return {"terrain": terrain, "release": [release], "material": rock, "basal_friction_angle": 20.0, "end_time": 90.0}
    terrain = runout.Terrain.from_raster(data / "frank_slide_1903" / "Frankslide_topography.asc")
    release = runout.Release.from_raster(data / "frank_slide_1903" / "Frankslide_pile.asc", terrain, placement="on_surface")
    return {"terrain": terrain, "release": [release], "material": rock, "basal_friction_angle": 15.0, "end_time": 100.0}


def filter_by(share: float) -> None:
    """Filter the ground by this half-width, over the spacing of the grid, in this process: a study of that choice."""
    relief.HALF_WIDTH = share


def run(task: tuple[str, float, int, str, str, int]) -> dict[str, Any]:
    """Distances [m] from the centre of the release, and area [m2], of one run."""
    import runout

    site, ratio, place, backend, device, substeps = task
    arguments = scenario(site)
    whole, thickness = arguments["terrain"], np.asarray(arguments["release"][0].thickness)
    rows = whole.shape[0] - place
    terrain = runout.Terrain.from_array(whole.elevation[:rows, place:], whole.cell_size)
    thickness = np.ascontiguousarray(thickness[:rows, place:])
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    size = ratio * float(np.mean(whole.cell_size))
    changed = {
        "terrain": terrain,
        "release": release,
        "cell_size": size,
        "backend": backend,
        "device": device,
        "substeps": substeps,
    }
    result = runout.simulate(**{**arguments, **changed}, threads=1)
    maps, area = result.maps, float(np.prod(whole.cell_size))
    deposit, peak = (np.nan_to_num(maps[name].values) for name in ("deposit_thickness", "max_flow_thickness"))
    y, x = np.meshgrid(*(np.arange(n) * d for n, d in zip(terrain.shape, whole.cell_size[::-1], strict=True)), indexing="ij")
    start = [float((thickness * c).sum() / thickness.sum()) for c in (x, y)]
    centre = [float((deposit * c).sum() / deposit.sum()) for c in (x, y)]
    ledger = result.ledger
    return {
        "site": site, "ratio": ratio, "place": place, "cell_size": size,
        "centre": float(np.hypot(centre[0] - start[0], centre[1] - start[1])),
        "area": float((peak > LEVEL).sum() * area),
        "numerical": float(ledger.numerical_dissipation[-1] / (ledger.potential_energy[0] - ledger.potential_energy[-1])),
    }  # fmt: skip


def main() -> None:
    """Make the runs and their record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--sites", nargs="+", default=SITES)
    parser.add_argument("--substeps", type=int, default=Scheme.substeps)
    parser.add_argument("--half-width", type=float, default=relief.HALF_WIDTH, help="of the filter of the ground, over the spacing")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    how = chosen.backend, chosen.device, chosen.substeps
    tasks = [(s, r, p, *how) for s in chosen.sites for r in RATIOS for p in (0, *PLACES.get(r, ()))]
    each = {"initializer": filter_by, "initargs": (chosen.half_width,)}
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn"), **each) as pool:
        rows = list(pool.map(run, sorted(tasks, key=lambda t: t[1])))
    rows.sort(key=lambda row: (row["site"], row["ratio"], row["place"]))
    engine = f"{chosen.backend} on {chosen.device}"
    record = {"versions": versions(), "machine": machine(), "engine": engine, "level": LEVEL, "runs": rows}
    print(write_json(record, chosen.out / "one_answer.json"))


if __name__ == "__main__":
    main()
