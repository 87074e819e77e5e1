"""Loading: the particles of all scenes are brought to the device a chunk at a time; the host never holds all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from runout.backends.hash.account import Account
from runout.backends.hash.limits import largest_particles, require_particles
from runout.backends.hash.scenes import SceneArrays
from runout.backends.hash.state import Store
from runout.backends.loading import fastest, require_movable
from runout.model.particle_source import ParticleSource, slices
from runout.model.particles import Particles, require_index_range
from runout.model.scene import Scene


@dataclass
class Loaded:
    """Particles of scenes on the device of the scope, in the order in which they were given."""

    scenes: SceneArrays
    store: Store
    nodes: wp.array  # first node of each particle, in the range of its scene
    accounts: list[Account] = field(default_factory=list)  # one a scene
    largest_radius: float = 0.0  # [m], in the precision of the scenes

    @classmethod
    def of(cls, scenes: SceneArrays, sources: Sequence[ParticleSource], more: int = 0) -> Loaded:
        """The particles of one source a scene, with places for so many ``more``.

        Raises StabilityError or CapacityError: for particles that no step can move, that lie beyond the range of the index, or
        that are too many to be addressed.
        """
        size = sum(map(len, sources))
        require_particles(size, scenes.scenes[0].dtype().itemsize)
        places = max(size, min(size + more, largest_particles(scenes.scenes[0].dtype().itemsize)))
        store = Store(np.zeros(places, np.int64), scenes.number, wet=scenes.wet)
        store.n = store.loaded = size
        if more:
            store.make_joining(0)
        loaded = cls(scenes, store, wp.zeros((size, 3), dtype=wp.int32))
        first = 0
        for number, (scene, source) in enumerate(zip(scenes.scenes, sources, strict=True)):
            total, speed = source.sums(scene.densities), 0.0
            for part, chunk in slices(source):
                loaded._put(slice(first + part.start, first + part.stop), chunk, scene, number)
                speed = max(speed, fastest(chunk))
            first += len(source)
            loaded.accounts.append(Account(len(source), total.mass, speed, total.mean_volume))
        scenes.constants.only = store.only
        return loaded

    def _put(self, part: slice, p: Particles, scene: Scene, number: int) -> None:
        """Bring some particles of scene ``number`` to their places."""
        require_movable(p)
        require_index_range(p.node, scene.spacing, np.zeros(3, np.int64))
        self.store.put(part, p, int(self.scenes.first_release[number]), scene.spacing, scene.dtype)
        node = p.node.copy()
        node[:, 1] += self.scenes.shifts[number].astype(np.int32)
        self.nodes[part].assign(node)
        self.largest_radius = max(self.largest_radius, float(p.radius.astype(scene.dtype).max(initial=0.0)))
