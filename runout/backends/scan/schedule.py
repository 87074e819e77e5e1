"""Which thread takes which blocks, and when nodes are summed: as soon as their arenas are complete, while these are in the cache.

    owners    0 ...          cuts[1] ...         cuts[2] ...                 one range of owners for each thread,
              | strip | strip | strip | strip | strip | ...                  in strips of 16 owners

    due       node blocks nodes[due[s] : due[s + 1]] are summed after strip s
    over      the arenas of owners[over[s] : over[s + 1]] are free after strip s

A node block is due after the last strip that reaches it if one thread takes all strips that do. Node blocks on the border between
two ranges wait until all threads are done: they are summed in a second, late pass. An arena is free for another owner once all
nodes that it reaches are summed.
"""

from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from runout.backends.scan.groups import Blocks, Pass

STRIP = 16  # owners, one after the other
BLOCK = 60  # particles that take as long as a block with particles takes beside them


@dataclass
class Schedule:
    """The order of sums between two rebuilds of the index."""

    cuts: np.ndarray  # (threads + 1,): first owner of each thread
    # due, nodes (strips + 1,): node blocks in the order in which they are summed, and where those begin that are due after each
    # strip; the last ones wait for other threads
    due: np.ndarray
    nodes: np.ndarray
    # over, owners (strips + 1,): owners in the order in which their arenas become free, and where those begin that are free after
    # each strip; the arenas of the last ones never become free in the pass
    over: np.ndarray
    owners: np.ndarray
    # late_cuts, late_due, late_over (threads + 1,): the same for the late pass: one strip without owners for each thread
    late_cuts: np.ndarray
    late_due: np.ndarray
    late_over: np.ndarray

    @classmethod
    def of(cls, blocks: Blocks, threads: int, at_once: bool = True) -> "Schedule":
        """Ranges with the same work for each thread; if not ``at_once``, no node is due before all threads are done.

        Links are reduced column by column: along rows of eight numpy takes several times as long.
        """
        cuts = _stretches(blocks, threads)
        last = np.maximum(reduce(np.maximum, blocks.down.T), 0) // STRIP
        least = reduce(np.minimum, blocks.down.T.view(np.uint32))  # -1 is the largest of these
        first = np.minimum(least // STRIP, last)
        strips = -(-blocks.nown // STRIP)
        thread = np.searchsorted(cuts, STRIP * np.arange(strips), side="right")
        behind = np.where(at_once & (thread[first] == thread[last]), last, strips) if strips else last
        nodes = np.lexsort((last, behind)).astype(np.int32)
        freed = reduce(np.maximum, (behind[column] for column in blocks.up.T))
        owners = np.argsort(freed, kind="stable").astype(np.int32)
        each = np.arange(strips + 1)
        due, over, parts = np.searchsorted(behind[nodes], each), np.searchsorted(freed[owners], each), np.arange(threads + 1)
        late = due[-1] + (len(nodes) - due[-1]) * parts // threads
        return cls(cuts, due, nodes, over, owners, STRIP * parts, late, np.zeros(threads + 1, np.int64))

    @cached_property
    def early(self) -> Pass:
        """The pass over all owners."""
        return Pass(len(self.owners), self.cuts, self.due, self.nodes, self.over, self.owners)

    @cached_property
    def late(self) -> Pass:
        """The pass without owners that sums the nodes that wait, when all threads are done."""
        return Pass(0, self.late_cuts, self.late_due, self.nodes, self.late_over, self.owners)

    @property
    def waits(self) -> bool:
        """Whether any nodes wait for the late pass."""
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


def _stretches(blocks: Blocks, threads: int) -> np.ndarray:
    """First owner of the range of each thread, in whole strips, so that each has the same work."""
    work = np.cumsum(np.where(blocks.held > 0, BLOCK + blocks.held, 1))
    if not len(work):
        return np.zeros(threads + 1, np.int64)
    cuts = np.searchsorted(work, work[-1] * np.arange(threads + 1) / threads)
    cuts = (cuts + STRIP // 2) // STRIP * STRIP
    cuts[-1] = blocks.nown
    return np.minimum(cuts, blocks.nown)
