"""Maps take memory only where they hold a value."""

import mmap
import sys
from pathlib import Path

import numpy as np
import pytest

from runout.hazard.exceedance import zeros_by_page


@pytest.mark.skipif(sys.platform != "linux", reason="memory as Linux states it")
def test_zeros_take_memory_only_where_they_change() -> None:
    """A value in every 2 MiB of 64 MiB; huge pages would take all."""

    def pages() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1])

    before, zeros = pages(), zeros_by_page((32, 2**19), np.float32)
    zeros[:, 5] = 1.0
    assert (pages() - before) * mmap.PAGESIZE < 8 * 2**20
    assert zeros.sum() == 32


def test_zeros_have_their_shape_also_without_cells() -> None:
    assert zeros_by_page((0, 3), np.int32).shape == (0, 3)
    assert zeros_by_page((2, 3), np.int32).dtype == np.int32
