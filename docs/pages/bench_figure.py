"""Figure of a benchmark from its JSON."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from runout.io.atomic import whole_file
from runout.studies.work_precision import count, fewest

STAGE_COLOURS = ("#33658a", "#86bbd8", "#758e4f", "#f6ae2d", "#f26419", "#8d6a9f", "#b0a8b9", "#5c5c5c")


def draw(content: dict[str, Any], file: Path) -> Path:
    """The path, after drawing the four panels to it: size, stages, sparsity, comparisons.

    Raises StorageError if the file cannot be written.
    """
    figure = Figure(figsize=(11, 7.6), layout="constrained")
    panels = figure.subplots(2, 2)
    _size(panels[0, 0], content)
    _stages(panels[0, 1], content)
    _sparsity(panels[1, 0], content)
    _comparisons(panels[1, 1], content)
    m = content["machine"]
    figure.suptitle(f"runout bench: {m['cores']} cores, vectors of {m['vector_bits']} bits", fontsize=11)
    with whole_file(file) as temporary:
        figure.savefig(temporary, dpi=130)
    return file


def _size(axes: Any, content: dict[str, Any]) -> None:
    first = fewest(content)
    for threads in sorted({m["case"]["threads"] for m in content["studies"]["size"]}):
        line = [m for m in content["studies"]["size"] if m["case"]["threads"] == threads]
        n, rate = [m["particles"] for m in line], [m["rate"] / 1e6 for m in line]
        label = f"{threads} thread{'s' * (threads > 1)}"
        axes.semilogx(n, rate, "o-", color=STAGE_COLOURS[0 if threads == first else 4], label=label)
    fastest = max(m["rate"] for m in content["studies"]["size"]) / 1e6
    axes.set(xlabel="particles", ylabel="million particle-steps per second", title="Rate, everything on", ylim=(0, 1.15 * fastest))
    counts = sorted({m["particles"] for m in content["studies"]["size"]})
    axes.set_xticks(counts, [count(n) for n in counts])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="lower left")
    memory = axes.twinx()
    alone = [m for m in content["studies"]["size"] if m["case"]["threads"] == first]
    memory.plot([m["particles"] for m in alone], [m["memory"]["bytes_per_particle"] for m in alone], "s:", color="0.5", ms=4)
    memory.set_ylim(0, 1.15 * max(m["memory"]["bytes_per_particle"] for m in alone))
    memory.set_ylabel("bytes per particle (dotted)", color="0.4")


def _stages(axes: Any, content: dict[str, Any]) -> None:
    bars = [m for m in content["studies"]["size"] if m["case"]["threads"] == fewest(content)] + content["studies"]["depth"][:1]
    names = list(dict.fromkeys(name for m in bars for name in m["ns_per_particle_step"]))
    base = [0.0] * len(bars)
    for name, colour in zip(names, STAGE_COLOURS, strict=False):
        part = [max(m["ns_per_particle_step"].get(name, 0.0), 0.0) for m in bars]
        axes.bar(range(len(bars)), part, bottom=base, color=colour, label=name, width=0.65)
        base = [a + b for a, b in zip(base, part, strict=True)]
    labels = [f"{count(m['particles'])}\n{m['case']['depth']} cells deep\n2 x 2 x {m['case']['upwards']}" for m in bars]
    axes.set_xticks(range(len(bars)), labels, fontsize=8)
    axes.set(ylabel="ns per particle-step", title=f"Stages of a step, {fewest(content)} thread(s)", xlim=(-0.6, len(bars) + 0.9))
    handles, texts = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], texts[::-1], frameon=False, fontsize=8, loc="center right")


def _sparsity(axes: Any, content: dict[str, Any]) -> None:
    rows = content["ratios"]["sparsity"]
    for kind, colour in (("sparse", STAGE_COLOURS[0]), ("dense", STAGE_COLOURS[4])):
        line = [x for x in rows if x["index"] == kind]
        if line:
            axes.semilogx([x["sparsity"] for x in line], [x["ratio"] for x in line], "o-", color=colour, label=f"{kind} index")
    ticks = sorted({x["sparsity"] for x in rows})
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set(xlabel="box around the bodies / volume of the bodies", ylabel="rate of steps / sparse, one body")
    axes.set_ylim(0, 1.15 * max(x["ratio"] for x in rows))
    axes.set_title("Two bodies apart")
    axes.axhline(1.0, color="0.7", lw=0.8)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="lower left")


def _comparisons(axes: Any, content: dict[str, Any]) -> None:
    r = content["ratios"]
    rows = [(f"{x['threads']} threads / {fewest(content)}, {count(x['particles'])}", x["ratio"]) for x in r["threads"]]
    rows += [("float64 / float32", r["float64_over_float32"])] if "float64_over_float32" in r else []
    rows += [(f"{x['depth']} / {x['deep']} cells deep, 2 x 2 x {x['upwards']}", x["ratio"]) for x in r["thin_over_deep"]]
    rows += [(f"runout / prototype, {x['threads']} thr., {count(x['particles'])}", x["ratio"]) for x in r.get("against", ())]
    rows = rows[::-1]
    bars = axes.barh(range(len(rows)), [value for _, value in rows], color=STAGE_COLOURS[1])
    axes.bar_label(bars, [f"{value:.2f}" for _, value in rows], padding=3, fontsize=8)
    axes.set_yticks(range(len(rows)), [name for name, _ in rows], fontsize=8)
    axes.axvline(1.0, color="0.4", lw=0.8)
    axes.set(title="Ratios of rates", xlim=(0, 1.15 * max(1.0, *(value for _, value in rows))))
