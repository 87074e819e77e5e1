"""State of the scan backend as plain arrays, and back, so that a run continues bit by bit as if it had not been interrupted.

    totals., counters., seconds.    numbers of the run          blocks.       the index
    store., particles.              particles, without padding
    packed_dt, corner, ...          single numbers

Every sum of a step follows the order of blocks, cells and slots, so that these are kept as they are. Arrays that a step writes
before it reads them, and what follows from the scene, are left out.
"""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from runout.backends.protocol import Counters
from runout.backends.scan.constants import Tables
from runout.backends.scan.groups import Blocks, Particles
from runout.backends.scan.state import BY_SLOT, PADDING, Store, _one_for_all, empty_slots
from runout.backends.scan.totals import Totals
from runout.backends.state import State, arrays_of, part, plain, put_arrays
from runout.model.scene import Scene

SCRATCH = ("listed",)  # of a step


class Saved(NamedTuple):
    """The parts of a backend that a checkpoint restores; the arrays by block follow from them."""

    tables: Tables
    store: Store
    blocks: Blocks
    travelled: float
    totals: Totals
    counters: Counters


def save(parts: Saved) -> State:
    """The state between two steps; its arrays are those of the backend and change with its next step."""
    tables, store, blocks, travelled, totals, counters = parts
    state = arrays_of(totals, prefix="totals.") | arrays_of(counters, prefix="counters.")
    state |= arrays_of(store, prefix="store.")
    state |= {f"seconds.{stage}": np.asarray(value) for stage, value in counters.seconds.items()}
    state |= arrays_of(SimpleNamespace(**blocks._asdict()), prefix="blocks.")
    particles = arrays_of(SimpleNamespace(**store.particles._asdict()), (*SCRATCH, "radius"), "particles.")
    end = store.end + PADDING
    state |= {name: values[:end] if name.split(".")[1] in BY_SLOT else values for name, values in particles.items()}
    numbers = {"packed_dt": tables.packed_dt, "particle_volume": tables.particle_volume, "corner": tables.constants.corner}
    return state | {name: np.asarray(value) for name, value in {**numbers, "slots": store.slots, "travelled": travelled}.items()}


def restored(scene: Scene, state: State) -> Saved:
    """The parts that :func:`save` kept, of the same scene; no time step is set yet."""
    tables = Tables.of(scene, float(state["particle_volume"]), np.array(state["corner"]))
    totals, counters = Totals(0.0), Counters()
    put_arrays(totals, state, "totals.")
    put_arrays(counters, state, "counters.")
    counters.seconds = {stage: float(value) for stage, value in part(state, "seconds.").items()}
    blocks = Blocks(**{name: plain(value) for name, value in part(state, "blocks.").items()})
    return Saved(tables, _store(scene, state), blocks, float(state["travelled"]), totals, counters)


def _store(scene: Scene, state: State) -> Store:
    """Storage with as many slots as before; arrays by slot are copied, arrays by particle are used as they are."""
    slots, saved = int(state["slots"]), part(state, "particles.")
    numbers = {name: plain(value) for name, value in part(state, "store.").items()}
    particles: Particles = empty_slots(slots, scene)._replace(
        force=saved["force"], label=saved["label"], radius=_one_for_all(numbers["radius"]), pores=saved["pores"]
    )
    for name in BY_SLOT:
        if name not in SCRATCH:
            getattr(particles, name)[: len(saved[name])] = saved[name]
    return Store(particles, **numbers)
