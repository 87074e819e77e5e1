"""Error and bias of the peak maps of Frank Slide and jacksboro at nine spacings, against a finer grid.

    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_maps OUT [--against OTHER] [--site NAME]
    RUNOUT_DATA=DIR python -m tests.benchmarks.peak_maps OUT --probability

Runs are kept in OUT, so that a second call only prints the tables. Those of another version, made with it in the folder OTHER,
are compared with the same references: with the finest maps of OUT. Area errors are those of cells over 0.1, 0.5 and 1 m.

The second command prints the convergence of inundation probabilities of Frank Slide: eight members with basal friction angles
at the middles of eight equal parts of the site's distribution, against the same members on a grid of 20 m. "Any" and "half" are
the areas that at least one and at least half of the members reach.
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
OF_MEMBERS = "frank_slide"
ANGLES = tuple(10.0 + 10.0 * (k + 0.5) / 8 for k in range(8))  # [degrees]
CELLS_OF_MEMBERS = (20.0, 28.3, 40.0, 56.6)  # [m]; the others are compared with the first
LEVELS_OF_MEMBERS = (0.1, 0.5, 1.0, 2.0)  # [m]


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


def maps(folder: Path, site: str, cell: float, angle: float | None = None) -> dict[str, np.ndarray]:
    """Peak maps of one run, from the folder if they are there; ``angle`` [degrees]: basal friction of a member."""
    import runout

    member = {} if angle is None else {"basal_friction_angle": angle}
    file = folder / ("_".join([site, f"{cell:g}", *(f"{value:g}" for value in member.values())]) + ".npz")
    if not file.is_file():
        maps = runout.simulate(**{**arguments(site), **member, "cell_size": cell, "threads": 1}).maps
        folder.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, **{name: np.nan_to_num(maps[name].values) for name in (*PEAKS, "deposit_thickness")})
        print(f"{site} {cell:g} m", flush=True)
    return dict(np.load(file))


def row(maps: dict[str, np.ndarray], exact: dict[str, np.ndarray]) -> str:
    """Relative L1 and bias [%] of each peak, and errors of the areas [%]."""
    errors = []
    for name in PEAKS:
        off, total = maps[name] - exact[name], exact[name].sum()
        errors.append(f"{100 * np.abs(off).sum() / total:.1f} ({100 * off.sum() / total:+.1f})")
    counts = [[int((m[PEAKS[0]] > level).sum()) for level in LEVELS] for m in (maps, exact)]
    return " | ".join([*errors, *(f"{100 * (a / b - 1):+.1f}" for a, b in zip(*counts, strict=True))])


def probabilities(folder: Path, cell: float) -> np.ndarray:
    """Share of the members whose largest thickness is at least each level, (levels, rows, columns)."""
    thickness = np.array([maps(folder, OF_MEMBERS, cell, angle)[PEAKS[0]] for angle in ANGLES])
    return np.array([(thickness >= level).mean(axis=0) for level in LEVELS_OF_MEMBERS])


def print_probabilities(folder: Path) -> None:
    """Table of L1 error and bias of the probabilities, and of the areas that any and half of the members reach."""
    finest, *others = CELLS_OF_MEMBERS
    exact = probabilities(folder, finest)
    print(f"\n{OF_MEMBERS}, {len(ANGLES)} members, against {finest:g} m\n\n| cell [m] | level [m] | L1 (bias) | any | half |")
    print("|" + "---|" * 5)
    for cell in others:
        for level, share, fine in zip(LEVELS_OF_MEMBERS, probabilities(folder, cell), exact, strict=True):
            off = f"{100 * np.abs(share - fine).sum() / fine.sum():.1f} ({100 * (share - fine).sum() / fine.sum():+.1f})"
            areas = [f"{100 * ((share >= least).sum() / (fine >= least).sum() - 1):+.1f}" for least in (0.5 / len(ANGLES), 0.5)]
            print(f"| {cell:g} | {level:g} | {off} | {' | '.join(areas)} |", flush=True)


def main() -> None:
    """Run what is missing and print a table a site and version."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--site", choices=SPACINGS, nargs="*", default=list(SPACINGS))
    parser.add_argument("--probability", action="store_true")
    options = parser.parse_args()
    if options.probability:
        return print_probabilities(options.out)
    for site in options.site:
        finest, cells = SPACINGS[site]
        exact = maps(options.out, site, finest)
        for folder in filter(None, (options.out, options.against)):
            print(f"\n{site}, {folder.name}, against {finest:g} m\n\n| cell [m] | {' | '.join(PEAKS)} | 0.1 m | 0.5 m | 1 m |")
            print("|" + "---|" * (len(PEAKS) + 4))
            for cell in cells:
                print(f"| {cell:g} | {row(maps(folder, site, cell), exact)} |", flush=True)


if __name__ == "__main__":
    main()
