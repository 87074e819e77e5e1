"""Terrain: a checked elevation raster with its place on the map."""

from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import DemError
from runout.model.arrays import real_array
from runout.model.facts import as_html, as_text, crs_name
from runout.model.readers import reader


@dataclass(frozen=True)
class LocalFrame:
    """Map coordinate system and the float64 origin of the local one.

    Local ``x`` points east, ``y`` north, ``z`` up (elevation itself); all in metres. Large map coordinates
    never reach a float32 array: they are subtracted here, in float64.
    """

    # easting, northing: map coordinates of the local origin [m], the outer south-west corner of the elevation raster
    easting: float = 0.0
    northing: float = 0.0
    crs: str | None = None  # coordinate reference system as WKT; None for a local one

    def to_local(self, coordinates: np.ndarray) -> np.ndarray:
        """Local coordinates (..., 2 or 3) [m] of map coordinates (..., 2 or 3) [m], float64."""
        return self._shifted(coordinates, -1.0)

    def to_map(self, coordinates: np.ndarray) -> np.ndarray:
        """Map coordinates (..., 2 or 3) [m] of local coordinates (..., 2 or 3) [m], float64."""
        return self._shifted(coordinates, 1.0)

    def _shifted(self, coordinates: np.ndarray, sign: float) -> np.ndarray:
        moved = np.array(coordinates, dtype=np.float64)
        moved[..., 0] += sign * self.easting
        moved[..., 1] += sign * self.northing
        return moved


@dataclass(frozen=True)
class Terrain:
    """Elevation on a regular raster, north up.

    Parameters
    ----------
    elevation : ndarray (rows, columns)
        Elevation of the cell centres [m], float64; ``[0, 0]`` is the north-west corner; NaN where unknown.
    cell_size : tuple of float
        Size of a cell ``(east-west, north-south)`` [m], both positive.
    west, south : float
        Map coordinates of the outer south-west corner [m].
    crs : str or None
        Projected coordinate reference system as WKT; None for a local one.
    source : str
        Where the elevations come from.
    changes : tuple of str
        Changes that the reader made, one sentence each.
    own_crs : str or None
        Coordinate system of the file as WKT if the elevations were reprojected; None if it is ``crs``.
    vertical_datum : str or None
        Vertical datum of the elevations; None if unknown.
    fine_relief : float or None
        Part of the natural waves of two cells that the ground of a grid keeps, 0 to 1; None: by the cells of the grid, as many
        as these resolve (:func:`runout.terrain.relief.resolved_in`).

    Raises
    ------
    DemError
        If the array is not two-dimensional, too small, wholly empty, or a size is not positive.
    """

    elevation: np.ndarray
    cell_size: tuple[float, float]
    west: float = 0.0
    south: float = 0.0
    crs: str | None = None
    source: str = "array"
    changes: tuple[str, ...] = field(default=())
    own_crs: str | None = None
    vertical_datum: str | None = None
    fine_relief: float | None = None

    def __post_init__(self) -> None:
        z = real_array(self.elevation, f"{self.source}: elevation", DemError)
        if z.ndim != 2 or min(z.shape) < 3:
            raise DemError(f"{self.source}: elevation has shape {z.shape}; a raster of at least 3 x 3 cells is needed")
        if not np.isfinite(z).any():
            raise DemError(f"{self.source}: none of the {z.size} cells has an elevation; check the nodata value")
        if np.isinf(z).any():
            raise DemError(f"{self.source}: {int(np.isinf(z).sum())} cells are infinite; mark unknown cells as nodata")
        if not (len(self.cell_size) == 2 and all(np.isfinite(s) and s > 0 for s in self.cell_size)):
            raise DemError(f"{self.source}: cell size {self.cell_size} m; both sizes must be positive")
        z.setflags(write=False)
        object.__setattr__(self, "elevation", z)
        object.__setattr__(self, "cell_size", (float(self.cell_size[0]), float(self.cell_size[1])))

    @classmethod
    def from_array(
        cls,
        elevation: np.ndarray,
        cell_size: float | tuple[float, float],
        crs: str | None = None,
        origin: tuple[float, float] = (0.0, 0.0),
    ) -> "Terrain":
        """Terrain of an array (rows, columns), north-west corner first.

        ``cell_size`` [m] is one number or ``(east-west, north-south)``; ``origin`` is the map position
        ``(easting, northing)`` [m] of the outer south-west corner; ``crs`` anything that names a projected
        coordinate system.
        """
        terrain: Terrain = reader("Terrain.from_array")(elevation, cell_size, crs, origin)
        return terrain

    def with_obstacles(self, path: str | PathLike[str], height: float | str, layer: str | None = None) -> "Terrain":
        """The terrain with dams, walls or basins: raised by ``height`` [m] inside the polygons of a vector file, or lowered by it.

        ``height`` is a number, negative for a basin or channel, or the name of an attribute; ``layer`` is needed if the file has
        several. The volume of a dam is kept; its crest is not where it is narrower than a cell of the raster, or of the run.
        """
        raised: Terrain = reader("Terrain.with_obstacles")(self, path, height, layer)
        return raised

    @classmethod
    def from_raster(
        cls, path: str | PathLike[str], crs: Any = None, extent: tuple[float, float, float, float] | None = None
    ) -> "Terrain":
        """Terrain of any raster that GDAL reads; ``crs`` names the system of a file that states none.

        ``extent`` is west, south, east and north of the part that is read, in the coordinates of the file.
        """
        read: Terrain = reader("Terrain.from_raster")(path, crs, extent)
        return read

    @classmethod
    def from_mesh(
        cls, path: str | PathLike[str], cell_size: float, crs: Any = None, extent: tuple[float, float, float, float] | None = None
    ) -> "Terrain":
        """Terrain of a surface mesh on square cells of ``cell_size`` [m].

        Where the surface overhangs, the terrain is the ground below; :meth:`runout.Structures.from_overhangs` makes the rock
        above it.

        Parameters
        ----------
        path : path
            OBJ, PLY or STL: an open surface in metres and map coordinates, with z up.
        cell_size : float
            Of the terrain [m].
        crs : str, optional
            Projected coordinate system of the mesh, in metres.
        extent : tuple of float, optional
            West, south, east and north of the part that is read [m].

        Raises
        ------
        DemError
            If the mesh cannot be used, with the place.
        """
        read: Terrain = reader("Terrain.from_mesh")(path, cell_size, crs, extent)
        return read

    def averaged(self, resolution: float) -> "Terrain":
        """The terrain averaged over whole blocks of cells to about ``resolution`` [m], as ``terrain.resolution`` does it."""
        coarse: Terrain = reader("Terrain.averaged")(self, resolution)
        return coarse

    def smoothed(self, length: float) -> "Terrain":
        """The terrain averaged over a triangle of half-width ``length`` [m] along both axes, as ``terrain.smoothing`` does it."""
        smooth: Terrain = reader("Terrain.smoothed")(self, length)
        return smooth

    def plot(self, *, title: str = "") -> Any:
        """Axes of matplotlib with a map of the elevation over hillshade, on a new figure of pyplot."""
        return reader("Terrain.plot")(self, title=title)

    def _facts(self) -> dict[str, str]:
        rows, columns = self.shape
        dx, dy = self.cell_size
        unknown = int(np.isnan(self.elevation).sum())
        facts = {
            "cells": f"{rows} x {columns} (rows x columns) of {dx:.4g} m" + ("" if dx == dy else f" x {dy:.4g} m"),
            "elevation": f"{np.nanmin(self.elevation):.1f} to {np.nanmax(self.elevation):.1f} m",
            "west, south, east, north": ", ".join(f"{edge:.1f}" for edge in self.extent) + " m",
            "coordinate system": crs_name(self.crs),
            "source": self.source,
        }
        return facts | ({"without elevation": f"{unknown} cells"} if unknown else {})

    def __repr__(self) -> str:
        return as_text("Terrain", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Terrain", self._facts())

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.elevation.shape  # type: ignore[return-value]

    def where_known(self, values: np.ndarray, otherwise: float = np.nan) -> np.ndarray:
        """Values (..., rows, columns) on the cells that have an elevation, another on those that have none."""
        return np.where(np.isnan(self.elevation), otherwise, values)

    def elevation_at(self, points: np.ndarray) -> np.ndarray:
        """Elevation [m] at local positions (..., 2 or 3) [m], linear between the centres of cells, constant beyond the outer ones.

        NaN beside cells without elevation.
        """
        rows, columns = self.shape
        x = np.clip(points[..., 0] / self.cell_size[0] - 0.5, 0.0, columns - 1.0)
        y = np.clip(rows - 0.5 - points[..., 1] / self.cell_size[1], 0.0, rows - 1.0)
        i, j = np.minimum(x.astype(int), columns - 2), np.minimum(y.astype(int), rows - 2)
        u, v, z = x - i, y - j, self.elevation
        upper, lower = (1 - u) * z[j, i] + u * z[j, i + 1], (1 - u) * z[j + 1, i] + u * z[j + 1, i + 1]
        return (1 - v) * upper + v * lower  # type: ignore[no-any-return]

    def part(self, rows: slice, columns: slice) -> "Terrain":
        """Some rows and columns, in their place on the map; both slices state where they start and stop."""
        west = self.west + columns.start * self.cell_size[0]
        south = self.south + (self.shape[0] - rows.stop) * self.cell_size[1]
        return replace(self, elevation=self.elevation[rows, columns], west=west, south=south)

    @property
    def frame(self) -> LocalFrame:
        """Local frame: origin at the outer south-west corner."""
        return LocalFrame(self.west, self.south, self.crs)

    @property
    def size(self) -> tuple[float, float]:
        """Extent east-west and north-south [m]."""
        return self.shape[1] * self.cell_size[0], self.shape[0] * self.cell_size[1]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Outer edges ``(west, south, east, north)`` [m], map coordinates."""
        return self.west, self.south, self.west + self.size[0], self.south + self.size[1]

    @property
    def easting(self) -> np.ndarray:
        """Easting of the cell centres (columns,) [m], ascending."""
        return self.west + (np.arange(self.shape[1]) + 0.5) * self.cell_size[0]

    @property
    def northing(self) -> np.ndarray:
        """Northing of the cell centres (rows,) [m], descending."""
        return self.south + (self.shape[0] - 0.5 - np.arange(self.shape[0])) * self.cell_size[1]

    @property
    def cell_area(self) -> float:
        """Plan area of a cell [m2]."""
        return self.cell_size[0] * self.cell_size[1]
