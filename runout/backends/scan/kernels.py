"""The compiled kernels of a scene."""

from types import SimpleNamespace

from runout.backends.compile import PHYSICS, numba_binding
from runout.backends.lanes import memory, shuffles, vectors
from runout.backends.scan import (
    arenas,
    contact_detection,
    contact_solution,
    domain,
    forces,
    gradients,
    grid_to_particles,
    ground,
    index,
    observe,
    particles_to_grid,
    precompile,
    raster_sums,
    rest,
    sort,
    stencil,
    zones,
)
from runout.backends.scan.gradient_transfer import uses_gradient_transfer
from runout.model.laws import Law
from runout.model.scene import Scene

COMMON = (
    stencil,
    arenas,
    ground,
    index,
    particles_to_grid,
    contact_detection,
    contact_solution,
    sort,
    observe,
    raster_sums,
    rest,
    zones,
)  # know no law
LANES = (vectors, shuffles, memory)
BY_GRADIENTS = (
    stencil,
    particles_to_grid,
    observe,
    contact_detection,
    forces,
    gradients,
)  # of transfers other than the packed one, and of F-bar
SOURCES = (*PHYSICS, *COMMON, domain, grid_to_particles, *LANES, precompile)
_MADE: dict[tuple[str, Law, bool, str], SimpleNamespace] = {}


def kernels_for(scene: Scene) -> SimpleNamespace:
    """Kernels for the number type and the law of a scene, made once a process and taken from the cache of compiled code."""
    key = (scene.precision, scene.law, len(scene.materials) == 1, precompile.variant(scene))
    if key not in _MADE:
        precompile.ensure_compiled(scene, (*SOURCES, *BY_GRADIENTS) if uses_gradient_transfer(scene) else SOURCES)
        _MADE[key] = _bound(scene)
    return _MADE[key]


def _bound(scene: Scene) -> SimpleNamespace:
    binding = numba_binding(scene.dtype)
    common = binding.kernels(*COMMON, sources=(*LANES, domain, grid_to_particles))
    law = binding.law(scene.law)
    names = {
        "law_update": law.step,
        "law_update_small": law.step_small,
        "ONE_MATERIAL": len(scene.materials) == 1,
        "GRADIENT_TRANSFER": uses_gradient_transfer(scene),
    }
    own = binding.kernels(stencil, domain, grid_to_particles, sources=LANES, **names)
    more = binding.kernels(*BY_GRADIENTS, sources=LANES) if uses_gradient_transfer(scene) else SimpleNamespace()
    return SimpleNamespace(**(vars(more) | vars(common) | vars(own)))
