"""Page of the published benchmarks: our numbers beside the published ones, from one record for each device."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from tests.benchmarks.seed_cases import published
from tests.benchmarks.seed_cases import synthetic_site as site

RECORDS = ("published", "published_gpu")  # file names without their ending
Record = Mapping[str, Any]
GIB = 2.0**30
OPENING = """# Published benchmarks

The benchmarks of the published sparse method ({source}) with `runout`. Backends: `scan` on the CPU, `hash` on the GPU.

{tables}

![Dense over sparse against sparsity; memory and run-out of the site](published.png)

{downloads}

## What the rows are

- *Sliding box*: case T1 of {{doc}}`../verification`, 1 m x 0.5 m x 0.5 m, friction angle 15°, 1 s, plane across the axes of the
  grid.
- *Columns*: case F4, plane strain, height twice the length, floor of 30° or what the sand hands on; until all rests.
- *Ladder*: two bodies, eight cells deep, eight particles per cell, single precision. *Sparsity* is the volume of the box around
  both over their volume; *of blocks*: blocks of the dense grid over those of the sparse one, which also holds their neighbours.
- *Dense*: the same kernels over all blocks of the box. Its time has no index and, on a GPU, no sort; the time of the sparse grid
  has both. One thread on the CPU.
- *Published code on one card*: 10⁹ particle-steps a second on {code_run}. Measured once, not by the
  commands below.
- *Dense control of the site*: substeps from the start of the run, over all blocks of the box of the whole flow; both take turns and
  sort as in a run.
- *Site*: **synthetic**. A flank falls {drop:g} m over {length:g} m into a valley; {volume:g} Mm³, eight particles per cell,
  internal friction 30°, basal friction {angle:g}°, up to {end:g} s. One thread on the CPU (processor time); wall time on the GPU.
- *Memory*: *backend*: arrays of particles, blocks and index. *Card*: all that the driver counts, with context and kernels. *Host*:
  largest resident memory of the process, with its libraries.
- *Forecast*: memory at the start of a run, by the formulas with which `runout` refuses runs that do not fit; not measured.
- *Run-out*: plan distance from the top of the release that 99 % of the deposit does not exceed. The deposit lies against the
  other side of the valley.
- *Sparsity* of the site: blocks of the box around the flow over blocks held, at the start, the largest, and at the end.

## What is not comparable

{limits}

## How to make this page

    python -m tests.benchmarks.published_benchmarks DIR --full
    python -m tests.benchmarks.published_benchmarks DIR --full --device cuda:0

Copy the records to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page, its tables and its
figure.

{record}
"""
COLOURS = {"CPU": "#33658a", "GPU": "#d1495b"}
LONGEST = 2700.0  # [m], from the top of the release to the edge of the terrain
CARD = 16.0  # [GB] that the finest run must fit


def page(records: Sequence[Record]) -> StudyPage:
    """The page of the records."""
    shown = "\n\n".join(f"## {title}\n\n{table}" for title, table in tables(records))
    files = {f"published_{name}.csv": text for name, text in _files(records)}
    links = [download(name, f"All numbers of the {name.split('_')[1].removesuffix('.csv')}") for name in files]
    text = OPENING.format(
        source=published.SOURCE,
        tables=shown,
        downloads=" · ".join(links),
        drop=site.DROP,
        length=site.LENGTH,
        volume=site.VOLUME / 1e6,
        angle=site.BASAL_ANGLE,
        end=site.END_TIME,
        code_run=published.CODE_RUN,
        limits=markdown(("what", "why"), published.NOT_COMPARABLE),
        record="\n".join((*map(_provenance, records), *_missing(records))),
    )
    return StudyPage("published", text, files, {"published.png": figure(records)})


def tables(records: Sequence[Record]) -> list[tuple[str, str]]:
    """Title and table in Markdown of each part that the records hold."""
    return [
        (title, markdown(heads, rows))
        for title, heads, rows in (
            ("Beside the published figures", ("quantity", "published", "ours", "device"), list(_beside(records))),
            ("Published code on one card", ("particles", "published, float64 [10⁹/s]", "runout, float64", "runout, float32",
             "ratio, float64", "ratio, float32"), list(map(_code, published.CODE_ON_ONE_CARD))),
            ("Sliding box", ("slope", "cell [m]", "rigid block [m]", "box [m]", "error", "speed beyond the block's [m/s]"),
             [_slide(r) for r in _rows(records, "slides")]),
            ("Collapsing columns", ("internal friction", "cells in the length", "run-out over length", "laws of experiments"),
             [_collapse(r) for r in _rows(records, "collapses")]),
            ("Sparsity ladder", ("device", "sparsity", "of blocks", "particles", "sparse [ns]", "dense [ns]", "dense / sparse",
             "memory, dense / sparse"), [_rung(device(x), r) for x in records for r in x.get("ladder", ())]),
            ("Synthetic site: cost", ("device", "cell [m]", "particles", "published", "steps", "time [s]", "backend [GiB]",
             "card [GiB]", "host [GiB]"), [_cost(device(x), r) for x in records for r in x.get("site", ())]),
            ("Synthetic site: dense control", ("cell [m]", "blocks, sparse", "blocks, dense", "sparse [ms]", "dense [ms]",
             "time, dense / sparse", "memory, dense / sparse"),
             [_control(r) for r in _rows(records, "site") if "dense_seconds" in r]),
            ("Synthetic site: blocks and run-out", ("device", "cell [m]", "blocks", "nodes", "sparsity", "run-out [m]",
             "deposit [m]", "stopped"), [_flow(device(x), r) for x in records for r in x.get("site", ())]),
            ("Synthetic site: forecast of the memory on a GPU", ("cell [m]", "particles", "published", "nodes", "device [GiB]",
             "host [GiB]"), [_forecast(r) for r in _rows(records, "forecasts")]),
        )
        if rows
    ]  # fmt: skip


def device(record: Record) -> str:
    """Name of a device for the tables."""
    return "CPU" if record["device"] == "cpu" else "GPU"


def _unmeasured(records: Iterable[Record]) -> list[str]:
    """Devices without a record."""
    return sorted({"CPU", "GPU"} - {device(record) for record in records})


def _rows(records: Iterable[Record], part: str) -> list[Record]:
    return [row for record in records for row in record.get(part, ())]


def _beside(records: Sequence[Record]) -> Iterator[tuple[str, ...]]:
    """The published figures with what the records have for them, and those of a device without a record."""
    for place in _unmeasured(records):
        quantity = f"time, dense grid / sparse grid, sparsity {published.SPARSITIES[-1]:g}"
        yield quantity, f"{published.SPEED_UP[place]:g}", "not measured", place
    for record in records:
        place = device(record)
        yield from _dense_over_sparse(record, place)
        for r in record.get("site", ()):
            if r["cell"] in published.SECONDS and place == "GPU":
                cell = f"site with cells of {r['cell']:g} m [s]"
                yield cell, f"{published.SECONDS[r['cell']]:g} (RTX 5070 Ti)", f"{r['seconds']:.3g}", record["card"] or place
        finest = min(record.get("site", ()), key=lambda r: float(r["cell"]), default=None)
        if finest is not None:
            each = published.MEMORY / published.PARTICLES[2.0]
            ours = f"{finest['backend_bytes'] / finest['particles']:.0f} ({_gib(finest['backend_bytes'])} GiB, {_million(finest)})"
            yield "bytes per particle", f"{each:.0f} ({_gib(published.MEMORY)} GiB, 10.7 M)", ours, place


def _dense_over_sparse(record: Record, place: str) -> Iterator[tuple[str, ...]]:
    """The first rung with at least the published sparsity, by blocks."""
    largest = published.SPARSITIES[-1]
    for r in [r for r in record.get("ladder", ()) if r.get("measured_sparsity", 0.0) >= largest][:1]:
        quantity, ours = f"time, dense grid / sparse grid, sparsity {largest:g}", f"{r['speed_up']:.1f}"
        yield quantity, f"{published.SPEED_UP[place]:g}", f"{ours} (sparsity {r['measured_sparsity']:.0f})", place


def _slide(r: Record) -> tuple[str, ...]:
    error = r["relative_displacement_error"]
    moved, share = ("rest", "") if error is None else (f"{r['rigid_block']:.4f}", f"{100 * error:+.2f} %")
    return f"{r['slope_deg']:g}°", f"{r['cell']:g}", moved, f"{r['displacement']:.4f}", share, f"{r['residual_speed']:+.1e}"


def _collapse(r: Record) -> tuple[str, ...]:
    law = f"{r['law'][0]:.2f} to {r['law'][1]:.2f}" if r["law"] else ""
    return f"{r['friction_angle_deg']:g}°", str(r["cells"]), f"{r['runout']:.2f}", law


def _rung(place: str, r: Record) -> tuple[str, ...]:
    each = 1e9 / r["particles"]
    sparse, dense = (r["sparse"]["step"] + r["sparse"]["index"]) * each, r.get("dense", {}).get("step", float("nan")) * each
    ratios = [f"{r[name]:.2f}" if name in r else "no room" for name in ("measured_sparsity", "speed_up", "memory_ratio")]
    digits = 1 if place == "CPU" else 3
    return (
        place, f"{r['sparsity']:g}", ratios[0], f"{r['particles']:,}", f"{sparse:.{digits}f}",
        f"{dense:.{digits}f}" if "dense" in r else "no room", *ratios[1:],
    )  # fmt: skip


def _cost(place: str, r: Record) -> tuple[str, ...]:
    theirs = published.PARTICLES.get(r["cell"])
    card = "" if r["card_bytes"] is None else _gib(r["card_bytes"])
    return (
        place, f"{r['cell']:g}", f"{r['particles']:,}", f"{theirs:,.0f}" if theirs else "", f"{r['steps']:,}",
        f"{r['seconds']:.3g}", _gib(r["backend_bytes"]), card, _gib(r["host_bytes"]),
    )  # fmt: skip


def _code(row: tuple[float, float, float, float]) -> tuple[str, ...]:
    """Throughput of the published code and of ours on the same card, and the ratios."""
    particles, theirs, *ours = row
    return f"{particles / 1e6:.3g} M", f"{theirs:g}", *(f"{v:.2f}" for v in ours), *(f"{v / theirs:.1f}" for v in ours)


def _control(r: Record) -> tuple[str, ...]:
    """A substep of the site on the sparse and on the dense grid."""
    times = [1e3 * r[f"{index}_seconds"] for index in ("sparse", "dense")]
    return (
        f"{r['cell']:g}", f"{r['sparse_blocks']:,}", f"{r['dense_blocks']:,}", *(f"{t:.3f}" for t in times),
        f"{times[1] / times[0]:.1f}", f"{r['dense_bytes'] / r['sparse_bytes']:.1f}",
    )  # fmt: skip


def _flow(place: str, r: Record) -> tuple[str, ...]:
    sparsity = ", ".join(f"{r[name]:.2g}" for name in ("sparsity_at_start", "sparsity", "sparsity_at_end"))
    return (
        place, f"{r['cell']:g}", f"{r['blocks']:,}", f"{r['nodes']:,}", sparsity, f"{r['runout']:.0f}", f"{r['max_deposit']:.0f}",
        f"{r['stop_reason']}, {r['end_time']:.0f} s",
    )  # fmt: skip


def _forecast(r: Record) -> tuple[str, ...]:
    particles = f"{r['particles']:,}", f"{published.PARTICLES[r['cell']]:,.0f}"
    return f"{r['cell']:g}", *particles, f"{r['nodes']:,}", _gib(r["device_bytes"]), _gib(r["host_bytes"])


def _gib(nbytes: float) -> str:
    return f"{nbytes / GIB:.2g}" if nbytes < GIB else f"{nbytes / GIB:.1f}"


def _million(r: Record) -> str:
    return f"{r['particles'] / 1e6:.2g} M"


def _files(records: Sequence[Record]) -> Iterator[tuple[str, str]]:
    """Name and CSV of the ladder and of the site with every number."""
    for part in ("ladder", "site"):
        rows = [{"device": device(x), **_flat(r)} for x in records for r in x.get(part, ())]
        if rows:
            heads = list(dict.fromkeys(name for row in rows for name in row))
            yield part, as_csv(heads, [[_number(row.get(name)) for name in heads] for row in rows])


def _flat(row: Record) -> dict[str, Any]:
    """A row with the numbers of its parts beside each other."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        flat |= {f"{name} {inner}": v for inner, v in value.items()} if isinstance(value, Mapping) else {name: value}
    return flat


def _number(value: Any) -> Any:
    return f"{value:.5g}" if isinstance(value, float) else value


def _missing(records: Sequence[Record]) -> list[str]:
    return [f"Record {place}: none; nothing on this page was measured on a {place}." for place in _unmeasured(records)]


def _provenance(record: Record) -> str:
    v, size = record["versions"], "" if record["full"] else ", small size"
    where = f"{record['machine']['cores']} cores" if record["device"] == "cpu" else record["card"] or record["device"]
    code = f"commit {v['commit'] or 'not recorded'}, numba {v['numba']}, warp {v['warp-lang']}"
    return f"Record {device(record)}: {where}, {code}{size}."


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
