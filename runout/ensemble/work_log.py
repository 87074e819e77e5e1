"""Work of a run over time, for the log file: active blocks and nodes, sparsity and memory."""

import logging
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from runout.errors import StorageError
from runout.io.member_maps import MemberMaps

LOGGER = logging.getLogger(__name__)
SERIES = ("active_blocks", "active_nodes", "sparsity", "memory")
MOST_TIMES = 21


def log_work(member: int, ledger: Mapping[str, np.ndarray]) -> None:
    """Log the series of a ledger, each (time,), at about :data:`MOST_TIMES` times that include the first and the last."""
    if not {"time", *SERIES} <= ledger.keys():
        return
    count = len(ledger["time"])
    places = np.unique(np.linspace(0, count - 1, min(count, MOST_TIMES)).round().astype(int))
    shown = {name: [_number(value) for value in np.asarray(ledger[name])[places].tolist()] for name in ("time", *SERIES)}
    largest = max(ledger["active_blocks"]), max(ledger["memory"]) / 1e9
    text = "member %d: at most %d active blocks and %.3g GB of memory"
    LOGGER.debug(text, member, *largest, extra={"member": member, "work": shown})


def _number(value: float) -> float | None:
    """None for a number that JSON lacks: the sparsity once all mass has left."""
    return value if math.isfinite(value) else None


def log_work_of_file(member: int, path: Path) -> None:
    """Log the work of a member from its file; a file without a ledger logs nothing."""
    try:
        with MemberMaps(path) as file:
            log_work(member, file.ledger())
    except StorageError as error:
        LOGGER.debug("member %d: no ledger to log (%s)", member, error)
