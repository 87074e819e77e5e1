"""What the host reads of the device between series of steps: all in one piece of memory, since each read waits."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from runout.backends.hash.groups import filled, groups_of
from runout.backends.hash.layout import COUNTS, FLAGS, TALLY

LINE = 256  # bytes: a part has cache lines of its own, so that atomic sums to one do not delay reads of another


class Snapshot:
    """The status at one place among the launches; the copy to the host begins at once."""

    def __init__(self, status: DeviceStatus):
        self.status, memory, is_cuda = status, status.memory, status.memory.device.is_cuda
        if not status.buffers:
            host = wp.empty(len(memory), dtype=wp.uint8, device="cpu", pinned=is_cuda)
            status.buffers.append((host, wp.Event(memory.device) if is_cuda else None))
        self.host, self.event = status.buffers.pop()
        wp.copy(self.host, memory)
        if self.event is not None:
            wp.record_event(self.event)

    def arrived(self) -> dict[str, np.ndarray]:
        """All numbers, once they are on the host; to be called once."""
        if self.event is not None:
            wp.synchronize_event(self.event)
        found = self.status.parted(self.host.numpy().copy())
        self.status.buffers.append((self.host, self.event))
        return found


class DeviceStatus:
    """Numbers that the device writes and the host reads, in one piece of memory on the device of the scope.

    They are those of :class:`runout.backends.hash.groups.StatusGroup`.
    """

    def __init__(self, many: int, number: Any):
        whole: np.dtype[Any] = np.dtype(np.int32)
        kind: np.dtype[Any] = np.dtype(np.float32 if number == wp.float32 else np.float64)
        parts = [("tally", whole, TALLY), ("flags", whole, FLAGS), ("counts", whole, COUNTS)]
        parts += [("contacts", whole, many), ("peaks", kind, many + 1)]
        ends = np.cumsum([-(-dtype.itemsize * size // LINE) * LINE for _, dtype, size in parts])
        self.memory = wp.zeros(int(ends[-1]), dtype=wp.uint8)
        self.parts = {name: (int(at), dtype, size) for (name, dtype, size), at in zip(parts, [0, *ends[:-1]], strict=True)}
        self.tally, self.flags, self.counts = (self._view(name, wp.int32) for name in ("tally", "flags", "counts"))
        self.contacts, self.peaks = self._view("contacts", wp.int32), self._view("peaks", number)
        self.both = wp.array(ptr=self.memory.ptr, dtype=wp.int64, shape=1, device=self.memory.device)
        self.buffers: list[tuple[wp.array, Any]] = []  # of the host, which copies have left, and the events behind these
        self.group = filled(groups_of(number).StatusGroup, self)

    def _view(self, name: str, kind: Any) -> Any:
        at, _, size = self.parts[name]
        return wp.array(ptr=self.memory.ptr + at, dtype=kind, shape=size, device=self.memory.device)

    def read(self) -> dict[str, np.ndarray]:
        """All of it, once the device has come here."""
        return self.snapshot().arrived()

    def snapshot(self) -> Snapshot:
        """All of it as the device finds it here, while the host and the device go on."""
        return Snapshot(self)

    def parted(self, raw: np.ndarray) -> dict[str, np.ndarray]:
        """The parts of a copy of the memory."""
        return {name: raw[at : at + dtype.itemsize * size].view(dtype) for name, (at, dtype, size) in self.parts.items()}
