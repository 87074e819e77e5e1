"""Cost and accuracy of each transfer and of F-bar: damping, pressure, locking, separation. Writes a page."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.io.atomic import write_json
from runout.physics.numerical_scales import numerical_viscosity
from runout.studies import transfer_cases as cases
from runout.studies.sloping_layer import Layer
from runout.studies.study_page import StudyPage, as_png, markdown
from runout.studies.verification_cases.bar import vibration
from runout.studies.verification_cases.column_collapse import measured_surface
from runout.studies.verification_cases.column_collapse import rods as collapsed_rods
from runout.studies.work_precision import machine, versions

WAYS: dict[str, dict[str, Any]] = {
    "mls": {},
    "apic": {"transfer": "apic"},
    "aflip": {"transfer": "aflip"},
    "mls, F-bar": {"f_bar": True},
    "apic, F-bar": {"transfer": "apic", "f_bar": True},
}
FILE = "transfers.json"
ROUNDS, STEPS = 7, 5  # of the timed layers


def damping(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """U6: remaining share of the amplitude of a bar of 16 cells after ten periods, for two time steps."""
    short = 0.05 if full else 0.2
    return {"amplitude left, CFL 0.5": vibration(16, 0.5, transfer=way)[1], f"CFL {short:g}": vibration(16, short, transfer=way)[1]}


def viscosity(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """Numerical viscosity for shear over 16 cells, relative to h^2/dt (h/wave length)^2; and the value of the formula."""
    keeps = replace(cases.weightless(), **way).keeps
    unit = numerical_viscosity(1.0, 16.0, 0.1, 0.0) / 0.95
    return {
        "viscosity, 16 cells": cases.shear_viscosity(16, 0.1, way) / unit,
        "by formula": numerical_viscosity(1.0, 16.0, 0.1, keeps) / unit,
    }


def column(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """Checkerboard and front of a column of sand that collapses."""
    rough, front = cases.collapse(way)
    return {"checkerboard of pressure": rough, "front of the column [cells]": front}


def footing(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """Load of a strip footing on clay over (2 + pi) c times its width with the half cell beside it."""
    return {"footing over exact": cases.footing(way, 0.05 if full else 0.2)}


def thrown(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """Relative height of a thrown layer after landing, for a volume gain of 10 % and 35 %."""
    return {f"landed, thrown at {v:g} m/s": cases.thrown(way, v) for v in (3.0, 6.0)}


def parted(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """Share of speed that two separating blocks of sand lose, for several initial distances [cells]."""
    return {f"lost from {gap:g} h": cases.parted(way, gap) for gap in (0.5, 1.5, 2.5, 3.0)}


def rods(way: Mapping[str, Any], full: bool) -> dict[str, float]:
    """RMS error of the final surface of the rods of Bui et al. 2008 (F5) [mm]; empty without the data."""
    experiment = measured_surface()
    if experiment is None:
        return {}
    errors = {}
    for h in (0.02, 0.01) if full else (0.02,):
        _, x, found = collapsed_rods(h, 1.0, 10, transfer=way)
        error = np.sqrt(np.mean((np.interp(experiment[:, 0], x, found) - experiment[:, 1]) ** 2))
        errors[f"surface of rods, h = {1e3 * h:g} mm: RMS [mm]"] = 1e3 * float(error)
    return errors


Study = Callable[[Mapping[str, Any], bool], dict[str, float]]
STUDIES: tuple[Study, ...] = (damping, viscosity, column, rods, footing, thrown, parted)


def costs(particles: int, depth: int) -> dict[str, float]:
    """Processor time of a step on one thread relative to the packed transfer; best of alternating rounds."""
    engines, best = {}, dict.fromkeys(WAYS, np.inf)
    for name, way in WAYS.items():
        scene, p = Layer(particles, depth=depth).build()
        engines[name] = get_backend("scan", threads=1)
        engines[name].load(replace(scene, **way), p)
    dt = 0.95 * min(engine.stable_step() for engine in engines.values())
    for turn in range(ROUNDS):
        for name in list(WAYS)[:: 1 if turn % 2 else -1]:
            started = time.process_time()
            for _ in range(STEPS):
                engines[name].step(dt)
            if turn:  # the first round compiles
                best[name] = min(best[name], time.process_time() - started)
    return {name: seconds / best["mls"] for name, seconds in best.items()}


def measure(full: bool = False, particles: int = 100_000) -> dict[str, Any]:
    """All measurements: one row per transfer, with its cost in a deep and in a thin layer."""
    deep, thin = costs(particles, 8), costs(particles, 2)
    rows = {}
    for name, way in WAYS.items():
        found = {key: value for study in STUDIES for key, value in study(way, full).items()}
        rows[name] = {"step over mls, 8 cells deep": deep[name], "2 cells deep": thin[name]} | found
    return {"versions": versions(), "machine": machine(), "full": full, "particles": particles, "rows": rows}


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

    python -m runout.studies.transfers DIR{full}

It writes this page, its figure and the record `transfers.json`. `python -m runout.studies.documentation` makes the same
files again from the record in `tests/benchmarks/records/`.

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


def study(out: Path, full: bool = False) -> str:
    """Write ``transfers.md``, its figure and ``transfers.json`` to the folder ``out``; returns the page."""
    found = measure(full)
    write_json(found, out / FILE)
    made = page(found)
    made.write(out)
    return made.text


if __name__ == "__main__":
    import sys

    print(study(Path(sys.argv[1]), "--full" in sys.argv))
