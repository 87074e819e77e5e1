"""Page of whole commands of two versions, from the record of ``tests/benchmarks/whole_commands.py``."""

from collections.abc import Mapping
from statistics import geometric_mean, median
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown

HEADS = ("command", "wall before [s]", "wall after [s]", "ratio", "processor, ratio", "error before", "error after")
RUNS = ("command", "version", "wall [s]", "processor [s]", "largest process [MB]")
VERSIONS = ("before", "after")
TEXT = """# Whole commands

Wall time of whole commands of two versions on the same machine.

{table}

Geometric mean of the wall times over those before: {mean:.2f}{without}.

![Wall time of each command before and after](commands.png)

- *Wall time*: as a user waits. {load} Each version chooses the threads of its members.
- *Processor, ratio*: user and system time of all processes, also of threads that wait.
- *Error*: relative L1 difference of the peak thickness, the mean over the members, from the same members with half the cells:
  by the version before, and by the version after where there is a second number.{errors}
- *Before*: stiffness stated by the sites, for waves about ten times as fast as the flow. *After*: stiffness chosen by the run.
- The first run compiles its kernels. Other runs find them, and start from a folder without results.
- Numbers are medians of the runs; {runs} has each run.

## How to make this page

    python tests/benchmarks/whole_commands.py --before CHECKOUT \\
        --after CHECKOUT --folder WORK --out whole_commands.json

Copy the record to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its table and
its figure.

Record: commits {commits[0]} and {commits[1]}; {machine}.
"""


def _medians(record: Mapping[str, Any], key: str) -> dict[str, list[float]]:
    """Median of a number of the runs before and after, by command."""
    names = dict.fromkeys(run["case"] for run in record["runs"])
    return {n: [median(r[v][key] for r in record["runs"] if r["case"] == n) for v in VERSIONS] for n in names}


def _errors(record: Mapping[str, Any], name: str) -> list[str]:
    """Errors before and after, each against both references."""
    found = record["errors"].get(name)
    return [" / ".join(f"{100 * e:.2g} %" for e in found[v].values()) if found else "" for v in VERSIONS]


def _table(record: Mapping[str, Any]) -> str:
    wall, processor = _medians(record, "wall"), _medians(record, "processor")
    rows = [
        [name, f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}", f"{processor[name][1] / processor[name][0]:.2f}", *_errors(record, name)]
        for name, (a, b) in wall.items()
    ]
    return markdown(HEADS, rows)


def _figure(record: Mapping[str, Any]) -> bytes:
    """Bars of wall time, one pair a command."""
    from matplotlib.figure import Figure

    wall = _medians(record, "wall")
    figure = Figure(figsize=(8, 0.6 + 0.5 * len(wall)), layout="constrained")
    axes = figure.add_subplot()
    for k, (version, colour) in enumerate(zip(VERSIONS, ("#b0b0b0", "#1f6f8b"), strict=True)):
        places = [n + 0.2 - 0.4 * k for n in range(len(wall), 0, -1)]
        bars = axes.barh(places, [pair[k] for pair in wall.values()], height=0.38, color=colour, label=version)
        axes.bar_label(bars, fmt="%.1f s", padding=3, fontsize=8)
    axes.set_yticks(range(len(wall), 0, -1), list(wall))
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.set_xlabel("wall time [s]")
    figure.legend(loc="outside upper center", ncols=len(VERSIONS), frameon=False)
    return as_png(figure)


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    beside = record.get("beside", ())
    ratios = [after / before for name, (before, after) in _medians(record, "wall").items() if name not in beside]
    rows = [
        [run["case"], v, round(run[v]["wall"], 2), round(run[v]["processor"], 2), round(run[v]["largest_process_mb"])]
        for run in record["runs"] for v in VERSIONS
    ]  # fmt: skip
    text = TEXT.format(
        table=_table(record), mean=geometric_mean(ratios), without=f"; not in it are *{'* and *'.join(beside)}*" if beside else "",
        commits=record["commits"],
        runs=download("commands.csv", "the table"), machine=record["machine"], load=record.get("load", ""),
        errors="".join(f" {note}" for note in record.get("notes", ())),
    )  # fmt: skip
    return StudyPage("commands", text, {"commands.csv": as_csv(RUNS, rows)}, {"commands.png": _figure(record)})
