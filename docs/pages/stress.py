"""Page of the stability stress test: the worst of every invariant, the verdicts by axis, and every trial as CSV."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.stability_cases.invariants import LIMITS
from runout.studies.stability_stress import changes

VERDICTS = {"survived": "#33658a", "refused": "#f6ae2d", "failed": "#c1121f"}
TOGETHER = "all together (Latin hypercube)"
OPENING = """# Stability

A mass of sand on a small terrain, with extreme values of every setting of a run: first each setting alone, then all
settings together in {samples} runs of a Latin hypercube. Each run moves in transfers of as many substeps as a run would take.

**{survived} survived, {refused} were refused, {failed} failed.**

- **Survived**: the run kept every invariant below.
- **Refused**: the run was refused with a reason before its first step.
- **Failed**: anything else.

![Number of runs that survived, were refused or failed, by axis](images/stress.png)

## Invariants

{worst}

All numbers of the state must be finite as well. *Rest* is measured in runs that must come to rest, *passage* in runs that
must leave a plane above a cliff.

## Verdicts by axis

{axes}

## Full table

{trials}: what each run changed, its verdict and reason, and its value of every invariant. `-` in *changed*: the
defaults.

## How to make this page

    {command}

It writes the record `stress.json`; `--full` takes all runs instead of a pinned set. Copy the record to
`tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its table and its figure.

Record: runout {version}, commit {commit}, backend {backend} on {device}.
"""
MEANINGS = {
    "mass": "relative error of mass, escaped mass and mass from a bed or an inflow included",
    "momentum": "momentum without the impulses of gravity and ground, over its tolerance",
    "energy": "rise of the sum of all energies over the drop of potential energy",
    "speed": "speed of the fastest particle over sqrt(v0² + 2 g dz) + 2 sqrt(g H) + 5 %",
    "mean speed": "speed of the centre of mass over that of its fall and of the release of the initial strain",
    "penetration": "depth of the middle of a layer of particles below the ground of raster and nodes [cells]",
    "penetration at narrow edges": "the same where walls and pits are narrower than two cells [cells]",
    "sinking": "depth of a particle below the height at which it touches the ground [cells]",
    "bed": "depth by which a node is eroded below its bed [cells]",
    "pore pressure": "distance of the part of the excess that remains from 0 to 1",
    "rest": "creep of masses that must rest, over 1 mm/s",
    "passage": "share of the mass that stays behind the edge of a cliff",
}


def page(content: Mapping[str, Any]) -> StudyPage:
    """The page of a record as :func:`runout.studies.stability_stress.stress` writes it, with its table and its figure."""
    trials = content["trials"]
    axes = _by_axis(trials)
    count = Counter(t["verdict"] for t in trials)
    text = OPENING.format(
        samples=sum(t["name"].startswith("sample") for t in trials),
        **{verdict: count[verdict] for verdict in VERDICTS},
        worst=markdown(("invariant", "meaning", "worst of the survivors", "limit"), _worst(trials)),
        axes=markdown(("axis", "runs", *VERDICTS, "reasons of refusals"), (_axis_row(name, some) for name, some in axes.items())),
        trials=download("stress.csv", f"all {len(trials)} runs"),
        **{name: content[name] for name in ("command", "version", "backend", "device")},
        commit=content["commit"] or "unknown",
    )
    return StudyPage("stress", text, {"stress.csv": _table(trials)}, {"images/stress.png": _figure(axes)})


def _worst(trials: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Rows: the worst of every invariant among the survivors, and its limit."""
    survivors = [t["worst"] for t in trials if t["verdict"] == "survived"]
    limits = {name: f"{limit:g}" if math.isfinite(limit) else "reported" for name, limit in LIMITS.items()}
    worst = {name: max((found[name] for found in survivors if name in found), default=0.0) for name in LIMITS}
    return [(name, MEANINGS[name], f"{worst[name]:.3g}", limits[name]) for name in _measured(trials)]


def _measured(trials: Sequence[Mapping[str, Any]]) -> list[str]:
    """Invariants that any trial has measured."""
    return [name for name in LIMITS if any(name in t["worst"] for t in trials)]


def _by_axis(trials: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The trials of each axis, in their order; those that change everything at once are one axis."""
    axes: dict[str, list[Mapping[str, Any]]] = {}
    for trial in trials:
        axes.setdefault(TOGETHER if trial["name"].startswith("sample") else trial["name"], []).append(trial)
    return axes


def _axis_row(name: str, trials: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    count = Counter(t["verdict"] for t in trials)
    reasons = Counter(t["reason"].split(" ")[0].rstrip(":;,") for t in trials if t["verdict"] == "refused")
    found = ", ".join(f"{word} ({number})" for word, number in reasons.most_common())
    return name, str(len(trials)), *(str(count[verdict]) for verdict in VERDICTS), found


def _table(trials: Sequence[Mapping[str, Any]]) -> str:
    """Every trial, as CSV."""
    measured = _measured(trials)
    heads = ("axis", "changed", "particles", "steps", "verdict", "reason", *measured)
    rows = [
        (
            *(t["name"], changes(t["changed"]) or "-", t["particles"], t["steps"], t["verdict"], t["reason"]),
            *(f"{t['worst'][name]:.2g}" if name in t["worst"] else "" for name in measured),
        )
        for t in trials
    ]
    return as_csv(heads, rows)


def _figure(axes: Mapping[str, Sequence[Mapping[str, Any]]]) -> bytes:
    """PNG of the share of each verdict, a bar an axis."""
    from matplotlib.figure import Figure

    names = list(axes)[::-1]
    canvas = Figure(figsize=(8.0, 0.6 + 0.3 * len(names)), layout="constrained")
    panel = canvas.add_subplot()
    left = [0.0] * len(names)
    for verdict, colour in VERDICTS.items():
        counts = [sum(t["verdict"] == verdict for t in axes[name]) for name in names]
        shares = [100.0 * n / len(axes[name]) for n, name in zip(counts, names, strict=True)]
        bars = panel.barh(names, shares, left=left, color=colour, label=verdict)
        panel.bar_label(bars, [str(n) if n else "" for n in counts], label_type="center", fontsize=8, color="white")
        left = [a + b for a, b in zip(left, shares, strict=True)]
    panel.set(xlabel="share of the runs [%], with their number", xlim=(0, 100))
    canvas.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return as_png(canvas)
