"""Shaded relief: brightness of the ground under one sun, and its picture for a page."""

import io
import math
from base64 import b64encode
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from PIL.Image import Image

SUN_AZIMUTH_DEG, SUN_ALTITUDE_DEG = 315, 42
EXAGGERATION = 1.3
BRIGHTEST = 250  # grey of ground that faces the sun
STRIPES, STRIPED = 4, (140, 205)  # pixels from stripe to stripe, and greys, of ground without elevation
QUALITY = 78  # of JPEG where no other is chosen


def hillshade(elevation: np.ndarray, cell_size: tuple[float, float]) -> np.ndarray:
    """Brightness, 0 to 1, of ground of known elevation (rows, columns) [m] that the sun of :data:`SUN_AZIMUTH_DEG` lights."""
    from matplotlib.colors import LightSource

    dx, dy = cell_size
    sun = LightSource(SUN_AZIMUTH_DEG, SUN_ALTITUDE_DEG)
    shade: np.ndarray = sun.hillshade(elevation, vert_exag=EXAGGERATION, dx=dx, dy=dy)
    return shade


def relief_picture(elevation: np.ndarray, cell_size: tuple[float, float], most: int, darkest: int, smoothed_to: int = 0) -> "Image":
    """Grey picture of the ground, north up; ground without elevation is striped.

    Parameters
    ----------
    elevation : ndarray (rows, columns)
        Elevation [m], NaN where unknown.
    cell_size : tuple of float
        Size of a cell east-west and north-south [m].
    most : int
        Cells along the longer side; larger grounds are thinned out.
    darkest : int
        Grey of ground that faces away from the sun, 0 to 255.
    smoothed_to : int
        Pixels that the longer side of a smaller ground has about, smoothed; 0: one pixel a cell.
    """
    from PIL import Image

    step = max(1, math.ceil(max(elevation.shape) / most))
    z = elevation[::step, ::step]
    known = np.isfinite(z)
    filled = np.where(known, z, np.nanmin(z) if known.any() else 0.0)
    shade = hillshade(filled, (cell_size[0] * step, cell_size[1] * step)) if min(z.shape) > 1 else np.ones(z.shape)
    stripes = np.where(np.add.outer(*map(np.arange, z.shape)) % STRIPES == 0, *STRIPED)
    grey = np.where(known, darkest + (BRIGHTEST - darkest) * np.clip(shade, 0.0, 1.0), stripes)
    picture = Image.fromarray(grey.astype(np.uint8))
    larger = max(1, round(smoothed_to / max(z.shape)))
    return picture.resize((larger * picture.width, larger * picture.height), Image.Resampling.BICUBIC) if larger > 1 else picture


def address(picture: "Image", kind: str = "jpeg", **options: Any) -> str:
    """A picture as the address of an image of a kind inside a page; ``options`` are those of Pillow."""
    file = io.BytesIO()
    picture.save(file, kind, **(options or {"quality": QUALITY}))
    return f"data:image/{kind};base64," + b64encode(file.getvalue()).decode("ascii")
