"""Invariants of a run that must hold at every observation, for all settings."""

from dataclasses import dataclass, field

import numpy as np

from runout.backends.protocol import Backend, LedgerRow
from runout.model.nodal_surface import NodalSurface
from runout.model.particles import Particles
from runout.model.scene import STANDARD_GRAVITY, Scene
from runout.release import arrangement
from runout.simulation.entering import Entering
from runout.simulation.erosion import ErodingBed
from runout.studies.stability_cases.layout import EDGE, NARROW, Layout

LIMITS = {  # largest measured value
    "mass": 1e-12,  # relative change of mass, including escaped mass and that from a bed or an inflow
    "momentum": 1.0,  # defect over its tolerance
    "energy": 1e-3,  # rise of all energy over the drop of potential energy
    "speed": 1.0,  # of a particle over its bound
    "mean speed": 1.0,  # of the centre of mass over its bound
    "penetration": 0.1,  # of the middle of a layer of particles below the ground [cells]; they lie at some heights in it
    "penetration at narrow edges": 1.0,  # the same on terrains with edges that the stencil of three nodes cannot resolve
    "sinking": np.inf,  # of a particle below where it touches, half its size above the ground [cells]; reported
    "bed": 1e-9,  # depth by which any node is eroded below its bed [cells]
    "pore pressure": 1e-6,  # by which the part of the excess that remains lies beyond 0 to 1
    "rest": 1.0,  # creep over 1 mm/s, for what must end at rest
    "passage": 0.03,  # share of the mass that stays behind the edge of a cliff, for what must pass it
}
FIELDS = ("offset", "velocity", "affine", "strain", "history", "pore_excess", "pore_left")


@dataclass
class Watch:
    """Follows a run and keeps the worst of every invariant in ``worst``."""

    layout: Layout
    scene: Scene
    start: Particles
    first: LedgerRow
    bed: ErodingBed | None = None
    entering: Entering | None = None
    entered_momentum: np.ndarray = field(default_factory=lambda: np.zeros(3))  # [N s]
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LIMITS, 0.0))
    weight: np.ndarray = field(default_factory=lambda: np.zeros(3))  # impulse of gravity so far [N s]
    steps: int = 0
    not_finite: str = ""
    lowest: list[float] = field(default_factory=lambda: [np.inf, np.inf])  # energy so far [J], see :meth:`close`
    rise: float = 0.0  # [J]
    drop: float = 0.0  # of potential energy [J]
    stored: float = 0.0  # energy that belongs to the places of the last look [J]
    moving: float = 0.0  # and to the velocities that led there [J]

    def ledger(self, engine: Backend) -> LedgerRow:
        """Sums since the start, those of a bed and an inflow included."""
        row = engine.ledger()
        row = self.bed.ledger(row) if self.bed else row
        return self.entering.ledger(row) if self.entering else row

    def enter(self, engine: Backend, time: float) -> None:
        """Let the inflow give what is due at a ``time`` [s], and book its momentum."""
        assert self.entering is not None
        before = engine.ledger().momentum
        self.entering.update(engine, time, self.bed.born if self.bed else 0)
        self.entered_momentum += engine.ledger().momentum - before

    def passed(self, seconds: float) -> None:
        """Count the impulse of gravity on all mass that is there for some ``seconds`` [s]."""
        entrained = self.bed.booked.entrained_mass if self.bed else 0.0
        entered = self.entering.entered.mass if self.entering else 0.0
        self.weight += seconds * (self.first.mass + entrained + entered) * np.array(self.scene.gravity)

    def look(self, engine: Backend) -> bool:
        """Update the invariants with the present state; False if it is not finite."""
        p, row = engine.particles(), self.ledger(engine)
        for name in FIELDS:
            if not np.isfinite(getattr(p, name)).all():
                self.not_finite = name
                return False
        self._budget(row)
        if len(p):
            self._bounds(p, row)
            self._keep("pore pressure", float(max(-p.pore_left.min(), p.pore_left.max() - 1.0)))
        if self.bed:
            self._within(self.bed)
        return True

    def finish(self, engine: Backend) -> None:
        """Evaluate the invariants of the final state."""
        weight = self.first.mass * STANDARD_GRAVITY * self.layout.h
        rounding = 2e-8 * self.steps * weight if self.scene.precision == "float32" else 0.0
        self.worst["energy"] = max(self.rise - rounding, 0.0) / max(self.drop, self.first.kinetic_energy, 1e-3 * weight)
        if self.layout.rests:
            p = engine.particles()
            creep = float(np.abs(p.mass @ p.velocity / p.mass.sum()).max())
            self.worst["rest"] = creep / 1e-3
        if self.layout.passes:
            p = engine.particles()
            behind = p.position(np.array(self.scene.spacing))[:, 0] < EDGE * self.layout.h
            self.worst["passage"] = float(p.mass[behind].sum() / self.first.mass)

    @property
    def broken(self) -> list[str]:
        """Violated invariants with their measured values."""
        reasons = [f"{self.not_finite} is not finite"] if self.not_finite else []
        return reasons + [f"{name} {self.worst[name]:.3g}" for name, limit in LIMITS.items() if not self.worst[name] <= limit]

    def _keep(self, name: str, value: float) -> None:
        self.worst[name] = max(self.worst[name], value)

    def _budget(self, row: LedgerRow) -> None:
        first = self.first
        self._keep("mass", abs(row.mass + row.escaped_mass - row.entrained_mass - row.entered_mass - first.mass) / first.mass)
        if row.escaped_mass == 0.0:
            defect = row.momentum - first.momentum - self.weight - row.basal_impulse - self.entered_momentum
            scale = np.abs(row.momentum).max() + np.abs(self.weight).max() + np.abs(row.basal_impulse).max()
            tolerance = (1e-10 if self.scene.precision == "float64" else 1e-5) * scale
            self._keep("momentum", float(np.abs(defect).max() / max(tolerance, np.finfo(float).tiny)))
        potential = row.potential_energy - row.entrained_energy - row.entered_energy
        self.stored = potential + row.elastic_energy + row.escaped_energy + row.plastic_dissipation
        self.moving = _moving(row) + row.structure_dissipation
        self.drop = max(self.drop, first.potential_energy - potential - row.escaped_energy)

    def close(self, row: LedgerRow) -> None:
        """Complete the budget of the last look with the ledger one step later.

        Velocities belong to the middle of a step and places to its end. The kinetic energy, and the work of the ground that
        belongs to it, is that before a place or the mean of before and after: both are of first order in the step, and each
        vibration shows in one of them as a rise and fall. Energy from nowhere rises in both.
        """
        rises = []
        for k, moving in enumerate((self.moving, 0.5 * (self.moving + _moving(row)))):
            self.lowest[k] = min(self.lowest[k], self.stored + moving)
            rises.append(self.stored + moving - self.lowest[k])
        self.rise = max(self.rise, min(rises))

    def _fastest_start(self) -> float:
        """Largest speed [m/s] that mass has at the start or when it enters, the push of the flow upstream included."""
        if not self.entering:
            return self.layout.speed
        push = np.sqrt(STANDARD_GRAVITY * self.layout.inflow_thickness * self.layout.h)  # k at most 1, see runout.simulation.inflow
        return max(self.layout.speed, self.layout.inflow_speed + float(push))

    def _within(self, bed: ErodingBed) -> None:
        """Keep the depth by which nodes are eroded below their bed, with and without particles that were born early."""
        spacing = self.scene.spacing
        there = bed.depth.on_nodes(bed.first, bed.eroded.shape, spacing)
        beyond = np.maximum(bed.eroded, bed.eroded - bed.owed) - there
        self._keep("bed", float(beyond.max()) / min(spacing))

    def _bounds(self, p: Particles, row: LedgerRow) -> None:
        h, g, v0 = np.array(self.scene.spacing), STANDARD_GRAVITY, self._fastest_start()
        z, before = p.position(h)[:, 2], self.start.position(h)[:, 2]
        height = max(self.layout.thickness, self.layout.inflow_thickness) * self.layout.h
        bound = 1.05 * (np.sqrt(v0**2 + 2 * g * max(before.max() - z.min(), 0.0)) + 2 * np.sqrt(g * height))
        self._keep("speed", row.max_speed / bound)
        if row.escaped_mass == 0.0 and not self.entering:  # mass that enters has a velocity of its own
            fall = before.mean() - z.mean() + 1e-6 * h[2]
            if self.bed:  # mass joins at other heights
                spent = self.first.potential_energy - row.potential_energy + row.entrained_energy
                fall = spent / (row.mass * g) + 1e-6 * h[2]
            mean = np.linalg.norm(row.momentum) / row.mass
            released = 2 * self.first.elastic_energy / row.mass  # a release under its own weight can spring back
            fastest = np.sqrt(v0**2 + 2 * g * max(fall, 0.0) + released)
            self._keep("mean speed", float(mean / (1e-9 + 1.001 * fastest + 1e-3 * np.sqrt(g * height))))
        assert self.scene.ground is not None
        above = _height(self.scene.ground, p.position(h))
        edges = " at narrow edges" if self.layout.terrain in NARROW else ""
        middle = above + (arrangement.LEVELS - 1) * p.radius  # half a layer above its lower end
        self._keep(f"penetration{edges}", float(-middle.min() / h.min()))
        self._keep("sinking", float(-(above - p.radius).min() / h.min()))


def _moving(row: LedgerRow) -> float:
    """Energy [J] that belongs to velocities: kinetic, and the work of the ground.

    What mass from a bed takes is booked when it is born, before the flow is slower: it is left out, as a loss.
    """
    return row.kinetic_energy + row.basal_dissipation


def _height(ground: NodalSurface, x: np.ndarray) -> np.ndarray:
    """First-order distance (n,) [m] of positions (n, 3) [m] from a ground, positive above."""
    elevation, east, north = ground.evaluate(x[:, 0], x[:, 1])
    return (x[:, 2] - elevation) / np.sqrt(1.0 + east**2 + north**2)  # type: ignore[no-any-return]
