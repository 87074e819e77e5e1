"""CUDA graphs of launches that repeat: one call of the host for all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import warp as wp


class Graphs:
    """Graphs of a device by name, as long as the arrays that they name are in use.

    Parameters
    ----------
    device : warp device
    modules : sequence of (module, lanes)
        What has to be loaded before anything is recorded.
    """

    def __init__(self, device: Any, modules: Sequence[tuple[Any, int]]):
        self.device, self.modules, self.enabled = device, modules, device.is_cuda
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
            for module, lanes in self.modules:
                wp.load_module(module, device=self.device, block_dim=lanes)
            with wp.ScopedCapture(force_module_load=False) as capture:
                enqueue()
            self.recorded[name] = capture.graph
        wp.capture_launch(self.recorded[name])
