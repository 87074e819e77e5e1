"""Erodible bed: the material on the ground that a flow may take up."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError, require_kind
from runout.model.arrays import real_array
from runout.model.erosion_laws import DEFAULT_EROSION, EROSIONS, Erosion
from runout.model.facts import short
from runout.model.limits import LIMITS, checked
from runout.model.readers import reader
from runout.model.release import Release
from runout.model.terrain import Terrain

DOUBTED = 100.0  # depth [m] that is doubted: a hundred times what `runout new --process debris_flow` writes; no site is known to it
UNITS = 300.0  # factor from a typical value at which a unit is doubted; 1000 is that of most prefixes
EROSION_REMEDY = "give a law of erosion, for example runout.RammsErosion(rate=0.025)"


def default_erosion() -> Erosion:
    """The default law with its default parameters."""
    return EROSIONS.find(DEFAULT_EROSION).example


@dataclass(frozen=True, eq=False)
class Bed:
    """Erodible bed.

    Parameters
    ----------
    depth : float or ndarray (rows, columns)
        Vertical depth that can be eroded [m], 0 to 1000: one number, or one a cell of the terrain, north-west corner first; NaN
        is 0.
    erosion : Erosion
        Law of the rate; :class:`runout.RammsErosion` with its default parameters by default.
    density : float, optional
        Of the bed [kg/m3]; that of the mass that erodes it by default. Eroded mass takes the density of the flow.
    pore_pressure_ratio : float, optional
        Pore pressure in the bed over the total normal stress [1], 0 to 0.97, with which mass is taken up; it drains as that of the
        release that takes it up. By default the ratio to which that relaxes, 0 for a dry release.
    source : str
        Where the depth is from, for messages.
    changes : tuple of str
        Assumptions of the reader, one sentence each.

    Raises
    ------
    ConfigError
        If a value cannot be used.
    """

    depth: float | np.ndarray
    erosion: Erosion = field(default_factory=default_erosion)
    density: float | None = None
    source: str = "bed"
    pore_pressure_ratio: float | None = None
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_kind(Erosion, self.erosion, f"{self.source}: erosion", EROSION_REMEDY, ConfigError)
        if self.density is not None:
            checked("bed_density", self.density, place=self.source, key="density", error=ConfigError)
        if self.pore_pressure_ratio is not None:
            ratio, place = self.pore_pressure_ratio, self.source
            checked("pore_pressure_ratio", ratio, place=place, key="pore_pressure: ratio", error=ConfigError)
        if np.ndim(self.depth) == 0:
            checked("bed_depth", self.depth, place=self.source, key="depth", error=ConfigError)
            return
        depth = np.nan_to_num(real_array(self.depth, f"{self.source}: depth", ConfigError))
        valid = LIMITS["bed_depth"]
        beyond = np.argwhere((depth < 0) | (depth > valid.high))
        if len(beyond):
            row, column = map(int, beyond[0])
            said = f"depth is {depth[row, column]:g} m at row {row}, column {column}, {len(beyond)} cells in all"
            raise ConfigError(f"{self.source}: {said}; it must be at least 0 and at most {valid.high:g} m")
        if not (depth > 0).any():
            raise ConfigError(f"{self.source}: depth is 0 everywhere; state where the bed lies, or leave the bed out")
        object.__setattr__(self, "depth", depth)

    @classmethod
    def from_vector(cls, path: str | PathLike[str], terrain: Terrain, depth: float | str, **choices: Any) -> "Bed":
        """Bed inside the polygons of a GeoPackage, Shapefile or GeoJSON; ``depth`` [m] is a number or the name of an attribute.

        ``choices`` are ``layer``, ``erosion``, ``density`` and ``pore_pressure_ratio``. ConfigError with place, value and remedy.
        """
        bed: Bed = reader("Bed.from_vector")(path, terrain, depth, **choices)
        return bed

    @classmethod
    def from_raster(cls, path: str | PathLike[str], terrain: Terrain, **choices: Any) -> "Bed":
        """Bed whose depth [m] a raster states, on any grid in any known coordinate system.

        Cells of the terrain without a value have no bed; a sentence in ``changes`` counts them.

        ``choices`` are ``erosion``, ``density`` and ``pore_pressure_ratio``. ConfigError with place, value and remedy.
        """
        bed: Bed = reader("Bed.from_raster")(path, terrain, **choices)
        return bed

    def depth_on(self, terrain: Terrain, releases: Sequence[Release]) -> np.ndarray:
        """Depth (rows, columns) [m] below releases: a scar has removed what it reaches of the bed; 0 without elevation.

        Raises
        ------
        ConfigError
            If the depth is that of another terrain.
        """
        if np.ndim(self.depth) and np.shape(self.depth) != terrain.shape:
            shapes = f"{np.shape(self.depth)} cells, the terrain {terrain.shape}"
            raise ConfigError(f"{self.source}: depth has {shapes}; give the depth on the cells of the terrain")
        dug = np.sum([r.excavation for r in releases], axis=0)
        return np.where(np.isfinite(terrain.elevation), np.maximum(0.0, self.depth - dug), 0.0)  # type: ignore[no-any-return]

    def sentences(
        self, terrain: Terrain, releases: Sequence[Release], spacing: tuple[float, float, float], volume: float
    ) -> list[str]:
        """What a user should know of the bed in a run with particles of a ``volume`` [m3]; inflows are among the releases."""
        left, sentences = self.depth_on(terrain, releases), []
        whole = np.where(np.isfinite(terrain.elevation), self.depth, 0.0)
        lost = float((whole - left).sum() * terrain.cell_area)
        if lost > 0:
            sentences.append(f"{self.source}: {short(lost, 'm3')} of the bed lie in scars of excavated releases; they are left out")
        sentences += [*self._depth_sentences(terrain, float(left.max())), *self._unit_sentences()]
        dry = [release.name for release in releases if release.pore_pressure is None]
        if self.pore_pressure_ratio and dry:
            named = f"{', '.join(dry)} {'are' if len(dry) > 1 else 'is'}"
            sentences.append(
                f"{self.source}: pore_pressure is {self.pore_pressure_ratio:.3g}, but {named} dry, and so is what joins dry mass; "
                "state pore_pressure of the release or inflow, which says how water drains"
            )
        layer = volume / (spacing[0] * spacing[1])
        thickest = float(left.max())
        if thickest < layer:
            finer = math.floor(spacing[0] * 1000 * thickest / layer) / 1000
            sentences.append(
                f"{self.source}: depth is {thickest:g} m at most, thinner than one particle ({layer:.3g} m); "
                f"use cell_size: {finer:g} or less, or more particles_per_cell, to resolve it"
            )
        return sentences

    def _unit_sentences(self) -> Iterator[str]:
        """Parameters of the law of erosion so far from their typical values that their unit is doubted."""
        for known in EROSIONS.find(self.erosion.law).parameters:
            value, typical, valid = getattr(self.erosion, known.name), known.typical, known.valid
            if valid is not None and value > 0.0 and typical > 0.0 and not 1.0 / UNITS < value / typical < UNITS:
                said = f"{known.key} is {value:g} {valid.unit}, {typical:g} is typical; check the unit"
                yield f"{self.source}: erosion: {said}{': ' + valid.hint if valid.hint else ''}"

    def _depth_sentences(self, terrain: Terrain, deepest: float) -> Iterator[str]:
        """A depth [m] that no flow erodes: beyond :data:`DOUBTED`, or below the lowest place of the terrain."""
        relief = float(np.ptp(terrain.elevation[np.isfinite(terrain.elevation)]))
        bounds = [f"{DOUBTED:g} m, a hundred times the depth of a debris flow's bed in guide/processes"] * (deepest > DOUBTED)
        bounds += [f"the relief of {terrain.source}, {short(relief, 'm')}"] * (0.0 < relief < deepest)
        if bounds:
            yield (
                f"{self.source}: depth is {short(deepest, 'm')} at most, more than {' and than '.join(bounds)}; "
                "the forecast of memory counts all of it within reach of the mass; state the depth that can be eroded, in metres"
            )
