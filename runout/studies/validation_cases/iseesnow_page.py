"""Pages of the cases of ISeeSnow."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from runout.studies.study_page import StudyPage, as_csv, as_png, download, markdown
from runout.studies.validation_cases.drawing import along, draw_outline
from runout.studies.validation_cases.iseesnow import LEVELS
from runout.studies.validation_cases.wording import ENDING

SCORES = ("front", "area", "speed", "csi_0.1", "csi_0.5", "l1")
FORMATS = (".0f", ".1f", ".1f", ".3f", ".3f", ".2f")
HEADS = ("tool", "front [m]", "area [ha]", "largest speed [m/s]", "CSI 0.1 m", "CSI 0.5 m", "relative L1", "time")
AREA_HEADS = ("run or tool", *(f"area > {level:g} m [ha]" for level in LEVELS), "pressure of the rim")
OPENING = """# {title}

{setup}

| quantity | meaning |
| --- | --- |
| front | farthest easting with a peak speed above 1 m/s |
| area | peak thickness above 0.1 m |
| CSI 0.1 m, 0.5 m | critical success index of the area with that peak thickness, median over the other tools |
| relative L1 | sum of absolute differences of peak thickness over its sum in the other tool, median over the other tools |
| time | processor time of one core without compilation, over that of the first row; the tools do not state theirs |

Thickness is normal to the slope.

{scores}

![Outlines at 0.1 m peak thickness, and peaks along the thalweg]({name}.png)

*Top: outline at 0.1 m; runout in red, tools in grey. Bottom: peaks along the thalweg; band from the least to the most of the
tools, line of their median.*

## Differences, and their reasons

{differences}

{areas}

*Pressure of the rim*: mean pressure of the outermost tenth of the slab after 5 s over the hydrostatic one of its thickness.

Data: ISeeSnow (EUPL-1.2), rasters as the groups submitted them. {tables}.

"""


def page(record: Mapping[str, Any], setup: str, differences: str) -> StudyPage:
    """Page of a case; ``setup`` and ``differences`` are its text."""
    name, results = record["case"], record["results"]
    text = OPENING.format(
        title=record["title"],
        name=name,
        setup=setup,
        differences=differences,
        scores=markdown(HEADS, _scores(results)),
        areas=markdown(AREA_HEADS, _areas(results)),
        tables=download(f"{name}.csv", "All runs and tools"),
    )
    return StudyPage(
        name, text + ENDING.format(command=record["command"]), {f"{name}.csv": _table(results)}, {f"{name}.png": _figure(results)}
    )


def _scores(results: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows: each run; least, median and most of the tools."""
    first = results["runs"][0]["seconds"]
    rows = [(f"**{r['tool']}**", *_numbers(r), f"{r['seconds'] / first:.2g}") for r in results["runs"]]
    return rows + [(name, *_numbers(numbers), "") for name, numbers in spread_of(results["tools"]).items()]


def spread_of(tools: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Least, median and most of every score over the tools."""
    kinds = (("least", np.min), ("median", np.median), ("most", np.max))
    return {f"{kind} of the tools": {key: float(of([t[key] for t in tools])) for key in SCORES} for kind, of in kinds}


def _numbers(row: Mapping[str, Any]) -> list[str]:
    return [format(row[key], how) for key, how in zip(SCORES, FORMATS, strict=True)]


def _areas(results: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of areas [ha]: each run, then the median of the tools."""
    rows = [(r["tool"], *(f"{a:.1f}" for a in r["areas"]), f"{r['rim_pressure']:.2f}") for r in results["runs"]]
    middle = np.median([t["areas"] for t in results["tools"]], axis=0)
    return [*rows, ("median of the tools", *(f"{a:.1f}" for a in middle), "")]


def _table(results: Mapping[str, Any]) -> str:
    """Every run and tool, as CSV."""
    rows = [
        (r["tool"], *_numbers(r), *(f"{a:.1f}" for a in r["areas"]), r.get("particles", ""), r.get("steps", ""))
        for r in (*results["runs"], *results["tools"])
    ]
    return as_csv((*HEADS[:-1], *(f"area above {level:g} m [ha]" for level in LEVELS), "particles", "steps"), rows)


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(9.0, 8.0), layout="constrained")
    plan, *below = canvas.subplots(3, 1, height_ratios=[1.4, 1, 1])
    for name, outline in results["outlines"].items():
        if name != "runout":
            draw_outline(plan, outline, color="0.6", linewidth=0.6)
    draw_outline(plan, results["outlines"]["runout"], color="#c1121f", linewidth=1.4)
    plan.set(xlabel="easting [m]", ylabel="northing [m]", aspect="equal")
    for axes, key, label in zip(below, ("thickness", "speed"), ("peak thickness [m]", "peak speed [m/s]"), strict=True):
        station, found = along(results["profile"]["station"]), {k: along(v) for k, v in results["profile"][key].items()}
        axes.fill_between(station, found["least"], found["most"], color="0.88")
        axes.plot(station, found["median"], color="0.45", label="median of the tools")
        axes.plot(station, found["runout"], color="#c1121f", label="runout")
        top = 1.1 * np.nanmax([found["runout"].max(), np.nanmax(found["median"])])
        axes.set(ylabel=label, ylim=(0, top), xlim=(station[0], station[-1]))
    below[0].legend(frameon=False)
    below[1].set_xlabel("along the thalweg [m]")
    return as_png(canvas)
