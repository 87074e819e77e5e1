"""Cost and accuracy of each transfer and of F-bar: damping, pressure, locking, separation."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.io.atomic import write_json
from runout.physics.numerical_scales import numerical_viscosity
from runout.studies.sloping_layer import Layer
from runout.studies.verification_cases.bar import vibration
from runout.studies.verification_cases.column_collapse import measured_surface
from runout.studies.verification_cases.column_collapse import rods as collapsed_rods
from runout.studies.work_precision import machine, versions
from tests.benchmarks import transfer_cases as cases

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


def study(out: Path, full: bool = False) -> Path:
    """Path of the record ``transfers.json``, after writing it to the folder ``out``."""
    found = measure(full)
    return write_json(found, out / FILE)


if __name__ == "__main__":
    import sys

    print(study(Path(sys.argv[1]), "--full" in sys.argv))
