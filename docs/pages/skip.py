"""Time saved by skipped work, as a page."""

from collections.abc import Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.simulation.checkpoint import EVERY
from tests.benchmarks.skip import FLOWING, RESTING

HEADS = ("switch", "on / off", "time", "share of observers on, off", "same bits", "largest change of a map")
OPENING = """# Skipped work

Time that a run saves by skipping work that its scene does not need, and the change of the maps. *Structures* is the other way
round: what a structure costs that nothing reaches. Without structures none of their code is compiled.

![Time with each switch over the time without it](skip.png)

{table}

- *Time*: processor time with the switch over that without it, the shortest of {repeats} alternating runs,
  without setup.
- *Share of observers*: of the wall time.
- *Largest change of a map*: relative L1, of {maps}. {changes} has the change of each map.

Scenes: site jacksboro on the backend scan, {particles:,} particles, cells of {cell:g} m, a raster of {rows} x
{columns} cells; {flowing[1]:g} s with a basal friction angle of {flowing[0]:g} deg, or {resting[1]:g} s with
{resting[0]:g} deg (stop rule).

## Checkpoints

A checkpoint of {checkpoint[particles]:,} particles in float32 takes {checkpoint[bytes_per_particle]:.0f} bytes a
particle and the time of {checkpoint[steps]:.1f} steps on one thread ({checkpoint[seconds]:.2g} s). By default a run
writes one every {every:g} s of wall time.

## How to make this page

    python -m tests.benchmarks.skip DIR

It writes the record `skip.json`. Copy it to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its
table and its figure.

Record: runout {version}, commit {commit}, Python {python}, NumPy {numpy}; {cores} cores ({processor}).
"""


def page(found: Mapping[str, Any]) -> StudyPage:
    """The results as a page of the documentation."""
    scene, rows = found["scene"], found["rows"]
    text = OPENING.format(
        table=markdown(HEADS, map(_row, rows)),
        repeats=found["repeats"],
        maps=", ".join(name.replace("_", " ") for name in rows[0]["difference"]),
        changes=download("skip.csv", "The table"),
        cell=scene["cell_size"][0],
        rows=scene["raster"][0],
        columns=scene["raster"][1],
        flowing=FLOWING,
        resting=RESTING,
        every=EVERY,
        particles=scene["particles"],
        **{name: found[name] for name in ("checkpoint", "version")},
        commit=found.get("commit") or "not recorded",
        **found["machine"],
    )
    return StudyPage("skip", text, {"skip.csv": _table(rows)}, {"skip.png": _figure(rows)})


def _row(row: Mapping[str, Any]) -> tuple[str, ...]:
    shares = f"{100 * row['observers_share_on']:.0f} %, {100 * row['observers_share_off']:.0f} %"
    name, largest = max(row["difference"].items(), key=lambda item: float(item[1]))
    change = f"{100 * largest:.2g} % ({name.replace('_', ' ')})" if largest else "0"
    same = ("yes" if row["same_bits"] else "no") + (" (must)" if row["exact"] else "")
    return row["skip"], row["remark"], f"{row['time_on_over_off']:.2f}", shares, same, change


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Steps, observations and the change of each map, as CSV."""
    heads = ("switch", "time on over off", "steps on", "steps off", "observations on", "observations off")
    maps = list(rows[0]["difference"])  # those of the record
    numbers = ((r, (f"{r['difference'][name]:.2g}" for name in maps)) for r in rows)
    lines = [(r["skip"], f"{r['time_on_over_off']:.2f}", *r["steps"], *r["observations"], *n) for r, n in numbers]
    return as_csv((*heads, *maps), lines)


def _figure(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of the time with each switch over the time without it."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(7.0, 0.8 + 0.35 * len(rows)), layout="constrained")
    axes = canvas.add_subplot()
    bars = axes.barh([r["skip"] for r in rows][::-1], [r["time_on_over_off"] for r in rows][::-1], color="#33658a")
    axes.bar_label(bars, fmt="%.2f", padding=3, fontsize=8)
    axes.axvline(1.0, color="0.4", lw=0.8)
    axes.set(xlabel="processor time with the switch over that without it")
    return as_png(canvas)
