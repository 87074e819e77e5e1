"""CUDA graphs of launches that repeat: one call of the host for all of them."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import warp as wp


class Graphs:
    """Graphs of a device by name, as long as the arrays that they name are in use.

    Parameters
    ----------
    device : warp device
    modules : sequence of warp modules
        What has to be loaded before anything is recorded. On a GPU they are compiled at once, as far as there are cores.
    """

    def __init__(self, device: Any, modules: Sequence[Any]):
        self.device, self.modules, self.enabled = device, modules, device.is_cuda
        if self.enabled:
            self._load(os.cpu_count())
        self.of: Hashable = None
        self.recorded: dict[Hashable, Any] = {}
        self.direct: Counter[Hashable] = Counter()

    def launch(self, name: Hashable, of: Hashable, enqueue: Callable[[], None], before: int = 0) -> None:
        """Launch what ``enqueue`` launches; all is recorded anew once ``of`` changes, which stands for the arrays.

        To record and to build a graph takes longer than the launches themselves: it is put off until these have come ``before``
        times in all, and never done where graphs are not ``enabled``, as on a CPU.
        """
        if not self.enabled:
            enqueue()
            return
        if self.of != of:
            self.of, self.recorded = of, {}
        if name not in self.recorded:
            self.direct[name] += 1
            if self.direct[name] <= before:
                enqueue()
                return
            self._load(0)  # what is loaded takes no threads: 0.02 ms, with threads 0.3 ms
            with wp.ScopedCapture(force_module_load=False) as capture:
                enqueue()
            self.recorded[name] = capture.graph
        wp.capture_launch(self.recorded[name])

    def _load(self, threads: int | None) -> None:
        wp.get_stream(self.device)  # takes the context of the device: threads that load modules would take one each, with a stream
        wp.force_load(self.device, list(self.modules), max_workers=threads)
