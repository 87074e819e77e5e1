"""Trials: each setting alone over its range, all settings together by Latin hypercube, and a fixed set for CI."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import qmc

from runout.model.limits import LARGEST_RADIANS, LIMITS
from runout.studies.stability_cases.layout import CLIFFS, TERRAINS, Layout
from runout.studies.stability_cases.trial import LARGEST

SAMPLES, SEED = 200, 20
PASSAGE: dict[str, Any] = {"passes": True, "basal": 10.0, "steps": 1500}
FAST_AND_THIN: dict[str, Any] = {"speed": 30.0, "thickness": 0.25, "terrain": "ramp", "youngs_modulus": 1e8}  # ends transfers early
SMALLEST_ANGLE = LARGEST_RADIANS + 0.03  # [deg]; smaller angles look like radians
FIERCE = ("ramms", (("rate", 10.0), ("critical_stress", 0.0), ("depth_per_stress", 1.0)))  # takes all of a bed in some steps


def eroding(law: str = "ramms", numbers: tuple[tuple[str, float], ...] = (("rate", 0.5),), **more: Any) -> dict[str, Any]:
    """A bed as thick as a cell, at whose rate a run of 400 steps takes up a part of it, and other choices."""
    return {"bed_depth": 1.0, "erosion": law, "erosion_numbers": numbers, **more}


AXES: dict[str, tuple[dict[str, Any], ...]] = {
    "Courant number": tuple({"cfl": c} for c in (0.1, 0.2, 0.4, 0.5, 0.6, 0.61, 0.8, 1.0, 1.5)),
    "Young's modulus": tuple({"youngs_modulus": e} for e in (1e4, 1e5, 1e6, 1e7, 1e8, 1e9)),
    "Poisson's ratio": tuple({"poisson_ratio": nu} for nu in (0.0, 0.2, 0.45, 0.495, 0.5)),
    "strength": (
        *({"friction_angle": phi} for phi in (0.0, 5.0, 15.0, 45.0, 60.0, 61.0)),
        *({"friction_angle": 0.0, "cohesion": c} for c in (1e2, 1e4, 1e6)),
        *({"cohesion": c} for c in (1e2, 1e4, 1e6)),
        {"friction_angle": 60.0, "cohesion": 1e6},
        {"elastic": True},
    ),
    "particles a cell": (
        *({"per_cell": (k, k, k)} for k in (1, 2, 3)),
        {"per_cell": (4, 4, 4), "thickness": 1.0},
        {"per_cell": (1, 1, 4)},
        {"per_cell": (4, 4, 1)},
    ),
    "size of a cell [m]": tuple({"h": h} for h in (1e-3, 1e-2, 0.1, 10.0, 100.0, 400.0)),
    "height of a cell": tuple({"flatness": f} for f in (0.25, 0.5, 2.0)),
    "terrain": (*({"terrain": t} for t in TERRAINS), *({"terrain": t, "slope": 0.0} for t in ("bumps", "wall of 80 deg"))),
    "passage": tuple({"terrain": t, **PASSAGE} for t in CLIFFS),
    "slope [deg]": tuple({"slope": s} for s in (0.0, 10.0, 45.0, 60.0, 75.0)),
    "basal friction angle [deg]": tuple({"basal": b} for b in (0.0, 30.0, 45.0, 60.0, 61.0)),
    "pore pressure ratio": (
        *({"pore_ratio": r} for r in (0.5, 0.97, 0.98)),
        {"pore_ratio": 0.97, "thickness": 0.25, "terrain": "bumps"},
        {"pore_ratio": 0.97, "terrain": "step down in one cell"},
        {"pore_ratio": 0.9, "speed": 30.0, "terrain": "ramp", "youngs_modulus": 1e8},
        *({"pore_blocks": (0.0, 0.97, size)} for size in (0.1, 2.0, 1e4)),
        {"pore_blocks": (0.8, 0.2, 2.0)},
    ),
    "drainage": (
        *({"pore_ratio": 0.9, "diffusivity": d} for d in (1e-9, 1.0, 100.0, 101.0)),
        *({"pore_ratio": 0.9, "decay_time": t} for t in (1e-6, 1.0, 1e6, 0.0)),
        *({"pore_ratio": 0.5, "saturation": s} for s in (0.5, 1.0, 1.1)),
        {"pore_ratio": 0.0, "saturation": 1.0, "decay_time": 0.1},
        {"pore_ratio": 0.9, "saturation": 1.0, "density": 1020.0},
        {"pore_ratio": 0.97, "decay_time": 1e-3, "speed": 30.0, "terrain": "ramp", "youngs_modulus": 1e8},
    ),
    "erodible bed": (
        *(
            eroding(law, numbers)
            for law, numbers in (
                ("ramms", ()),
                FIERCE,
                ("growth", (("growth_rate", 1.0),)),
                ("energy", (("specific_energy", 1.0),)),
                ("jump", (("most", 0.05),)),
                ("jump", (("most", 10.0), ("friction_angle", 0.0))),
            )
        ),
        *(eroding(bed_depth=depth) for depth in (1e-3, 0.1, 8.0)),
        eroding(bed_depth=-1.0),
        *(eroding("ramms", (("rate", rate),)) for rate in (0.0, 10.0, 11.0)),
        *(eroding(bed_density=density) for density in (1.0, 500.0, 20_000.0, 0.5)),
        *(eroding(*FIERCE, terrain=t) for t in ("bumps", "step down in one cell", "edge", "unknown cells", "wall of 80 deg")),
        eroding(*FIERCE, placement="excavated"),
        eroding(*FIERCE, thickness=0.25),
        eroding(*FIERCE, keep=1),
        eroding(*FIERCE, per_cell=(1, 1, 1)),
        eroding(*FIERCE, flatness=0.5),
        eroding(*FIERCE, precision="float64"),
        eroding(*FIERCE, **FAST_AND_THIN),
        eroding(*FIERCE, h=400.0, youngs_modulus=4e9),
        eroding(*FIERCE, h=1e-3),
    ),
    "wet bed": (
        *(eroding(*FIERCE, pore_ratio=0.5, bed_ratio=ratio) for ratio in (0.0, 0.9, 0.97, 0.98)),
        eroding(*FIERCE, bed_ratio=0.9),
        eroding("jump", (("most", 10.0),), pore_ratio=0.9, bed_ratio=0.97, terrain="bumps"),
        eroding(*FIERCE, pore_blocks=(0.0, 0.97, 2.0), bed_ratio=0.97, saturation=1.0, decay_time=0.1),
        eroding(*FIERCE, pore_ratio=0.9, bed_ratio=0.5, substeps=64, **FAST_AND_THIN),
    ),
    "inflow": (
        *({"inflow_thickness": t} for t in (0.1, 0.5, 2.0, 4.0)),
        *({"inflow_thickness": 1.0, "inflow_speed": v} for v in (0.1, 1.0, 30.0, 150.0)),
        *({"inflow_thickness": 1.0, "inflow_over": "polygon", "inflow_speed": v} for v in (1.0, 10.0)),
        {"inflow_thickness": 1.0, "inflow_speed": 201.0},
        *({"inflow_thickness": 2.0, "terrain": t} for t in ("bumps", "ramp")),
        {"inflow_thickness": 2.0, "slope": 0.0},
        {"inflow_thickness": 2.0, "slope": 60.0},
        {"inflow_thickness": 2.0, "inflow_speed": 0.3, "speed": 20.0},
        {"inflow_thickness": 1.0, "per_cell": (1, 1, 1)},
        {"inflow_thickness": 1.0, "precision": "float64"},
        {"inflow_thickness": 1.0, "h": 1e-2, "inflow_speed": 0.5},
        {"inflow_thickness": 1.0, "pore_ratio": 0.9, "saturation": 1.0},
        eroding(*FIERCE, inflow_thickness=1.0),
        eroding(*FIERCE, inflow_thickness=1.0, pore_ratio=0.9, bed_ratio=0.97, terrain="bumps"),
    ),
    "thickness [cells]": tuple({"thickness": t} for t in (0.1, 0.25, 0.5, 1.0, 4.0)),
    "placement": ({"placement": "excavated"}, {"placement": "excavated", "terrain": "bumps"}),
    "one and two particles": tuple({"keep": n, "terrain": t} for n in (1, 2) for t in ("plane", "step down in one cell")),
    "impact [m/s]": (
        *({"speed": v, "terrain": "ramp"} for v in (10.0, 100.0)),
        *({"speed": v, "terrain": "wall of 80 deg", "youngs_modulus": e} for v, e in ((10.0, 1e7), (30.0, 1e8), (100.0, 1e9))),
    ),
    "coordinates": tuple({"origin": o} for o in ((2.627e6, 5.14e6), (-5e5, -5e6))),
    "precision": ({"precision": "float64"},),
    "substeps": (
        *({"substeps": k} for k in (1, 2, 16, 64)),
        {"substeps": 64, "cfl": 0.1, "speed": 20.0, "terrain": "ramp"},
        {"substeps": 64, **FAST_AND_THIN},
        {"substeps": 64, "speed": 30.0, "terrain": "wall of 80 deg", "youngs_modulus": 1e8},
        {"substeps": 16, "terrain": "step down in one cell", **PASSAGE},
        {"substeps": 64, "slope": 10.0, "elastic": True, "rests": True, "steps": 2000},
    ),
    "rest": (
        {"slope": 10.0, "elastic": True, "rests": True, "steps": 2000},
        {"slope": 10.0, "thickness": 0.5, "friction_angle": 45.0, "rests": True, "steps": 20000},
    ),
}
PINNED: tuple[dict[str, Any], ...] = (
    {},
    {"cfl": 0.6},
    {"cfl": 0.61},
    {"youngs_modulus": 1e9},
    {"friction_angle": 0.0, "cohesion": 1e3},
    {"friction_angle": 0.0},
    {"per_cell": (1, 1, 1)},
    {"per_cell": (4, 4, 4), "thickness": 1.0},
    {"h": 1e-3},
    {"h": 400.0, "youngs_modulus": 4e9},
    {"flatness": 0.5},
    {"terrain": "bumps"},
    {"terrain": "cliff of 80 deg"},
    {"terrain": "step down in one cell"},
    {"terrain": "step down in one cell", **PASSAGE},
    {"terrain": "edge"},
    {"terrain": "unknown cells"},
    {"terrain": "cells of -9999"},
    {"thickness": 0.25},
    {"keep": 1},
    {"speed": 100.0, "terrain": "ramp", "youngs_modulus": 1e8},
    {"origin": (2.627e6, 5.14e6)},
    {"pore_ratio": 0.97, "terrain": "bumps"},
    {"pore_blocks": (0.0, 0.97, 2.0), "saturation": 1.0, "decay_time": 0.1},
    {"pore_ratio": 0.98},
    eroding(*FIERCE, terrain="bumps"),
    eroding("jump", (("most", 10.0),), pore_ratio=0.9, bed_ratio=0.97),
    eroding(bed_ratio=0.98),
    {"inflow_thickness": 2.0, "terrain": "bumps"},
    {"inflow_thickness": 1.0, "inflow_over": "polygon"},
    {"inflow_thickness": 1.0, "inflow_speed": 201.0},
    {"substeps": 1},
    {"substeps": 16},
    {"substeps": 64, **FAST_AND_THIN},
    {"slope": 10.0, "elastic": True, "rests": True, "steps": 1000},
)


def one_at_a_time() -> Iterator[tuple[str, Layout]]:
    """Each setting over its range, all others at their defaults."""
    for axis, choices in AXES.items():
        for choice in choices:
            yield axis, Layout(**choice)


def pinned() -> Iterator[tuple[str, Layout]]:
    """The fixed set for CI."""
    for choice in PINNED:
        yield named(choice), Layout(**choice)


def sampled(count: int = SAMPLES) -> Iterator[tuple[str, Layout]]:
    """All settings together, by Latin hypercube with a fixed seed."""
    points = qmc.LatinHypercube(14, rng=np.random.default_rng(SEED)).random(count)
    for k, u in enumerate(points):
        yield f"sample {k}", _from_unit(u)


def named(choice: dict[str, Any]) -> str:
    """Text of the changes of a layout."""
    return ", ".join(f"{name} = {value}" for name, value in choice.items()) or "as it is"


def _wet_and_eroding(u: np.ndarray, h: float) -> dict[str, Any]:
    """Pore pressure of every second sample on cells of ``h`` [m], and a bed of every second: from the sixteenths of the axes."""
    v = u * 16.0 % 1.0
    wet, bed = v[2] < 0.5, v[3] < 0.5
    laws = (FIERCE, ("growth", (("growth_rate", v[4]),)), ("energy", ()), ("jump", (("most", 10.0 * v[4]),)))
    pores: dict[str, Any] = {"saturation": float(v[6]), **({"decay_time": 10.0 ** (4.0 * v[7] - 2.0)} if v[8] < 0.5 else {})}
    blocks = max(2.0, 1.01 * LIMITS["pore_pressure_block"].low / h)  # [cells]
    pores |= {"pore_blocks": (0.0, 0.97, blocks)} if v[5] < 0.3 else {"pore_ratio": 0.97 * v[5]}
    law, numbers = laws[int(v[9] * 4)]
    beds = {"bed_depth": 0.05 * 80.0 ** v[10], "erosion": law, "erosion_numbers": numbers, "bed_ratio": 0.97 * v[11]}
    return (pores if wet else {}) | (beds if bed else {})


def _from_unit(u: np.ndarray) -> Layout:
    terrains = [t for t in TERRAINS if not t.startswith(("unknown", "cells of"))]
    per_cell = tuple(int(k) for k in np.floor(1.0 + 3.0 * u[5:8]))
    thickness = 0.25 * 16.0 ** u[12]
    h = min(10.0 ** (-3.0 + 6.0 * u[8]), LIMITS["thickness"].high / thickness)
    layout = Layout(
        cfl=0.1 + 0.5 * u[0],
        youngs_modulus=10.0 ** (4.0 + 5.0 * u[1]),
        poisson_ratio=0.45 * u[2],
        friction_angle=max(60.0 * u[3], SMALLEST_ANGLE),
        cohesion=0.0 if u[4] < 0.4 else 10.0 ** (10.0 * (u[4] - 0.4)),
        per_cell=(per_cell[0], per_cell[1], per_cell[2]),
        h=h,
        terrain=terrains[int(u[9] * len(terrains))],
        slope=60.0 * u[10],
        basal=max(60.0 * u[11], SMALLEST_ANGLE),
        thickness=thickness,
        flatness=0.5 + 0.5 * u[13],
        precision="float32" if u[0] * 16 % 1 < 0.5 else "float64",
        substeps=(1, 4, 16, 64)[int(u[1] * 16 % 1 * 4)],
        **_wet_and_eroding(u, h),
    )
    volume = 64 * np.prod(per_cell) * layout.thickness / layout.flatness
    return layout if volume <= LARGEST else replace(layout, per_cell=(1, 1, 1))
