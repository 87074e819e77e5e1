"""Page of the case Maipo."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import COARSE, ENDING, HEADING
from runout.studies.validation_cases.maipo import BED, CELL_SIZE, COARSE_CELL_SIZE, REACHED

NAMES = {"voellmy": "Voellmy", "pore_pressure": "pore pressure"}
HEADS = (
    *("flow", "length [m]", "area [ha]", "slope of reach", "length by that of the others [m]", "error"),
    *("Voellmy: length [m]", "error", "CSI", "pore pressure: length [m]", "error", "CSI"),
)
COARSE_NAMES = {"rigid": "rigid ground", "bed": "erodible bed"}
COARSE_HEADS = (
    *("flow", "rigid ground: length [m]", "error", "CSI", "erodible bed: length [m]", "error", "CSI", "release [m³]"),
    *("taken from the bed [m³]",),
)
ALL_HEADS = ("family", "parameters", "flow", "length [m]", "error of the length", "CSI")
OPENING = """# Six debris flows of the upper Maipo, each from the other five

Terrain of 12.5 m (whole metres), source points and mapped outlines of six debris flows in the Andes of Chile, from the package
runoptGPP (Goetz et al. 2021). Volume, thickness and speed were not observed. So the volume is one of the parameters: each run
releases a disc of mass, 4 m thick, at the source point. For each flow the parameters are those with the best mean CSI of the other
five flows (leave-one-out); beside it stands the mean slope of reach of the other five (Heim 1932), which uses the path, no model.

"""
FULL = """{rows}

Mean of the six: error of the length {empirical:.0%} by the slope of reach, {voellmy_error:.0%} with Voellmy friction and
{wet_error:.0%} with pore pressure; CSI {voellmy_csi:.2f} and {wet_csi:.2f}. The best choice of each flow for itself has a CSI of
{voellmy_best:.2f} and {wet_best:.2f} in the mean.

![Length of the run-out, observed and predicted, and scores of the areas](maipo.png)

- *Length*: along the path, from the source to the farthest cell that is reached, {reached:g} m thick or more. *CSI*: area reached
  in both over that in either, path and deposit. Cells of {cell:g} m, {runs} runs.

{heading}- **The slope of reach predicts the length as well as the model, with one number and no volume.** All six flows
  end on the floor of one valley, so that their slopes of reach are alike. The model adds area, thickness and speed, and it answers
  for a volume; of these only the area was observed.
- **The parameters trade.** Voellmy friction with 0.1 and 800 m/s2 and 10 000 m3 has a CSI of {small:.2f} over all six, with
  40 000 m3 {large:.2f}; 0.2 and 200 m/s2 with 40 000 m3 {slow:.2f}. Outlines alone do not tell which; a volume, a speed or a
  deposit would.
- **Pore pressure does not help here**: the others choose a ratio of {ratio} for every flow, where four of six stop short. With more
  of it the flows go farther, but beside the outlines. The released mass takes nothing from the channel in these runs.
- **The grid does not resolve these flows.** The channel is one or two cells of the terrain wide, and the flow less than one cell
  thick.

## With an erodible bed

Bed and law as `runout new --process debris_flow` writes them: {bed:g} m deep everywhere, law `ramms` with its default parameters.
Voellmy friction with and without this bed, on cells of {coarse_cell:g} m, {coarse_runs} runs: two pairs of friction numbers, those
that fit best above. The releases on the bed are smaller, because the bed adds to them. Each flow is predicted from the other five,
as above.

{coarse_rows}

- Mean of the six: CSI {rigid_csi:.2f} on rigid ground and {bed_csi:.2f} with the bed; error of the length {rigid_error:.0%} and
  {bed_error:.0%}, beside {empirical:.0%} by the slope of reach. The best choice of each flow for itself has a CSI of
  {rigid_best:.2f} and {bed_best:.2f}.
- Mean CSI of all six, without choice: {each_friction}.
- {bed_verdict}
- The flows take {least_taken:.0f} to {most_taken:.0f} m³ from the bed, {least_growth:.0f} to {most_growth:.0f} times the release.
  No volume was observed, so that nothing tells whether that is true. The bed lies on steep rock, too, where there is none.

Data: runoptGPP (GPL-3), found below `RUNOUT_DATA`. {tables}. The runs with and without the bed on cells of {coarse_cell:g} m are
those of {coarse_version}.

"""
HELPS = "**The bed improves the areas**: the CSI of the flow that is left out rises in {better} of six flows."
HARDLY = "**The bed does not improve the areas of flows that are left out**: the CSI rises in {better} of six flows."


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results, ending = record["results"], ENDING.format(command=record["command"])
    if not record["full"]:
        return StudyPage("maipo", OPENING + HEADING + COARSE + "\n\n" + ending)
    flows, families = results["flows"], results["families"]
    rows = [_row(number, flow, families) for number, flow in enumerate(flows)]
    tables = {"maipo.csv": as_csv(ALL_HEADS, _all(results))}
    text = FULL.format(
        rows=markdown(HEADS, rows),
        heading=HEADING,
        reached=REACHED,
        cell=CELL_SIZE,
        runs=sum(np.size(family["csi"]) for family in families.values()),
        empirical=np.mean([abs(flow["empirical"]["length_error"]) for flow in flows]),
        tables=download("maipo.csv", "All runs"),
        ratio=_ratio(families["pore_pressure"]),
        **_means("voellmy", families["voellmy"]),
        **_means("wet", families["pore_pressure"]),
        small=_csi_of(families["voellmy"], "mu 0.1, xi 800 m/s2, 10000 m3"),
        large=_csi_of(families["voellmy"], "mu 0.1, xi 800 m/s2, 40000 m3"),
        slow=_csi_of(families["voellmy"], "mu 0.2, xi 200 m/s2, 40000 m3"),
        **_coarse(results["coarse"]),
    )
    return StudyPage("maipo", OPENING + text + ending, tables, {"maipo.png": _figure(results)})


def _means(name: str, family: Mapping[str, Any]) -> dict[str, float]:
    """Means over the flows."""
    rows = family["left_out"]
    return {
        f"{name}_error": np.mean([abs(row["length_error"]) for row in rows]),
        f"{name}_csi": np.mean([row["csi"] for row in rows]),
        f"{name}_best": np.mean([row["best_csi"] for row in rows]),
    }


def _coarse(families: Mapping[str, Any]) -> dict[str, Any]:
    """Words and rows on the runs with and without a bed."""
    rigid, bed = (_means(name, families[name]) for name in COARSE_NAMES)
    better = sum(own["csi"] > other["csi"] for own, other in zip(*(families[n]["left_out"] for n in ("bed", "rigid")), strict=True))
    volumes = np.array([_release(told) for told in families["bed"]["choices"]])
    taken = np.array(families["bed"]["entrained"])
    growth, helps = taken / volumes[:, None], bed["bed_csi"] >= rigid["rigid_csi"] + 0.02 and better > 3
    return {
        **rigid,
        **bed,
        "bed": BED,
        "coarse_cell": COARSE_CELL_SIZE,
        "coarse_runs": sum(np.size(family["csi"]) for family in families.values()),
        "coarse_rows": markdown(COARSE_HEADS, [_coarse_row(number, families) for number in range(taken.shape[1])]),
        "each_friction": "; ".join(
            f"{told.split(', bed')[0].rsplit(',', 1)[0]}: {np.mean(own):.2f} on rigid ground, {np.mean(other):.2f} with the bed"
            for told, own, other in zip(families["bed"]["choices"], families["rigid"]["csi"], families["bed"]["csi"], strict=True)
        ),
        "bed_verdict": (HELPS if helps else HARDLY).format(better=better),
        "least_taken": taken.min(),
        "most_taken": taken.max(),
        "least_growth": growth.min(),
        "most_growth": growth.max(),
        "coarse_version": f"runout {families['bed']['version']}" if "version" in families["bed"] else "this record",
    }


def _release(told: str) -> float:
    """Volume [m3] of a choice in words."""
    return float(told.split(" m3")[0].split()[-1])


def _coarse_row(flow: int, families: Mapping[str, Any]) -> tuple[str, ...]:
    rows = [families[name]["left_out"][flow] for name in COARSE_NAMES]
    scores = ((f"{row['length']:.0f}", f"{round(row['length_error'], 2) + 0.0:+.0%}", f"{row['csi']:.2f}") for row in rows)
    chosen = rows[1]["choice"]
    release, taken = _release(families["bed"]["choices"][chosen]), families["bed"]["entrained"][chosen][flow]
    return (str(flow + 1), *(cell for row in scores for cell in row), f"{release:.0f}", f"{taken:.0f}")


def _ratio(family: Mapping[str, Any]) -> str:
    """Pore pressure ratios that are chosen."""
    told = (family["choices"][row["choice"]] for row in family["left_out"])
    return " or ".join(sorted({sentence.split(",")[0].removeprefix("ratio ") for sentence in told}))


def _csi_of(family: Mapping[str, Any], told: str) -> float:
    """Mean CSI of a choice over the flows."""
    return float(np.mean(family["csi"][family["choices"].index(told)]))


def _row(number: int, flow: Mapping[str, Any], families: Mapping[str, Any]) -> tuple[str, ...]:
    empirical = flow["empirical"]
    own = (str(number + 1), f"{flow['length']:.0f}", f"{flow['area'] / 1e4:.1f}", f"{empirical['slope']:.2f}")
    others = (f"{empirical['length']:.0f}", f"{round(empirical['length_error'], 2) + 0.0:+.0%}")
    left_out = [families[name]["left_out"][number] for name in NAMES]
    scores = ((f"{row['length']:.0f}", f"{round(row['length_error'], 2) + 0.0:+.0%}", f"{row['csi']:.2f}") for row in left_out)
    return (*own, *others, *(cell for row in scores for cell in row))


def _all(results: Mapping[str, Any]) -> list[Sequence[Any]]:
    """Rows of all runs."""
    names = NAMES | COARSE_NAMES
    return [
        (names[name], choice, flow + 1, length, round(length / results["flows"][flow]["length"] - 1.0, 3), csi)
        for name, family in (results["families"] | results["coarse"]).items()
        for choice, lengths, indices in zip(family["choices"], family["lengths"], family["csi"], strict=True)
        for flow, (length, csi) in enumerate(zip(lengths, indices, strict=True))
    ]


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes, areas = canvas.subplots(1, 2)
    observed = [flow["length"] for flow in results["flows"]]
    longest = 1.35 * max(observed)
    axes.plot([0, longest], [0, longest], color="0.6", linewidth=1)
    axes.plot(observed, [flow["empirical"]["length"] for flow in results["flows"]], "k^", label="slope of reach of the others")
    for name, style in (("voellmy", "C0o"), ("pore_pressure", "C1s")):
        lengths = [row["length"] for row in results["families"][name]["left_out"]]
        axes.plot(observed, lengths, style, label=f"{NAMES[name]}, chosen by the others")
    axes.set(
        xlabel="observed length [m]", ylabel="predicted length [m]", xlim=(1000, longest), ylim=(1000, longest), aspect="equal"
    )
    axes.legend(loc="lower right", frameon=False, fontsize="small")
    _draw_areas(areas, results)
    return as_png(canvas)


def _draw_areas(axes: Any, results: Mapping[str, Any]) -> None:
    """CSI of the flows that are left out, a bar for each family."""
    names = NAMES | {name: f"{told}, {COARSE_CELL_SIZE:g} m" for name, told in COARSE_NAMES.items()}
    families, width = results["families"] | results["coarse"], 0.2
    for number, (name, color) in enumerate(zip(names, ("C0", "C1", "#9ecae1", "C2"), strict=True)):
        csi = [row["csi"] for row in families[name]["left_out"]]
        axes.bar([flow + (number - 1.5) * width for flow in range(1, len(csi) + 1)], csi, width, label=names[name], color=color)
    axes.set(xlabel="flow", ylabel="CSI of the area, chosen by the others", ylim=(0, 0.8))
    axes.legend(frameon=False, fontsize="small")
