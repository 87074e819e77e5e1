"""Page of wet flows and erodible beds on a GPU, from the record of ``tests/benchmarks/gpu_wet_flows.py``."""

from collections.abc import Mapping
from typing import Any, TypeAlias

from docs.pages.study_page import StudyPage, as_png, markdown

MAPS = {"max_flow_thickness": "thickness", "deposit_thickness": "deposit", "eroded_depth": "eroded depth"}
SCENES = {"slope": "slope", "cascades_2021": "Cascades 2021", "maipo": "Maipo"}
PRECISIONS = "float64", "float32"
HEADS = ("flow", "simulated [s]", "bed", *(f"{name}, {kind}" for kind in PRECISIONS for name in MAPS.values()))
TAKEN = ("flow", "simulated [s]", "precision", "CPU [m³]", "GPU [m³]", "GPU again [m³]", "largest error of the mass")
Runs: TypeAlias = dict[tuple[str, float, bool, str], Mapping[str, Any]]
OPENING = """# Wet flows and erodible beds on a GPU

Three flows with pore pressure, each without and with an erodible bed, on the backends scan (CPU) and hash (GPU).

| flow | particles | pore pressure | bed |
| --- | --- | --- | --- |
| a slope of 25 degrees, cells of 1 m | {particles[slope]:,} | drains through the thickness | 1.2 m, wet, law `energy` |
| Cascades 2021, cells of 5 m | {particles[cascades_2021]:,} | drains through the thickness | 1.2 m, wet, law `ramms` |
| upper Maipo, cells of 12.5 m, Voellmy friction | {particles[maipo]:,} | decays in a time | 1 m, law `growth` |

Relative L1 differences of maps: of the GPU from the CPU and, in brackets, of two runs on the GPU, where sums have no order.

{maps}

![Difference of the GPU from the CPU against that of two runs on the GPU](gpu_wet_flows.png)

- In float64 the short runs agree to {short:.0e} or better in every map, energy and mass: laws, rates and births are the same.
- Rounding grows in a flow that few cells resolve, in float64 as in float32. At the end two runs on the GPU differ as much as
  the GPU and the CPU do. These differences are the noise of one run.
- In float32 the backends round in different places, two runs on the GPU only in the order of their sums: before rounding has
  grown, the first differ more in most maps.
- One particle is a part in {particles[maipo]:,} of the smallest flow at its start.

Volume that was taken up, and the error of the mass: present and escaped mass less what was taken up, against the mass at the start,
largest of all rows of the ledger of the three runs. On the slope nothing is due in the short run.

{taken}

## How to make this page

    RUNOUT_DATA=DATA python tests/benchmarks/gpu_wet_flows.py --device cuda:0 --out DIR/gpu_wet_flows.json

Copy the record to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page and its figure.
Record: {card}, commit {commit}.
"""


def page(record: Mapping[str, Any]) -> StudyPage:
    """The page of a record."""
    runs: Runs = {(r["scene"], r["end_time"], r["bed"], r["precision"]): r for r in record["records"]}
    cases = sorted({key[:2] for key in runs}, key=lambda case: (list(SCENES).index(case[0]), case[1]))
    first = {scene: min(end for name, end in cases if name == scene) for scene in SCENES}
    short = [max(r["against_cpu"].values()) for key, r in runs.items() if key[1] == first[key[0]] and key[3] == "float64"]
    text = OPENING.format(
        particles={scene: runs[scene, first[scene], True, "float32"]["particles"] for scene in SCENES},
        maps=markdown(HEADS, (_differences(runs, *case, bed) for case in cases for bed in (False, True))),
        taken=markdown(TAKEN, (_taken(runs, *case, precision) for case in cases for precision in PRECISIONS)),
        short=max(short),
        card=record["card"],
        commit=record["commit"],
    )
    return StudyPage("gpu_wet_flows", text, {}, {"gpu_wet_flows.png": _figure(runs)})


def _differences(runs: Runs, scene: str, end: float, bed: bool) -> tuple[str, ...]:
    """Differences of maps in either precision."""
    cells = (
        f"{r['against_cpu'][name]:.0e} ({r['against_itself'][name]:.0e})" if name in r["against_cpu"] else ""
        for r in (runs[scene, end, bed, precision] for precision in PRECISIONS)
        for name in MAPS
    )
    return SCENES[scene], f"{end:g}", "yes" if bed else "no", *cells


def _taken(runs: Runs, scene: str, end: float, precision: str) -> tuple[str, ...]:
    """Volumes taken up by the three runs, and the largest error of their mass."""
    sums = runs[scene, end, True, precision]["sums"].values()
    volumes = (f"{one['entrained']:.1f}" for one in sums)
    return SCENES[scene], f"{end:g}", precision, *volumes, f"{max(one['mass_error'] for one in sums):.0e}"


def _figure(runs: Runs) -> bytes:
    """PNG of the differences, a point for each map and run."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(5.5, 5), layout="constrained")
    axes = canvas.subplots()
    for precision, marker in zip(PRECISIONS, "os", strict=True):
        for scene, label in SCENES.items():
            own = [r for key, r in runs.items() if key[0] == scene and key[3] == precision]
            pairs = [(r["against_itself"][name], r["against_cpu"][name]) for r in own for name in MAPS if name in r["against_cpu"]]
            axes.loglog(
                *zip(*pairs, strict=True),
                marker,
                fillstyle="none" if precision == "float64" else "full",
                label=f"{label}, {precision}",
            )
    axes.axline((1e-10, 1e-10), (1.0, 1.0), color="0.7", zorder=0)
    axes.set(xlabel="difference of two runs on the GPU", ylabel="difference of the GPU from the CPU")
    axes.legend(frameon=False)
    return as_png(canvas)
