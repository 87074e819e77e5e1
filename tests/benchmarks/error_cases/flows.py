"""F3, F5 and real terrain: flows of sand against a closed form, an experiment and a finer grid."""

import time
from dataclasses import replace
from functools import cache

import numpy as np

from runout.forecast.accuracy import chosen_cell_size
from runout.model.limits import CFL
from runout.release.arrangement import particles_for
from runout.simulation.result import Result
from runout.simulation.single import simulate
from runout.studies.convergence import quantities, relative_l1
from runout.studies.verification_cases import column_collapse, flow, spreading_cap
from runout.studies.verification_cases.dam_breaks import as_one, columns, relative
from tests.benchmarks.error_cases.choice import BASE, March, Outcome, Variation
from tests.benchmarks.error_cases.terrains import SITE, site_arguments

MATERIAL = ("wave_ratio", "weight_strain")  # what a variation changes of the material
Reference = tuple[str, float] | float  # preset and how much larger its cells are, or the size of a cell [m]
MAP = "max_flow_thickness"
RODS_TIME = 0.7  # [s], when the rods are at rest
SLICE = (0, flow.ACROSS, 0)  # [cells] after which the grid of a slice repeats


def strip(cells: int, v: Variation) -> Outcome:
    """Relative L2 of thickness of the spreading strip after 5 s (earth pressure of one); value: its front [m]."""
    scene, p, cap = spreading_cap.strip(spreading_cap.HEIGHT / cells, as_one(spreading_cap.BED), 1.0, v.per_axis, v.particles[2])
    march = March(scene, p, v, SLICE)
    march.until(spreading_cap.END)
    x = columns(scene) - spreading_cap.START
    thickness = march.engine.columns().volume[0] / (scene.spacing[0] * flow.ACROSS * scene.spacing[1])
    exact = cap.thickness(x, np.zeros(1), spreading_cap.END)
    front = np.quantile(march.positions()[:, 0], 0.99) - spreading_cap.START
    return march.outcome(relative(thickness, exact, 2), float(front))


def rods(cells: int, v: Variation) -> Outcome:
    """RMS of the aluminium rods' surface against the experiment over their first height; value: front of 99 % [m]."""
    experiment = column_collapse.measured_surface()
    if experiment is None:
        raise FileNotFoundError("the digitised experiment is in no folder that RUNOUT_DATA names")
    wide = 1.2
    along, _, up = v.particles if v.upwards else particles_for(cells, 0.0, column_collapse.RODS.internal_friction)
    h = column_collapse.HEIGHT / cells
    scene = flow.level_scene(h, (wide, 0.0), column_collapse.RODS, column_collapse.NO_SLIP)
    places = wide / 2 + (np.arange(round(2 * column_collapse.LENGTH * along / h)) + 0.5) * h / along - column_collapse.LENGTH
    p, depth = flow.staggered(places, np.full(len(places), column_collapse.HEIGHT), h / along, h / up, scene)
    flow.press(p, depth, scene, column_collapse.AT_REST)
    march = March(scene, p, v, SLICE)
    march.until(RODS_TIME)
    x, thickness = columns(scene) - wide / 2, march.engine.columns().volume[0] / (flow.ACROSS * h**2)
    thickness = 0.5 * (thickness + thickness[::-1])
    off = np.interp(experiment[:, 0], x[x > 0], thickness[x > 0]) - experiment[:, 1]
    front = np.quantile(np.abs(march.positions()[:, 0] - wide / 2), 0.99)
    return march.outcome(np.sqrt(np.mean(off**2)) / column_collapse.HEIGHT, float(front))


def flowed(cell: float, v: Variation, site: str = SITE) -> tuple[Result, float, float]:
    """Run of a site with cells of ``cell`` [m], its processor time without setup [s], and its wall time in all [s]."""
    changed = {name: value for name, value in v.arguments.items() if name not in ("flat", *MATERIAL)}
    high = cell / v.arguments.get("flat", 1.0)
    particles = None if v.upwards is None else v.particles
    settings = {"particles_per_cell": particles, "backend": v.backend, "device": "cpu", **v.scene, **changed}
    stiffness = {name: value for name, value in v.arguments.items() if name in MATERIAL}
    settings |= {"material": replace(site_arguments(site)["material"], **stiffness)} if stiffness else {}
    arguments = {**site_arguments(site), "cell_size": (cell, cell, high), **settings}
    started, processor = time.perf_counter(), time.process_time()
    result = simulate(**arguments)
    wall, processor = time.perf_counter() - started, time.process_time() - processor
    return result, processor * (1 - result.timing["setup"] / wall), wall


@cache
def at_preset(name: str, coarser: float = 1.0, site: str = SITE) -> tuple[Result, float, float]:
    """:func:`flowed` with the cells of a preset of accuracy, ``coarser`` times as large."""
    return flowed(coarser * chosen_cell_size(name, site_arguments(site)["release"]), Variation(name, scene={"cfl": CFL}), site)


@cache
def at_reference(reference: Reference, site: str = SITE) -> Result:
    """The run that errors are measured from, with the choices of the defaults."""
    return at_preset(*reference, site)[0] if isinstance(reference, tuple) else flowed(reference, BASE, site)[0]


def distance(one: Result, other: Result) -> float:
    """Relative L1 distance of two maps of flow thickness."""
    return relative_l1(one.fields[MAP], other.fields[MAP])


def runout_of(result: Result, site: str = SITE) -> float:
    """Run-out of 99 % of the mass [m]."""
    return quantities(result, site_arguments(site)["release"], ())["f99"]


def terrain(cell: float, v: Variation, reference: Reference, site: str = SITE) -> Outcome:
    """Relative L1 of the map of flow thickness against that of a finer run (:func:`at_reference`); value: run-out of 99 % [m]."""
    result, seconds, wall = flowed(cell, v, site)
    error, front = distance(result, at_reference(reference, site)), runout_of(result, site)
    series, setup = result.series, result.timing["setup"]
    work = (result.n_particles, result.steps, result.n_particles * result.steps, int(np.max(series["active_blocks"])))
    return Outcome(error, front, *work, seconds, wall - setup, setup, float("nan"))
