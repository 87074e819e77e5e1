"""The structures that were made last in this process: members of an ensemble that need the same ones do not make them again."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from runout.model.structures import Structures
from runout.model.terrain import Terrain
from runout.structures.solid import Solid
from runout.terrain.ground_store import content_key

KEPT = 4


@dataclass
class _Place:
    """Structures, once they are made; who makes them holds the lock."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    made: Structures | None = None


class StructureStore:
    """Structures by the content that they are made of, the last :data:`KEPT` that were asked for."""

    def __init__(self) -> None:
        self._places: OrderedDict[bytes, _Place] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes, make: Callable[[], Structures]) -> Structures:
        """The structures of a key; the first thread that asks for them makes them, others wait."""
        with self._lock:
            place = self._places.setdefault(key, _Place())
            self._places.move_to_end(key)
            while len(self._places) > KEPT:
                self._places.popitem(last=False)
        with place.lock:
            if place.made is None:
                place.made = make()
            return place.made


def structures_key(solids: Sequence[Solid], terrain: Terrain, spacing: Sequence[float]) -> bytes:
    """Checksum of bodies, ground and grid."""
    names = repr([(s.name, s.facades, s.friction) for s in solids]).encode()
    arrays = [array for s in solids for array in (s.vertices, s.faces, s.facade)]
    return content_key(np.frombuffer(names, np.uint8), terrain.elevation, np.array([*terrain.cell_size, *spacing]), *arrays)


STRUCTURES = StructureStore()
