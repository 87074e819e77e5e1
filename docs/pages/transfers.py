"""Cost and accuracy of each transfer and of F-bar, as a page."""

from collections.abc import Mapping
from typing import Any

from docs.pages.study_page import StudyPage, as_png, markdown

REMARKS = """- *Amplitude left*: a bar of 16 cells after ten periods (U6).
- *Viscosity*: decay of a shear wave, in units of h²/Δt (h/λ)².
- *Checkerboard*: RMS difference of the pressure from its linear fit over the 20 nearest particles, over its mean,
  in a collapsing column of sand of 6 x 6 x 8 cells. *Front*: the width of the column at that time.
- *Surface of rods*: aluminium rods of 100 mm height that collapse (F5), surface at the end against the experiment
  of Bui et al. 2008.
- *Footing*: a rigid rough strip, six cells wide, pressed into weightless clay (friction angle 0, Poisson's ratio
  0.49), relative to (2 + π) c and its width on the grid, half a cell more on each side. Values above 1 mean locking.
- *Landed*: final over initial height of a periodic layer of sand, four cells thick, that was thrown up. In flight its volume
  grew by a tenth (3 m/s) or a third (6 m/s). 1 means the initial density.
- *Lost*: share of speed that two blocks of sand lose while they separate at 1 m/s, for several initial distances of their
  particles. From three cells on, they share no node and lose nothing.
"""
OPENING = """# Transfers and F-bar

Cost and accuracy of the choices `transfer` and `f_bar` ({{doc}}`../theory`, {{doc}}`../decisions/06-transfers`).

![Time of a step and error of the surface of the rods](transfers.png)

{table}

{remarks}
Steps: layers of {particles:,} particles in float32 on one thread, processor time, taken in turns. All else: float64.

## How to make this page

    python -m tests.benchmarks.transfers DIR{full}

It writes the record `transfers.json`. Copy it to `tests/benchmarks/records/`; `python -m docs.pages` then writes this page,
its figure.

Record: runout {runout}, commit {commit}, Python {python}, NumPy {numpy}, numba {numba}; {cores} cores
({architecture}), with other work.
"""


def page(found: Mapping[str, Any]) -> StudyPage:
    """The numbers as a page of the documentation."""
    ways, made = found["rows"], found["versions"]
    quantities = ((key, *(_number(row[key]) for row in ways.values())) for key in next(iter(ways.values())))
    text = OPENING.format(
        table=markdown(("", *ways), quantities),
        remarks=REMARKS,
        full=" --full" if found["full"] else "",
        particles=found["particles"],
        **{name: made[name] for name in ("runout", "commit", "python", "numpy", "numba")},
        **{name: found["machine"][name] for name in ("cores", "architecture")},
    )
    return StudyPage("transfers", text, pictures={"transfers.png": _figure(ways)})


def _number(value: float) -> str:
    """A number with four digits; round-off becomes 0."""
    return f"{value:.4g}" if abs(value) > 1e-12 else "0"


def _figure(ways: Mapping[str, Mapping[str, float]]) -> bytes:
    """PNG of the time of a step and of the error of the surface of the rods, a bar a way."""
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(9.0, 3.2), layout="constrained")
    keys = list(next(iter(ways.values())))
    panels = (
        ("time of a step over mls", [key for key in keys if key.endswith("cells deep")]),
        ("surface of rods: RMS error [mm]", [key for key in keys if key.startswith("surface of rods")]),
    )
    for axes, (label, shown) in zip(canvas.subplots(1, 2), panels, strict=True):
        for k, key in enumerate(shown):
            name = key.split(", ")[-1].split(":")[0]
            axes.bar([n + 0.4 * k for n in range(len(ways))], [row[key] for row in ways.values()], 0.4, label=name)
        axes.set_xticks([n + 0.2 for n in range(len(ways))], list(ways), fontsize=8)
        axes.set(ylabel=label, ylim=(0, 1.3 * axes.get_ylim()[1]))
        axes.legend(fontsize=8, frameon=False)
    return as_png(canvas)
