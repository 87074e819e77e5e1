"""Pages of the cases of ISeeSnow."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.iseesnow_terms import term_numbers
from docs.pages.study_page import StudyPage, along, as_csv, as_png, download, draw_outline, markdown
from docs.pages.wording import ENDING, told
from runout.studies.validation_cases.iseesnow import LEVELS

COULOMB_SETUP = (
    "Slab of 1.5 m on a parabolic slope with a channel that ends on a cone; Coulomb friction 0.4 (21.8 deg), no other term. "
    "Snow: 200 kg/m3, internal friction 30 deg, stiffness by default. "
    "Release: the raster of the case, or its polygon with the same mean thickness or the same mass."
)
TOPO_SETUP = (
    "Slab of 1.5 m on a plane of 34 deg that ends on level ground; Voellmy friction with mu = 0.4 and xi = 2000 m/s2. Snow: "
    "200 kg/m3, stiffness by default. Release: the raster of the case, or its polygon with the same mean thickness."
)
COULOMB_DIFFERENCES = """\
- **With 2 x 2 x 4 particles in cells of 5 m the area is below every tool. Reason: the slab is one particle thick.** Levels are a
  quarter of a cell; the slab is one of them. Its sides carry {one_pressure:.2f} of the hydrostatic pressure (last column,
  {coarse_pressure:.2f} in cells of 10 m), so it spreads too little to its sides and stays too thick. No thin rim is lost below a
  threshold: the area above 0.001 m is too small as well, and that above 1 m is too large.
- **More levels in the same cells mend it**, and so do flat cells and small cells. Four levels at 5 m: pressure {pressure:.2f},
  {more_area:+.1f} ha. So the default has four levels through releases thinner than half a cell, here 2 x 2 x 12. They take
  {cost:.1f} times the time of one.
- **The polygon has {less_mass:.1f} % less mass than the raster**, whose cells reach beyond it: less area and CSI at 0.1 m. With the
  mass of the raster its CSI is {heavy_csi:.3f}, that of the raster {csi:.3f}, of the tools {tools_csi:.3f} (median). Its partly
  filled cells lower the pressure of the rim.
- With cells of 10 m the map smooths particles that are far apart, which hides a part of the deficit of one level.
- What is left to the median of the tools, {left:.1f} ha with cells of 5 m and {left_fine:.1f} ha with 2.5 m, is in the run-out
  zone. The tools have hydrostatic pressure; internal friction resists spreading (compare [Frank Slide](frank_slide.md), where
  this was measured).
- The front stops {behind:.0f} m before the median, where {near} stop ({near_least:.0f} to {near_most:.0f} m). The tools' fronts
  spread over {spread:.0f} m.
- Peak thickness in the track is above the median of the tools by up to {thicker:.1f} m, and up to {thinner:.1f} m below it where
  the track begins."""
TOPO_DIFFERENCES = """\
- **Internal friction decides whether the base can pass on the drag.** On 34 deg a steady Voellmy flow needs {load:.3f} of its
  load as shear, and a mass of internal friction phi passes on sin(phi) at most. With drag at the base (law `voellmy_base`) and 30
  deg the mass shears over a slow base: {base_speed:.0f} m/s; the fastest tool has {fastest:.0f} m/s.
- **Drag over the column (law `voellmy`), as depth-averaged tools mean it, needs no internal friction.** With 30 deg and four
  levels of particles in cells of 5 m, the front lies {polygon_beyond:.0f} m (polygon) and {raster_beyond:.0f} m (raster) beyond
  the median of the tools. The largest speed differs from their median by {speed_error:.1f} % at most; CSI at 0.1 m is
  {csi_least:.3f} to {csi_most:.3f}, that of the tools {csi_median:.3f} (median).
- **More internal friction takes runout away from the tools.** With 40 deg in place of 30 deg the front goes {farther:.0f} m
  farther, the area grows by {grown:.1f} ha and CSI falls by {fallen:.2f}. Where the channel narrows, internal friction allows
  passive earth pressure across the flow; the tools have hydrostatic pressure. The mass then gathers late and is thick farther
  down.
- **In the lower half runout stays thicker and faster than the median of the tools** also with 30 deg (figure): its surge is less
  stretched. After 60 s its largest cross-section, by size of the cells, is {sections}.
  com1DFA has {com1dfa_section:.0f} m². With {weak:g} deg it is {weak_section:.0f} m²; friction at the base needs nearly all of that
  strength.
- **Internal friction where the channel narrows makes most of that difference.** It holds the sides back from the thalweg. There
  the flow is thinner and slower than in the tools, {narrow_thickness:.2f} m and {narrow_speed:.1f} m/s, and stretches later. With
  5 deg, and Coulomb friction of the whole column as in depth-averaged tools, the values are {fluid_thickness:.2f} m and
  {fluid_speed:.1f} m/s, those of the tools {tools_thickness:.2f} m and {tools_speed:.1f} m/s. The cross-section is
  {fluid_section:.0f} m²: {share:.0f} % of the difference is gone. The same friction with 30 deg gives {whole_section:.0f} m².
- **Lower pressure fits the rest, and most of the thickness in the lower half.** Pressure along the flow is {front_pressure:.2f}
  (front half) and {rear_pressure:.2f} (rear half) of the hydrostatic one. By its source, com1DFA
  takes gravity and distances in plan: on this slope that is {plan:.2f} times the hydrostatic pressure. With 0.6 of it com1DFA
  moves as the run with 5 deg:
  {weak_pressure:.0f} m², and {cut_lower:.2f} m in the lower half. There the run with 5 deg has {fluid_lower:.2f} m, that with 30
  deg {narrow_lower:.2f} m, com1DFA {com1dfa_lower:.2f} m, the tools {tools_lower:.2f} m.
- **Equal speeds across the flow are not the reason**: they make com1DFA slower, {plug_speed:.1f} m/s in the lower half in place of
  {com1dfa_speed:.1f} m/s. Nor is pressure across alone: twice of it leaves com1DFA's cross-section at {across_section:.0f} m².
- com1DFA's artificial viscosity hides a part of the difference: without it its cross-section is {inviscid:.0f} m².
- **Acceleration agrees with the law**: a rigid slab of 1.5 m slides {slab:.0f} m in plan in 20 s, the median of the mass of
  runout {median:.0f} m.

{terms}

One term changed in runout (5 m, raster) and in com1DFA (AvaFrame {avaframe}, 5 m, polygon). *Section*: largest cross-section.
*Length*: that of nine tenths of the volume. *Narrowing*, *lower half*: means of the peaks along the thalweg, 400 to 800 m and
1000 to 2100 m. *Whole column*: Coulomb friction slows the column as drag does. *Plug*: cross-sections move with their mean
velocity. All but com1DFA, standard and plug, end after 100 s. `tests/benchmarks/idealized_topo_com1dfa.py` makes the rows."""
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


NEAREST = 4  # tools whose fronts are nearest to that of runout
SLOPE = math.radians(34.0)  # of IdealizedTopo


def coulomb_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of CoulombOnly."""
    by_default = _run(results, "5 m, 2 x 2 x 12 particles, 30 deg, raster")
    one, coarse = (_run(results, f"{cells} m, 2 x 2 x 4 particles, 30 deg, raster") for cells in (5, 10))
    finest = _run(results, "2.5 m, 30 deg, raster")
    light, heavy = (_run(results, f"5 m, 2 x 2 x 12 particles, 30 deg, polygon{mass}") for mass in ("", ", mass of the raster"))
    tools, front = results["tools"], by_default["front"]
    near = sorted(tools, key=lambda tool: abs(tool["front"] - front))[:NEAREST]
    *names, last = (tool["tool"].removeprefix("AvaFrame-") for tool in near)
    left, left_fine = (float(np.median([t["area"] for t in tools])) - run["area"] for run in (by_default, finest))
    thickness = {name: along(values) for name, values in results["profile"]["thickness"].items()}
    above = thickness["runout"] - thickness["median"]
    return {
        "pressure": by_default["rim_pressure"], "one_pressure": one["rim_pressure"], "coarse_pressure": coarse["rim_pressure"],
        "less_mass": 100.0 * (1.0 - light["volume"] / by_default["volume"]), "csi": by_default["csi_0.1"],
        "heavy_csi": heavy["csi_0.1"], "tools_csi": float(np.median([tool["csi_0.1"] for tool in tools])),
        "more_area": by_default["area"] - one["area"], "cost": by_default["seconds"] / one["seconds"],
        "left": left, "left_fine": left_fine,
        "behind": float(np.median([t["front"] for t in tools])) - front,
        "near": f"{', '.join(names)} and {last}",
        "near_least": min(tool["front"] for tool in near), "near_most": max(tool["front"] for tool in near),
        "spread": max(t["front"] for t in tools) - min(t["front"] for t in tools),
        "thicker": float(np.nanmax(above)), "thinner": -float(np.nanmin(above)),
    }  # fmt: skip


def topo_numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of IdealizedTopo."""
    names = "30 deg, raster, drag: column", "30 deg, polygon, drag: column", "40 deg, raster, drag: column"
    raster, polygon, strong = (_run(results, f"5 m, 2 x 2 x 12 particles, {name}") for name in names)
    base = _run(results, "5 m, 2 x 2 x 12 particles, 30 deg, raster, drag: base")
    tools = results["tools"]
    middle = {key: float(np.median([tool[key] for tool in tools])) for key in ("front", "speed", "csi_0.1")}
    own = (raster, polygon)
    return {
        "load": math.tan(SLOPE), "plan": 1.0 / math.cos(SLOPE) ** 2,
        "base_speed": base["speed"], "fastest": max(tool["speed"] for tool in tools),
        "polygon_beyond": polygon["front"] - middle["front"], "raster_beyond": raster["front"] - middle["front"],
        "speed_error": 100.0 * max(abs(run["speed"] / middle["speed"] - 1.0) for run in own),
        "csi_least": min(run["csi_0.1"] for run in own), "csi_most": max(run["csi_0.1"] for run in own),
        "csi_median": middle["csi_0.1"],
        "farther": strong["front"] - raster["front"], "grown": strong["area"] - raster["area"],
        "fallen": raster["csi_0.1"] - strong["csi_0.1"],
    } | _surges(results) | term_numbers(results)  # fmt: skip


def _surges(results: Mapping[str, Any]) -> dict[str, Any]:
    """Of the runs that end on the slope; the first is that by default."""
    first, *others = results["surges"]
    weak = min(others, key=lambda row: row["friction_angle_deg"])
    cells = [row for row in (first, *others) if row is not weak]
    sections = [f"{row['section']:.0f} m² ({' x '.join(f'{size:g}' for size in row['cells'])} m)" for row in cells]
    return {
        "sections": ", ".join(sections), "slab": results["slab"], "median": first["way"],
        "front_pressure": first["front_pressure"], "rear_pressure": first["rear_pressure"],
        "weak": weak["friction_angle_deg"], "weak_section": weak["section"],
        "weak_front": weak["front_pressure"], "weak_rear": weak["rear_pressure"],
    }  # fmt: skip


def _run(results: Mapping[str, Any], what: str) -> Mapping[str, Any]:
    """The run of a name; see :attr:`runout.studies.validation_cases.iseesnow.Variant.name`."""
    (found,) = (run for run in results["runs"] if run["tool"] == f"runout, {what}")
    return found  # type: ignore[no-any-return]


def coulomb_page(record: Mapping[str, Any]) -> StudyPage:
    """Page of CoulombOnly."""
    return page(record, COULOMB_SETUP, told(record, COULOMB_DIFFERENCES, coulomb_numbers))


def topo_page(record: Mapping[str, Any]) -> StudyPage:
    """Page of IdealizedTopo."""
    return page(record, TOPO_SETUP, told(record, TOPO_DIFFERENCES, topo_numbers))
