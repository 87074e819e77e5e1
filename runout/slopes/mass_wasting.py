"""Runout by landlab's MassWastingRunout, a cellular automaton, on square cells around a release."""

import logging
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError, InputError, StabilityError
from runout.model.arrays import window_of
from runout.scores.grid import Grid, resampled
from runout.slopes.choices import MassWasting
from runout.slopes.drainage import ELEVATION, landlab_components, nodes, on_map, raster_grid
from runout.terrain.prepare import reachable

if TYPE_CHECKING:
    from runout.model.release import Release
    from runout.model.terrain import Terrain

LOGGER = logging.getLogger("runout.slopes")
FEWEST = 5  # cells along each side
LONGEST = 60.0  # [s] of processor time; beyond it cells are made coarser
REFUSED = 1800.0  # [s] beyond it a stated cell size is refused
SECONDS_PER_CALL, SECONDS_PER_NODE = 5e-3, 2e-6  # of one update of the flow directions of the whole grid, measured
ITERATIONS = 0.75  # iterations over rows or columns, the larger; measured 0.3 to 0.7
ROUND_OFF = 1e-6  # of the released volume; landlab rounds fluxes to 8 decimals
MARGIN = 5  # cells around what the mass can reach
FEWEST_ITERATIONS = 1000


@dataclass(frozen=True)
class Baseline:
    """Result of the automaton."""

    terrain: "Terrain"  # ground with the mass on it, on the cells of the computation; row 0 in the north
    # release, peak, deposit, change: (rows, columns): released thickness, largest flow thickness, thickness above the ground
    # without the mass at the end, and change of elevation [m]; NaN where unknown
    release: np.ndarray
    peak: np.ndarray
    deposit: np.ndarray
    change: np.ndarray
    iterations: int
    moving: bool  # whether mass was still moving after the last iteration

    @property
    def volumes(self) -> dict[str, float]:
        """Released, eroded and deposited volume [m3], and what left through the edge; the balance is closed."""
        area = self.terrain.cell_area
        released, deposited = (float(np.nansum(values) * area) for values in (self.release, self.deposit))
        eroded = float(np.nansum(np.maximum(-self.change - self.release, 0.0)) * area)
        left = released + eroded - deposited
        left = 0.0 if abs(left) < ROUND_OFF * released else left
        return {"released": released, "eroded": eroded, "deposited": deposited, "left": left}


def mass_wasting(terrain: "Terrain", releases: "Sequence[Release]", parameters: MassWasting) -> Baseline:
    """The runout of all releases together.

    Raises ConfigError or InputError if the stated cell size would take too long, or the releases hold no mass on its cells. Raises
    StabilityError if the automaton fails. Raises LibraryError if landlab is missing.
    """
    landlab_components()
    thickness = np.sum([r.thickness for r in releases], axis=0)
    surface = terrain.elevation + thickness - np.sum([r.excavation for r in releases], axis=0)
    ground, mass = _placed(replace(terrain, elevation=surface), thickness, parameters)
    return _run(ground, mass, parameters)


def seconds(shape: tuple[int, int], sources: float) -> float:
    """Forecast of the processor time [s] from the number of cells of the raster and of the release."""
    calls = sources + ITERATIONS * max(shape)
    return calls * (SECONDS_PER_CALL + SECONDS_PER_NODE * shape[0] * shape[1])


def _placed(terrain: "Terrain", thickness: np.ndarray, parameters: MassWasting) -> "tuple[Terrain, np.ndarray]":
    """Ground and thickness on square cells around what the mass can reach."""
    part, mass = _reached_part(terrain, thickness, math.atan(0.5 * parameters.critical_slope))
    size = max(part.cell_size)
    if parameters.resolution is not None:
        if parameters.resolution < (1 - 1e-6) * size:
            raise ConfigError(f"--resolution is {parameters.resolution:g} m, finer than the terrain's {size:g} m; leave it out")
        size = parameters.resolution
        shortest = min(n * h for n, h in zip(part.shape, part.cell_size[::-1], strict=True))
        if FEWEST * size > shortest:
            fault = f"{size:g} m leaves less than {FEWEST} cells of the {shortest:g} m that the mass can reach"
            raise ConfigError(f"--resolution is {fault}; state a finer one, or leave it out")
    ground, mass = _on_square_cells(part, mass, size)
    expected = seconds(ground.shape, (mass > 0).sum())
    if parameters.resolution is not None and expected > REFUSED:
        raise ConfigError(
            f"--resolution {size:g} m takes about {expected / 60:.0f} minutes on {ground.shape[0]} x {ground.shape[1]} cells; "
            "state a coarser one or leave it out"
        )
    step = 1
    while parameters.resolution is None and expected > LONGEST:
        step += 1
        ground, mass = _on_square_cells(part, _reached_mass(part, terrain, thickness), step * size)
        expected = seconds(ground.shape, (mass > 0).sum())
    if step > 1:
        LOGGER.warning(
            "%s: cells of %g m in place of %g m, so that the baseline takes at most %g s; --resolution states others",
            terrain.source, step * size, size, LONGEST,
        )  # fmt: skip
    if not (mass > 0).any():
        raise InputError(f"{terrain.source}: no mass is left on cells of {ground.cell_size[0]:g} m; state a finer --resolution")
    return ground, mass


def _reached_part(terrain: "Terrain", thickness: np.ndarray, angle: float) -> "tuple[Terrain, np.ndarray]":
    window = window_of(reachable(terrain, thickness, angle), margin=(MARGIN, MARGIN))
    return terrain.part(*window), thickness[window]


def _reached_mass(part: "Terrain", terrain: "Terrain", thickness: np.ndarray) -> np.ndarray:
    row = round((terrain.extent[3] - part.extent[3]) / terrain.cell_size[1])
    column = round((part.west - terrain.west) / terrain.cell_size[0])
    return thickness[row : row + part.shape[0], column : column + part.shape[1]]


def _on_square_cells(terrain: "Terrain", thickness: np.ndarray, size: float) -> "tuple[Terrain, np.ndarray]":
    """Means by area on square cells of ``size`` [m] from the south-west corner on."""
    rows, columns = (max(3, math.floor(length / size + 1e-6)) for length in (terrain.size[1], terrain.size[0]))
    own = Grid.of(terrain)
    target = replace(own, cell_size=(size, size), shape=(rows, columns))
    z, mass = resampled(terrain.elevation, own, target), np.nan_to_num(resampled(thickness, own, target))
    return replace(terrain, elevation=z, cell_size=(size, size)), np.where(np.isfinite(z), mass, 0.0)


def _run(terrain: "Terrain", mass: np.ndarray, parameters: MassWasting) -> Baseline:
    grid, shape = raster_grid(terrain), terrain.shape
    source = nodes(mass)
    grid.add_field("soil__thickness", np.where(source > 0, source, parameters.erodible_thickness), at="node")
    grid.add_field("mass__wasting_id", (source > 0).astype(int), at="node")
    grid.add_field("particle__diameter", np.full(source.size, parameters.grain_diameter), at="node")
    most = max(FEWEST_ITERATIONS, 4 * sum(shape))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        landlab_components().FlowDirectorMFD(grid, diagonals=True, partition_method="slope").run_one_step()
        model = _with_peaks()(
            grid,
            critical_slope=[parameters.critical_slope],
            threshold_flux=parameters.threshold_flux,
            erosion_coefficient=parameters.erosion_coefficient,
            tracked_attributes=["particle__diameter"],
            itL=most,
        )
        try:
            model.run_one_step()
        except (ValueError, IndexError, FloatingPointError) as cause:
            raise StabilityError(
                f"landlab's MassWastingRunout fails ({cause}); try another --critical-slope, --threshold-flux or --resolution"
            ) from cause
    end, peak = on_map(grid.at_node[ELEVATION], shape), on_map(model.peak, shape)
    deposit = np.maximum(end - (terrain.elevation - mass), 0.0)
    peak = np.maximum(np.maximum(peak, mass), deposit)
    mass, peak, deposit, change = (terrain.where_known(values) for values in (mass, peak, deposit, end - terrain.elevation))
    return Baseline(terrain, mass, peak, deposit, change, model.c, model.c >= most and len(model.arn) > 0)


def _with_peaks() -> Any:
    """MassWastingRunout that also keeps the largest flow thickness of each node; landlab keeps it of all iterations or none."""
    from landlab.components.mass_wasting_runout import MassWastingRunout

    class WithPeaks(MassWastingRunout):  # type: ignore[misc]
        """The component with the attribute ``peak`` (nodes,) [m]."""

        def __init__(self, grid: Any, **parameters: Any):
            super().__init__(grid, **parameters)
            self.peak = np.zeros(grid.number_of_nodes)

        def _update_E_dem(self) -> None:
            super()._update_E_dem()
            node = self.qsi_dat[:, 0].astype(int)
            self.peak[node] = np.maximum(self.peak[node], self.qsi_dat[:, 1].astype(float))

    return WithPeaks
