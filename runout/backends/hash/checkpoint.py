"""State of the hash backend as plain arrays, and back, so that a run goes on as if it had not been broken off.

What the kernels read from one step to the next is kept as it is: particles, the list of each cell, the blocks and their links.
The grid is empty between two steps and the table of keys is made anew with every index. On the CPU, and on a GPU in deterministic
mode, the run goes on bit by bit.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from runout.backends.hash.batch import ground_of, structures_of
from runout.backends.hash.index import Index
from runout.backends.hash.layout import HOMES, run
from runout.backends.hash.parts import Parts
from runout.backends.hash.state import Store
from runout.backends.state import State, arrays_of, part, put_arrays
from runout.model.particles import Particles
from runout.model.scene import Scene

if TYPE_CHECKING:
    from runout.backends.hash.backend import HashBackend

BY_BLOCK = ("coordinates", "member", "around", "up", "down", "cstart", "active")  # of the index
OF_NODES = ("grounded", "booked")
OF_STRUCTURES = ("upper", "lower", "units", "forces", "grounded", "standing")
BY_NUMBER = ("forces", "pore_left", "pore_excess")  # of the particles, as far as there are any
BY_PARTICLE = ("radius", "release", "number", "key", "order")


def save(engine: "HashBackend") -> State:
    """The state between two steps; on the CPU some arrays are those of the backend and change with its next step."""
    parts = engine.parts
    i, s, n, status, scenes = parts.index, parts.store, parts.nodes, parts.status, parts.scenes
    state = arrays_of(engine.counters, prefix="counters.") | arrays_of(engine.accounts[0], prefix="account.")
    state |= {f"seconds.{stage}": np.asarray(value) for stage, value in engine.counters.seconds.items()}
    own = {"since_sort": engine.since_sort, "largest": scenes.constants.largest, "identity": s.identity}
    state |= {f"own.{name}": np.asarray(value) for name, value in own.items()}
    state |= {f"index.{name}": getattr(i, name).numpy()[: i.nall] for name in BY_BLOCK}
    state |= {"homes": i.homes.numpy()[: int(status.tally.numpy()[HOMES])]}
    state |= {f"nodes.{name}": getattr(n, name).numpy()[: i.nall] for name in OF_NODES}
    state |= {f"store.{name}": getattr(s, name).numpy()[: s.n] for name in BY_PARTICLE}
    state |= {name: getattr(s, name).numpy()[: len(s.identity)] for name in BY_NUMBER}
    state |= {"step_counts": scenes.group.step_counts.numpy()}
    state |= {"peaks": status.peaks.numpy(), "tally": status.tally.numpy(), "kept": engine.report.kept.numpy()}
    state |= {"tiles": n.tiles.numpy(), "standing": n.standing.numpy(), "rec": s.rec.numpy()[:, : s.n]}
    if parts.structures is not None:
        state |= {f"structures.{name}": getattr(parts.structures, name).numpy() for name in OF_STRUCTURES}
    sizes = {
        "nown": i.nown,
        "nall": i.nall,
        "room": i.capacity,
        "entries": i.table.shape[0],
        "launched": i.launched,
        "piece": i.piece,
        "places": s.size,
        "numbers": len(s.forces),
        "slots": n.slots,
        "reached": parts.structures.slots if parts.structures else 0,
    }
    return state | {f"size.{name}": np.asarray(value) for name, value in sizes.items()}


def restore_state(engine: "HashBackend", scene: Scene, state: State) -> None:
    """Bring the backend to a state of the same scene that :func:`save` gave."""
    engine.load(scene, Particles.zeros(0))
    put_arrays(engine.counters, {name: value for name, value in state.items() if name.startswith("counters.")}, "counters.")
    engine.counters.seconds = {stage: float(value) for stage, value in part(state, "seconds.").items()}
    put_arrays(engine.accounts[0], state, "account.")
    engine.since_sort = int(state["own.since_sort"])
    with wp.ScopedDevice(engine.device):
        parts = engine.parts
        scenes, status = parts.scenes, parts.status
        status.peaks.assign(state["peaks"])
        scenes.group.step_counts.assign(state["step_counts"])
        engine.looks.made[:] = state["step_counts"]
        engine.report.kept.assign(state["kept"])
        scenes.set_steps(np.array([engine.accounts[0].packed_dt]))
        parts.ground = ground_of(scenes, float(state["own.largest"]))
        parts.structures = structures_of(scenes, parts.k, engine.accounts, int(state["size.numbers"]), float(state["own.largest"]))
        parts.store = _store(state, scenes.number, scenes.wet)
        parts.index = _index(parts, state)
        parts.make_nodes()
        n = parts.nodes
        n.make_room(len(state["tiles"]), int(state["size.slots"]), exactly=True)
        for name in OF_NODES:
            _fill(getattr(n, name), state[f"nodes.{name}"])
        _fill(n.tiles, state["tiles"])
        _fill(n.standing, state["standing"])
        _restore_structures(parts, state)
        run(parts.k.bound_columns, (n.places, 16), n.ground_group, scenes.constants)
        run(parts.k.number_columns, n.columns.shape[0], status.group, parts.index.block_group, n.contact_group)
        run(parts.k.number_upper_columns, 4 * n.columns.shape[0], status.group, parts.index.block_group, n.contact_group)
        run(parts.k.number_beside, n.beside.size, status.group, parts.index.block_group, n.contact_group, n.column_group)
        run(parts.k.note_shares, (n.places, 8), status.group, parts.index.block_group, n.ground_group)


def _restore_structures(parts: Parts, state: State) -> None:
    """Sums, forces, and blocks beside structures."""
    s = parts.structures
    if s is None:
        return
    s.make_room(len(state["structures.standing"]), int(state["size.reached"]), exactly=True)
    for name in OF_STRUCTURES:
        _fill(getattr(s, name), state[f"structures.{name}"])
    s.note_shares(parts.k, parts.index)


def _store(state: State, number: Any, wet: bool) -> Store:
    """A store with as many places as before, and room for as many numbers."""
    rec, many = state["rec"], int(state["size.numbers"])
    store = Store(np.zeros(many, np.int64), number, int(state["size.places"]), wet)
    store.identity, store.n = np.asarray(state["own.identity"]), rec.shape[1]
    store.put_releases = set(np.unique(state["store.release"]).tolist())
    for name in BY_NUMBER:
        _fill(getattr(store, name), state[name])
    if rec.size:
        wp.copy(store.rec[:, : store.n], wp.array(np.ascontiguousarray(rec), dtype=store.memory.dtype))
    for name in BY_PARTICLE:
        _fill(getattr(store, name), state[f"store.{name}"])
    return store


def _index(parts: Parts, state: State) -> Index:
    """An index with the blocks of a state; its table stays empty until the next index is made."""
    size = {name: int(value) for name, value in part(state, "size.").items()}
    index = Index(parts.k, parts.status, parts.store.size, parts.ordered, parts.scenes.largest_blocks(parts.ordered))
    index.piece, index.more_pieces = size["piece"], parts.store.size // size["piece"]
    index.make_table(size["entries"])
    index.make_room(size["room"])
    index.nown, index.nall, index.launched = size["nown"], size["nall"], size["launched"]
    index.up.fill_(-1)
    for name in BY_BLOCK:
        _fill(getattr(index, name), state[f"index.{name}"])
    _fill(index.homes, state["homes"])
    parts.status.tally.assign(state["tally"])
    return index


def _fill(target: Any, values: np.ndarray) -> None:
    """Bring values to the first rows of a device array."""
    if values.size:
        target[: len(values)].assign(np.ascontiguousarray(values))
