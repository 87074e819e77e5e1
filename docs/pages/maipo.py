"""Page of the case Maipo."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import COARSE, ENDING, HEADING
from runout.studies.validation_cases.maipo import CELL_SIZE, REACHED

NAMES = {"voellmy": "Voellmy", "pore_pressure": "pore pressure"}
HEADS = (
    *("flow", "length [m]", "area [ha]", "slope of reach", "length by that of the others [m]", "error"),
    *("Voellmy: length [m]", "error", "CSI", "pore pressure: length [m]", "error", "CSI"),
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

![Length of the run-out, observed and predicted](maipo.png)

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

Data: runoptGPP (GPL-3), found below `RUNOUT_DATA`. {tables}.

"""


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
    return [
        (NAMES[name], choice, flow + 1, length, round(length / results["flows"][flow]["length"] - 1.0, 3), csi)
        for name, family in results["families"].items()
        for choice, lengths, indices in zip(family["choices"], family["lengths"], family["csi"], strict=True)
        for flow, (length, csi) in enumerate(zip(lengths, indices, strict=True))
    ]


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(6.0, 5.0), layout="constrained")
    axes, observed = canvas.subplots(), [flow["length"] for flow in results["flows"]]
    longest = 1.35 * max(observed)
    axes.plot([0, longest], [0, longest], color="0.6", linewidth=1)
    axes.plot(observed, [flow["empirical"]["length"] for flow in results["flows"]], "k^", label="slope of reach of the others")
    for name, style in (("voellmy", "C0o"), ("pore_pressure", "C1s")):
        lengths = [row["length"] for row in results["families"][name]["left_out"]]
        axes.plot(observed, lengths, style, label=f"{NAMES[name]}, chosen by the others")
    axes.set(
        xlabel="observed length [m]", ylabel="predicted length [m]", xlim=(1000, longest), ylim=(1000, longest), aspect="equal"
    )
    axes.legend(loc="lower right", frameon=False)
    return as_png(canvas)
