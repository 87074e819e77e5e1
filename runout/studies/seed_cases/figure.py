"""Figure of the published benchmarks: the sparsity ladder, and memory and run-out of the synthetic site."""

from collections.abc import Mapping, Sequence
from typing import Any

from runout.studies.seed_cases import published
from runout.studies.study_page import as_png

COLOURS = {"CPU": "#33658a", "GPU": "#d1495b"}
CARD = 16.0  # [GB] that the finest run must fit


def figure(records: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of the figure."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(11.0, 3.6), layout="constrained")
    ladder, memory, runout = canvas.subplots(1, 3)
    for record in records:
        name = "CPU" if record["device"] == "cpu" else "GPU"
        rungs = [r for r in record.get("ladder", ()) if "speed_up" in r]
        ladder.loglog([r["sparsity"] for r in rungs], [r["speed_up"] for r in rungs], "o-", color=COLOURS[name], label=name)
        ladder.plot(published.SPARSITIES[-1], published.SPEED_UP[name], "x", color=COLOURS[name], label=f"{name}, published")
        _site(memory, runout, record.get("site", ()), name)
    ladder.set(xlabel="box around the bodies / their volume", ylabel="time, dense grid / sparse grid", title="Sparsity ladder")
    memory.axhline(CARD, color="0.5", lw=0.8, ls="--")
    memory.set(xlabel="particles", ylabel="memory [GB]", title="Synthetic site")
    runout.set(xlabel="cell [m]", ylabel="run-out of 99 % of the mass [m]", title="Synthetic site")
    for axes in (ladder, memory, runout):
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    return as_png(canvas)


def _site(memory: Any, runout: Any, rows: Sequence[Mapping[str, Any]], name: str) -> None:
    """Lines of one device."""
    n = [r["particles"] for r in rows]
    memory.loglog(n, [r["backend_bytes"] / 1e9 for r in rows], "o-", color=COLOURS[name], label=f"{name}, backend")
    if rows and rows[0]["card_bytes"] is not None:
        memory.loglog(n, [r["card_bytes"] / 1e9 for r in rows], "s:", color=COLOURS[name], label="card")
    memory.loglog(n, [r["host_bytes"] / 1e9 for r in rows], "^--", color=COLOURS[name], label=f"host ({name})", alpha=0.6)
    runout.plot([r["cell"] for r in rows], [r["runout"] for r in rows], "o-", color=COLOURS[name], label=name)
