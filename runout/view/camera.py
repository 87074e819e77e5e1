"""Where the camera stands: a direction from which the path of the flow is visible and fills the picture."""

import math
from dataclasses import dataclass

import numpy as np

from runout.errors import ConfigError
from runout.view.scene import FlowScene

ELEVATIONS_DEG = (33.0, 50.0)  # of the camera above the horizon; the second where ridges hide the flow from the first
AZIMUTH_STEP_DEG = 15
FACING = 0.8  # of the largest area per plan area, that a direction needs
VISIBLE = 0.9  # share of the flow that the first elevation must show
HIDDEN = 0.05  # of a cell, by which ground above a line hides its end
VIEW_ANGLE_DEG = 30.0  # height of the picture
FILLED = 0.8  # of the picture, by the flow
BAR_ROOM = 0.16  # of the width, at the right, for the colour bar
MOST_POINTS, RAY_STEPS = 400, 80
NAMED = {"north": 0.0, "east": 90.0, "south": 180.0, "west": 270.0}
TOP_DEG = 90.0
HINT = "give auto, top, north, east, south, west, or azimuth,elevation in degrees such as 135,30"


@dataclass(frozen=True)
class Camera:
    """Position, focal point (3,) in local metres, and upward direction (3,)."""

    position: np.ndarray
    focus: np.ndarray
    up: np.ndarray


def stated_direction(text: str) -> tuple[float, float] | None:
    """Azimuth (clockwise from north, where the camera stands) and elevation [rad] of a text such as "south" or "135,30".

    None for "auto". ConfigError if the text states no direction.
    """
    if text == "auto":
        return None
    if text == "top":
        return math.pi, math.radians(TOP_DEG)
    if text in NAMED:
        return math.radians(NAMED[text]), math.radians(ELEVATIONS_DEG[0])
    try:
        azimuth, _, elevation = text.partition(",")
        direction = float(azimuth), float(elevation or ELEVATIONS_DEG[0])
    except ValueError:
        raise ConfigError(f"camera is {text!r}; {HINT}") from None
    if not (math.isfinite(direction[0]) and 0 < direction[1] <= TOP_DEG):
        raise ConfigError(f"camera is {text!r}; its elevation must be above 0 and at most 90 degrees; {HINT}")
    return math.radians(direction[0]), math.radians(direction[1])


def camera_for(scene: FlowScene, direction: tuple[float, float] | None, aspect: float) -> Camera:
    """Camera that looks from a direction (azimuth, elevation) [rad], by default the best one, at the whole flow.

    ``aspect`` is width over height of the picture.
    """
    points = _flow_points(scene)
    azimuth, elevation = direction or best_direction(scene, aspect)
    return _fitted(points, azimuth, elevation, aspect)


def best_direction(scene: FlowScene, aspect: float) -> tuple[float, float]:
    """Azimuth and elevation [rad] from which the ground of the flow is visible, faces the camera and fills the picture.

    Candidates are directions with nearly the largest mean area in the picture per plan area: they face the slope. Among them, the
    flow fills most of the picture in the best one; that alone would choose a view along the slope.
    """
    points, normals = _flow_points(scene), _flow_normals(scene)
    for elevation in np.radians(ELEVATIONS_DEG):
        rated = []
        for azimuth in np.radians(np.arange(0, 360, AZIMUTH_STEP_DEG)):
            towards = _towards(azimuth, elevation)
            seen = _visible(scene, points, towards)
            facing = np.clip(normals @ towards, 0.0, None) / normals[:, 2]  # area in the picture per area of the plan
            faced = float((seen * facing).mean())
            rated.append((faced, faced / _picture_area(points, azimuth, elevation, aspect), seen.mean(), azimuth))
        enough = FACING * max(faced for faced, *_ in rated)
        _, seen_share, best = max(one[1:] for one in rated if one[0] >= enough)
        if seen_share >= VISIBLE:
            break
    return float(best), float(elevation)


def _towards(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector from the ground to the camera."""
    flat = math.cos(elevation)
    return np.array([math.sin(azimuth) * flat, math.cos(azimuth) * flat, math.sin(elevation)])


def _axes(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the right and the top of the picture, and to the camera."""
    towards = _towards(azimuth, elevation)
    right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
    return right, np.cross(towards, right), towards


def _sampled(scene: FlowScene) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of at most :data:`MOST_POINTS` cells of the flow; of all known cells if there is no flow."""
    reached = scene.reached & np.isfinite(scene.ground)
    rows, columns = np.nonzero(reached if reached.any() else np.isfinite(scene.ground))
    step = max(1, len(rows) // MOST_POINTS)
    return rows[::step], columns[::step]


def _flow_points(scene: FlowScene) -> np.ndarray:
    """Local positions (n, 3) [m] of some cells of the flow."""
    points: np.ndarray = scene.points()[_sampled(scene)]
    return points


def _flow_normals(scene: FlowScene) -> np.ndarray:
    """Upward unit normals (n, 3) of the ground there."""
    dx, dy = scene.cell_size
    down_rows, along_columns = np.gradient(scene.points()[..., 2])
    normals = np.stack([-along_columns / dx, down_rows / dy, np.ones_like(down_rows)], axis=-1)[_sampled(scene)]
    unit: np.ndarray = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return unit


def _visible(scene: FlowScene, points: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Whether the ground hides no part of the lines from points (n, 3) to a camera far away, (n,) of bool."""
    from scipy.ndimage import map_coordinates

    surface = scene.points()
    z, (dx, dy) = surface[..., 2], scene.cell_size
    rise = z.max() - points[:, 2]
    reach = np.minimum(rise / max(towards[2], 1e-6), np.hypot(surface[0, -1, 0], surface[0, 0, 1]))
    seen = np.ones(len(points), bool)
    for part in np.linspace(0.0, 1.0, RAY_STEPS)[1:]:
        at = points + (part * np.maximum(reach, 3 * dx))[:, None] * towards
        ground = map_coordinates(z, [len(z) - 1 - at[:, 1] / dy, at[:, 0] / dx], order=1, cval=-np.inf)
        seen &= ~(ground > at[:, 2] + HIDDEN * dx)
    return seen


def _picture_area(points: np.ndarray, azimuth: float, elevation: float, aspect: float) -> float:
    """Area of the picture [m2] at the distance of the points, if they just fit."""
    right, up, _ = _axes(azimuth, elevation)
    width, height = np.ptp(points @ right), np.ptp(points @ up)
    return float(max(width / aspect, height, 1e-6) ** 2 * aspect)


def _fitted(points: np.ndarray, azimuth: float, elevation: float, aspect: float) -> Camera:
    """Camera in a direction, so near that the points just fit into :data:`FILLED` of the picture."""
    right, up, towards = _axes(azimuth, elevation)
    corners = np.array([[points @ axis] for axis in (right, up, towards)]).reshape(3, -1)
    middle = (corners.min(axis=1) + corners.max(axis=1)) / 2
    focus = middle[0] * right + middle[1] * up + middle[2] * towards
    x, y, depth = corners - middle[:, None]
    half = math.tan(math.radians(VIEW_ANGLE_DEG) / 2) * FILLED
    wide = half * aspect * (1.0 - BAR_ROOM)
    distance = float(max((depth + np.abs(x) / wide).max(), (depth + np.abs(y) / half).max(), 10.0))
    focus = focus + BAR_ROOM / 2 * distance * half / FILLED * aspect * right
    return Camera(focus + distance * towards, focus, up)
