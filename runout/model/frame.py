"""The local metric frame: the only conversion between map and local coordinates."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LocalFrame:
    """Map coordinate system and the float64 origin of the local one.

    Local ``x`` points east, ``y`` north, ``z`` up (elevation itself); all in metres. Large map coordinates
    never reach a float32 array: they are subtracted here, in float64.

    Parameters
    ----------
    easting, northing : float
        Map coordinates of the local origin [m], the outer south-west corner of the elevation raster.
    crs : str or None
        Coordinate reference system as WKT; None for a local one.
    """

    easting: float = 0.0
    northing: float = 0.0
    crs: str | None = None

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
