"""Page of the case of the USGS debris-flow flume."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown
from docs.pages.wording import ENDING, told

OPENING = """# Gate releases at the USGS debris-flow flume

Wet sand, gravel and mud behind a gate at the head of a concrete channel, 2 m wide: 31 deg over 78 m, then a curve of 10 m radius
onto a pad of 2.5 deg. The side walls end at 82.5 m; the bed is rough. 9.9 m³, 1.9 m deep at the gate, are released at once; the
real gate opens within 0.8 s. All distances are along the bed from the gate. The bed is terrain, the side walls are structures.

| what | value | source |
| --- | --- | --- |
| bed, side walls, reservoir | above | D-Claw's example (1) |
| density | 2092 kg/m³: 62 % of 2700 in a fluid of 1100 | table 2 of (2) |
| basal friction | 40.7 deg | table 2 of (2) |
| pore pressure ratio, which stays | {ratio:.2f}: hydrostatic behind the gate | table 2 of (2) |
| inner friction | {inner:.1f} deg: passes the basal friction on | sine of the one is tangent of the other |
| friction of the side walls | 20 deg, concrete | not measured |
| arrival and peak, May 2017 | below | sensors (3), reduced in (5) |
| peak of the mean of eight releases | below | data set ds03 of (4), reduced in (5) |
| deposit: front, thickest place, end | 112, 106, 120 m | figs 15 and 16 of (2), read in (5) |

1. [D-Claw's applications](https://github.com/geoflows/dclaw-apps/blob/a5067fb/USGSFlume/gate_release_example/setinit.py)
2. George & Iverson 2014, Proc. R. Soc. A 470:20130820; the numbers of table 2 as they stand in (5)
3. Iverson & Obryk 2019, doi 10.5066/P9NAFXW7
4. Iverson et al. 2010, J. Geophys. Res. 115:F03005
5. A third party: tests of [2017](https://github.com/youryugi/dclaw/tree/51f0c4e/validation/usgs_flume_2017) and
   [2010](https://github.com/youryugi/dclaw/tree/89964d5/validation/usgs_flume_2010_paper2014)

The raw records were not at hand: two numbers of each sensor, and no series. **Nothing is fitted.**

## Arrival [s]

{arrival}

## Largest thickness, normal to the bed [m]

{peak}

*Arrival*: 0.02 m or more at the middle of the channel, since the gate began to open; in the runs it is gone at once. Peaks of
single tests include splashes. The mean of eight is of 32, 66 and 90 m.

## Other numbers, in cells of {coarse:g} m

{sensitivity}

*Duration*: with more than 0.02 m at 31.7 m. *Middle*: half of the volume of the deposit lies above it.

![Front over time, and thickness at three gauges](flume.png)

## Differences, and their reasons

{differences}

{tables}.

"""
DIFFERENCES = """\
- **Arrival**: at 31.7 m it is {near:.1f} s, in the tests {near_low:.1f} and {near_high:.1f} s. Farther down the flow is early:
  {middle:.1f} s against {middle_low:.1f} and {middle_high:.1f} s at 65.4 m, {far:.1f} against {far_low:.1f} and {far_high:.1f} s
  at 80 m. The tests have a front of coarse grains with little pore pressure, which brakes the wet mass behind it (Iverson et al.
  2010). A mass with one pore pressure has none.
- **Thickness**: the peaks at 31.7 and 65.4 m are {peak_near:.2f} and {peak_middle:.2f} m, less than half of the mean of eight, for
  the same reason: nothing holds the flow up, and it stretches. It passes within {duration:.0f} s. In the mean of eight, (5) reads
  more than 0.02 m for 20 s, and 0.117 m at 90 m after 30 s.
- **D-Claw with the numbers of its authors, run by (5), differs alike**: arrival at 3.4, 5.7 and 7.4 s, peaks of 0.12, 0.09 and
  0.13 m. (5) later found its gauges misplaced: 32, 66 and 90 m are horizontal there.
- **Deposit**: the middle lies at {deposit:.0f} m and the front at {front:.0f} m; the tests have the thickest place at 106 m and the
  front at 112 m. The deposit of the run is shorter, and thicker ({thickest:.1f} m at most).
- **Pore pressure decides**: with the {dry:.2f} that was measured behind the gate on 25 May 2017 the flow is at 80 m after
  {dry_far:.1f} s, and half of it stops above {dry_middle:.0f} m. With 0.7 {wet}. One ratio does not give both the fast start and
  the slow end.
- **Inner friction decides too**: in steady shear a mass passes on the sine of its friction angle. With {inner:.1f} deg inside as at
  the base, {acting:.1f} deg act there; the front is then at {inner_front:.0f} m.
- **Cells**: cells of {cell:g} and {coarse:g} m are thicker than the flow from 31.7 m on, so that the mass moves in columns, as in
  depth-averaged models. Between them arrivals differ by up to {finer:.1f} s."""
HEADS = ("", *(f"{gauge} m" for gauge in ("2.5", "31.7", "65.4", "80", "90")))
SENSITIVITY = (
    *("run", "pore pressure ratio", "inner friction [deg]", "31.7 m [s]", "65.4 m [s]", "80 m [s]"),
    *("peak at 31.7 m [m]", "duration [s]", "middle [m]", "front [m]"),
)


def page(record: Mapping[str, Any]) -> StudyPage:
    """Page of a record."""
    results = record["results"]
    base, observed = results["runs"][0], results["observed"]
    text = OPENING.format(
        ratio=base["ratio"], inner=base["inner_deg"], coarse=results["runs"][-1]["cell"],
        arrival=markdown(HEADS, _beside(observed, results["runs"][:2], "arrival", "{:.1f}")),
        peak=markdown(HEADS, _beside(observed, results["runs"][:2], "peak", "{:.2f}")),
        sensitivity=markdown(SENSITIVITY, map(_row, results["runs"][1:])),
        differences=told(record, DIFFERENCES, _numbers), tables=download("flume.csv", "All runs"),
    )  # fmt: skip
    heads = ("run", "cell_size", "pore_pressure_ratio", "gauge", "arrival", "peak", "duration")
    text += ENDING.format(command=record["command"])
    return StudyPage("flume", text, {"flume.csv": as_csv(heads, _all(results))}, {"flume.png": _figure(results)})


def _beside(observed: Mapping[str, Any], runs: Sequence[Mapping[str, Any]], key: str, digits: str) -> list[tuple[str, ...]]:
    """A row a test and run; tests without any value are left out."""

    def cells(values: Sequence[float | None]) -> tuple[str, ...]:
        return tuple("" if value is None else digits.format(value) for value in values)

    tests = [(f"{name}, {test['volume']:g} m³", test[key]) for name, test in observed.items() if any(test[key])]
    return [
        *((name, *cells(values)) for name, values in tests),
        *((f"runout, cells of {run['cell']:g} m", *cells(run[key])) for run in runs),
    ]


def _row(run: Mapping[str, Any]) -> tuple[str, ...]:
    """Row of the sensitivity."""
    arrival = ["not reached" if run["arrival"][k] is None else f"{run['arrival'][k]:.1f}" for k in (1, 2, 3)]
    deposit = run["deposit"]
    ends = ("left the terrain",) * 2 if deposit is None else (f"{deposit['middle']:.0f}", f"{deposit['front']:.0f}")
    start = run["name"], f"{run['ratio']:.2f}", f"{run['inner_deg']:.1f}"
    return (*start, *arrival, f"{run['peak'][1]:.2f}", f"{run['duration'][1]:.0f}", *ends)


def _numbers(results: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the text."""
    base, coarse = results["runs"][:2]
    runs = {run["name"]: run for run in results["runs"]}
    tests = [results["observed"][day]["arrival"] for day in ("2017-05-24", "2017-05-25")]
    dry, wet = runs["pore pressure of 25 May 2017"], runs["pore pressure 0.7"]["deposit"]
    weak = runs["inner friction 40.7 deg"]
    bounds = {
        f"{place}_{end}": of(test[k] for test in tests)
        for place, k in (("near", 1), ("middle", 2), ("far", 3)) for end, of in (("low", min), ("high", max))
    }  # fmt: skip
    changes = [abs(a - b) for a, b in zip(base["arrival"], coarse["arrival"], strict=True) if a is not None and b is not None]
    return bounds | {
        "near": base["arrival"][1], "middle": base["arrival"][2], "far": base["arrival"][3],
        "peak_near": base["peak"][1], "peak_middle": base["peak"][2], "duration": base["duration"][1],
        "deposit": base["deposit"]["middle"], "front": base["deposit"]["front"], "thickest": base["deposit"]["thickest"],
        "inner": weak["inner_deg"], "inner_front": weak["deposit"]["front"],
        "acting": np.degrees(np.arctan(np.sin(np.radians(weak["inner_deg"])))),
        "dry": dry["ratio"], "dry_far": dry["arrival"][3],
        "wet": "all of it leaves the terrain, 60 m below the mouth" if wet is None else f"half of it passes {wet['middle']:.0f} m",
        "cell": base["cell"], "coarse": coarse["cell"], "dry_middle": dry["deposit"]["middle"], "finer": max(changes),
    }  # fmt: skip


def _all(results: Mapping[str, Any]) -> list[Sequence[Any]]:
    """Rows of all runs and gauges."""
    return [
        (run["name"], run["cell"], run["ratio"], gauge, run["arrival"][k], run["peak"][k], run["duration"][k])
        for run in results["runs"]
        for k, gauge in enumerate(results["gauges"])
    ]


def _figure(results: Mapping[str, Any]) -> bytes:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(12.0, 4.2), layout="constrained")
    fronts, gauge_series = canvas.subplots(1, 2)
    gauges, base, observed = results["gauges"], results["runs"][0], results["observed"]
    for (name, test), mark in zip(observed.items(), ("k^", "ks"), strict=False):
        fronts.plot(*_known(test["arrival"], gauges), mark, label=f"{name}, {test['volume']:g} m³")
    fronts.plot(12.0, results["deposit"]["front"], "k*", markersize=10, label="front of the deposit (2)")
    for number, run in enumerate(results["runs"]):
        style = {"color": "C0", "linewidth": 2.5} if number == 0 else {"linewidth": 1, "color": f"C{number}"}
        fronts.plot(*_known(run["arrival"], gauges), label=run["name"], **style)
    fronts.set(xlabel="time since the gate opens [s]", ylabel="distance along the bed [m]", xlim=(0, 14), ylim=(0, 120))
    fronts.legend(frameon=False, fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for colour, k in enumerate((1, 2, 4)):
        gauge_series.plot(base["time"], base["thickness"][k], color=f"C{colour}", label=f"runout, {gauges[k]:g} m")
        mean = observed["mean of eight"]["peak"][k]
        gauge_series.axhline(mean, color=f"C{colour}", linestyle=":", label=f"peak of the mean of eight, {(32, 66, 90)[colour]} m")
    gauge_series.set(xlabel="time since the gate opens [s]", ylabel="thickness [m]", xlim=(0, 20), ylim=(0, 0.3))
    gauge_series.legend(frameon=False, fontsize=7)
    return as_png(canvas)


def _known(times: Sequence[float | None], places: Sequence[float]) -> tuple[list[float], list[float]]:
    """Times [s] and distances [m] of the gauges that were reached."""
    pairs = [(time, place) for time, place in zip(times, places, strict=True) if time is not None]
    return [time for time, _ in pairs], [place for _, place in pairs]
