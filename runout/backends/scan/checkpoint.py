"""State of the scan backend as plain arrays, and back, so that a run goes on bit by bit as if it had not been broken off.

Every sum of a step follows the order of blocks, cells and slots, so that they are kept as they are; what a step writes
before it reads it, or what follows from the scene, is left out. An attribute that is not named here is kept.
"""

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from runout.backends.scan import sleep
from runout.backends.scan.domain import Domain
from runout.backends.scan.index import Index
from runout.backends.scan.state import PADDING, Store
from runout.backends.state import State, arrays_of, part, plain, put_arrays
from runout.model.particles import Particles
from runout.model.scene import Scene

if TYPE_CHECKING:
    from runout.backends.scan.backend import ScanBackend

OF_THE_SCENE = ("allowed", "threads", "dense", "spacing", "h", "mats", "friction", "density", "gravity", "dv")
WITHIN_A_STEP = (
    *("number", "arenas", "grid", "tiles", "planes", "bounds", "rim", "touching", "candidates", "place"),
    *("reached", "pressed", "shares", "sharer", "shared", "inverse", "lent", "free"),
    *(
        "leaving",
        "arrivals",
        "before",
        "shifted",
        "changed",
        "motion",
        "ground",
        "sums",
        "total",
        "nothing",
        "falling",
        "moving",
        "giving",
    ),
)
SCRATCH = ("contacts", "measured", "felt", "given", "listed")  # of a step


def save(engine: "ScanBackend") -> State:
    """The state between two steps; the arrays are those of the backend and change with its next step."""
    slots, end = engine.store.slots, engine.end + PADDING
    state = arrays_of(engine, OF_THE_SCENE, "own.")
    state |= arrays_of(engine.index, prefix="index.")
    if engine.scene.sleep_speed:
        state |= arrays_of(engine.arenas, WITHIN_A_STEP, "arenas.")
    state |= arrays_of(engine.counters, prefix="counters.")
    state |= {f"seconds.{stage}": np.asarray(value) for stage, value in engine.counters.seconds.items()}
    state["slots"] = np.asarray(slots)
    for name, values in arrays_of(engine.store, SCRATCH, "store.").items():
        state[name] = values[:end] if len(values) == slots + PADDING else values
    return state


def restore_state(engine: "ScanBackend", scene: Scene, state: State) -> None:
    """Bring the backend to a state of the same scene that :func:`taken` gave."""
    from runout.backends.scan.backend import PARTICLES_PER_THREAD

    engine.load(scene, Particles.zeros(0))
    engine._change_step(float(state["own.packed_dt"]))  # while there is no particle: the records hold that step already
    put_arrays(engine, state, "own.")
    engine.domain = Domain.of(scene, engine.corner)
    put_arrays(engine.counters, state, "counters.")
    engine.counters.seconds = {stage: float(value) for stage, value in part(state, "seconds.").items()}
    engine.index = Index(**{name: plain(value) for name, value in part(state, "index.").items()})
    engine.store = _store(scene, state)
    engine.threads = max(1, min(engine.allowed, len(engine.store.label) // PARTICLES_PER_THREAD))
    engine._allocate_blocks()
    if scene.sleep_speed:
        put_arrays(engine.arenas, state, "arenas.")
        sleep.share_work(engine)


def _store(scene: Scene, state: State) -> Store:
    """Slots with room as before; what belongs to a slot is copied, what belongs to a particle taken over."""
    slots = int(state["slots"])
    store = Store.of(slots, np.zeros(0, np.int64), Particles.zeros(0), scene)
    saved = part(state, "store.")
    for field in fields(store):
        if field.name in SCRATCH:
            continue
        capacity, values = getattr(store, field.name), saved[field.name]
        if len(capacity) == slots + PADDING:
            capacity[: len(values)] = values
        else:
            setattr(store, field.name, values)
    return store
