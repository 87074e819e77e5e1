"""When and how a release starts: at a time or when the flow of another arrives, at rest or with a velocity."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ReleaseError
from runout.model.arrays import window_of
from runout.model.limits import checked

if TYPE_CHECKING:
    from runout.model.nodal_surface import NodalSurface
    from runout.model.release import Release

LEVEL = 0.01  # [1]: mean slope below which the ground has no direction of descent


@dataclass(frozen=True)
class Arrival:
    """A release starts when the flow of another one arrives at it.

    Parameters
    ----------
    arrives : str
        Name of the other release.
    thickness : float
        Vertical thickness [m] of its flow, inside the outline of the release that waits, that starts this.
    """

    arrives: str
    thickness: float = 0.1

    def __post_init__(self) -> None:
        checked("arrival_threshold", self.thickness, place="starts_when", key="thickness", error=ReleaseError)

    def __str__(self) -> str:
        return f"when the flow of {self.arrives} arrives with {self.thickness:g} m"


@dataclass(frozen=True)
class StartVelocity:
    """Velocity of a release at its start, the same horizontal direction everywhere, along the ground below each particle.

    Parameters
    ----------
    speed : float
        Along the ground [m/s].
    azimuth_deg : float, optional
        Direction clockwise from north [deg]; by default that in which the ground below the release descends in the mean.
    """

    speed: float
    azimuth_deg: float | None = None

    def __post_init__(self) -> None:
        checked("release_speed", self.speed, place="velocity", key="speed", error=ReleaseError)
        if self.azimuth_deg is not None:
            checked("azimuth", self.azimuth_deg, place="velocity", key="azimuth_deg", error=ReleaseError)

    def direction(self, release: "Release") -> np.ndarray:
        """Horizontal unit vector (2,) east and north [1] of a release.

        Raises
        ------
        ReleaseError
            If the ground is level in the mean, and no azimuth is stated.
        """
        if self.azimuth_deg is not None:
            azimuth = math.radians(self.azimuth_deg)
            return np.array([math.sin(azimuth), math.cos(azimuth)])
        down = -_mean_gradient(release)
        slope = float(np.hypot(*down))
        if not slope >= LEVEL:
            raise ReleaseError(
                f"release {release.name}: velocity states no azimuth, and the ground below the release is level in the mean (slope "
                f"{slope:.2g}); add azimuth_deg, or give three components"
            )
        return np.asarray(down / slope)

    def at(self, release: "Release", ground: "NodalSurface", x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Velocities (n, 3) [m/s] of particles of a release at local positions (n,) [m]."""
        a = self.direction(release)
        _, east, north = ground.evaluate(x, y)
        rise = a[0] * east + a[1] * north
        along = np.column_stack([np.full(len(rise), a[0]), np.full(len(rise), a[1]), rise])
        return self.speed * along / np.sqrt(1.0 + rise**2)[:, None]


def _mean_gradient(release: "Release") -> np.ndarray:
    """Mean gradient (2,) east and north [1] of the terrain below a release, weighted by its thickness."""
    part = window_of(release.thickness, margin=(1, 1))
    dx, dy = release.terrain.cell_size
    south, east = np.gradient(release.terrain.elevation[part], dy, dx)
    weight = np.where(np.isfinite(south + east), release.thickness[part], 0.0)
    return np.array([(weight * np.nan_to_num(side)).sum() for side in (east, -south)]) / max(weight.sum(), 1e-300)


def checked_velocity(velocity: Any, what: str) -> "StartVelocity | tuple[float, float, float] | None":
    """The velocity of a release: a speed down the slope [m/s], a :class:`StartVelocity`, or components east, north and up [m/s].

    Raises ReleaseError for something else, or a value out of range.
    """
    if isinstance(velocity, StartVelocity):
        return velocity if velocity.speed else None
    if velocity is None:
        return None
    if isinstance(velocity, int | float) and not isinstance(velocity, bool):
        return StartVelocity(float(velocity)) if velocity else None
    components = tuple(velocity) if isinstance(velocity, Sequence | np.ndarray) and not isinstance(velocity, str) else ()
    if len(components) != 3 or not all(isinstance(v, int | float | np.number) and math.isfinite(v) for v in components):
        raise ReleaseError(
            f"{what} is {velocity!r}; give a speed down the slope [m/s], runout.StartVelocity(speed, azimuth_deg), or three "
            "components east, north and up [m/s]"
        )
    checked("release_speed", math.hypot(*components), place=what, key="speed", error=ReleaseError)
    return tuple(float(v) for v in components)  # type: ignore[return-value]


def require_starts(releases: "Sequence[Release]", end_time: float) -> None:
    """Raise ReleaseError with all releases that cannot start within a run that ends at ``end_time`` [s]."""
    problems = list(start_problems([(r.name, r.start_time, r.starts_when) for r in releases], end_time))
    if problems:
        raise ReleaseError("; ".join(f"release {name}: {message}; {remedy}" for _, name, _, message, remedy in problems))


def start_problems(
    starts: Sequence[tuple[str, float, Arrival | None]], end_time: float
) -> Iterator[tuple[int, str, str, str, str]]:
    """Number, name, key, message and remedy of each release that cannot start.

    ``starts``: name, start time [s] and trigger of each release. ``end_time``: of the run [s].
    """
    names = [name for name, _, _ in starts]
    starting = {name for name, _, trigger in starts if trigger is None}
    while more := {name for name, _, t in starts if t and t.arrives in starting and name not in starting and t.arrives != name}:
        starting |= more
    for number, (name, time, trigger) in enumerate(starts):
        if time >= end_time:
            yield number, name, "start_time", f"starts at {time:g} s, the run ends at {end_time:g} s", "start it earlier"
        if trigger is None:
            continue
        others = ", ".join(other for other in names if other != name)
        fix = f"name another release ({others})" if others else "add the release whose flow starts it, or state start_time"
        if trigger.arrives == name:
            yield number, name, "starts_when", "waits for its own flow", fix
        elif trigger.arrives not in names:
            yield number, name, "starts_when", f"waits for {trigger.arrives!r}, which is no release", fix
        elif name not in starting:
            message = f"waits for {trigger.arrives}, which never starts before it"
            yield number, name, "starts_when", message, "let one of these releases start at a time"
