"""Substeps of a transfer, as a page: error, work at equal error, and cost of a substep."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown

TITLES = {
    "frank_slide": "Frank Slide, 15°",
    "frank_slide_20": "Frank Slide, 20°",
    "jacksboro": "jacksboro, 15°",
    "jacksboro_25": "jacksboro, 25°",
    "coulomb_only": "CoulombOnly",
}
ERRORS = {"peak": "largest thickness", "deposit": "thickness at 60 s"}
TEXT = """# Substeps of a transfer

A transfer between particles and grid damps the flow. With `substeps` several time steps share one transfer (theory:
{{doc}}`../theory`). How much smaller is the error, and what does a substep cost? Flows on terrain of 60 s on uneven grids, two
seeds each, against the finest grid with {reference} substeps.

![Error of the map of largest thickness against particle-steps, by substeps](substeps.png)

## Error on the same grid

{errors}

Relative L1 error of the map [%], mean of two seeds: 1, 2, 4 and 8 substeps. The seeds differ by {seeds:.2f} points in the median,
{most_seeds:.1f} at most. One substep on the finest grid differs from {reference} there by {finest}.

## Work at equal error

{work}

Particle-steps over those that one substep needs for the same error, by a power law through its points; geometric mean over the
grids. Four substeps reach what two cannot; eight gain little more, except for slow flows (jacksboro, 25°).

## Cost of a substep

{scan}

Backend scan, one thread, processor time of a run over particles and substeps [ns]; beside other work, so that single runs differ
by a fifth. On a GPU ({card}, float32, layers of `runout bench`), nanoseconds a particle and substep:

{gpu}

On this CPU a substep costs what a step costs, within the spread of the runs. On this GPU a substep of 0.1, 0.3 and 1 million
particles costs 17, 12 and 8 % less than a step, one of 10 million as much.

## Kernels of a transfer on a GPU

A layer of {million} million particles, each kernel of a transfer of one and of four substeps, sorts left out. Bytes are read
from and written to the memory of the device. *Before*: commit {kernels[commit_before]}; one substep has the kernels of that.

{by_kernel}

A substep of four takes {of_four:.0f} µs ({before:.0f} before), a step {of_one:.0f} µs. The law in place (`strain_in_place`) takes
4 % longer than both transfers of a step, though it moves half of their bytes: 128 registers of a thread let 16 warps share a
multiprocessor, which issue in 56 % of the cycles. With 96 registers and a larger spill it takes 15 % longer. With two warps a block
and 256 particles at once it takes as long for 5 million particles, and 40 % longer for 0.1 million. If only cells that hold
particles get threads, and few such cells more of them each, it takes 7 % longer for both, and with eight warps a block 48 and 16 %.

Between two substeps, `update_nodes` leaves the velocity of each node beside the momentum with which the next substep begins, and
`strain_in_place` adds its impulses to that. Before, `resume_nodes` made momentum of velocity and impulses. Nodes without mass are
not read: 200 MB a launch in place of 241. The last launch closes the transfer. Since this record, the kernel that does this is one
of its own, `end_substep`, with as many registers and instructions.

Groups of arrays reach a kernel packed since commit {kernels[rates_commit]}, and a sort takes fewer launches. Rates of transfers of
four substeps, sorts included, before and now:

{rates}

Runs of both commits took turns, five to fifteen each: medians, in brackets least and largest; the ratio is the median over the
pairs. The scenes together have as many particles as the layer of 6.4M. In two sessions with an earlier form of this sort the ratio
of 0.1M was 1.15 and 1.13 (15 and 25 pairs), that of 0.3M 1.08 and 1.03, that of the scenes 1.00 and 1.01.

A transfer of 0.1 million particles behind a sort takes 185 µs (199 before). Its 16 launches take 42 µs (48) where they have
nothing to do: arguments have 0.3 to 1.0 kB (1.3 to 3.9). A sort of 0.1, 0.3, 1 and 10 million particles takes 177, 245, 461 and
2091 µs (205, 345, 494, 2107), the copy of the status to the host included, every fourth transfer where the layer has become fast.

## Full table

{table}: every run

## How to make this page

    RUNOUT_DATA=DIR python -m tests.benchmarks.substeps OUT --backend hash --device cuda:0 --processes 8
    python tests/benchmarks/gpu_substeps.py --device cuda:0 --out gpu_substeps.json
    python tests/benchmarks/gpu_kernels.py --device cuda:0 --out gpu_kernels.json

Times of scan are those of the first command without a device. Copy the records to `tests/benchmarks/records/` (`substeps.json`
holds the others under `gpu`, `kernels` and `scan`); `python -m docs.pages` then writes this page, its table and its figure.

Record: runout {runout}, commit {commit}, NumPy {numpy}. Times on the GPU: commit {gpu_commit}, kernels {kernels[commit]}; times
of scan: an earlier one.
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    runs = record["runs"]
    numbers = sorted({run["substeps"] for run in runs})
    coarse = {site: sorted({r["cell"] for r in runs if r["site"] == site}, reverse=True)[:-1] for site in TITLES}
    apart = [100 * abs(a - b) for a, b in _pairs(runs, coarse, numbers)]
    finest = [f"{100 * _mean(runs, s, min(r['cell'] for r in runs if r['site'] == s), 1, 'peak'):.1f} %" for s in TITLES]
    heads = ("flow", "cells [m]", *(f"{name} [%]" for name in ERRORS.values()))
    errors = [
        (TITLES[s] if cell == coarse[s][0] else "", f"{cell:g}", *(_by_number(runs, s, cell, numbers, key) for key in ERRORS))
        for s in TITLES
        for cell in coarse[s]
    ]
    text = TEXT.format(
        reference=record["reference"], errors=markdown(heads, errors), seeds=np.median(apart), most_seeds=max(apart),
        finest=", ".join(finest), work=_work_table(runs, coarse, numbers[1:]), scan=_scan(record["scan"]),
        gpu_commit=record["gpu"]["commit"], card=record["gpu"]["device"],
        gpu=_gpu(record["gpu"]["records"]), kernels=record["kernels"], million=f"{record['kernels']['particles'] / 1e6:.3g}",
        by_kernel=_by_kernel(record["kernels"]), rates=_rates(record["kernels"]["rates"]), **_of_substeps(record["kernels"]),
        table=download("substeps.csv", f"all {len(runs)} runs"),
        **{name: record["versions"][name] for name in ("runout", "commit", "numpy")},
    )  # fmt: skip
    names = ("site", "cell", "substeps", "seed", *ERRORS, "centre", "numerical", "particle_steps")
    table = as_csv(names, [[run[name] for name in names] for run in runs])
    return StudyPage("substeps", text, {"substeps.csv": table}, {"substeps.png": _figure(runs, coarse, numbers)})


def _mean(runs: Sequence[Mapping[str, Any]], site: str, cell: float, number: int, key: str) -> float:
    """Mean over the seeds of a number of the runs on one grid."""
    return float(np.mean([r[key] for r in runs if (r["site"], r["cell"], r["substeps"]) == (site, cell, number)]))


def _by_number(runs: Sequence[Mapping[str, Any]], site: str, cell: float, numbers: Sequence[int], key: str) -> str:
    return ", ".join(f"{100 * _mean(runs, site, cell, number, key):.1f}" for number in numbers)


def _pairs(runs: Sequence[Mapping[str, Any]], coarse: Mapping[str, Sequence[float]], numbers: Sequence[int]) -> list[list[float]]:
    """Errors of the two seeds of each grid."""
    seeds = (
        [r["peak"] for r in runs if (r["site"], r["cell"], r["substeps"]) == (site, cell, number)]
        for site, cells in coarse.items()
        for cell in cells
        for number in numbers
    )
    return [errors for errors in seeds if len(errors) == 2]


def work_at_equal_error(runs: Sequence[Mapping[str, Any]], site: str, cells: Sequence[float], number: int, key: str) -> float:
    """Particle-steps with a number of substeps over those of one substep at the same error, geometric mean over the grids."""
    work, error = (
        {n: np.log([_mean(runs, site, cell, n, name) for cell in cells]) for n in (1, number)} for name in ("particle_steps", key)
    )
    slope, start = np.polyfit(work[1], error[1], 1)
    return float(np.exp(np.mean(work[number] - (error[number] - start) / slope)))


def _work_table(runs: Sequence[Mapping[str, Any]], coarse: Mapping[str, Sequence[float]], numbers: Sequence[int]) -> str:
    heads = ("flow", *(f"{name}, {n} substeps" for name in ERRORS.values() for n in numbers))
    rows = [
        (TITLES[s], *(f"{work_at_equal_error(runs, s, cells, n, key):.2f}" for key in ERRORS for n in numbers))
        for s, cells in coarse.items()
    ]
    return markdown(heads, rows)


def _scan(times: Sequence[Mapping[str, Any]]) -> str:
    cases = dict.fromkeys((t["site"], t["cell"]) for t in times)

    def of(case: tuple[str, float], number: int) -> str:
        nanoseconds = [t["nanoseconds"] for t in times if (t["site"], t["cell"]) == case and t["substeps"] == number]
        return ", ".join(f"{value:.0f}" for value in nanoseconds)

    rows = [(TITLES[case[0]], f"{case[1]:g}", of(case, 1), of(case, 4)) for case in cases]
    return markdown(("flow", "cells [m]", "1 substep", "4 substeps"), rows)


def _gpu(records: Sequence[Mapping[str, Any]]) -> str:
    columns = ("nanoseconds", ".3f"), ("bytes_a_particle", ".0f")
    rows = [(r["name"], *(format(r[name][number], how) for name, how in columns for number in "14")) for r in records]
    return markdown(("particles", "1 substep", "4 substeps", "bytes a particle, 1", "4"), rows)


def _by_kernel(record: Mapping[str, Any]) -> str:
    """Launches, time and bytes of each kernel of a transfer of one and of four substeps."""
    one, four = ({r["kernel"]: r for r in record["records"][number]} for number in "14")
    earlier = {r["kernel"]: r for r in record["before"]}
    rows = []
    for name in [*four, *(gone for gone in earlier if gone not in four)]:
        alone, now = one.get(name), four.get(name)
        single = (f"{alone['microseconds']:.0f}", _megabytes(alone)) if alone else ("", "")
        found = (*_launched(now), _megabytes(now), f"{now['registers']:.0f}") if now else ("", "", "", "")
        rows.append((f"`{name}`", *single, *(_launched(earlier[name]) if name in earlier else ("", "")), *found))
    of_launches = ("launches before", "each [µs]", "launches, 4 substeps", "each [µs]")
    heads = ("kernel", "1 substep [µs]", "[MB]", *of_launches, "[MB]", "registers")
    return markdown(heads, rows)


def _launched(kernel: Mapping[str, float]) -> tuple[str, str]:
    """Launches of a kernel in a transfer, and the time [µs] of each."""
    return f"{kernel['launches']:g}", f"{kernel['microseconds']:.0f}"


def _rates(rates: Sequence[Mapping[str, Any]]) -> str:
    """Rates of substeps before and now."""

    def of(row: Mapping[str, Any], when: str) -> str:
        least, largest = row[f"{when}_range"]
        return f"{row[when]:.2f} ({least:.2f} to {largest:.2f})"

    rows = [(r["name"], of(r, "before"), of(r, "now"), f"{r['ratio']:.2f}") for r in rates]
    return markdown(("particles", "before [10⁹ substeps/s]", "now", "now over before"), rows)


def _megabytes(kernel: Mapping[str, float]) -> str:
    return f"{(kernel['bytes_read'] + kernel['bytes_written']) / 1e6:.0f}"


def _of_substeps(record: Mapping[str, Any]) -> dict[str, float]:
    """Time [µs] of a substep: the only one of a transfer, and of four, also before."""
    one, four, before = (
        sum(r["launches"] * r["microseconds"] for r in rows) for rows in (*record["records"].values(), record["before"])
    )
    return {"of_one": one, "of_four": four / 4, "before": before / 4}


def _figure(runs: Sequence[Mapping[str, Any]], coarse: Mapping[str, Sequence[float]], numbers: Sequence[int]) -> bytes:
    """Error of the peak map against particle-steps; points are means over the seeds."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(11.0, 2.9), layout="constrained")
    for axes, (site, cells) in zip(canvas.subplots(1, len(coarse), sharey=True), coarse.items(), strict=True):
        for k, number in enumerate(numbers):
            work, error = ([_mean(runs, site, cell, number, key) for cell in cells] for key in ("particle_steps", "peak"))
            axes.loglog(work, 100 * np.array(error), "o-", color=f"C{k}", markersize=3.5, linewidth=1.2, label=f"{number}")
        axes.set_title(TITLES[site], fontsize=9)
        axes.grid(color="0.9", which="both")
        axes.tick_params(labelsize=7)
        axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
        axes.minorticks_off()
    canvas.axes[0].set_ylabel("error of the largest thickness [%]", fontsize=8)
    canvas.supxlabel("particle-steps", fontsize=8)
    canvas.axes[0].legend(title="substeps", frameon=False, fontsize=7, title_fontsize=7)
    return as_png(canvas)
