"""Inflow: mass that enters at a line across a channel, or over a polygon, as a hydrograph states it."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np

from runout.errors import ConfigError, require_kind
from runout.model.arrays import real_array
from runout.model.basal_friction import FRICTION_REMEDY, BasalFriction
from runout.model.facts import as_html, as_text, short
from runout.model.limits import checked, checked_radians
from runout.model.materials import MATERIAL_REMEDY, Material
from runout.model.pore_pressure import PorePressure
from runout.model.probes import CrossSection, downhill_on_the_left, ground_at, vertex_problems
from runout.model.readers import reader
from runout.model.terrain import Terrain

LARGEST_DISCHARGE, LARGEST_VELOCITY = 1e7, 200.0  # [m3/s], [m/s]
SHOWN = 5  # problems of a series that a message lists
SLOWEST = 0.05  # speed [m/s], 3 m a minute, from which a landslide is very rapid (Cruden & Varnes 1996), as debris flows are
FALLS = 8  # places along a line at which the ground must fall on
STRIP = 2.0  # cells of the terrain that the mass of a forecast covers along the flow


@dataclass(frozen=True)
class Cumulative:
    """Integral of a rate that is linear between its times, 0 before the first and constant after the last."""

    time: np.ndarray  # (n,): ascending [s]
    rate: np.ndarray  # (n,): of what is summed, by second, >= 0

    @cached_property
    def sums(self) -> np.ndarray:
        """Integral (n,) up to each time."""
        steps = 0.5 * (self.rate[1:] + self.rate[:-1]) * np.diff(self.time)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def _since(self, segment: np.ndarray, seconds: np.ndarray) -> np.ndarray:
        rise = np.diff(self.rate) / np.diff(self.time)
        return self.rate[segment] * seconds + 0.5 * rise[segment] * seconds**2  # type: ignore[no-any-return]

    def at(self, time: Any) -> np.ndarray:
        """Integral from the first to a ``time`` (m,) [s]; beyond the last one that up to the last."""
        inside = np.clip(np.asarray(time, np.float64), self.time[0], self.time[-1])
        segment = np.clip(np.searchsorted(self.time, inside, "right") - 1, 0, len(self.time) - 2)
        return self.sums[segment] + self._since(segment, inside - self.time[segment])

    def when(self, amount: Any) -> np.ndarray:
        """First time (m,) [s] at which the integral reaches an ``amount`` (m,), 0 to that of the whole series."""
        amount = np.clip(np.asarray(amount, np.float64), 0.0, self.sums[-1])
        segment = np.clip(np.searchsorted(self.sums, amount, "left") - 1, 0, len(self.time) - 2)
        rest, rate = amount - self.sums[segment], self.rate[segment]
        rise = (np.diff(self.rate) / np.diff(self.time))[segment]
        root = rate + np.sqrt(np.maximum(rate**2 + 2.0 * rise * rest, 0.0))
        seconds = np.divide(2.0 * rest, root, out=np.zeros(np.shape(rest)), where=root > 0.0)
        return np.minimum(self.time[segment] + seconds, self.time[segment + 1])  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class Hydrograph:
    """Discharge over time, linear between its rows and 0 before the first and after the last.

    Parameters
    ----------
    time : sequence of float (n,)
        Ascending, n >= 2 [s]; 0 is the start of the run.
    discharge : sequence of float (n,)
        Volume of the mass, with its water and voids, by second [m3/s], 0 to 1e7.
    velocity : sequence of float (n,), optional
        Speed of the flow along the ground [m/s], above 0 where there is a discharge, at most 200.
    source : str
        Where the series is from, for messages.

    Raises
    ------
    ConfigError
        With the first rows that cannot be used.

    Examples
    --------
    >>> Hydrograph([0.0, 10.0, 30.0], [0.0, 50.0, 0.0]).volume
    750.0
    """

    time: Any
    discharge: Any
    velocity: Any = None
    source: str = "hydrograph"

    def __post_init__(self) -> None:
        for name in ("time", "discharge", "velocity"):
            if getattr(self, name) is not None:
                values = np.array(real_array(getattr(self, name), f"{self.source}: {name}", ConfigError))
                values.setflags(write=False)
                object.__setattr__(self, name, values)
        problems = hydrograph_problems(self.time, self.discharge, self.velocity, [f"row {k + 1}" for k in range(self.time.size)])
        if problems:
            more = f"; and {len(problems) - SHOWN} more" if len(problems) > SHOWN else ""
            raise ConfigError(f"{self.source}: {'; '.join(problems[:SHOWN])}{more}")

    @cached_property
    def entered(self) -> Cumulative:
        """Volume [m3] over time."""
        return Cumulative(self.time, self.discharge)

    @property
    def volume(self) -> float:
        """Whole volume [m3]."""
        return float(self.entered.sums[-1])

    @property
    def peak(self) -> float:
        """Largest discharge [m3/s]."""
        return float(self.discharge.max())

    @property
    def begin(self) -> float:
        """Time [s] of the first discharge."""
        return float(self.time[max(0, int(np.argmax(self.discharge > 0.0)) - 1)] if self.discharge[0] == 0.0 else self.time[0])

    @property
    def end(self) -> float:
        """Time [s] of the last discharge."""
        last = int(np.flatnonzero(self.discharge > 0.0)[-1])
        return float(self.time[min(last + 1, len(self.time) - 1)])

    @property
    def duration(self) -> float:
        """Time [s] from the first to the last discharge."""
        return self.end - self.begin

    def changed(self, factor: float = 1.0, delay: float = 0.0) -> "Hydrograph":
        """The series with ``factor`` [1] times the discharge, ``delay`` [s] later; velocities stay."""
        return replace(self, time=self.time + delay, discharge=factor * self.discharge)


def hydrograph_problems(
    time: np.ndarray, discharge: np.ndarray, velocity: np.ndarray | None, rows: "list[str]"
) -> list[str]:  # fmt: skip
    """What is wrong with a series, with the names of its ``rows`` (n,)."""
    series = {"time": (time, "s"), "discharge": (discharge, "m3/s")}
    if velocity is not None:
        series["velocity"] = (velocity, "m/s")
    shapes = {np.shape(values) for values, _ in series.values()}
    if len(shapes) > 1 or len(next(iter(shapes))) != 1:
        said = ", ".join(f"{name} {np.shape(values)}" for name, (values, _) in series.items())
        return [f"the columns have shapes {said}; give one row of each for every time"]
    if time.size < 2:
        return [f"{time.size} row of numbers; give two times at least"]
    problems = []
    for name, (values, _) in series.items():
        bad = np.flatnonzero(~np.isfinite(values))
        problems += [f"{rows[k]}: {name} is {values[k]:g}; it must be a finite number" for k in bad]
    for k in np.flatnonzero(~(np.diff(time) > 0.0) & np.isfinite(np.diff(time))) + 1:
        problems.append(f"{rows[k]}: time is {time[k]:g} s after {time[k - 1]:g} s; times must ascend")
    for k in np.flatnonzero((discharge < 0.0) | (discharge > LARGEST_DISCHARGE) & np.isfinite(discharge)):
        problems.append(f"{rows[k]}: discharge is {discharge[k]:g} m3/s; it must be at least 0 and at most {LARGEST_DISCHARGE:g}")
    if velocity is not None:
        still = (velocity <= 0.0) & (discharge > 0.0)
        for k in np.flatnonzero((velocity < 0.0) | (velocity > LARGEST_VELOCITY) & np.isfinite(velocity) | still):
            wanted = f"it must be above 0 where there is a discharge, and at most {LARGEST_VELOCITY:g}"
            problems.append(f"{rows[k]}: velocity is {velocity[k]:g} m/s; {wanted}")
    if not problems and not (discharge > 0.0).any():
        problems.append("discharge is 0 at all times; state an inflow, or remove it")
    if not problems and float(time[-1]) <= 0.0:
        problems.append(f"the last time is {time[-1]:g} s; the run starts at 0 s")
    return problems


@dataclass(frozen=True, eq=False)
class Inflow:
    """Mass that enters at a line across a channel, or over a polygon.

    At a line it enters downslope, as thick as discharge over width and speed. Over a polygon its surface rises evenly.

    Parameters
    ----------
    terrain : Terrain
        The terrain it lies on.
    hydrograph : Hydrograph
        Discharge over time; with velocities if no ``thickness`` is given.
    line : array (n, 2), optional
        Vertices in map coordinates [m], drawn across the channel. Mass leaves it at a right angle to the chord between its ends,
        downslope; its width is the length of that chord.
    polygon : shapely Polygon, optional
        Instead of a line, in map coordinates.
    thickness : float, optional
        Vertical thickness [m] of the flow at the line, where the hydrograph states no velocity.
    name, source : str
        For messages and products.
    material : Material, optional
        Of this mass; by default that of the run.
    basal_friction_angle : float, optional
        Of this mass [rad]; by default that of the run.
    basal_friction : BasalFriction, optional
        Law of friction under this mass; by default that of the run.
    pore_pressure : PorePressure, optional
        Of this mass when it enters; by default it is dry.
    changes : tuple of str
        Assumptions of the reader, one sentence each.

    Raises
    ------
    ConfigError
        If line and polygon, or velocity and thickness, are both given or both missing, or a line cannot be used on the terrain.
    """

    terrain: Terrain
    hydrograph: Hydrograph
    line: Any = None
    polygon: Any = None
    thickness: float | None = None
    name: str = "inflow"
    source: str = "inflow"
    material: Material | None = None
    basal_friction_angle: float | None = None
    basal_friction: BasalFriction | None = None
    pore_pressure: PorePressure | None = None
    changes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        remedy = "give runout.Hydrograph([0, 60], [20, 20]): times [s] and discharges [m3/s]"
        require_kind(Hydrograph, self.hydrograph, f"{self.source}: hydrograph", remedy, ConfigError)
        if (self.line is None) == (self.polygon is None):
            said = "neither line nor polygon is given" if self.line is None else "line and polygon are both given"
            raise ConfigError(f"{self.source}: {said}; give one of them")
        require_one_speed(self.source, self.line is not None, self.thickness is not None, self.hydrograph.velocity is not None)
        if self.thickness is not None:
            checked("thickness", self.thickness, place=self.source, error=ConfigError)
        self._require_laws()
        if self.line is not None:
            vertices = real_array(self.line, f"{self.source}: line", ConfigError)
            if vertices.ndim != 2 or vertices.shape[1] != 2:
                raise ConfigError(f"{self.source}: line has shape {vertices.shape}; give its vertices (n, 2) [m]")
            object.__setattr__(self, "line", self._oriented(vertices))
            self._require_speed()

    def _require_laws(self) -> None:
        """Raise ConfigError if material or friction of its own are of another kind or out of range."""
        own = f"{self.source}: inflow {self.name}"
        for kind, name, remedy in (
            (Material, "material", MATERIAL_REMEDY),
            (BasalFriction, "basal_friction", FRICTION_REMEDY),
            (PorePressure, "pore_pressure", "give runout.PorePressure(ratio=0.7, decay_time=20.0)"),
        ):
            if getattr(self, name) is not None:
                require_kind(kind, getattr(self, name), f"{own}: {name}", remedy, ConfigError)
        if self.basal_friction_angle is not None:
            what = f"{own}: basal_friction_angle"
            angle = checked_radians("basal_friction_angle", self.basal_friction_angle, what, error=ConfigError)
            object.__setattr__(self, "basal_friction_angle", angle)

    def _require_speed(self) -> None:
        """Raise ConfigError if discharge, width and thickness make a flow faster than any."""
        speed = self.peak_speed()
        if speed > LARGEST_VELOCITY:
            raise ConfigError(
                f"{self.source}: {self.hydrograph.peak:g} m3/s over a line of {short(self.width)} m, "
                f"{short(self.peak_thickness())} m thick, flow at {speed:.4g} m/s, at most {LARGEST_VELOCITY:g} can be computed; "
                "check the unit of the discharge, or give a larger thickness or a wider line"
            )

    def _oriented(self, vertices: np.ndarray) -> np.ndarray:
        """The line with its downslope side on the left."""
        line = CrossSection(self.name, tuple((float(x), float(y)) for x, y in vertices), self.source)
        problems = list(vertex_problems(line))
        if problems:
            raise ConfigError(problems)
        turned = np.array(downhill_on_the_left(line, self.terrain))
        along = (turned - turned[0]) @ (turned[-1] - turned[0])
        if not (np.diff(along) > 0.0).all():
            raise ConfigError(
                f"{self.source}: the line turns back between its ends; draw it straight across the channel, or in small bends"
            )
        turned.setflags(write=False)
        return turned

    @classmethod
    def from_vector(cls, path: str | PathLike[str], terrain: Terrain, hydrograph: Any, **choices: Any) -> "Inflow":
        """Inflow at the one line, or over the polygons, of a GeoPackage, Shapefile or GeoJSON.

        ``hydrograph`` is a :class:`Hydrograph`, or a CSV file with columns time [s], discharge [m3/s] and, if there is no
        ``thickness``, velocity [m/s]. ``choices`` are ``thickness`` [m], ``layer``, ``name``, ``material``,
        ``basal_friction_angle_deg``, ``basal_friction`` and ``pore_pressure``. InputError with place, value and remedy.
        """
        inflow: Inflow = reader("Inflow.from_vector")(path, terrain, hydrograph, **choices)
        return inflow

    @property
    def width(self) -> float:
        """Length [m] of the chord of a line; of a polygon, the root of its area."""
        if self.line is None:
            return math.sqrt(float(self.polygon.area))
        return float(np.hypot(*(self.line[-1] - self.line[0])))

    @property
    def direction(self) -> np.ndarray:
        """Horizontal unit vector (2,) in which mass leaves a line."""
        along = (self.line[-1] - self.line[0]) / self.width
        return np.array([-along[1], along[0]])

    def places(self, count: int) -> np.ndarray:
        """Middles (count, 2) [m] of equal parts of the chord, on the line, in map coordinates."""
        chord = (self.line[-1] - self.line[0]) / self.width
        along = (self.line - self.line[0]) @ chord
        wanted = (np.arange(count) + 0.5) / count * self.width
        return np.column_stack([np.interp(wanted, along, self.line[:, axis]) for axis in range(2)])

    def horizontal_speed(self, velocity: np.ndarray, slope: float) -> np.ndarray:
        """Horizontal speed (n,) [m/s] of a ``velocity`` (n,) [m/s] along ground that rises by ``slope`` [1] in the direction."""
        return velocity / math.sqrt(1.0 + slope * slope)

    def peak_thickness(self, slope: float = 0.0) -> float:
        """Largest vertical thickness [m] of the flow at a line on ground with a ``slope`` [1] along the flow; 0 for a polygon."""
        if self.line is None:
            return 0.0
        if self.thickness is not None:
            return self.thickness
        q, v = self.hydrograph.discharge, self.hydrograph.velocity
        speed = self.horizontal_speed(v, slope) * self.width
        thickness = np.divide(q, speed, out=np.zeros(len(q)), where=speed > 0)
        return float(thickness.max())

    def peak_speed(self, slope: float = 0.0) -> float:
        """Largest speed [m/s] along the ground at which mass enters."""
        h = self.hydrograph
        if h.velocity is not None:
            return float(h.velocity[h.discharge > 0].max())
        if self.line is None or self.thickness is None:
            return 0.0
        return h.peak / (self.width * self.thickness) * math.sqrt(1.0 + slope * slope)

    def changed(self, factor: float = 1.0, delay: float = 0.0) -> "Inflow":
        """The inflow with ``factor`` [1] times the discharge, ``delay`` [s] later."""
        if factor == 1.0 and delay == 0.0:
            return self
        return replace(self, hydrograph=self.hydrograph.changed(factor, delay))

    def friction_on(self, otherwise: BasalFriction | float) -> BasalFriction | float:
        """Basal friction under this mass, or its friction angle [rad]: its own, or that of the run."""
        if self.basal_friction is not None:
            return self.basal_friction
        return otherwise if self.basal_friction_angle is None else self.basal_friction_angle

    def sentences(self, end_time: float, spacing: tuple[float, float, float]) -> list[str]:
        """What a user should know of the inflow in a run until ``end_time`` [s] on a grid of ``spacing`` [m]."""
        h, said = self.hydrograph, []
        lost = h.volume - float(h.entered.at(end_time))
        early = float(h.entered.at(0.0))
        if lost > 1e-9 * h.volume:
            said.append(
                f"{self.source}: the hydrograph of inflow {self.name} goes on until {h.end:g} s, the run ends at {end_time:g} s: "
                f"{short(lost, 'm3')} of {short(h.volume, 'm3')} do not enter; raise end_time, or cut the hydrograph"
            )
        if early > 1e-9 * h.volume:
            said.append(
                f"{self.source}: the hydrograph of inflow {self.name} begins at {h.begin:g} s, before the start of the run: "
                f"{short(early, 'm3')} of {short(h.volume, 'm3')} do not enter; shift its times"
            )
        if self.line is not None and self.peak_thickness() < spacing[2]:
            said.append(
                f"{self.source}: inflow {self.name} is {self.peak_thickness() / spacing[2]:.2g} cells thick at the line "
                f"({short(self.peak_thickness())} m at most); use a smaller cell_size to resolve it"
            )
        if self.line is not None and 0.0 < self.peak_speed() < SLOWEST:
            said.append(
                f"{self.source}: inflow {self.name} enters at {short(self.peak_speed(), 'm/s')} at most; debris flows are faster "
                f"than {SLOWEST:g} m/s (very rapid, Cruden & Varnes 1996); check discharge, and thickness or velocity"
            )
        if self.line is not None and (along := self._fall_along()):
            said.append(
                f"{self.source}: the ground falls by {along:.2g} along the line of inflow {self.name}, more than across it; mass "
                "leaves the line at a right angle, so draw it across the fall"
            )
        return said

    def _fall_along(self) -> float:
        """Mean fall [1] of ground that falls all along the line, and more than in the direction of the flow; else 0."""
        places, step = self.places(FALLS), max(self.terrain.cell_size) * self.direction
        ground = ground_at(self.terrain, places)
        across = np.nanmean(ground_at(self.terrain, places - step) - ground_at(self.terrain, places + step)) / (
            2.0 * np.hypot(*step)
        )
        steps = np.diff(ground)
        fall = abs(float(ground[-1] - ground[0])) / (self.width * (1.0 - 1.0 / FALLS))
        return fall if ((steps < 0.0).all() or (steps > 0.0).all()) and fall > float(across) else 0.0

    def statement(self, spacing: tuple[float, float, float]) -> str:
        """Volume, peak, duration and resolution on a grid of ``spacing`` [m], in words."""
        h, (dx, dy, dz) = self.hydrograph, spacing
        said = f"{short(h.volume, 'm3')} from {h.begin:g} to {h.end:g} s, at most {h.peak:.4g} m3/s"
        across = self.width / math.sqrt(dx * dy)
        if self.line is None:
            return f"{said}, over a polygon of {short(self.polygon.area, 'm2')} ({across:.2g} x {across:.2g} cells)"
        thickest = self.peak_thickness()
        thickness = f"{thickest:.3g} m thick at most ({thickest / dz:.2g} cells)"
        return f"{said}; line of {self.width:.4g} m ({across:.3g} cells), {thickness}"

    def record(self) -> dict[str, float]:
        """What products keep of it in SI units: volume, peak discharge, begin and end of the hydrograph, width and thickness."""
        h = self.hydrograph
        times = {"begin": h.begin, "end": h.end}
        thickness = self.peak_thickness() if self.line is not None else h.volume / float(self.polygon.area)
        return {"volume": h.volume, "peak_discharge": h.peak, **times, "width": self.width, "thickness": thickness}

    def content(self) -> list[np.ndarray]:
        """All that particles depend on, as arrays."""
        h = self.hydrograph
        place = self.line if self.line is not None else np.frombuffer(self.polygon.wkb, np.uint8)
        speeds = np.zeros(0) if h.velocity is None else h.velocity
        pores = self.pore_pressure.content() if self.pore_pressure else []
        return [h.time, h.discharge, speeds, place, np.array([self.thickness or 0.0]), *pores]

    def _facts(self) -> dict[str, str]:
        h = self.hydrograph
        place = f"line of {self.width:.4g} m" if self.line is not None else f"polygon of {short(self.polygon.area, 'm2')}"
        return {
            "name": self.name,
            "volume": short(h.volume, "m3"),
            "discharge": f"{h.peak:.4g} m3/s at most, from {h.begin:g} to {h.end:g} s",
            "place": place,
            "source": self.source,
        }

    def __repr__(self) -> str:
        return as_text("Inflow", self._facts())

    def _repr_html_(self) -> str:
        return as_html("Inflow", self._facts())


def require_one_speed(source: str, line: bool, thickness: bool, velocity: bool) -> None:
    """Raise ConfigError unless an inflow at a line has a thickness or velocities, not both, and one over a polygon no thickness."""
    if not line and thickness:
        raise ConfigError(f"{source}: thickness has no meaning with a polygon, over which the surface rises; remove it")
    if line and thickness and velocity:
        said = "thickness and the velocities of the hydrograph are both given"
        raise ConfigError(f"{source}: {said}; remove thickness, or the column velocity")
    if line and not (thickness or velocity):
        said = "neither thickness nor velocity is given"
        raise ConfigError(f"{source}: {said}; add thickness: [m] to the inflow, or a column velocity [m/s] to the hydrograph")
