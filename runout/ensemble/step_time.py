"""Notes what a step of a member took, for the forecasts of the day."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from runout.forecast import engine_notes

STAYED = 0.99  # share of the mass that is on the terrain at the end; otherwise particles were fewer than at the start


class StepTimer:
    """Processor time of the steps of a member: it counts from the first call of its progress on, after all preparation.

    Parameters
    ----------
    progress : callable, optional
        Called with the fraction, 0 to 1, that this object is called with.
    """

    def __init__(self, progress: Callable[[float], None] | None = None):
        self.progress = progress
        self.first: float | None = None
        self.started = self.seconds = 0.0

    def __call__(self, fraction: float) -> None:
        if self.first is None:
            self.first, self.started = fraction, time.process_time()
        self.seconds = time.process_time() - self.started
        if self.progress:
            self.progress(fraction)

    def note(self, arguments: Mapping[str, Any], result: Any) -> None:
        """Note the result's cost of a step, if the member ran as a whole on one thread of the CPU and its mass stayed."""
        mass = getattr(result, "series", {}).get("mass", ())
        alone = arguments.get("device", "cpu") == "cpu" and arguments["threads"] == 1 and not arguments.get("sleep_speed")
        if alone and self.first == 0.0 and len(mass) and mass[-1] >= STAYED * mass[0]:
            engine_notes.note_member(arguments, self.seconds, result.steps, result.steps * result.n_particles)
