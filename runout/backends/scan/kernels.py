"""The compiled kernels of a scene."""

from types import SimpleNamespace

from runout.backends.compile import PHYSICS, numba_binding
from runout.backends.lanes import memory, shuffles, vectors
from runout.backends.scan import (
    ahead,
    arenas,
    columns,
    contact,
    domain,
    forces,
    gradients,
    ground,
    impulses,
    index,
    motion,
    observe,
    order,
    rest,
    stencil,
    transfer,
    zones,
)
from runout.backends.scan.general import is_general
from runout.model.laws import Law
from runout.model.scene import Scene

COMMON = (stencil, arenas, ground, index, transfer, contact, impulses, order, observe, columns, rest, zones)  # know no law
LANES = (vectors, shuffles, memory)
BY_GRADIENTS = (stencil, transfer, observe, contact, forces, gradients)  # of transfers other than the packed one, and of F-bar
SOURCES = (*PHYSICS, *COMMON, domain, motion, *LANES, ahead)
_MADE: dict[tuple[str, Law, bool, str], SimpleNamespace] = {}


def kernels_for(scene: Scene) -> SimpleNamespace:
    """Kernels for the number type and the law of a scene, made once a process and taken from the cache of compiled code."""
    key = (scene.precision, scene.law, len(scene.materials) == 1, ahead.variant(scene))
    if key not in _MADE:
        ahead.ensure_compiled(scene, (*SOURCES, *BY_GRADIENTS) if is_general(scene) else SOURCES)
        _MADE[key] = _bound(scene)
    return _MADE[key]


def _bound(scene: Scene) -> SimpleNamespace:
    binding = numba_binding(scene.dtype)
    common = binding.kernels(*COMMON, sources=(*LANES, domain, motion))
    law = binding.law(scene.law)
    names = {
        "law_update": law.step,
        "law_update_small": law.step_small,
        "ONE_MATERIAL": len(scene.materials) == 1,
        "GENERAL": is_general(scene),
    }
    own = binding.kernels(stencil, domain, motion, sources=LANES, **names)
    more = binding.kernels(*BY_GRADIENTS, sources=LANES) if is_general(scene) else SimpleNamespace()
    return SimpleNamespace(**(vars(more) | vars(common) | vars(own)))
