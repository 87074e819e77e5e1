"""The published benchmarks of the sparse method at full size: a record for each device, and a page beside the published figures.

The parts are the sliding box and the collapsing columns (CPU), the sparsity ladder and the synthetic site (CPU and GPU).
"""

import logging
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from runout import log
from runout.backends.protocol import find_device
from runout.io.atomic import write_json
from runout.studies.seed_cases import bodies, ladder, site_runs
from runout.studies.seed_cases.memory_peak import card_name
from runout.studies.seed_cases.page import page, tables
from runout.studies.work_precision import machine, versions

LOGGER = logging.getLogger("runout.published_benchmarks")
SCHEMA = 1
FILE = "published.json"
Parts = Mapping[str, Callable[[], list[dict[str, Any]]]]


def planned(device: str, full: bool) -> Parts:
    """Parts of a record by name, in the order of their run; a GPU leaves out those that only need the CPU.

    The site comes first: memory that the ladder takes from a card stays in the pool of the process.
    """
    flows: Parts = {"site": lambda: site_runs.by_cell_size(device, full), "ladder": lambda: ladder.climb(device, full)}
    if device != "cpu":
        return flows
    own: Parts = {"slides": lambda: bodies.slides(full), "collapses": lambda: bodies.collapses(full)}
    return {**own, **flows, "forecasts": site_runs.forecasts}


def measured(device: str = "cpu", full: bool = False) -> dict[str, Any]:
    """Record of a device.

    Parameters
    ----------
    device : str
        "cpu" or "cuda:N".
    full : bool
        The sizes of the page; else small ones, which show that all parts run.

    Returns
    -------
    dict
        ``full``, ``created`` (UTC), ``device``, ``card``, ``machine``, ``versions``, and the rows of each part: ``slides``,
        ``collapses`` and ``forecasts`` (CPU only), ``site``, ``ladder``.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    place = find_device(device)
    found: dict[str, Any] = {
        "schema": SCHEMA,
        "full": full,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "device": place,
        "card": None if place == "cpu" else card_name(),
        "machine": machine(),
        "versions": versions(),
    }
    parts = planned(place, full)
    with log.progress("published") as bar:
        for done, (name, run) in enumerate(parts.items(), 1):
            found[name] = run()
            bar(done / len(parts))
    return found


def command(out: Path | None, full: bool, device: str = "cpu", json: Path | None = None) -> None:
    """Measure, and print our numbers beside the published ones; ``out`` gets record and page, ``json`` another record."""
    found = measured(device, full)
    for title, table in tables([found]):
        log.output().print(f"{title}\n\n{table}", end="\n\n", markup=False)
    if json:
        LOGGER.info("wrote %s", write_json(found, json))
    if out:
        LOGGER.info("wrote %s", write_json(found, out / FILE))
        LOGGER.info("wrote %s", page([found]).write(out))
