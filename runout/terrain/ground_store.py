"""The grounds that were made last in this process: members of an ensemble that need the same one do not make it again."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from runout.model.nodal_surface import NodalSurface

KEPT = 4  # grounds
LARGEST = 100e6  # bytes of all that are kept beside the last one


def content_key(*arrays: np.ndarray) -> bytes:
    """Checksum of types, shapes and values."""
    found = hashlib.sha256()  # processors have instructions for it: half the time of blake2b
    for values in map(np.ascontiguousarray, arrays):
        found.update(repr((values.dtype.str, values.shape)).encode())
        found.update(values)  # type: ignore[arg-type]  # its memory
    return found.digest()


@dataclass
class _Place:
    """A ground, once it is made; who makes it holds the lock."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    ground: NodalSurface | None = None


class GroundStore:
    """Grounds by the content that they are made of: the last :data:`KEPT` that were asked for, within :data:`LARGEST` bytes."""

    def __init__(self) -> None:
        self._places: OrderedDict[bytes, _Place] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes, make: Callable[[], NodalSurface]) -> NodalSurface:
        """The ground of a key; the first thread that asks for it makes it, others wait."""
        with self._lock:
            place = self._places.setdefault(key, _Place())
            self._places.move_to_end(key)
            while len(self._places) > 1 and (len(self._places) > KEPT or self._bytes() > LARGEST):
                self._places.popitem(last=False)
        with place.lock:
            if place.ground is None:
                place.ground = make()
            return place.ground

    def _bytes(self) -> int:
        """Memory of all grounds but the last one."""
        grounds = [place.ground for place in list(self._places.values())[:-1]]
        return sum(g.surface.coefficients.nbytes + g.change.nbytes for g in grounds if g is not None)
