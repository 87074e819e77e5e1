"""Pressure in a thin layer at its sides, against that of a column at rest: why thin layers of few particles spread too little."""

import numpy as np

from runout.materials.drucker_prager import DruckerPrager
from runout.model.scene import STANDARD_GRAVITY
from runout.scores import Grid, values_at
from runout.simulation.result import Result

WIDTH, OUTER = 10.0, 0.1  # width of columns [m]; share of the particles that counts as the rim
EARLY = 5.0  # [s], before the slab has left its place


def rim_pressure(result: Result, snow: DruckerPrager, axis: float, slope: np.ndarray) -> float:
    """Mean pressure of the outer tenth of a mass over the hydrostatic one, rho g H cos(slope)^2 / 2 with the thickness H [1].

    Parameters
    ----------
    result : Result
        A run that has just begun.
    snow : DruckerPrager
        Its material; the modulus is that of the run.
    axis : float
        Northing [m] of the line that the mass is symmetric about.
    slope : ndarray (rows, columns)
        Slope of the ground [rad].
    """
    p, terrain = result.state, result.terrain
    bulk = result.start["youngs_modulus"][0] / (3 - 6 * snow.poisson_ratio)
    east, north = (result.particles[name].values for name in ("easting", "northing"))
    volume = p.mass / snow.density
    pressure = -bulk * p.strain[:, :3].sum(axis=1) / 2  # small elastic strain: tr B = 2 ln J
    cosine = np.cos(values_at(Grid.of(terrain), slope, east, north))
    hydrostatic = layer_pressure(east, north, volume, snow.density) * cosine**2
    away = np.abs(north - axis)
    rim = away > np.quantile(away, 1 - OUTER)
    return float((volume * pressure)[rim].sum() / (volume * hydrostatic)[rim].sum())


def layer_pressure(east: np.ndarray, north: np.ndarray, volume: np.ndarray, density: float) -> np.ndarray:
    """Mean hydrostatic pressure [Pa] over the depth, on level ground, of the columns of particles (n,) of a volume [m3]."""
    _, column = np.unique(np.floor(np.column_stack([east, north]) / WIDTH), axis=0, return_inverse=True)
    thickness = np.bincount(column.ravel(), volume)[column.ravel()] / WIDTH**2
    return density * STANDARD_GRAVITY * thickness / 2  # type: ignore[no-any-return]
