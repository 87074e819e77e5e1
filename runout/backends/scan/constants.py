"""Constants of a run, and of its present time step, as the kernels take them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from runout.backends.scan.domain import domain_of
from runout.backends.scan.groups import Constants, Domain, TimeStep, Zones
from runout.backends.scan.node_columns import FreeDrag
from runout.model.scene import Scene
from runout.physics import moments

MODULI = ("lame_lambda", "shear_modulus")


@dataclass
class Tables:
    """What the scene and the time step say."""

    constants: Constants
    step: TimeStep
    # (releases, 2): lame parameters of the materials [Pa]. Kernels that need no more take these, so that they are compiled once
    # for all laws
    moduli: np.ndarray
    packed_dt: float  # time step [s] with whose stress the records are packed; 0 before the first step
    domain: Domain
    zones: Zones | None
    # (releases times kinds of ground,): records of basal friction. No group has them, so that few kernels depend on the law of
    # friction
    basal: np.ndarray
    free_drag: FreeDrag  # what mass in flight takes of them
    particle_volume: float  # mean volume of a particle [m3]
    pores: np.ndarray  # (releases,): records of pore pressure

    @classmethod
    def of(cls, scene: Scene, particle_volume: float, corner: np.ndarray) -> "Tables":
        """Tables of a scene whose blocks are counted from the node ``corner`` (3,); no time step is set yet."""
        real, spacing = scene.dtype, np.array(scene.spacing)
        basal = scene.basal.table(real, np.longdouble)  # kernels fuse products and sums
        friction, zones = _frictions(scene, basal)
        constants = Constants(
            friction=friction, density=scene.densities, h=spacing.astype(real),
            spacing=spacing, gravity=np.array(scene.gravity, np.float64), corner=corner, dv=np.zeros(16, real),
        )  # fmt: skip
        none = (real(0),) * 3
        mats = scene.law.table(scene.materials, real, min(scene.spacing))
        moduli = np.stack([mats[name] for name in MODULI], axis=1)
        step, domain = TimeStep(mats, real(0), none, none), domain_of(scene, corner)
        drag, pores = _free_drag(scene, basal), scene.pore_table(real)
        return cls(constants, step, moduli, 0.0, domain, zones, basal, drag, particle_volume, pores)

    def set_step(self, scene: Scene, dt: float) -> Any:
        """Set the constants of steps of ``dt`` [s]; returns by how much longer [s] the step is with which records are packed."""
        real, dv, mats = scene.dtype, self.constants.dv, self.step.mats
        scene.law.set_step(mats, dt)
        longer = real(dt - self.packed_dt)
        self.packed_dt = dt
        for k in range(16):
            dv[k] = dt * scene.gravity[k % 4 - 1] if k % 4 else 0.0
        slopes = tuple(real(moments.moment_slope(dt, h)) for h in scene.spacing)
        self.step = TimeStep(mats, real(dt), slopes, tuple(real(dt / h) for h in scene.spacing))  # type: ignore[arg-type]
        return longer


def _free_drag(scene: Scene, table: np.ndarray) -> FreeDrag:
    basal, gravity = scene.basal, scene.dtype(math.hypot(*scene.gravity))
    kind = np.zeros((1, 1), np.int32) if basal.kind is None else basal.kind
    size = np.full(2, np.inf) if basal.kind is None else basal.size
    return FreeDrag(table.reshape(-1, basal.kinds), kind, size, gravity)


def _frictions(scene: Scene, table: np.ndarray) -> tuple[np.ndarray, Zones | None]:
    """What contacts hold of the friction of each release (releases,) until the zones are looked up, and the zones."""
    basal, real = scene.basal, scene.dtype
    alone = len(basal.law.fields) == 1
    friction = table[basal.law.fields[0]] if alone else np.arange(len(table)).astype(real)
    if basal.kind is None:
        return np.ascontiguousarray(friction), None
    zones = Zones(basal.kind, basal.size, np.ascontiguousarray(friction.reshape(-1, basal.kinds)))
    return np.arange(len(basal.numbers)).astype(real), zones
