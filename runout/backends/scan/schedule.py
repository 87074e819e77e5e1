"""Which thread takes which blocks, and when arenas are summed: as soon as nothing is missing, while they are in the second cache.

A thread goes through one stretch of owners, strip by strip. A block of nodes is *due* behind the last strip that reaches it if the
same thread takes all that do; those on the border between two stretches wait until all threads are done. An arena is *free* for
another owner once all nodes are summed that it reaches.
"""

from dataclasses import dataclass

import numpy as np

from runout.backends.scan.index import Index

STRIP = 16  # owners, one after the other
BLOCK = 60  # particles that take as long as a block with particles takes beside them


@dataclass
class Schedule:
    """The order of sums between two rebuilds of the index.

    Attributes
    ----------
    cuts : (threads + 1,) int64
        First owner of each thread.
    due, nodes : (strips + 1,) int64, (nall,) int32
        Blocks of nodes in the order in which they are summed, and where those begin that are due behind each strip; the last, those
        that wait for other threads.
    over, owners : (strips + 1,) int64, (nown,) int32
        The same of the owners whose arenas are free behind each strip; the last, behind none.
    late_cuts, late_due, late_over : (threads + 1,) int64
        The same where those that wait are summed, a strip without owners for each thread.
    """

    cuts: np.ndarray
    due: np.ndarray
    nodes: np.ndarray
    over: np.ndarray
    owners: np.ndarray
    late_cuts: np.ndarray
    late_due: np.ndarray
    late_over: np.ndarray

    @classmethod
    def of(cls, index: Index, threads: int, at_once: bool = True) -> "Schedule":
        """Stretches with as much to do for each thread; no node is due before all threads are done if not ``at_once``."""
        cuts = _stretches(index, threads)
        last = np.maximum(index.down.max(axis=1, initial=0), 0) // STRIP
        first = np.where(index.down < 0, last[:, None], index.down // STRIP).min(axis=1, initial=len(last))
        strips = -(-index.nown // STRIP)
        thread = np.searchsorted(cuts, STRIP * np.arange(strips), side="right")
        behind = np.where(at_once & (thread[first] == thread[last]), last, strips) if strips else last
        nodes = np.lexsort((last, behind)).astype(np.int32)
        freed = behind[index.up].max(axis=1, initial=0)
        owners = np.argsort(freed, kind="stable").astype(np.int32)
        each = np.arange(strips + 1)
        due, over, parts = np.searchsorted(behind[nodes], each), np.searchsorted(freed[owners], each), np.arange(threads + 1)
        late = due[-1] + (len(nodes) - due[-1]) * parts // threads
        return cls(cuts, due, nodes, over, owners, STRIP * parts, late, np.zeros(threads + 1, np.int64))

    @property
    def early(self) -> tuple[np.ndarray, ...]:
        """What a kernel takes that goes through all owners."""
        return self.cuts, self.due, self.nodes, self.over, self.owners

    @property
    def late(self) -> tuple[np.ndarray, ...]:
        """What it takes, with no owners, when all threads are done."""
        return self.late_cuts, self.late_due, self.nodes, self.late_over, self.owners

    @property
    def waits(self) -> bool:
        """Whether any nodes wait for that."""
        return bool(self.due[-1] < len(self.nodes))

    def most_arenas(self, held: np.ndarray) -> int:
        """Arenas that a thread needs at once where these owners hold something."""
        strips = len(self.due) - 1
        filled = np.bincount(np.flatnonzero(held) // STRIP, minlength=strips)
        freed = np.repeat(np.arange(strips + 1), np.diff(self.over, append=len(self.owners)))
        emptied = np.bincount(freed[held[self.owners] > 0] + 1, minlength=strips + 2)[:strips]
        taken, given = (np.concatenate(([0], np.cumsum(n))) for n in (filled, emptied))
        most = 0
        for low, end in zip(self.cuts[:-1] // STRIP, -(-self.cuts[1:] // STRIP), strict=True):
            live = taken[low + 1 : end + 1] - taken[low] - (given[low + 1 : end + 1] - given[low])
            most = max(most, int(live.max(initial=0)))
        return most


def _stretches(index: Index, threads: int) -> np.ndarray:
    """First owner of each thread's stretch, of whole strips, so that each gets its share of the work."""
    work = np.cumsum(np.where(index.held > 0, BLOCK + index.held, 1))
    if not len(work):
        return np.zeros(threads + 1, np.int64)
    cuts = np.searchsorted(work, work[-1] * np.arange(threads + 1) / threads)
    cuts = (cuts + STRIP // 2) // STRIP * STRIP
    cuts[-1] = index.nown
    return np.minimum(cuts, index.nown)
