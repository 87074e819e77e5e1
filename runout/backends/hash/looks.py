"""Observations between the steps of a series: the device adds up columns and goes on, the host takes them meanwhile.

    device   | step | step | sums, spread | copy | step | sort | step | step | sums, spread | copy | step | sort | ...
    host     launches up to a sort and on, then raises the maps to the copies of the launches before, while the device goes on

The windows of the sums are larger than the mass, by a margin that it cannot pass until they are found anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from runout.backends import footprints
from runout.backends.hash.account import Account
from runout.backends.hash.columns import LaunchedColumns
from runout.backends.hash.parts import Parts
from runout.backends.hash.readback import Bounds, Report, bounds_of
from runout.backends.protocol import RasterSums
from runout.model.particles import Particles, node_range

MARGIN = 8  # grid cells around the mass
SPAN = 2  # nodes from the first of a particle to the last that it covers
Take = Callable[[int, int, RasterSums], None]


class Looks:
    """Looks at so many scenes, and where their mass was when the host last read it.

    Attributes
    ----------
    made : (scenes,) int
        Substeps that each scene has made.
    substeps : (scenes,) int
        Of its transfers in this series.
    """

    def __init__(self, scenes: int):
        self.bounds: list[Bounds | None] = [None] * scenes
        self.windows: list[footprints.Lattice | None] = [None] * scenes  # of these bounds, once there was a look at them
        self.travelled = np.full(scenes, np.inf)  # [cells] at most, since then
        self.made = np.zeros(scenes, np.int64)
        self.substeps = np.ones(scenes, np.int64)
        self.wanted: Mapping[int, Sequence[int]] = {}
        self.take: Take | None = None
        self.begun = self.made.copy()
        self.launched: list[LaunchedColumns] = []

    def begin(self, wanted: Mapping[int, Sequence[int]], take: Take | None, substeps: np.ndarray) -> None:
        """Open a series of transfers; ``take`` gets scene, transfer and columns after the ``wanted`` ones, from 1 on.

        The columns and their boxes are valid until it returns: the next ones may take their memory.
        """
        self.wanted, self.take, self.begun, self.substeps = wanted, take, self.made.copy(), substeps
        self.launched = []  # of a series that an error has ended

    def find_mass(
        self, parts: Parts, report: Report, accounts: Sequence[Account], lengths: np.ndarray, settle: Callable[[], None]
    ) -> None:
        """Make windows hold all mass for the ``lengths`` [s] of a series; the host waits if they have to be found anew.

        The mass of every scene moves on, also in a series in which nobody looks at it. ``settle`` waits for a sort in which
        particles join.
        """
        for s, time in enumerate(lengths):
            scene = parts.scenes.scenes[s]
            reach = (accounts[s].max_speed + np.linalg.norm(scene.gravity) * time) * time / min(scene.spacing[:2])
            if self.wanted.get(s) and self.travelled[s] + reach > MARGIN:
                settle()
                self._cover(s, bounds_of(parts, report, s, max(MARGIN, int(np.ceil(reach)))))
            self.travelled[s] += reach

    def window(self, scene: int) -> Bounds | None:
        """Nodes that hold the mass of a scene, None if they are not known."""
        return self.bounds[scene] if self.travelled[scene] <= MARGIN else None

    def note(self, scene: int, bounds: Bounds) -> None:
        """The mass of a scene covers nodes within ``bounds`` now. A window that it cannot leave soon stays."""
        low, high = bounds
        if self.travelled[scene] > MARGIN / 2:
            self._cover(scene, (low - MARGIN, high + MARGIN))

    def _cover(self, scene: int, bounds: Bounds | None) -> None:
        self.bounds[scene], self.windows[scene], self.travelled[scene] = bounds, None, 0.0

    def join(self, scene: int, p: Particles) -> None:
        """Particles join a scene: its window stays if they lie as far inside as the mass that was there."""
        bounds, left = self.bounds[scene], MARGIN - self.travelled[scene]
        if bounds is None or left < 0:
            self.travelled[scene] = np.inf
            return
        (lowest, highest), (low, high) = node_range(p.node), bounds
        if (lowest[:2] < low + left).any() or (highest[:2] + SPAN > high - left).any():
            self.travelled[scene] = np.inf

    def launch(self, parts: Parts, accounts: Sequence[Account], step: int, left: np.ndarray) -> None:
        """Launch the sums that are wanted after this transfer, ``step`` of a batch, before which ``left`` (scenes,) were."""
        done, windows = (self.made - self.begun) // self.substeps, {}
        for s, steps in self.wanted.items():
            bounds = self.bounds[s]
            if bounds is not None and left[s] >= step and done[s] + step in steps:
                windows[s] = self.windows[s] = self.windows[s] or footprints.Lattice.around(parts.scenes.scenes[s], *bounds)
        if windows:
            made = {s: int(self.made[s] + step * self.substeps[s]) for s in windows}
            self.launched.append(parts.columns.launch(parts, accounts, windows, made))

    def deliver(self, count: int | None = None) -> None:
        """Hand over the first ``count`` that have been launched, or all, as soon as they are here; not steps that were left out."""
        ready, self.launched = self.launched[:count], [] if count is None else self.launched[count:]
        for sums in ready:
            for s, (step, columns) in sums.arrived().items():
                if step == sums.expected[s] and self.take:
                    self.take(s, int(step - self.begun[s]) // int(self.substeps[s]), columns)
            sums.release()
