"""What was made last in this process, by its content: members of an ensemble that need the same do not make it again."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

KEPT = 4  # values
LARGEST = 100e6  # bytes of all that are kept beside the last one
Value = TypeVar("Value")


def content_key(*arrays: np.ndarray) -> bytes:
    """Checksum of types, shapes and values."""
    checksum = hashlib.sha256()  # processors have instructions for it: half the time of blake2b
    for values in map(np.ascontiguousarray, arrays):
        checksum.update(repr((values.dtype.str, values.shape)).encode())
        checksum.update(values)  # type: ignore[arg-type]  # its memory
    return checksum.digest()


@dataclass
class _Place(Generic[Value]):
    """A value, once it is made; who makes it holds the lock."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    value: Value | None = None


class ContentStore(Generic[Value]):
    """Values by the content that they are made of: the last :data:`KEPT` that were asked for, within :data:`LARGEST` bytes.

    ``size``: memory of a value [byte].
    """

    def __init__(self, size: Callable[[Value], int]) -> None:
        self.size = size
        self._places: OrderedDict[bytes, _Place[Value]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes, make: Callable[[], Value]) -> Value:
        """The value of a key; the first thread that asks for it makes it, others wait."""
        with self._lock:
            place = self._places.setdefault(key, _Place())
            self._places.move_to_end(key)
            while len(self._places) > 1 and (len(self._places) > KEPT or self._bytes() > LARGEST):
                self._places.popitem(last=False)
        with place.lock:
            if place.value is None:
                place.value = make()
            return place.value

    def _bytes(self) -> int:
        """Memory of all values but the last one."""
        return sum(self.size(place.value) for place in list(self._places.values())[:-1] if place.value is not None)
