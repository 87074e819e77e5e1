"""Inflow of a run: the particles that a hydrograph brings to a line or a polygon (:mod:`runout.release.inlet` says when).

At a line, a plane of particles stands as high as the flow and moves with its speed, as far from the line as it has gone since it
was due. Nothing pushes it from behind, where the flow upstream would: it gets that momentum at once. The flow upstream presses with
k g' H^2/2 by width and density (k: lateral over normal stress at rest, g' and H: gravity and thickness normal to the ground) and
brings q u, so that mass at the speed

    u + k g' H / (2 max(u, sqrt(g' H)/2))

carries both. Slower than half the speed of long waves a flow is governed from downstream, and the push stays that of this speed.

No mass enters where mass is. Columns of a plane that would stand in the flow, since it has backed up to the line, stand on it
instead, and so do all particles over a polygon. The volume that stood on the flow at a line is booked.
"""

import logging
import math
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from runout.backends.compile import array_binding
from runout.backends.protocol import Backend, WindowBackend
from runout.backends.state import State, put_arrays
from runout.model.inflow import Inflow
from runout.model.nodal_surface import NodalSurface
from runout.model.particles import Particles
from runout.model.scene import Scene
from runout.release import arrangement, inlet

LOGGER = logging.getLogger(__name__)
CROWDED = 0.55  # of the thickness of a plane: where columns of the flow have more, its particles are looked at
APART = 0.75  # of the distance of particles: those of a new column that are closer would stand in the flow


class HydrographSource:
    """Source of one inflow (:class:`runout.simulation.entering.Source`).

    Parameters
    ----------
    inflow : Inflow
    number : int
        Of its mass among those of the scene.
    how : inlet.Spacing
        Distances of its particles.
    births : inlet.Births
    end_time : float
        Of the run [s].
    seed : int
        Of the run, for random pore pressures.

    Attributes
    ----------
    name : str
        Of the inflow.
    scene : Scene
        Of the run, from :meth:`begin` on.
    started : float
        Time [s] of the first birth; NaN before.
    particle_volume : float
        Mean volume of its particles [m3].
    due : float
        Time [s] of the last of the births that come next.
    coming : bool
        Whether mass will enter before the end of the run.
    next, last : int
        Number of the next birth, and that of those until the end of the run.
    entered, lifted : float
        Volume that has entered, and that of it which stood on the flow at the line [m3].
    """

    sudden = False
    reserved = 0
    stop = math.inf
    waiting_mass = 0.0  # it holds none: the sentences of the inflow say what comes after the end of the run
    thickness: np.ndarray | float = 0.0
    group = 1  # births at once
    scene: Scene

    def __init__(self, inflow: Inflow, number: int, how: inlet.Spacing, births: inlet.Births, end_time: float, seed: int = 0):
        self.inflow, self.number, self.how, self.births, self.seed = inflow, number, how, births, seed
        self.name, self.started = inflow.name, math.nan
        self.before = np.concatenate([[0], np.cumsum(births.count)])  # particles before each birth
        self.last = int(np.searchsorted(births.time, end_time, "right"))
        self.expected = int(self.before[-1])
        self.particle_volume = births.total / float(self.before[-1])
        self.next, self.entered, self.lifted = 0, 0.0, 0.0
        self._go_on(0)

    def _go_on(self, following: int) -> None:
        """Note which birth is the ``following``, when the last of those with it is due, and whether there is any."""
        self.next, self.coming = following, following < self.last
        self.due = float(self.births.time[min(following + self.group, self.last) - 1]) if self.coming else math.inf

    def begin(self, scene: Scene) -> None:
        """Take the scene of the run."""
        self.scene = scene

    @property
    def ground(self) -> NodalSurface:
        """Ground of the run, which a bed may lower."""
        assert self.scene.ground is not None
        return self.scene.ground

    def take(self, engine: Backend, time: float) -> Particles | None:
        """Particles that are due up to a time [s]."""
        last = int(np.searchsorted(self.births.time, time * (1.0 + 1e-12), "right"))
        if last <= self.next:
            return None
        first = self.next
        self._go_on(last)
        self.started = time if math.isnan(self.started) else self.started
        newborn = self._born(engine, first, last, time)
        self.entered += float(newborn.volume.sum())
        if last == len(self.births) and self.lifted > 0.0:
            LOGGER.warning("%s", self.sentence())
        return newborn

    def _born(self, engine: Backend, first: int, last: int, time: float) -> Particles:
        """Particles of some births at a time [s]."""
        raise NotImplementedError

    def sentence(self) -> str:
        """What a user should know of mass that stood on the flow; empty if there is none."""
        if not self.lifted:
            return ""
        volumes = f"{self.lifted:.4g} of {self.entered:.4g} m3 entered on top of it"
        return (
            f"inflow {self.name}: the flow backed up to the line; {volumes}. The flow below is slower than the hydrograph states: "
            "state a lower velocity or a larger thickness, or move the line"
        )

    def _particles(self, position: np.ndarray, volume: np.ndarray) -> Particles:
        """Particles without stress at local positions (n, 3) [m], with the mass and the pore pressure of this inflow."""
        scene, raster, density = self.scene, self.scene.raster, float(self.scene.densities[self.number])
        limits = np.multiply((raster.columns, raster.rows), raster.cell_size)
        position[:, :2] = np.clip(position[:, :2], 0.0, limits)
        newborn = Particles.at(position, np.array(scene.spacing))
        newborn.release[:] = self.number
        newborn.mass[:] = (density * volume).astype(scene.dtype).astype(np.float64)
        newborn.volume[:] = volume
        pore = scene.pore_pressure[self.number] if scene.is_wet else None
        if pore is not None:
            ratio = pore.at(position[:, 0], position[:, 1], raster.cell_size, (self.seed, self.number))
            newborn.pore_excess[:], newborn.pore_left[:] = ratio - pore.equilibrium(density), 1.0
        return newborn

    def _thickness_at(self, engine: Backend, plan: np.ndarray) -> np.ndarray:
        """Thickness (n,) [m] of the flow at local places (n, 2) [m], in cells of half the size of those of the grid."""
        boxes = engine.lattice_columns().boxes if isinstance(engine, WindowBackend) else None
        thickness = np.zeros(len(plan))
        if boxes is None:
            return thickness
        half = 0.5 * np.array(self.scene.spacing[:2])
        i, j = (np.floor(plan / half).astype(np.int64) - (boxes.column, boxes.row)).T
        _, rows, columns = boxes.sums.shape
        inside = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
        thickness[inside] = boxes.sums[0, j[inside], i[inside]] / half.prod()
        return thickness

    def state(self) -> State:
        """Births so far, and volumes."""
        return {name: np.asarray(getattr(self, name)) for name in ("next", "entered", "lifted", "started")}

    def restore(self, state: State) -> None:
        """Continue from :meth:`state`."""
        put_arrays(self, state)
        self._go_on(self.next)

    def content(self) -> Iterable[np.ndarray]:
        """Births, places, and the mass."""
        births = self.births
        yield from (births.time, births.count, births.volume, births.thickness, births.speed)
        yield from self.inflow.content()
        yield np.array([self.number, self.how.along, self.how.across, self.how.layer, self.last, self.seed])


class LineSource(HydrographSource):
    """Source of an inflow at a line, from ground with a ``slope`` [1] along the flow there."""

    def __init__(self, inflow: Inflow, number: int, how: inlet.Spacing, end_time: float, seed: int = 0):
        slope = inlet.slope_at(inflow)
        self.group = how.planes
        super().__init__(inflow, number, how, inlet.births_at_line(inflow, how, slope), end_time, seed)
        self.path = inlet.path_of(inflow, slope)

    def _born(self, engine: Backend, first: int, last: int, time: float) -> Particles:
        """Particles of some planes, as far from the line as the flow has gone since their middle left it."""
        births, how, plan, index, rows, birth = self.births, self.how, [], [], [], []
        for k in range(first, last):
            planar = births.thickness[k] > 0.0
            if planar:
                share = (np.arange(how.columns) + 0.5) / how.columns
            else:
                share = inlet.shares_along(int(self.before[k]), int(births.count[k]))
            gone = self._gone(time) - self._gone(births.time[k]) + 0.5 * how.along
            plan.append(self._on_line(share) + gone * self.inflow.direction)
            index.append(np.column_stack([np.full(len(share), k), np.floor(share * how.columns).astype(np.int64)]))
            rows.append(np.full(len(share), births.count[k] // len(share)))
            birth.append(np.full(len(share), k))
        places = self.inflow.terrain.frame.to_local(np.concatenate(plan))
        return self._columns(engine, places, np.concatenate(index), np.concatenate(rows), np.concatenate(birth))

    def _gone(self, time: float) -> float:
        """Path [m] of the flow at the line up to a time [s]; after the hydrograph it goes on at its last speed."""
        late = max(0.0, time - float(self.path.time[-1]))
        return float(self.path.at(time)) + late * float(self.births.speed[-1])

    def _on_line(self, share: np.ndarray) -> np.ndarray:
        """Places (n, 2) [m] on the line in map coordinates, at shares (n,) [1] of its chord."""
        line, width = self.inflow.line, self.inflow.width
        along = (line - line[0]) @ (line[-1] - line[0]) / width
        return np.column_stack([np.interp(share * width, along, line[:, axis]) for axis in range(2)])

    def _columns(self, engine: Backend, plan: np.ndarray, index: np.ndarray, rows: np.ndarray, birth: np.ndarray) -> Particles:
        """Particles of columns (n,) that stand at local places (n, 2) [m], with so many ``rows`` (n,) of some births (n,)."""
        births = self.births
        single = births.volume[birth] / (self.how.along * self.how.across)
        thickness = np.where(births.thickness[birth] > 0.0, births.thickness[birth], single)
        ground, east, north = self.ground.evaluate(plan[:, 0], plan[:, 1])
        lift = self._lifts(engine, plan, thickness)
        column = np.repeat(np.arange(len(rows)), rows)
        row = np.arange(len(column)) - np.repeat(np.cumsum(rows) - rows, rows)
        height = (thickness / rows)[column]
        z = ground[column] + lift[column] + (row + arrangement.shares(index)[column]) * height
        newborn = self._particles(np.column_stack([plan[column], z]), births.volume[birth][column])
        newborn.radius[:] = arrangement.half_size(height) / np.sqrt(1.0 + east**2 + north**2)[column]
        newborn.velocity[:] = self._velocities(births.speed[birth], thickness, east, north)[column]
        self.lifted += float(newborn.volume[(lift > 0.0)[column]].sum())
        return newborn

    def _velocities(self, speed: np.ndarray, thickness: np.ndarray, east: np.ndarray, north: np.ndarray) -> np.ndarray:
        """Velocities (n, 3) [m/s] along the ground with slopes (n,) [1], with the push of the flow upstream."""
        scene, (dx, dy) = self.scene, self.inflow.direction
        rise, steep = dx * east + dy * north, np.sqrt(1.0 + east**2 + north**2)
        gravity = np.maximum(0.0, (scene.gravity[0] * east + scene.gravity[1] * north - scene.gravity[2]) / steep)
        along = speed * np.sqrt(1.0 + rise**2)
        push = array_binding().inflow.push_of_flow(along, gravity, thickness / steep, scene.materials[self.number].rest_ratio)
        factor = 1.0 + np.divide(push, along, out=np.zeros(len(along)), where=along > 0.0)
        return np.asarray((speed * factor)[:, None] * np.column_stack([np.full(len(rise), dx), np.full(len(rise), dy), rise]))

    def _lifts(self, engine: Backend, plan: np.ndarray, thickness: np.ndarray) -> np.ndarray:
        """Heights (n,) [m] of the flow where new columns at local places (n, 2) [m] would stand in it; 0 elsewhere.

        Particles are looked at only where the columns of the flow have more than a plane that left in time.
        """
        lift, how = np.zeros(len(plan)), self.how
        crowded = np.flatnonzero(self._thickness_at(engine, plan) > CROWDED * thickness)
        if not len(crowded):
            return lift
        present = engine.particles()
        x = present.position(np.array(self.scene.spacing))
        low, high = (plan[crowded].min(axis=0) - how.along - how.across, plan[crowded].max(axis=0) + how.along + how.across)
        near = np.flatnonzero(((x[:, :2] >= low) & (x[:, :2] <= high)).all(axis=1))
        ground, _, _ = self.ground.evaluate(x[near, 0], x[near, 1])
        top = x[near, 2] - ground + 0.5 * present.volume[near] / (how.along * how.across)
        forwards = self.inflow.direction
        sideways = np.array([-forwards[1], forwards[0]])
        for column in crowded:
            away = x[near, :2] - plan[column]
            inside = (np.abs(away @ forwards) < APART * how.along) & (np.abs(away @ sideways) < APART * how.across)
            lift[column] = max(0.0, float(top[inside].max(initial=0.0)))
        return lift


class PolygonSource(HydrographSource):
    """Source of an inflow over a polygon."""

    def __init__(self, inflow: Inflow, number: int, how: inlet.Spacing, end_time: float, seed: int = 0):
        super().__init__(inflow, number, how, inlet.births_over_polygon(inflow, how), end_time, seed)

    @cached_property
    def places(self) -> np.ndarray:
        """Local places (n, 2) [m] of all its particles."""
        return self.inflow.terrain.frame.to_local(inlet.places_in(self.inflow.polygon, int(self.before[-1])))

    def _born(self, engine: Backend, first: int, last: int, time: float) -> Particles:
        """Single particles on the flow, or on the ground; with a velocity they move down the slope."""
        births, plan = self.births, self.places[self.before[first] : self.before[last]]
        birth = np.repeat(np.arange(first, last), births.count[first:last])
        ground, east, north = self.ground.evaluate(plan[:, 0], plan[:, 1])
        size = births.volume[birth] / (self.how.along * self.how.across)
        z = ground + self._top_of_flow(engine, plan) + 0.5 * size
        newborn = self._particles(np.column_stack([plan, z]), births.volume[birth])
        newborn.radius[:] = arrangement.half_size(size) / np.sqrt(1.0 + east**2 + north**2)
        slope = np.hypot(east, north)
        horizontal = births.speed[birth] / np.sqrt(1.0 + slope**2)
        newborn.velocity[:, :2] = -(horizontal / np.maximum(slope, 1e-12))[:, None] * np.column_stack([east, north])
        newborn.velocity[:, 2] = -horizontal * slope
        return newborn

    def _top_of_flow(self, engine: Backend, plan: np.ndarray) -> np.ndarray:
        """Thickness (n,) [m] of the flow around local places (n, 2) [m], the largest within half a cell."""
        half = 0.5 * np.array(self.scene.spacing[:2])
        around = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]) * half
        places = (plan[None] + around[:, None]).reshape(-1, 2)
        return np.asarray(self._thickness_at(engine, places).reshape(len(around), -1).max(axis=0))


def source_of(
    inflow: Inflow, number: int, spacing: tuple[float, float, float], per_axis: tuple[int, int, int], end_time: float, seed: int = 0
) -> HydrographSource:
    """Source of an inflow in a run until ``end_time`` [s].

    Parameters
    ----------
    inflow : Inflow
    number : int
        Of its mass among those of the scene.
    spacing : tuple of float
        Of the grid [m].
    per_axis : tuple of int
        Particles (px, py, pz) of a cell.
    end_time : float
    seed : int
        Of the run.

    Raises
    ------
    ConfigError
        If the line or the polygon is smaller than a cell.
    """
    inlet.require_wide(inflow, spacing)
    how = inlet.Spacing.of(inflow, spacing, per_axis)
    return (PolygonSource if inflow.line is None else LineSource)(inflow, number, how, end_time, seed)


def sources_of(
    inflows: Sequence[Inflow], first: int, spacing: tuple[float, float, float], per_axis: tuple[int, int, int], end_time: float,
    seed: int,
) -> list[HydrographSource]:  # fmt: skip
    """Sources of the inflows of a run, whose masses are numbered from ``first`` on."""
    return [source_of(one, first + k, spacing, per_axis, end_time, seed) for k, one in enumerate(inflows)]


def record_of(sources: Sequence[object]) -> dict[str, list[float]]:
    """For the record of a run with some sources, by inflow: volume that entered, and that of it which stood on the flow [m3]."""
    own = [source for source in sources if isinstance(source, HydrographSource)]
    return {"inflow_volume": [s.entered for s in own], "inflow_on_top_volume": [s.lifted for s in own]} if own else {}
