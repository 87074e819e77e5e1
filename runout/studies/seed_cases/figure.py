"""Figure of the published benchmarks: the sparsity ladder, and memory and run-out of the synthetic site."""

from collections.abc import Mapping, Sequence
from typing import Any

from runout.studies.seed_cases import published
from runout.studies.study_page import as_png

COLOURS = {"CPU": "#33658a", "GPU": "#d1495b"}
LONGEST = 2700.0  # [m], from the top of the release to the edge of the terrain
CARD = 16.0  # [GB] that the finest run must fit


def figure(records: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of the figure."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(11.0, 3.6), layout="constrained")
    ladder, memory, runout = canvas.subplots(1, 3)
    for record in records:
        name = "CPU" if record["device"] == "cpu" else "GPU"
        rungs = [r for r in record.get("ladder", ()) if "speed_up" in r]
        sparsity, ratio = ([r[key] for r in rungs] for key in ("measured_sparsity", "speed_up"))
        ladder.loglog(sparsity, ratio, "o-", color=COLOURS[name], label=name)
        ladder.plot(published.SPARSITIES[-1], published.SPEED_UP[name], "x", color=COLOURS[name], label=f"{name}, published")
        _site(memory, runout, record.get("site", ()), name)
    ladder.set(xlabel="blocks, dense grid / sparse grid", ylabel="time, dense grid / sparse grid", title="Sparsity ladder")
    memory.axhline(CARD, color="0.5", lw=0.8, ls="--")
    for place, key, style in (("GPU, forecast", "device_bytes", "v:"), ("host of a GPU, forecast", "host_bytes", "<:")):
        forecasts = [r for record in records for r in record.get("forecasts", ())]
        gigabytes = [r[key] / 1e9 for r in forecasts]
        memory.loglog([r["particles"] for r in forecasts], gigabytes, style, color="0.4", label=place)
    memory.set(xlabel="particles", ylabel="memory [GB]", title="Synthetic site; dashed: 16 GB", ylim=(0.01, 2000.0))
    runout.set(xlabel="cell [m]", ylabel="run-out of 99 % of the mass [m]", title="Synthetic site", ylim=(0.0, LONGEST))
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
    memory.loglog(n, [r["host_bytes"] / 1e9 for r in rows], "^--", color=COLOURS[name], label=f"host of the {name} run", alpha=0.6)
    runout.plot([r["cell"] for r in rows], [r["runout"] for r in rows], "o-", color=COLOURS[name], label=name)
