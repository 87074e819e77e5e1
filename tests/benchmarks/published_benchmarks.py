"""The published benchmarks of the sparse method at full size: a record for each device.

    python -m tests.benchmarks.published_benchmarks DIR [--full] [--device cuda:0]

The parts are the sliding box and the collapsing columns (CPU), the sparsity ladder and the synthetic site (CPU and GPU).
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from docs.pages.published import tables
from runout import log
from runout.backends.protocol import find_device
from runout.io.atomic import write_json
from runout.studies.work_precision import machine, versions
from tests.benchmarks.seed_cases import bodies, ladder, site_runs
from tests.benchmarks.seed_cases.memory_peak import card_name

SCHEMA = 1
FILE, FILE_OF_A_CARD = "published.json", "published_gpu.json"
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
    content: dict[str, Any] = {
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
            content[name] = run()
            bar(done / len(parts))
    return content


def main(arguments: Sequence[str] | None = None) -> Path:
    """Path of the record, after measuring and printing our numbers beside the published ones."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--full", action="store_true", help="the sizes of the documentation (half an hour)")
    parser.add_argument("--device", default="cpu")
    chosen = parser.parse_args(arguments)
    content = measured(chosen.device, chosen.full)
    for title, table in tables([content]):
        log.output().print(f"{title}\n\n{table}", end="\n\n", markup=False)
    return write_json(content, chosen.out / (FILE if content["device"] == "cpu" else FILE_OF_A_CARD))


if __name__ == "__main__":
    print(main())
