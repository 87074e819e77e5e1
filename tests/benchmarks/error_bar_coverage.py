"""Coverage of error bars: how often the bar of a convergence study holds the value of a finer grid, and how wide it is.

    python -m tests.benchmarks.error_bar_coverage --out DIR [--processes 16] [--backend hash --device cuda:0] [--small]

A case is a site at a basal friction angle with a number of grid cells through the mean thickness of its release. Its bar comes from
the runs of `runout verify SITE --convergence`, on other shifts in each case. Its true value is the mean of two shifted runs on a
finer grid; half their distance is the noise of the true value.

`--true RECORD` takes the true values, and the differences from them, of an earlier record whose runs of the site's own grid are
the same; then only the bars are made anew.

Each run is a file in DIR/runs. A second call does those that are missing, so take another folder for another version. Calls with
other `--cases` may share a folder and run at the same time, one on a GPU; a last call with all cases makes the record. Copy
DIR/error_bars.json to tests/benchmarks/records/, take the numbers of its `expected` over into runout/forecast/accuracy.py, then run
`python -m docs.pages`.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from docs.pages.error_bars import FILE, coverage
from runout.forecast import numerical_error
from runout.forecast.numerical_error import MAP
from runout.io.atomic import whole_file, write_json
from runout.studies import convergence
from runout.studies.convergence import SHIFT, Ground, Pair, Run, bars, grounds, paired, plan, relative_l1, run_once

SITES = Path(__file__).parents[2] / "sites"
CHOSEN_BY = ("jacksboro:11,13,16,19", "frank_slide:11,13,16,19", "cascades_2021:10,13,16,19", "made:15,17,19,22")  # [deg]
HELD_OUT = (
    *("jacksboro:12.3,17.7", "frank_slide:9.5,14.5,20", "cascades_2021:11.5,14.5,17.5", "made:13.5,16,20.5"),
    "avakot:17,22",
)  # by which no constant was chosen
CASES = (*CHOSEN_BY, *HELD_OUT)
SMALL = ("jacksboro:15",)
CELLS, TRUTH = (1.0, 1.22, 1.5, 1.83, 2.25), 4.5  # through the mean thickness of the release
SMALL_CELLS, SMALL_TRUTH = (0.6, 0.75), 1.5
END_TIME = 60.0  # [s]
TRUTHS = 2  # runs of a true value
OFFSET = 0.23  # shift for a degree of friction [cells]
KEPT = ("flow_thickness", "speed", "pressure")  # maps of a run
LAYERS = (0.0, 0.5, 1.0, 2.0, 5.0, 20.0)  # least thickness on the fine grid of the parts of a bias [m]


@dataclass(frozen=True)
class Task:
    """One run: case, cells through the thickness in it, cell size over that, number, negative for the true value, and ground."""

    site: str
    friction: float
    cells: float
    ratio: float
    number: int
    end_time: float
    backend: str
    device: str
    fine_relief: float | None = None  # part of the waves of two cells of the raster; None: by the grid

    @property
    def path(self) -> str:
        """File name."""
        case = f"{Path(self.site).name}_{self.friction:g}_{self.cells:g}"
        ground = "" if self.fine_relief is None else f"_{self.fine_relief:.3g}"
        return f"{case}_{self.ratio:g}_{self.number}_{self.end_time:g}{ground}.npz"

    @property
    def shift(self) -> float:
        """Of the grid against the terrain [cells], another one in each case."""
        return abs(self.number) * SHIFT + OFFSET * self.friction + self.cells

    def run(self, folder: Path) -> float:
        """Run, unless the file is there; returns its seconds."""
        path = folder / self.path
        if path.is_file():
            return 0.0
        arguments, thresholds = problem(self.site, self.friction)
        single = {"threads": 1} if self.device == "cpu" else {}
        changed = {name: getattr(self, name) for name in ("end_time", "backend", "device")}
        changed["cell_size"] = spacing(self.site, self.cells)
        how = self.ratio, self.shift, abs(self.number), thresholds, None, self.fine_relief
        made = run_once({**arguments, **changed, **single}, *how)
        with whole_file(path) as temporary, temporary.open("wb") as file:
            maps = {name: made.maps[name].astype(np.float32) for name in KEPT}
            facts = {"seconds": made.seconds, "particles": made.particles, "engine": f"{self.backend} on {self.device}"}
            np.savez_compressed(file, quantities=json.dumps(made.quantities), **facts, **maps)
        return made.seconds


@cache
def finished(task: Task, folder: Path) -> Run:
    """The run of a task, read once."""
    with np.load(folder / task.path) as content:
        maps = {name: content[name] for name in KEPT if name in content}
        quantities = json.loads(str(content["quantities"]))
        return Run(task.ratio, quantities, maps, float(content["seconds"]), int(content["particles"]))


def engines(plans: Mapping[Any, Sequence[Task]], folder: Path) -> str:
    """Backends and devices of all runs."""
    paths = (folder / task.path for each in plans.values() for task in each)
    return ", ".join(sorted({str(np.load(path)["engine"]) for path in paths}))


@cache
def problem(site: str, friction: float) -> tuple[dict[str, Any], Sequence[float]]:
    """Arguments of ``runout.simulate`` and thresholds of thickness [m]; "made", "avakot", a site by name or by path."""
    from runout import log, read_site

    if site in ("made", "avakot"):
        arguments = made_site() if site == "made" else avakot_site()
        return {**arguments, "basal_friction_angle": friction, "seed": 0}, (0.5, 1.0, 2.0, 5.0)
    with log.muted():
        known = read_site(SITES / site if (SITES / site).is_dir() else Path(site))
        arguments = known.member_arguments({"basal_friction_angle_deg": friction})
    return {**arguments, "stop": False}, known.settings.hazard.thickness_thresholds


def spacing(site: str, cells: float) -> float:
    """Spacing [m] of a grid with so many cells through the mean thickness of the release."""
    arguments, _ = problem(site, 15.0)
    return float(sum(r.volume for r in arguments["release"]) / sum(r.area for r in arguments["release"]) / cells)


@cache
def ground(site: str, cells: float) -> Ground:
    """Grounds of the runs of a case."""
    arguments, _ = problem(site, 15.0)
    return grounds(arguments["terrain"], (spacing(site, cells),) * 2)


def made_site() -> dict[str, Any]:
    """15 m of rock on a slope with relief of all wavelengths and an oscillation of two cells of 5 m, as resampled rasters have."""
    import runout

    rng, cell = np.random.default_rng(3), 5.0
    row, column = np.indices((260, 420))
    x, y = column * cell, (len(row) - row) * cell
    frequency = np.hypot(np.fft.fftfreq(row.shape[0], cell)[:, None], np.fft.fftfreq(row.shape[1], cell)[None, :])
    frequency[0, 0] = 1.0
    spectrum = np.where(frequency < 1 / 800, 0.0, frequency**-1.6)
    rough = np.fft.ifft2(np.fft.fft2(rng.standard_normal(row.shape)) * spectrum).real
    smooth = 900.0 * np.exp(-x / 900.0) + 60.0 * ((y - len(row) * cell / 2) / 600.0) ** 2
    oscillation = np.where((row + column) % 2, 1, -1) * rng.uniform(0.5, 1.5, row.shape)
    terrain = runout.Terrain.from_array(smooth + 4.0 * rough / rough.std() + oscillation, cell)
    thickness = np.zeros(row.shape)
    thickness[110:150, 20:60] = 15.0
    release = runout.Release.from_array(thickness, terrain, placement="on_surface")
    return {"terrain": terrain, "release": [release], "material": runout.DruckerPrager(density=2000.0, friction_angle=32.0)}


def avakot_site() -> dict[str, Any]:
    """12 m of rock on the terrain of AvaFrame's avaKot (5 m), with the outline of its release; RUNOUT_DATA holds both."""
    import runout

    inputs = Path(os.environ["RUNOUT_DATA"]) / "avaframe" / "avaKot" / "Inputs"
    terrain = runout.Terrain.from_raster(inputs / "avaKot.asc")
    release = runout.Release.from_vector(inputs / "REL" / "relKot.shp", terrain, thickness=12.0)
    return {"terrain": terrain, "release": [release], "material": runout.DruckerPrager(density=2000.0, friction_angle=32.0)}


def tasks(cases: Sequence[str], cells: Sequence[float], truth: float, **run: Any) -> dict[tuple[str, float, float], list[Task]]:
    """Runs by site, friction [deg] and cells through the thickness; those of the true value have the cells of ``truth``."""
    by_name = {}
    for site, angles in (case.split(":") for case in cases):
        for friction in map(float, angles.split(",")):
            by_name[site, friction, truth] = [Task(site, friction, truth, 1.0, -1 - k, **run) for k in range(TRUTHS)]
            for through in cells:
                grids = plan(ground=ground(site, through))
                by_name[site, friction, through] = [
                    Task(site, friction, through, ratio, k, fine_relief=part, **run) for ratio, k, part in grids
                ]
    return by_name


def finish(plans: Mapping[Any, Sequence[Task]], folder: Path, processes: int) -> None:
    """Run what is missing, the finest first."""
    folder.mkdir(parents=True, exist_ok=True)
    left = [task for each in plans.values() for task in each if not (folder / task.path).is_file()]
    left.sort(key=lambda task: -task.cells / task.ratio)
    for task in [left.pop()] if left and processes > 1 else left:
        task.run(folder)  # the first one compiles for all processes
    if processes == 1:
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(task.run, folder): task for task in left}
        for k, job in enumerate(as_completed(jobs)):
            print(f"{k + 1} of {len(jobs)}: {jobs[job].path}, {job.result():.1f} s", flush=True)


def cases_of(
    plans: Mapping[tuple[str, float, float], Sequence[Task]], truth: float, folder: Path, known: Sequence[Mapping[str, Any]] = ()
) -> Iterator[dict[str, Any]]:
    """Bar, true value with its noise, difference, and whether the bar holds it, for each quantity of each case.

    ``known``: cases of an earlier record, whose true values and differences are taken.
    """
    for (site, friction, cells), each in plans.items():
        if cells != truth:
            made = [(task.ratio, task.number, task.fine_relief or 0.0) for task in each]
            runs, pair = paired([finished(task, folder) for task in each], made, ground(site, cells).weight)
            case = {"site": Path(site).name, "friction": friction, "cells": cells}
            if known:
                quantities = judged_again(runs, pair, [one for one in known if case.items() <= one.items()])
            else:
                quantities = judged(runs, pair, [finished(task, folder) for task in plans[site, friction, truth]])
            for quantity in quantities:
                yield {**case, "held_out": friction not in angles_of(CHOSEN_BY, site), **quantity}


def angles_of(cases: Sequence[str], site: str) -> tuple[float, ...]:
    """Friction angles [deg] of a site among cases."""
    return tuple(float(angle) for case in cases if case.startswith(f"{site}:") for angle in case.split(":")[1].split(","))


def judged(runs: Sequence[Run], pair: Pair | None, true: Sequence[Run]) -> Iterator[dict[str, Any]]:
    """Each quantity with the error bar of ``runs``, the finest last, and its difference from the mean of the true runs.

    ``pair`` is that of :func:`runout.studies.convergence.paired`.
    """
    fine = runs[-1]
    for name, bar in bars(runs, pair).items():
        if name == MAP:
            maps = [run.maps["flow_thickness"] for run in true]
            mean, value = np.mean(maps, axis=0), None
            difference, noise = relative_l1(fine.maps["flow_thickness"], mean), relative_l1(maps[0], mean)
        else:
            values = [run.quantities[name] for run in true]
            value, noise = float(np.mean(values)), float(np.ptp(values) / 2.0)
            difference = abs(value - fine.quantities[name])
        if np.isfinite(difference) and bar.relative is not None:
            scale = abs(bar.fine) if bar.fine else 1.0
            entry = {"truth": value, "noise": noise / scale, "difference": float(difference / scale)}
            yield {"quantity": name, **bar.as_dict(name), **entry, "holds": bool(difference <= bar.error)}


def judged_again(runs: Sequence[Run], pair: Pair | None, known: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Each quantity of earlier cases with the error bar of ``runs``, as :func:`judged`; maps have the earlier difference."""
    error_bars = bars(runs, pair)
    for case in known:
        bar = error_bars[case["quantity"]]
        difference = case["difference"] if bar.fine is None else abs(case["truth"] / bar.fine - 1.0)
        entry = {"truth": case["truth"], "noise": case["noise"], "difference": difference, "holds": difference <= bar.relative}
        yield {"quantity": case["quantity"], **bar.as_dict(case["quantity"]), **entry}


def tried_constants(
    plans: Mapping[tuple[str, float, float], Sequence[Task]], truth: float, folder: Path, known: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[dict[str, float], list[dict[str, Any]]]]:
    """Other constants of a bar, and all cases with them; ``known``: the cases with those of now, whose differences stay."""
    distances, between = {}, convergence._distances

    def known_distances(runs: Sequence[Run], name: str) -> list[float]:
        """Distances of the maps of the same runs, which no constant changes; ``finished`` keeps the runs."""
        key = (name, *map(id, runs))
        if key not in distances:
            distances[key] = between(runs, name)
        return distances[key]

    for safety, of_map, scatters, share in product((1.0, 1.25, 1.5), (1.25, 1.5, 1.75, 2.0), (1.0, 2.0), (0.25, 0.35, 0.45, 0.6)):
        numbers = {"SAFETY": safety, "MAP_SAFETY": of_map, "SCATTERS": scatters, "SHARE": share}
        with patch.multiple(numerical_error, **numbers), patch.object(convergence, "_distances", known_distances):
            yield numbers, list(cases_of(plans, truth, folder, known))


def constants(tried: Sequence[tuple[dict[str, float], list[dict[str, Any]]]]) -> Iterator[str]:
    """Lines on other constants of a bar: share of bars that hold, in all and by site, and median bar over median difference."""
    for numbers, cases in tried:
        content, names = coverage(cases), dict.fromkeys(case["site"] for case in cases)
        sites = (f"{name} {coverage([c for c in cases if c['site'] == name])['holds']:.2f}" for name in names)
        chosen = " ".join(f"{name} {value:g}" for name, value in numbers.items())
        yield f"{chosen}: {content['holds']:.3f} ({', '.join(sites)}), ratio {content['ratio']:.2f}"


def left_out_sites(tried: Sequence[tuple[dict[str, float], list[dict[str, Any]]]]) -> list[dict[str, Any]]:
    """Coverage on each site with the constants that the other sites choose: of those that hold 9 of 10 bars there, the tightest.

    The most that hold, where none hold so many.
    """
    rows = []
    for site in dict.fromkeys(case["site"] for case in tried[0][1]):
        others = [coverage([case for case in cases if case["site"] != site]) for _, cases in tried]
        best = min(range(len(tried)), key=lambda k: (max(0.0, 0.9 - others[k]["holds"]), others[k]["ratio"]))
        numbers, cases = tried[best]
        rows.append({"site": site, **numbers, **coverage([case for case in cases if case["site"] == site])})
    return rows


def bias_by_thickness(run: Run, true: Run) -> list[dict[str, float]]:
    """Parts of the bias [1] of speed and pressure against a finer grid, by the largest thickness there.

    With the number of cells that either reaches, the number that both reach, and the bias of speed in those.
    """
    thickness, rows = np.nan_to_num(true.maps["flow_thickness"]), []
    speeds = run.maps["speed"], true.maps["speed"]
    for least, most in pairwise((*LAYERS, np.inf)):
        either = (thickness >= least) & (thickness < most) & (np.maximum(*speeds) > 0)
        both = either & (np.minimum(*speeds) > 0)
        row = {"least": least, "cells": int(either.sum()), "both": int(both.sum())}
        row["bias_where_both"] = float(speeds[0][both].sum() / speeds[1][both].sum() - 1.0) if both.any() else 0.0
        for name in ("speed", "pressure"):
            one, other = run.maps[name], true.maps[name]
            row[name] = float((one[either] - other[either]).sum() / other.sum())
        rows.append(row)
    return rows


def split_case(case: str, truth: float, folder: Path, run: Mapping[str, Any]) -> dict[str, Any]:
    """The bias by thickness of SITE:ANGLE:CELLS, against one run of the true value."""
    site, friction, cells = case.split(":")
    tried = [Task(site, float(friction), float(through), 1.0, k, **run) for through, k in ((cells, 0), (truth, -1))]
    for task in tried:
        task.run(folder)
    sizes = {"cell_size": spacing(site, float(cells)), "true_cell_size": spacing(site, truth)}
    layers = bias_by_thickness(*(finished(task, folder) for task in tried))
    return {"site": Path(site).name, "friction": float(friction), **sizes, "layers": layers}


def expected_errors(cases: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Median bars of map and run-out, brought to one cell through the thickness by first order."""
    scaled = {name: [c["relative_error"] * c["cells"] for c in cases if c["quantity"] == name] for name in (MAP, "f99")}
    return {name: float(np.median(bars)) for name, bars in scaled.items() if bars}


def record(cases: Sequence[Mapping[str, Any]], seconds: float, wall: float, chosen: argparse.Namespace) -> dict[str, Any]:
    """Machine, versions, command, cases, how many bars hold, and expected errors."""
    from runout.studies.work_precision import machine, versions

    return {
        "machine": machine(),
        "versions": versions(),
        **{name: getattr(chosen, name) for name in ("options", "engines", "processes", "truth", "end_time", "bias_by_thickness")},
        "seconds": {"runs": round(seconds), "wall": round(wall)},
        "coverage": coverage(cases),
        "coverage_held_out": coverage([case for case in cases if case["held_out"]] or cases),
        "expected": expected_errors(cases),
        "cases": list(cases),
    }


def options() -> argparse.ArgumentParser:
    """Options of the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of runs and record")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--backend", default="scan")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--small", action="store_true", help="one coarse case, for CI")
    parser.add_argument("--cases", nargs="+", help="SITE:ANGLE,ANGLE with made, avakot, a name below sites/ or the path of a site")
    parser.add_argument("--cells", nargs="+", type=float, help="cells through the mean thickness, one case each")
    parser.add_argument("--truth", type=float, help="cells through the mean thickness of the true value")
    parser.add_argument("--true", type=Path, help="earlier record of the true values, which are not run")
    parser.add_argument("--split", help="SITE:ANGLE:CELLS whose bias of speed and pressure is split by thickness")
    parser.add_argument("--constants", action="store_true", help="also other constants of a bar, and those of other sites")
    parser.add_argument("--end-time", type=float, default=END_TIME)
    return parser


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Make all runs, and write the record."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    chosen = options().parse_args(words)
    chosen.options = " ".join(words).replace(str(chosen.out), "DIR").replace(str(chosen.true), "RECORD")
    chosen.truth = chosen.truth or (SMALL_TRUTH if chosen.small else TRUTH)
    run = {name: getattr(chosen, name) for name in ("end_time", "backend", "device")}
    named, cells = chosen.cases or (SMALL if chosen.small else CASES), chosen.cells or (SMALL_CELLS if chosen.small else CELLS)
    started, plans, folder = time.perf_counter(), tasks(named, cells, chosen.truth, **run), chosen.out / "runs"
    known = json.loads(chosen.true.read_text())["cases"] if chosen.true else []
    if known:
        plans = {case: each for case, each in plans.items() if case[2] != chosen.truth}
    finish(plans, folder, chosen.processes)
    chosen.engines = engines(plans, folder)
    seconds = sum(finished(task, folder).seconds for each in plans.values() for task in each)
    chosen.bias_by_thickness = split_case(chosen.split, chosen.truth, folder, run) if chosen.split else None
    content = record(list(cases_of(plans, chosen.truth, folder, known)), seconds, time.perf_counter() - started, chosen)
    if chosen.constants:
        tried = list(tried_constants(plans, chosen.truth, folder, content["cases"]))
        print("\n".join(constants(tried)), flush=True)
        content["left_out"] = left_out_sites(tried)
    print(write_json(content, chosen.out / FILE), json.dumps(content["coverage"]), json.dumps(content["expected"]))
    return content


if __name__ == "__main__":
    os.environ["NUMBA_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # of each process
    main()
