"""Error and bias of the peak maps of Frank Slide and jacksboro at nine spacings, against a finer grid.

    RUNOUT_DATA=DIR python tests/benchmarks/peak_maps.py OUT [--against OTHER]

Runs are kept in OUT, so that a second call only prints the tables. Those of another version, made with it in the folder OTHER,
are compared with the same references: with the finest maps of OUT. Area errors are those of cells over 0.1, 0.5 and 1 m.
"""

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

SPACINGS = {
    "frank_slide": (14.0, (20.0, 24.0, 28.3, 34.0, 39.5, 40.0, 41.0, 48.0, 56.6)),
    "jacksboro": (10.0, (14.14, 17.0, 20.0, 24.0, 28.3, 34.0, 40.0, 41.6, 48.0)),
}
PEAKS = ("max_flow_thickness", "max_speed", "max_pressure", "max_momentum_flux")
LEVELS = (0.1, 0.5, 1.0)  # [m]


def arguments(site: str) -> dict[str, Any]:
    """Arguments of ``runout.simulate`` but for the grid."""
    import runout
    from tests.benchmarks.error_cases.terrains import site_arguments

    if site == "jacksboro":
        return {**site_arguments(site), "backend": "scan"}
    folder = Path(os.environ["RUNOUT_DATA"]) / "frank_slide_1903"
    terrain = runout.Terrain.from_raster(folder / "Frankslide_topography.asc")
    return {
        "terrain": terrain,
        "release": runout.Release.from_raster(folder / "Frankslide_pile.asc", terrain, placement="on_surface"),
        "material": runout.DruckerPrager(density=2000.0, friction_angle=35.0),
        "basal_friction_angle": 15.0, "end_time": 60.0, "stop": False,
    }  # fmt: skip


def maps(folder: Path, site: str, cell: float) -> dict[str, np.ndarray]:
    """Peak maps of one run, from the folder if they are there."""
    import runout

    file = folder / f"{site}_{cell:g}.npz"
    if not file.is_file():
        found = runout.simulate(**{**arguments(site), "cell_size": cell, "threads": 1}).maps
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, **{name: np.nan_to_num(found[name].values) for name in (*PEAKS, "deposit_thickness")})
        print(f"{site} {cell:g} m", flush=True)
    return dict(np.load(file))


def row(found: dict[str, np.ndarray], exact: dict[str, np.ndarray]) -> str:
    """Relative L1 and bias [%] of each peak, and errors of the areas [%]."""
    errors = []
    for name in PEAKS:
        off, total = found[name] - exact[name], exact[name].sum()
        errors.append(f"{100 * np.abs(off).sum() / total:.1f} ({100 * off.sum() / total:+.1f})")
    counts = [[int((m[PEAKS[0]] > level).sum()) for level in LEVELS] for m in (found, exact)]
    return " | ".join([*errors, *(f"{100 * (a / b - 1):+.1f}" for a, b in zip(*counts, strict=True))])


def main() -> None:
    """Run what is missing and print a table a site and version."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--site", choices=SPACINGS, nargs="*", default=list(SPACINGS))
    stated = parser.parse_args()
    for site in stated.site:
        finest, cells = SPACINGS[site]
        exact = maps(stated.out, site, finest)
        for folder in filter(None, (stated.out, stated.against)):
            print(f"\n{site}, {folder.name}, against {finest:g} m\n\n| cell [m] | {' | '.join(PEAKS)} | 0.1 m | 0.5 m | 1 m |")
            print("|" + "---|" * (len(PEAKS) + 4))
            for cell in cells:
                print(f"| {cell:g} | {row(maps(folder, site, cell), exact)} |", flush=True)


if __name__ == "__main__":
    main()
