"""inflow: a steady discharge of a Voellmy fluid at a line on a slope; thickness and speed of the flow, its front, and its volume.

A steady discharge q by width becomes as thick as friction lets it,

    H = (q^2/(xi (sin - mu cos)))^(1/3),    u = q/H.

Its front goes as fast as the flow. In the frame of the front the thickness h(s) behind it obeys dh/ds = a (1 - h_n/h)/k with
a = tan(slope) - mu and k the lateral over the normal stress, so that the volume that is missing at the front is that of a uniform
flow over k H/(2 a): the front is at u t + k H/(2 a).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from runout.backends.protocol import get_backend
from runout.friction.voellmy import Voellmy
from runout.materials.drucker_prager import DruckerPrager
from runout.model.inflow import Hydrograph, Inflow
from runout.model.particles import Particles
from runout.model.terrain import Terrain
from runout.simulation.entering import Entering
from runout.simulation.inflow import source_of
from runout.simulation.run import Run, RunControl
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.closed_forms import GRAVITY
from runout.studies.verification_cases.finding import Bound, Case, Result

SLOPE_DEG, MU, THICKNESS, FROUDE = 20.0, 0.15, 1.0, 1.5  # H [m], u/sqrt(g H cos(slope)) [1]
SLOPE = math.radians(SLOPE_DEG)
SPEED = FROUDE * math.sqrt(GRAVITY * math.cos(SLOPE) * THICKNESS)  # [m/s]
DISCHARGE = SPEED * THICKNESS  # [m2/s]
XI = SPEED**2 / (THICKNESS * (math.sin(SLOPE) - MU * math.cos(SLOPE)))  # [m/s2]
LINE = 4.0  # [m] from the western edge
SAND = DruckerPrager(density=1800.0, youngs_modulus=2e6, poisson_ratio=0.25, friction_angle=35.0)
PER_CELL = (2, 2, 4)
LASTING = 0.9  # share of the time of a run in which mass enters, so that all of it has entered at the end


def steady_thickness(discharge: float) -> float:
    """Thickness [m] of a steady flow with a ``discharge`` by width [m2/s]."""
    return float((discharge**2 / (XI * (math.sin(SLOPE) - MU * math.cos(SLOPE)))) ** (1.0 / 3.0))


def front(time: float, lateral: float) -> float:
    """Distance [m] of the front from the line after a ``time`` [s]; ``lateral``: stress along the ground over that normal to it."""
    return SPEED * time + lateral * THICKNESS / (2.0 * (math.tan(SLOPE) - MU))


@dataclass
class Flume:
    """A slice of a wide slope, on which a steady discharge enters at a line."""

    # spacing, time: of the grid [m]; how long the flow lasts [s]
    spacing: float
    time: float
    stated: float = THICKNESS  # thickness [m] that the inflow states; its speed follows from the discharge

    @property
    def width(self) -> float:
        """Of the slice [m]."""
        return flow.ACROSS * self.spacing

    @cached_property
    def run(self) -> Run:
        """The run at its end."""
        h, length = self.spacing, 16.0 + SPEED * self.time
        scene = flow.level_scene(h, (length, 0.0), SAND, Voellmy(mu=MU, xi=XI), SLOPE_DEG)  # type: ignore[arg-type]
        hydrograph = Hydrograph([0.0, LASTING * self.time], [DISCHARGE * self.width] * 2)
        terrain = Terrain.from_array(np.zeros((3, round(length / h))), (h, h))
        sides = [(LINE, (flow.ACROSS + 0.5) * h), (LINE, 0.5 * h)]
        inflow = Inflow(terrain, hydrograph, line=sides, thickness=self.stated)
        source = source_of(inflow, 0, scene.spacing, PER_CELL, self.time)
        engine: Any = get_backend("scan", threads=1, index="dense")
        engine.period = (0, flow.ACROSS, 0)
        run = Run(engine, scene, RunControl(self.time, stop=False, crop=False), None, None, None, None, Entering([source]))
        run.start(Particles.zeros(0))
        run.go()
        return run

    def middle(self) -> tuple[float, float]:
        """Thickness [m] and speed [m/s] of the flow from a quarter to a half of the way that it has gone."""
        p = self.run.engine.particles()
        x = p.position(np.full(3, self.spacing))[:, 0] - LINE
        low, high = (self.spacing * round(share * SPEED * self.time / self.spacing) for share in (0.25, 0.5))
        inside = (x >= low) & (x < high)
        mass = p.mass[inside].sum()
        thickness = mass / SAND.density / ((high - low) * self.width)
        return float(thickness), float(p.mass[inside] @ p.velocity[inside, 0] / mass)

    def front(self) -> float:
        """Distance [m] of the foremost of the particles from the line."""
        return float(self.run.engine.particles().position(np.full(3, self.spacing))[:, 0].max()) - LINE

    def unbooked(self) -> float:
        """Largest part of the mass that is neither there, nor gone, nor entered [1]."""
        s = self.run.ledger.series()
        return float(np.abs(s["mass"] + s["escaped_mass"] - s["entered_mass"]).max() / s["entered_mass"][-1])

    def volume(self) -> float:
        """Volume [m3] that has entered."""
        return float(self.run.ledger.series()["entered_mass"][-1]) / SAND.density


def steady_flow(flume: Flume, name: str) -> list[Result]:
    """Errors of thickness, speed and front of the steady flow in a flume."""
    thickness, speed = flume.middle()
    return [
        Bound(f"thickness over the closed form, {name}", thickness / steady_thickness(DISCHARGE), 1.02, 0.98),
        Bound(f"speed over the closed form, {name}", speed / SPEED, 1.02, 0.98),
        Bound(f"way of the front over the closed form, {name}", flume.front() / front(flume.time, SAND.rest_ratio), 1.04, 0.97),
        Bound(f"mass that is not booked, {name}", flume.unbooked(), 1e-12),
    ]


def measure(full: bool) -> list[Result]:
    """Two cells through the flow, in full four and a longer flow, and an inflow that states another thickness."""
    results: list[Result] = []
    for cells, time in ((2, 8.0), (4, 8.0)) if full else ((2, 4.0),):
        flume = Flume(THICKNESS / cells, time)
        results += steady_flow(flume, f"{cells} cells")
        exact = DISCHARGE * flume.width * LASTING * time
        results.append(Bound(f"relative error of the volume, {cells} cells", flume.volume() / exact - 1.0, 1e-12, -1e-12))
    if full:
        thickness, speed = (
            measured / exact for measured, exact in zip(Flume(0.5, 12.0, 1.4).middle(), (THICKNESS, SPEED), strict=True)
        )
        results.append(Bound("thickness over the closed form, an inflow of 1.4 times the thickness", thickness, 1.02, 0.98))
        results.append(Bound("speed over the closed form, an inflow of 1.4 times the thickness", speed, 1.02, 0.98))
    return results


CASE = Case(
    "inflow",
    "steady discharge at a line",
    f"Voellmy fluid, mu = {MU:g}, xi = {XI:.0f} m/s2, {DISCHARGE:.2f} m2/s down a slope of {SLOPE_DEG:g} deg: uniform thickness "
    f"{THICKNESS:g} m, Froude number {FROUDE:g}",
    measure,
)
