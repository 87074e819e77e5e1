"""The two cases of ISeeSnow: the runs of each, and the surge of IdealizedTopo in runs that end on the slope.

How far the mass slides and stretches, and its pressure along the flow.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from runout.materials.drucker_prager import DruckerPrager
from runout.model.scene import STANDARD_GRAVITY
from runout.scores import Grid, slope_normal_thickness, values_at
from runout.simulation.result import Result
from runout.studies.validation_cases.case import ValidationCase
from runout.studies.validation_cases.iseesnow import Inputs, Variant, layer_pressure, measure, read

LEVELLED = (2, 2, 12)  # particles per cell: at 5 m four levels through the slab, as by default
ONE_LEVEL = (2, 2, 4)
COARSE = (Variant(10.0, (2, 2, 24)),)
COULOMB_FULL = (
    Variant(5.0, LEVELLED),
    Variant(5.0, LEVELLED, polygon=True),
    Variant(5.0, LEVELLED, polygon=True, same_mass=True),
    Variant(5.0, ONE_LEVEL),
    Variant((5.0, 5.0, 2.5)),
    Variant(2.5),
    Variant(10.0, (2, 2, 24)),
    Variant(10.0, ONE_LEVEL),
)
TOPO_FULL = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(5.0, LEVELLED, polygon=True, drag="column"),
    Variant(5.0, LEVELLED, 40.0, drag="column"),
    Variant(10.0, (2, 2, 24), drag="column"),
    Variant(5.0, LEVELLED, drag="base"),
    Variant(5.0, LEVELLED, 43.0, drag="base"),
)
TOPO_COARSE = (Variant(10.0, (2, 2, 24), drag="column"),)
SURGES = (
    Variant(5.0, LEVELLED, drag="column"),
    Variant(10 / 3, (2, 2, 8), drag="column"),
    Variant((5.0, 5.0, 2.5), (2, 2, 6), drag="column"),
    Variant(5.0, LEVELLED, 24.0, drag="column"),
)

COULOMB_ONLY = ValidationCase(
    "coulomb_only",
    "ISeeSnow CoulombOnly: a slab with Coulomb friction beside 13 tools",
    lambda full: measure("CoulombOnly", COULOMB_FULL if full else COARSE),
)
IDEALIZED_TOPO = ValidationCase(
    "idealized_topo",
    "ISeeSnow IdealizedTopo: a slab with Voellmy friction beside 12 tools",
    lambda full: measure("IdealizedTopo", TOPO_FULL) | measure_surges(SURGES) if full else measure("IdealizedTopo", TOPO_COARSE),
)
START, SLID, STRETCHED = 0.0, 20.0, 60.0  # times [s] of the start, of the way of the mass and of the stretched surge


def measure_surges(variants: Sequence[Variant]) -> dict[str, Any]:
    """``surges``: a row a variant; ``slab``: way in plan [m] of a rigid slab in :data:`SLID`."""
    inputs = read("IdealizedTopo")
    return {"surges": [_surge(inputs, variant) for variant in variants], "slab": slab_way(inputs)}


def _surge(inputs: Inputs, variant: Variant) -> dict[str, Any]:
    """Row of a variant: largest cross-section [m2], way of the median of the mass [m], pressure over the hydrostatic one [1]."""
    looks = {"snapshot_times": (START, SLID, STRETCHED), "snapshot_particles": 10**6}
    result = inputs.simulated(variant, STRETCHED, **looks)
    thickness = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values[-1])
    normal = slope_normal_thickness(thickness, np.nan_to_num(inputs.slope))
    east = [float(np.nanmedian(frame[:, 0])) for frame in result.particle_frames]
    front, rear = pressures_along(result, variant.snow, inputs.slope)
    cells = variant.cell_size if isinstance(variant.cell_size, tuple) else (variant.cell_size,)
    return {
        "cells": [round(size, 2) for size in cells],
        "friction_angle_deg": variant.friction_angle,
        "section": float(normal.sum(axis=0).max()) * inputs.terrain.cell_size[1],
        "way": east[1] - east[0],
        "front_pressure": front,
        "rear_pressure": rear,
        "particles": result.n_particles,
    }


def pressures_along(result: Result, snow: DruckerPrager, slope: np.ndarray) -> tuple[float, float]:
    """Mean pressure towards the east along the ground over the hydrostatic one, of the front and the rear half of the mass."""
    p, east, north = result.state, *(result.particles[name].values for name in ("easting", "northing"))
    angle = values_at(Grid.of(result.terrain), slope, east, north)
    modulus, volume = result.start["youngs_modulus"][0], p.mass / snow.density
    shear, bulk = modulus / (2 + 2 * snow.poisson_ratio), modulus / (3 - 6 * snow.poisson_ratio)
    cosine, sine, strain = np.cos(angle), np.sin(angle), p.strain / 2  # small elastic strain: B = I + 2 e
    along = cosine**2 * strain[:, 0] + sine**2 * strain[:, 2] - 2 * sine * cosine * strain[:, 5]
    change = strain[:, :3].sum(axis=1)
    pressure = -2 * shear * (along - change / 3) - bulk * change
    hydrostatic = layer_pressure(east, north, volume, snow.density) * cosine**2
    eastern = east > np.median(east)
    front, rear = (float((volume * pressure)[half].sum() / (volume * hydrostatic)[half].sum()) for half in (eastern, ~eastern))
    return front, rear


def slab_way(inputs: Inputs) -> float:
    """Way in plan [m] of a rigid slab with Voellmy friction from rest: v^2 ln cosh(a t / v) / a along the slope, v at its end."""
    release = inputs.release(polygon=False).thickness
    angle = float(inputs.slope[release > 0].mean())
    normal = float(slope_normal_thickness(release, np.nan_to_num(inputs.slope))[release > 0].mean())
    surplus = math.sin(angle) - inputs.mu * math.cos(angle)
    fastest, gain = math.sqrt((inputs.xi or math.inf) * normal * surplus), STANDARD_GRAVITY * surplus
    return fastest**2 / gain * math.log(math.cosh(gain * SLID / fastest)) * math.cos(angle)
