"""Closed forms of depth-averaged flow, which a flow in space approaches as it grows long; SI units, slopes in degrees."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from runout.studies.verification_cases.closed_forms import GRAVITY


def dam_break(
    x: np.ndarray, time: float, depth: float, slope_deg: float = 0.0, friction_deg: float = 0.0, pressure: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Thickness [m] and speed [m/s] at x (n,) [m] of a slab x < 0 of thickness ``depth`` that was let go, on a Coulomb bed.

    Mangeney, Heinrich & Roche 2000, Pure Appl. Geophys. 157:1081, eq. 24 to 26; without slope and friction Ritter 1892.
    ``pressure``: stress along the bed over that normal to it (:func:`earth_pressure`).
    """
    slope = np.radians(slope_deg)
    weight = GRAVITY * np.cos(slope)
    pull = weight * (np.tan(slope) - np.tan(np.radians(friction_deg)))
    wave = np.sqrt(pressure * weight * depth)
    place = np.asarray(x, float) - 0.5 * pull * time**2
    fan = (place > -wave * time) & (place < 2 * wave * time)
    thickness = np.where(place <= -wave * time, depth, np.where(fan, (2 * wave - place / time) ** 2 / (9 * wave**2) * depth, 0.0))
    return thickness, np.where(fan, 2 / 3 * (place / time + wave), 0.0) + pull * time * (thickness > 0)


def earth_pressure(internal_deg: float, friction_deg: float) -> float:
    """Stress along the bed over that normal to it [1] of a mass that slides and spreads at yield; one where sin phi = tan delta.

    Savage & Hutter 1989, J. Fluid Mech. 199:177, eq. 2.16, active.
    """
    c, t = np.cos(np.radians(internal_deg)) ** 2, np.tan(np.radians(friction_deg)) ** 2
    return float(2 * (1 - np.sqrt(1 - c * (1 + t))) / c - 1)


def wet_dam_break(x: np.ndarray, time: float, depth: float, wet_depth: float) -> np.ndarray:
    """Thickness (n,) [m] of a dam break at x = 0 onto water ``wet_depth`` [m] deep; Stoker 1957, Water Waves, sec. 10.8."""
    middle, speed, shock = wet_middle_state(depth, wet_depth)
    wave, x = np.sqrt(GRAVITY * depth), np.asarray(x, float)
    fan = (2 * wave - x / time) ** 2 / (9 * GRAVITY)
    tail = (speed - np.sqrt(GRAVITY * middle)) * time
    return np.where(x <= -wave * time, depth, np.where(x < tail, fan, np.where(x < shock * time, middle, wet_depth)))


def wet_middle_state(depth: float, wet_depth: float) -> tuple[float, float, float]:
    """Thickness [m] and speed [m/s] between rarefaction and shock, and the speed of the shock [m/s]."""

    def mismatch(h: float) -> float:
        shocked = (h - wet_depth) * np.sqrt(GRAVITY * (h + wet_depth) / (2 * h * wet_depth))
        return float(2 * (np.sqrt(GRAVITY * depth) - np.sqrt(GRAVITY * h)) - shocked)

    middle = brentq(mismatch, wet_depth, depth)
    speed = 2 * (np.sqrt(GRAVITY * depth) - np.sqrt(GRAVITY * middle))
    return middle, speed, middle * speed / (middle - wet_depth)


@dataclass(frozen=True)
class SpreadingCap:
    """A parabolic cap of thickness ``height`` [m] that spreads while it slides down a plane with a Coulomb bed.

    Half-lengths ``along`` and ``across`` [m]; a strip of endless width where ``across`` is 0. Hutter, Siegel, Savage & Nohguchi
    1993, Acta Mech. 100:37, sec. 4; h = H/(f g) (1 - (xi/(L g))^2 - (y/(L_y f))^2).
    """

    along: float = 80.0
    across: float = 80.0
    height: float = 4.0
    slope_deg: float = 35.0
    friction_deg: float = 25.0
    pressure: float = 1.0  # stress along the bed over that normal to it
    end: float = 8.0  # [s], of the solution

    @cached_property
    def _solution(self) -> Any:
        slope = np.radians(self.slope_deg)
        drag = np.cos(slope) * np.tan(np.radians(self.friction_deg))
        pull = np.sin(slope) - drag
        push = self.pressure * self.height / self.along * np.cos(slope)
        side = push * (self.along / self.across) ** 2 if self.across else 0.0

        def rates(t: float, y: np.ndarray) -> list[float]:
            g, dg, f, df = y
            return [dg, 2 * push / (g**2 * f), df, 2 * side / (g * f**2) - drag * df / (pull * t)]

        t = 1e-3  # a series spans the 0/0 at the start
        turned = side * pull / np.sin(slope)
        start = [1 + push * t**2, 2 * push * t, 1 + turned * t**2, 2 * turned * t]
        end = max(2 * t, self.end / np.sqrt(self.along / GRAVITY))
        return solve_ivp(rates, (t, end), start, rtol=1e-10, atol=1e-12, dense_output=True).sol

    def _state(self, time: float) -> tuple[float, ...]:
        """Centre [m], stretch along, its rate [1/s], stretch across, its rate [1/s], speed of the centre [m/s]."""
        unit = np.sqrt(self.along / GRAVITY)
        g, dg, f, df = self._solution(max(time / unit, 1e-3))
        slope = np.radians(self.slope_deg)
        pull = GRAVITY * (np.sin(slope) - np.cos(slope) * np.tan(np.radians(self.friction_deg)))
        return 0.5 * pull * time**2, g, dg / unit, f, df / unit, pull * time

    def thickness(self, x: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
        """Thickness [m] normal to the plane at x down the slope from the first centre and y across [m]."""
        centre, g, _, f, _, _ = self._state(time)
        aside = (np.asarray(y) / (self.across * f)) ** 2 if self.across else 0.0
        return np.maximum(self.height / (f * g) * (1 - ((np.asarray(x) - centre) / (self.along * g)) ** 2 - aside), 0.0)

    def speed(self, x: np.ndarray, time: float) -> np.ndarray:
        """Speed [m/s] down the slope at x [m]."""
        centre, g, dg, _, _, speed = self._state(time)
        return speed + (np.asarray(x) - centre) * dg / g

    def reach(self, time: float) -> tuple[float, float, float]:
        """Front, tail and half-width [m]."""
        centre, g, _, f, _, _ = self._state(time)
        return centre + self.along * g, centre - self.along * g, self.across * f
