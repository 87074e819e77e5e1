"""Reads the observations of a site as site.yaml states them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.fetch import locate
from runout.config.observations import FILE_KEYS, DepositSettings, DifferenceSettings, ObservationSettings
from runout.config.stated_at import stated_at
from runout.errors import InputError
from runout.io.side_files import files_of

if TYPE_CHECKING:
    from runout.model.terrain import Terrain
    from runout.scores.observations import Observations


@dataclass(frozen=True)
class SiteObservations:
    """The observations of a site. Each call reads their files.

    Attributes
    ----------
    settings : ObservationSettings or None
        What site.yaml states.
    file : Path
        The site.yaml; other paths are relative to its folder.
    """

    settings: ObservationSettings | None
    file: Path

    def paths(self) -> list[Path]:
        """All files with their side files; public files are downloaded.

        Raises
        ------
        InputError, StorageError
            If a public file cannot be downloaded or has another checksum than stated.
        """
        return [path for _, source in self._stated() for path in files_of(self._located(source))]

    def read(self, terrain: "Terrain") -> "Observations | None":
        """The observations on the cells of the terrain; None if site.yaml states none.

        Raises
        ------
        InputError
            If one of them cannot be used: the first problem of :meth:`problems`.
        """
        found, problems = self.problems(terrain)
        if problems:
            raise problems[0]
        return found

    def problems(self, terrain: "Terrain") -> tuple["Observations | None", list[InputError]]:
        """What can be read, and the problems of the rest."""
        if self.settings is None:
            return None, []
        from runout.scores.grid import Grid
        from runout.scores.observations import Observations

        readers: dict[str, Callable[[Any, Terrain], tuple[dict[str, Any], tuple[str, ...]]]] = {
            "outline": self._outline, "deposit": self._deposit, "difference": self._difference, "gauges": self._gauges,
            "thalweg": self._thalweg,
        }  # fmt: skip
        parts: dict[str, Any] = {}
        changes: tuple[str, ...] = ()
        problems = []
        for name, _ in self._stated():
            try:
                with stated_at(self.file, "observations", name):
                    found, said = readers[name](getattr(self.settings, name), terrain)
                parts |= found
                changes += said
            except InputError as error:
                problems.append(error)
        return (Observations(Grid.of(terrain), **parts, changes=changes) if parts else None), problems

    def _outline(self, stated: Any, terrain: "Terrain") -> tuple[dict[str, Any], tuple[str, ...]]:
        from runout.scores.read import read_outline

        outline, said = read_outline(self._located(stated.polygons), terrain, stated.layer)
        return {"outline": outline, "outline_shows": stated.shows}, said

    def _deposit(self, stated: Any, terrain: "Terrain") -> tuple[dict[str, Any], tuple[str, ...]]:
        from runout.scores.slope_normal import terrain_slope, vertical_thickness

        values, said = self._raster(stated, terrain)
        if stated.thickness == "slope_normal":
            values = vertical_thickness(values, terrain_slope(terrain.elevation, terrain.cell_size))
        return {"deposit": values}, said

    def _difference(self, stated: Any, terrain: "Terrain") -> tuple[dict[str, Any], tuple[str, ...]]:
        values, said = self._raster(stated, terrain)
        return {"change": values, "detection_limit": stated.detection_limit}, said

    def _raster(self, stated: DepositSettings | DifferenceSettings, terrain: "Terrain") -> tuple[np.ndarray, tuple[str, ...]]:
        """Values on the cells of the terrain, NaN where unknown or without elevation."""
        from runout.scores.grid import Grid, placed
        from runout.scores.observations import on_grid
        from runout.scores.read import Nodata, read_map

        path, nodata = self._located(stated.raster), Nodata(stated.nodata)
        quantity = "change" if isinstance(stated, DifferenceSettings) else "thickness"
        values, own, said = read_map(path, nodata, quantity=quantity)
        grid = Grid.of(terrain)
        sentences = placed(own, grid).sentences
        on_terrain = on_grid(values, own, grid, 0.0 if nodata == Nodata.ZERO else np.nan)
        return terrain.where_known(on_terrain), (*said, *sentences)

    def _gauges(self, stated: Any, terrain: "Terrain") -> tuple[dict[str, Any], tuple[str, ...]]:
        from runout.scores.read import read_gauges

        gauges, said = read_gauges(self._located(stated.points), terrain, stated.attributes, stated.layer)
        return {"gauges": gauges}, said

    def _thalweg(self, stated: Any, terrain: "Terrain") -> tuple[dict[str, Any], tuple[str, ...]]:
        from runout.scores.read import read_thalweg

        thalweg, said = read_thalweg(self._located(stated.line), terrain, stated.layer)
        return {"thalweg": thalweg}, said

    def _stated(self) -> Iterator[tuple[str, Any]]:
        """Name and file of each observation."""
        for name, key in FILE_KEYS.items():
            stated = getattr(self.settings, name, None)
            if stated is not None:
                yield name, getattr(stated, key)

    def _located(self, source: Any) -> Path:
        return Path(locate(source, self.file.parent))
