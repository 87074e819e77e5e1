"""Page of the case Cascades 2021, fitted on half of the reaches."""

from collections.abc import Mapping
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import COARSE, ENDING, HEADING
from runout.studies.validation_cases.cascades_2021_fit import (
    ARRANGEMENTS,
    AUTOMATON_RANGES,
    CELL_SIZE,
    HALVES,
    LAW_MEMBERS,
    LAW_RANGES,
    MEMBERS,
    RANGES,
    SEVERAL,
    WIDER_MEMBERS,
    WIDER_RANGES,
)

HEADS = (
    *("model", "fitted on", "error there [m³]", "error on the others [m³]", f"of the mean of the best {SEVERAL} [m³]"),
    *("least of any member there [m³]", "CSI", "agreement within a cell", "eroded [m³]", "deposited [m³]"),
)
SPREAD_HEADS = ("model", "members", "CSI", "agreement within a cell", "reach error [m³]", "eroded [m³]", "deposited [m³]")
BED_HEADS = ("pore pressure ratio of the bed", "taken from the bed [m³]", "eroded [m³]", "reach error [m³]", "CSI")
BED_KEYS = ("entrained_volume", "erosion_volume", "reach_error")
NUMBER_HEADS = ("model", "fitted on", "number", "value", "from", "to")
REACH_HEADS = ("model", "fitted on", *(f"reach {number} [m³]" for number in range(1, 7)))
MODELS = {"runout": "runout", "wider": "runout, wider ranges", "laws": "runout, other laws of erosion", "landlab": "landlab"}
RANGES_OF = {"runout": RANGES, "wider": WIDER_RANGES, "landlab": AUTOMATON_RANGES}
RANGES_OF["laws"] = LAW_RANGES["growth"] | LAW_RANGES["energy"]
LABELS = ("1, 3, 5", "2, 4, 6")
OPENING = """# Cascades 2021 fitted on half of the reaches

The event of {{doc}}`cascades_2021` with a wet mass on an erodible bed of 1.2 m. {members} members draw the friction of the ground,
pore pressure ratios by blocks of the mass, decay time, pore pressure and erodible depth of the bed, and bulking from ranges that
are not narrowed by this event. Of these the one with the smallest error of the volumes on three of the six reaches is chosen, and
judged on the other three. {wider} more members draw from wider ranges, with the depth of the bed and the saturation of the mass as
well. {laws} more have another law of erosion, `growth` or `energy`. landlab's MassWastingRunout is drawn over four parameters
and chosen in the same way. No choice uses the half of the reaches that judges it.

"""
FULL = """{halves}

![Net volume by reach](cascades_2021_fit.png)

- *Error*: sum over three reaches of the absolute difference from the observed net volume. Reaches are numbered from north to south.

{heading}- **{verdict}**
- The mean of the {several} best members is no better guess than the best alone by more than a quarter: what one half of the reaches
  tells about the parameters, it tells little about the places of the deposits in the other half.
- **Wider ranges hardly help.** With a depth of the bed of 0.6 to 2 m, a saturation of 0 to 1 (the pressure relaxes to 0 to 0.53 of
  the weight) and frictions to 32 deg, {wider_count} members give errors of {wider_low:.0f} and {wider_high:.0f} m³. Members that
  fit one half to {wider_fitted:.0f} m³ or less place the rest of the mass in any of the other reaches: {wider_spread}.
- **Another law of erosion brings one half below 12 000 m³, at the price of the areas**: {law_count} members, half with `growth`
  (0.0003 to 0.003 per metre) and half with `energy` (1 to 20 kJ/kg), give errors of {law_low:.0f} and {law_high:.0f} m³ on the
  other half, with a CSI of {law_csi:.2f} at most. Chosen: {law_chosen}. The ranges lie around the typical value and the
  default of the laws. So few members do not rank the laws.
- **The automaton is the better fit here**, by reach as follows.

Error by reach, modelled less observed net volume of the chosen members:

{reaches}

Runs with the numbers of the two choices of `runout` and another arrangement of blocks, volumes lowered and raised by reach:

| reach | fall of the channel | observed [m³] | fitted on 1, 3, 5 [m³] | fitted on 2, 4, 6 [m³] |
| --- | --- | --- | --- | --- |
| 2 | 14 deg | -1622, +1089 | -1052, +4750 | -2006, +242 |
| 3 | 12 deg | -764, +5512 | -617, +5314 | -1971, 0 |
| 4 | 10 deg | -170, +6980 | -41, +8573 | -1474, +8573 |
| 5 | 15 deg | -1848, +435 | 0, +13 | -1514, +9311 |
| 6 | 4 deg | -47, +6522 | 0, 0 | -263, +4869 |
| taken from the bed |  |  | 8008 | 16328 |

- **Fitted on reaches 1, 3 and 5, the mass stops too early**: too much in reaches 2 and 4, and nothing in reach 6.
- **Fitted on reaches 2, 4 and 6, it stops too late and takes too much from the bed**: nothing stays in reach 3, and 9300 m³ stay in
  reach 5, which is steeper. Mass that is mobile enough for reach 6 takes up its volume along the whole path, also where the survey
  shows deposits.
- **The end of the run is not the reason**: at 400 s in place of 150 s the volumes of the reaches differ by 390 m³ at most.

## The spread of the members

Median, and 5 to 95 % of the members:

{spread}

- **The observed eroded volume, {eroded:.0f} m³, lies in the 90 % range of the members** ({low:.0f} to {high:.0f} m³).
- The best CSI of a member is {best_csi:.2f}, the best agreement within a cell {best_agreement:.2f}, the least reach error
  {least_error:.0f} m³: of three different members.

## The pore pressure of the bed decides

{arrangements} arrangements of blocks for each ratio, all other numbers in the middle of their ranges; median, least and largest:

{beds}

- **An answer is the range, not a run.** Between ratios of 0.5 and 0.8, all plausible for a wet channel, the flow takes
  {entrained_low:.0f} and {entrained_high:.0f} m³ from the bed in the median. State the pore pressure of a bed as a range.

Cells of {cell:g} m. {tables}.{wider_record}

"""
MET = "The error on the other half is at most 12 000 m³ for both choices of runout."
MISSED = (
    "A member fitted on one half misses the other by {low:.0f} and {high:.0f} m³; 12 000 m³ were aimed at. landlab's automaton, "
    "fitted likewise, misses by {ll_low:.0f} and {ll_high:.0f} m³."
)


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    opening = OPENING.format(members=MEMBERS, wider=WIDER_MEMBERS, laws=len(LAW_RANGES) * LAW_MEMBERS)
    ending = ENDING.format(command=record["command"])
    if not record["full"]:
        return StudyPage("cascades_2021_fit", opening + HEADING + COARSE + "\n\n" + ending)
    results = record["results"]
    own, beds = results["runout"], {row["bed_ratio"]: row for row in results["bed_ratios"]}
    errors, of_landlab = (sorted(half["error"] for half in results[name]["halves"]) for name in ("runout", "landlab"))
    numbers = {"low": errors[0], "high": errors[-1], "ll_low": of_landlab[0], "ll_high": of_landlab[-1]}
    text = FULL.format(
        halves=markdown(HEADS, [_half(MODELS[name], half) for name in MODELS for half in results[name]["halves"]]),
        heading=HEADING,
        verdict=MET if errors[-1] <= 12e3 else MISSED.format(**numbers),
        several=SEVERAL,
        spread=markdown(SPREAD_HEADS, [*(_spread(name, results[name]) for name in ("runout", "landlab")), _observed(results)]),
        eroded=results["observed"]["erosion_volume"],
        low=own["erosion_volume"][1],
        high=own["erosion_volume"][3],
        best_csi=own["csi"][4],
        best_agreement=own["agreement"][4],
        least_error=own["reach_error"][0],
        arrangements=ARRANGEMENTS,
        beds=markdown(BED_HEADS, map(_bed, results["bed_ratios"])),
        entrained_low=beds[0.5]["entrained_volume"][1],
        entrained_high=beds[0.8]["entrained_volume"][1],
        **_wider(results["wider"]),
        **_laws(results["laws"]),
        reaches=markdown(REACH_HEADS, _by_reach(results)),
        cell=CELL_SIZE,
        tables=download("cascades_2021_fit.csv", "Numbers of the chosen members"),
    )
    tables = {"cascades_2021_fit.csv": as_csv(NUMBER_HEADS, _numbers(results))}
    pictures = {"cascades_2021_fit.png": _figure(results)}
    return StudyPage("cascades_2021_fit", opening + text + ending, tables, pictures)


def _wider(table: Mapping[str, Any]) -> dict[str, Any]:
    """Words on the members of the wider ranges, and the version that ran them where it is another one."""
    errors = sorted(half["error"] for half in table["halves"])
    ranges = (f"{half['least_several']:.0f} to {half['most_several']:.0f} m³" for half in table["halves"])
    return {
        "wider_count": table["count"],
        "wider_low": errors[0],
        "wider_high": errors[-1],
        "wider_fitted": max(half["fitted_several"] for half in table["halves"]),
        "wider_spread": f"the {SEVERAL} best have errors of " + " and ".join(ranges),
        "wider_record": f" Wider ranges and other laws: runout {table['version']}." if "version" in table else "",
    }


def _laws(table: Mapping[str, Any]) -> dict[str, Any]:
    """Words on the members with other laws of erosion."""
    errors = sorted(half["error"] for half in table["halves"])
    names = ("`growth`" if "log_growth_rate" in half["numbers"] else "`energy`" for half in table["halves"])
    chosen = ", ".join(f"{name} by reaches {_label(half)}" for name, half in zip(names, table["halves"], strict=True))
    csi = max(half["csi"] for half in table["halves"])
    return {"law_count": table["count"], "law_low": errors[0], "law_high": errors[-1], "law_chosen": chosen, "law_csi": csi}


def _by_reach(results: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Errors [m3] of the chosen members in each reach, below the observed volumes."""
    observed = results["observed"]["reach_volumes"]
    rows = [
        (MODELS[model], _label(half), *(f"{v - o:+.0f}" for v, o in zip(half["reach_volumes"], observed, strict=True)))
        for model in MODELS
        for half in results[model]["halves"]
    ]
    return [("**observed**", "", *(f"{volume:.0f}" for volume in observed)), *rows]


def _label(half: Mapping[str, Any]) -> str:
    return LABELS[HALVES.index(half["fitted"])]


def _half(model: str, half: Mapping[str, Any]) -> tuple[str, ...]:
    errors = (f"{half[key]:.0f}" for key in ("error_fitted", "error", "error_of_several", "least"))
    return (
        *(model, _label(half), *errors),
        *(f"{half[key]:.2f}" for key in ("csi", "agreement")),
        *(f"{half[key]:.0f}" for key in ("erosion_volume", "deposition_volume")),
    )


def _spread(model: str, table: Mapping[str, Any]) -> tuple[str, ...]:
    shares = ("{2:.2f} ({1:.2f} to {3:.2f})".format(*table[key]) for key in ("csi", "agreement"))
    keys = "reach_error", "erosion_volume", "deposition_volume"
    return (model, str(table["count"]), *shares, *("{2:.0f} ({1:.0f} to {3:.0f})".format(*table[key]) for key in keys))


def _observed(results: Mapping[str, Any]) -> tuple[str, ...]:
    volumes = (f"{results['observed'][key]:.0f}" for key in ("erosion_volume", "deposition_volume"))
    return ("**observed**", "", "", "", "", *volumes)


def _bed(row: Mapping[str, Any]) -> tuple[str, ...]:
    volumes = ("{1:.0f} ({0:.0f} to {2:.0f})".format(*row[key]) for key in BED_KEYS)
    return (f"{row['bed_ratio']:g}", *volumes, "{1:.2f} ({0:.2f} to {2:.2f})".format(*row["csi"]))


def _numbers(results: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """Numbers of the chosen members beside the ranges they were drawn from."""
    return [
        (MODELS[model], _label(half), name, round(value, 6), *(round(end, 6) for end in RANGES_OF[model][name]))
        for model in MODELS
        for half in results[model]["halves"]
        for name, value in half["numbers"].items()
    ]


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes, width = canvas.subplots(), 0.16
    bars = [("observed", results["observed"]["reach_volumes"], "0.3")]
    for model, colors in (("runout", ("C0", "#9ecae1")), ("landlab", ("C1", "#fdd0a2"))):
        for half, color in zip(results[model]["halves"], colors, strict=True):
            bars.append((f"{model}, fitted on {_label(half)}", half["reach_volumes"], color))
    for number, (label, volumes, color) in enumerate(bars):
        places = [reach + (number - 2) * width for reach in range(1, len(volumes) + 1)]
        axes.bar(places, [volume / 1000.0 for volume in volumes], width, label=label, color=color)
    axes.axhline(0.0, color="k", linewidth=0.8)
    axes.set(xlabel="reach, from north to south", ylabel="net volume [1000 m³]")
    axes.legend(frameon=False, fontsize="small")
    return as_png(canvas)
