"""Scenes that a batch may take over."""

from collections.abc import Sequence

import numpy as np

from runout.errors import ConfigError
from runout.model.scene import Scene

LARGEST_BLOCK = 2**20


def extent(scene: Scene) -> np.ndarray:
    """Size of the domain [cells] from west to east and from south to north."""
    r = scene.raster
    return np.array([r.columns * r.cell_size[0], r.rows * r.cell_size[1]]) / np.array(scene.spacing[:2])


def require_alike(scenes: Sequence[Scene]) -> None:
    """ConfigError unless scenes can be stepped together, and by this backend."""
    for name in ("spacing", "gravity", "precision", "contact_band"):
        values = {getattr(s, name) for s in scenes}
        if len(values) > 1:
            raise ConfigError(f"scenes that run in one batch must share {name}; these have {sorted(values)}")
    if len({(s.law.name, s.basal.law.name) for s in scenes}) > 1 or len({s.surface is None for s in scenes}) > 1:
        raise ConfigError("scenes that run in one batch must follow one law each of material and friction, all or none on a ground")
