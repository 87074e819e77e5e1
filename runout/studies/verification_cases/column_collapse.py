"""F4, F5: collapse of columns of grains: run-out laws of experiments, and the aluminium rods of Bui et al. 2008.

A wall is the mirror image of the column. The floor of the rods holds what touches it, as do glued grains.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from runout.materials.drucker_prager import Cone, DruckerPrager
from runout.model.particles import Particles
from runout.physics.geostatic import acting_friction
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.bodies import filled, lattice
from runout.studies.verification_cases.closed_forms import GRAVITY, axisymmetric_height, axisymmetric_runout
from runout.studies.verification_cases.dam_breaks import budget, columns
from runout.studies.verification_cases.finding import Bound, Case, Result
from runout.studies.verification_cases.flow import Frame

RODS = DruckerPrager(density=2650.0, youngs_modulus=0.84e6, poisson_ratio=0.3, friction_angle=19.8)
LENGTH, HEIGHT = 0.2, 0.1  # [m] of the rods
NO_SLIP = 10.0  # friction coefficient of a floor to which grains stick
AT_REST = RODS.poisson_ratio / (1 - RODS.poisson_ratio)
SURFACE = "bui2008_final_surface.csv"
SCATTER = 0.25  # of experiments on run-out
REPOSE, FLOOR = 30.0, 30.0  # [deg] internal friction, and that of the floor where the sand hands so much on (:func:`held_by`)
CONTROL = 65.0  # [deg] internal friction of the negative control
WALLED = 8.0  # [m] initial length or radius of the columns of sand
CLAIMED = 1.1, 0.9  # most and least volume that particles may claim by their strains over the space that they have
AT_REST_AFTER = 5.0  # [sqrt(H/g)]; after 3.5 the outermost percent still slides at 1 to 3 m/s


def rods(
    spacing: float, time: float, samples: int, threads: int = 1, transfer: Mapping[str, Any] | None = None
) -> tuple[Frame, np.ndarray, np.ndarray]:
    """Frame of the rods at ``time`` [s], distance from the wall [m] and thickness [m], mean of both sides, of the columns.

    ``transfer`` are choices of the scene besides the usual ones.
    """
    wide = 1.2
    scene = replace(flow.level_scene(spacing, (wide, 0.0), RODS, NO_SLIP), **(transfer or {}))
    plane = flow.rectangle(2 * LENGTH, HEIGHT, spacing, wide / 2 - LENGTH)
    p = flow.slice_of(plane, spacing**3 / 4, scene)
    flow.press(p, np.tile(HEIGHT - plane[:, 1], flow.ACROSS), scene, AT_REST)
    frame = flow.run(scene, p, (time,), samples, threads)[-1]
    x, thickness = columns(scene) - wide / 2, frame.thickness[0]
    return frame, x[x > 0], 0.5 * (thickness + thickness[::-1])[x > 0]


def measured_surface() -> np.ndarray | None:
    """Final surface (n, 2) [m] of the experiment, None where the data are not at hand (RUNOUT_DATA)."""
    path = Path(os.environ.get("RUNOUT_DATA", ".")) / SURFACE
    if not path.is_file():
        return None
    return np.array([row.split(",") for row in path.read_text().splitlines() if row[:1].isdigit()], float)


def measure_rods(full: bool) -> list[Result]:
    """Surface against the experiment at 10 mm; in full at 5 mm, with the energy budget."""
    experiment = measured_surface()
    spacing = 0.005 if full else 0.01
    frame, x, thickness = rods(spacing, 1.0 if full else 0.7, 320 if full else 1, 2 if full else 1)
    name = f"h = {1e3 * spacing:g} mm"
    speed = np.abs(frame.particles.velocity).max()
    order = np.sort(np.abs(frame.particles.position(np.full(3, spacing))[:, 0] - 0.6))
    results: list[Result] = [
        Bound(f"front of 99 % of the mass [m], {name}", float(order[int(0.99 * len(order))]), 0.42, 0.3),
        Bound(f"largest speed at the end [m/s], {name}", float(speed), 0.05),
    ]
    if experiment is not None:
        error = float(np.sqrt(np.mean((np.interp(experiment[:, 0], x, thickness) - experiment[:, 1]) ** 2)))
        results.insert(0, Bound(f"surface, RMS against the experiment [mm], {name}", 1e3 * error, 3.0 if full else 5.0))
    return results + (budget(frame, name) if full else [])


def sand(aspect: float, friction_angle: float, cone: Cone = Cone.PLANE_STRAIN) -> DruckerPrager:
    """Sand of which a column of :data:`WALLED` times ``aspect`` strains its foot by 1.5 percent; friction angle in degrees."""
    modulus = 8e6 * max(aspect, 1.0) * WALLED / 8.0
    return DruckerPrager(density=2000.0, youngs_modulus=modulus, poisson_ratio=0.3, friction_angle=friction_angle, cone=cone)


def in_compression(friction_angle: float) -> float:
    """Friction angle [deg] in triaxial compression of the cone that has ``friction_angle`` [deg] in plane strain."""
    slope = np.sqrt(3.0) * np.sin(np.radians(friction_angle))
    return float(np.degrees(np.arcsin(3 * slope / (6 + slope))))


def held_by(material: DruckerPrager, floor: float = FLOOR) -> float:
    """Friction coefficient [1] of a floor of so many degrees, or that of the sand in simple shear where this is less.

    Isochoric sand at yield has equal normal stresses, and no more than M/sqrt(3) of them as shear: sin(phi) with the cone of plane
    strain. A stronger floor changes nothing where the flow is resolved; a flow one cell deep cannot shear and gets all of it.
    """
    return acting_friction(float(np.tan(np.radians(floor))), material.shear_strength(np.inf))


def planar(aspect: float, cells: int, material: DruckerPrager | None = None, samples: int = 1) -> tuple[float, Frame]:
    """Run-out of 99 % of a column between walls over its length [1], and its last frame; sand of :data:`REPOSE` by default."""
    h, height = WALLED / cells, aspect * WALLED
    half = np.ceil((WALLED * (2.5 + 3.0 * aspect)) / h) * h
    material = material or sand(aspect, REPOSE)
    scene = flow.level_scene(h, (2 * half, 0.0), material, held_by(material))
    plane = flow.rectangle(2 * WALLED, height, h, half - WALLED)
    p = flow.slice_of(plane, h**3 / 4, scene)
    flow.press(p, np.tile(height - plane[:, 1], flow.ACROSS), scene, AT_REST)
    frame = flow.run(scene, p, (AT_REST_AFTER * float(np.sqrt(height / GRAVITY)),), samples)[-1]
    away = np.abs(frame.particles.position(np.full(3, h))[:, 0] - half)
    return float(np.quantile(away, 0.99) / WALLED - 1), frame


@dataclass(frozen=True)
class Deposit:
    """Deposit of a round column."""

    runout: float  # (R_99 - R_0)/R_0 of 99 % of the mass [1]
    height: float  # thickness over R_0 within a quarter of the radius [1]: mass over area and density, as in maps
    # volume that the particles of the core claim by their strains, over the space there is [1]. The core reaches to half the radius
    # and half the height: a lattice that has been stretched stands in strings more than a cell apart, and there must be enough of
    # them
    claimed: float


def deposit(p: Particles, x: np.ndarray, density: float) -> Deposit:
    """Deposit of particles at positions ``x`` (n, 3) [m] relative to axis and floor."""
    away, volume = np.hypot(x[:, 0], x[:, 1]), p.mass / density
    height = float(volume[away < WALLED / 4].sum() / (np.pi * (WALLED / 4) ** 2))
    core = (away < WALLED / 2) & (x[:, 2] < height / 2)
    now = volume[core] * np.exp(p.history[core] + p.strain[core, :3].sum(axis=1) / 2)  # small elastic strain: tr B = 2 ln J
    claimed = float(now.sum() / (np.pi * (WALLED / 2) ** 2 * height / 2))
    return Deposit(float(np.quantile(away, 0.99) / WALLED - 1), height / WALLED, claimed)


def round_column(
    aspect: float,
    cells: int,
    cone: Cone,
    precision: str = "float64",
    choices: Mapping[str, Any] | None = None,
    friction_angle: float = REPOSE,
) -> Deposit:
    """Deposit of a round column of sand with so many cells in its radius; ``friction_angle`` [deg] of its inside.

    ``choices`` of the scene besides the usual ones: another transfer, or another ``friction`` of the floor.
    """
    h, height = WALLED / cells, aspect * WALLED
    half, material = np.ceil((WALLED * (2.5 + 2.0 * aspect)) / h) * h, sand(aspect, friction_angle, cone)
    scene = flow.level_scene(h, (2 * half, 2 * half), material, held_by(material), precision=precision)
    scene = replace(scene, **(choices or {}))
    local = lattice((2 * WALLED, 2 * WALLED, height), h) - (WALLED, WALLED, 0.0)
    local = local[np.hypot(local[:, 0], local[:, 1]) < WALLED]
    centre = np.array([half + 0.13 * h, half + 0.27 * h, flow.BASE * h])
    p = filled(local + centre, h, material.density, h**3 / 8, h / 4)
    flow.press(p, height - local[:, 2], scene, AT_REST)
    p = flow.run(scene, p, (AT_REST_AFTER * float(np.sqrt(height / GRAVITY)),), 1)[-1].particles
    return deposit(p, p.position(np.full(3, h)) - centre, material.density)


def planar_envelope(aspect: float) -> tuple[float, float]:
    """Least and largest run-out of experiments in channels, with their scatter.

    Lube, Huppert, Sparks & Freundt 2005, Phys. Rev. E 72:041301, 1.2 a up to 1.8 and 1.9 a^(2/3) from 2.8 on; above, Lajeunesse,
    Monnier & Homsy 2005, Phys. Fluids 17:103302, 1.8 a up to 3 and 2.3 a^(2/3), prefactors at second hand.
    """
    share = float(np.clip(aspect - 1.8, 0.0, 1.0))
    least = (1 - share) * 1.2 * aspect + share * 1.9 * aspect ** (2 / 3)
    most = 1.8 * aspect if aspect < 3 else 2.3 * aspect ** (2 / 3)
    return least * (1 - SCATTER), most * (1 + SCATTER)


def exponent(aspects: tuple[float, ...], runouts: list[float]) -> float:
    """Least-squares slope of log run-out over log aspect ratio."""
    return float(np.polyfit(np.log(aspects), np.log(runouts), 1)[0])


def measure_planar(full: bool) -> list[Result]:
    """Run-out of planar columns in the envelope of experiments, monotone; sand that is too strong must fall out of it."""
    chosen = (
        ((0.5, 32), (1.0, 16), (2.0, 16), (3.0, 16), (4.0, 16), (6.0, 16), (8.0, 16)) if full else ((1.0, 16), (2.0, 8), (4.0, 8))
    )
    runs = {aspect: planar(aspect, cells, samples=120 if aspect == 2 else 1) for aspect, cells in chosen}
    deposits = {aspect: run[0] for aspect, run in runs.items()}
    results: list[Result] = []
    for aspect, cells in chosen:
        low, high = planar_envelope(aspect)
        results.append(Bound(f"run-out of a planar column, a = {aspect:g}, {cells} cells long", deposits[aspect], high, low))
    runouts = list(deposits.values())
    results.append(Bound("least growth of run-out from one planar column to the next", float(np.diff(runouts).min()), low=0.0))
    if full:
        for tall in ((3.0, 4.0, 6.0), (4.0, 6.0, 8.0)):
            slope = exponent(tall, [deposits[a] for a in tall])
            name = f"exponent of planar run-out, a = {tall[0]:g} to {tall[-1]:g}"
            results.append(Bound(name, slope, 2 / 3 + 0.1, 2 / 3 - 0.1))
    results += budget(runs[2.0][1], "planar column, a = 2")
    low, _ = planar_envelope(2.0)
    strong = planar(2.0, 8, sand(2.0, in_compression(CONTROL), Cone.TRIAXIAL_COMPRESSION))[0]
    control = f"run-out of sand of {CONTROL:g} deg (negative control) over the least of the envelope"
    results.append(Bound(control, strong / low, 0.95))
    return results


def measure_round(full: bool) -> list[Result]:
    """Round columns with both cones, between which the laws of experiments lie; the CI tests of collapse cover them at one size."""
    if not full:
        return []
    results, deposits = list[Result](), dict[tuple[float, Cone], Deposit]()
    for aspect, cells in ((1.0, 16), (2.0, 12), (4.0, 12)):  # with 8 the edge of a low one is thinner than a cell
        law, top = axisymmetric_runout(aspect), axisymmetric_height(aspect)
        for cone, weak in ((Cone.PLANE_STRAIN, True), (Cone.TRIAXIAL_COMPRESSION, False)):
            place = f"a = {aspect:g}, {cells} cells in the radius, cone of {cone.replace('_', ' ')}"
            end = deposits[aspect, cone] = round_column(aspect, cells, cone)
            far = {"low": 1 - SCATTER} if weak else {"high": 1 + SCATTER}
            tall = {"high": 1 + SCATTER} if weak else {"low": 1 - SCATTER}
            results.append(Bound(f"run-out of a round column over the law, {place}", end.runout / law, **far))
            results.append(Bound(f"height of a round column over the law, {place}", end.height / top, **tall))
            results.append(Bound(f"volume that the core's strains claim over its space, {place}", end.claimed, *CLAIMED))
    higher = round_column(8.0, 12, Cone.PLANE_STRAIN)
    results.append(Bound("volume that the core's strains claim over its space, a = 8", higher.claimed, *CLAIMED))
    slope = exponent((4.0, 8.0), [deposits[4.0, Cone.PLANE_STRAIN].runout, higher.runout])
    results.append(Bound("exponent of round run-out, a = 4 to 8, 12 cells in the radius", slope, 0.6, 0.4))
    return results


COLUMNS = Case(
    "F4",
    "collapse of columns of sand",
    f"internal friction {REPOSE:g} deg, floor {FLOOR:g} deg or what the sand hands on, E = 8 MPa or more, {WALLED:g} m, until "
    "all rests; run-out (L_99 - L_0)/L_0 of 99 % of the mass against the envelope of experiments with a scatter of 25 %; round "
    "columns in the full size only, against Lube et al. 2004 (run-out) and Lajeunesse et al. 2004 (height: mass over area and "
    "density, as in maps)",
    lambda full: [*measure_planar(full), *measure_round(full)],
    "Run-out falls short of its limit by about ten cells, whatever the height of the column: the edge is thinner than a cell, "
    "moves as one with its friction on the floor, and is held by the numerical viscosity; more particles (27 a cell) or a "
    "stiffer sand do not help. A low column loses a larger share of its way (over a floor of tan 30, 0.24, 0.33 and 0.50 "
    "lengths at a = 0.5 with 8, 16 and 32 cells), so that exponents come out too high on coarse grids. That of round run-out "
    "from a = 4 to 8 is 0.63, 0.61 and 0.58 with 6, 8 and 12 cells in the radius, and 0.54 where the straight line in h through "
    "the last two ends. It was 0.66 here with 8 cells and a floor of tan 30, which is more than such sand hands on: in simple "
    "shear at yield it has sin 30 of its pressure as shear, and no floor is stronger than that now. Between walls the exponent "
    "from a = 3 to 6 was 0.77 for the same reason. Friction mu(I), other measures of the run-out and more particles do not "
    "bring it down (docs/decisions/13-laws-and-their-verification.md). "
    "A round column shows what a Drucker-Prager cone cannot be: one of 30 degrees in plane strain, "
    "in which the thin flow shears, is one of 22 degrees in triaxial compression, in which the core fails, and one of 30 "
    "degrees there is one of 44 in plane strain. So the runs with both cones have to enclose the experiments, within their "
    "scatter; the weaker one overruns them the more, the better it is resolved. With the stronger one the exponent is 0.72 (8 "
    "cells, floor of tan 30). The core of a tall column was held to be 1.4 times as dense as its particles know; that was four "
    "strings of particles in four cells about the axis. Within half the radius and half the height they have the space that "
    "they claim. The negative control is the cone of 65 degrees in plane strain, which is that of 38.5 in triaxial compression.",
)
BUI = Case(
    "F5",
    "aluminium rods (Bui et al. 2008)",
    "plane strain, 0.2 m x 0.1 m, 2650 kg/m3, phi = 19.8 deg, E = 0.84 MPa, nu = 0.3, floor that holds, wall as mirror image; "
    "thickness from the mass over each cell, at the 23 places of the experiment",
    measure_rods,
    "The surface is compared where RUNOUT_DATA names the folder of the digitised experiment. The front bound is that of the "
    "experiment and coarser.",
)
