"""Whether the stated sampling error holds: errors of sub-ensembles against one large ensemble.

    python -m tests.benchmarks.sampling_error --out DIR [--members 512] [--sizes 16 32 64 128] [--device cuda:0] [--workers 1]
        [--sites jacksboro frank_slide] [--set KEY=VALUE ...]

The members of a site are one Sobol net. Each block of n consecutive members is a net of its own, as an ensemble of n members is.
For each block the estimator of the products (:mod:`runout.hazard.sampling`) states an error in each cell. The true error is the
difference of its map from that of all N members, divided by sqrt(1 - n / N), since the block is a part of them. The table has the
root mean square of both over the cells that any member reaches and over the blocks, and their ratio, which is to lie within 0.8
and 1.5. The error of independent members, sqrt(p (1 - p) / n), stands beside them.

Members are kept in DIR/SITE/members, so that a second call goes on. DIR/sampling_error.json is the record,
DIR/sampling_error.md the table. frank_slide reads its rasters below RUNOUT_DATA.
"""

import argparse
import logging
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

SITES, FOLDER = ("jacksboro", "frank_slide"), Path(__file__).parents[2] / "sites"
MEMBERS, SIZES = 512, (16, 32, 64, 128)
BOUNDS = 0.8, 1.5  # of stated over true
NAME = "sampling_error"
COLUMNS = ("site", "map", "members", "blocks", "stated", "true", "ratio", "independent", "holds")


def settings(members: int, changes: Sequence[str]) -> list[str]:
    """Changes of a site.yaml: the number of members, no growth by a tolerance, and those of the command line."""
    return [f"ensemble.members={members}", *changes]


def simulated(site_path: Path, out: Path, members: int, device: str, workers: int | None, changes: Sequence[str]) -> Any:
    """Members of a site with the files of the valid ones, after running those that are missing."""
    import runout
    from runout.ensemble.member import planned_table
    from runout.ensemble.run import run_ensemble
    from runout.hazard.members import Ensemble

    site = runout.read_site(site_path, settings(members, changes)).on_device(device)
    report = run_ensemble(site, out, workers=workers)
    print(f"{site_path.name}: {len(report.done)} members run, {len(report.skipped)} kept, {len(report.failed)} failed", flush=True)
    return site, Ensemble.of(out, planned_table(site))


def stacks(files: Sequence[Path], thresholds: Mapping[str, Sequence[float]]) -> Iterator[tuple[str, np.ndarray]]:
    """Words of a map and its values (cells, members): whether each threshold is reached, and the largest thickness."""
    from runout.io.member_maps import MemberMaps
    from runout.quantities import QUANTITIES

    for name, limits in thresholds.items():
        quantity, layers = QUANTITIES[name], []
        for path in files:
            with MemberMaps(path) as member:
                layers.append(np.nan_to_num(member.layer(quantity.member_map, None)).ravel())
        values = np.stack(layers, axis=1)
        values = values[values.max(axis=1) > 0]
        for limit in limits:
            yield f"P({name} >= {limit:g})", (values >= np.float32(limit)).astype(np.float32)
        if quantity.mean:
            yield f"mean {name}", values


def row_of(values: np.ndarray, size: int, points: Any) -> dict[str, Any]:
    """Root mean square of stated, true and independent errors of the blocks of ``size`` members, over all cells reached.

    Parameters
    ----------
    values : ndarray (cells, members)
        In the order of the net.
    size : int
    points : NetPoints
        Of all members.
    """
    from runout.hazard.sampling import BLOCKS, Estimator

    members, blocks = values.shape[1], values.shape[1] // size
    reached = values[values.max(axis=1) > 0]
    whole, part = reached.mean(axis=1, dtype=np.float64), 1.0 - size / members
    squares = np.zeros(3)
    for k in range(blocks):
        in_net = slice(k * size, (k + 1) * size)
        block, estimator = reached[:, in_net], Estimator(BLOCKS, "", replace(points, members=points.members[in_net]))
        factor = estimator.factor(estimator.scatter(block, np.arange(size), size))
        stated_errors = factor * estimator.of_mean(block, np.arange(size), size)  # type: ignore[operator]
        mean = block.mean(axis=1, dtype=np.float64)
        variance = block.var(axis=1, dtype=np.float64) / size
        squares += [np.mean(np.square(stated_errors)), np.mean(np.square(mean - whole)) / part, np.mean(variance)]  # type: ignore[arg-type]
    stated_rms, true_rms, independent = np.sqrt(squares / blocks)
    ratio = float(stated_rms / true_rms) if true_rms else None
    holds = ratio is not None and BOUNDS[0] <= ratio <= BOUNDS[1]
    numbers = {"stated": float(stated_rms), "true": float(true_rms), "ratio": ratio, "independent": float(independent)}
    return {"members": size, "blocks": blocks, "cells": len(reached), **numbers, "holds": holds}


def rows_of(site: Any, ensemble: Any, sizes: Sequence[int]) -> list[dict[str, Any]]:
    """Rows of the table of a site; all its members are needed, since a net with a gap is none."""
    from runout.hazard.exceedance import stated_thresholds

    if len(ensemble.files) != len(ensemble.table):
        raise SystemExit(f"{site.name}: {ensemble.statement()}; the blocks would be no nets")
    from runout.ensemble.design import nets_of

    files, rows = [ensemble.files[k] for k in sorted(ensemble.files)], []
    points = nets_of(site.settings.ensemble, len(files))[""]
    for words, values in stacks(files, stated_thresholds(site.settings.hazard)):
        if values.any():
            rows += [{"site": site.name, "map": words, **row_of(values, size, points)} for size in sizes if size < len(files)]
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as a table of Markdown."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    return "\n".join([*lines, *("| " + " | ".join(_cell(row[name]) for name in COLUMNS) + " |" for row in rows)]) + "\n"


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else ("yes" if value else "no") if isinstance(value, bool) else str(value)


def summary(rows: Sequence[Mapping[str, Any]], sizes: Sequence[int]) -> list[dict[str, Any]]:
    """For each number of members how many maps hold, and the range and the median of the ratios."""
    lines = []
    for size in sizes:
        ratios = [row["ratio"] for row in rows if row["members"] == size and row["ratio"] is not None]
        if ratios:
            numbers = {"least": min(ratios), "median": float(np.median(ratios)), "largest": max(ratios)}
            lines.append(
                {"members": size, "maps": len(ratios), "hold": sum(BOUNDS[0] <= r <= BOUNDS[1] for r in ratios), **numbers}
            )
    return lines


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Run the members, compare, print the table, and write it with the record."""
    from runout.io.atomic import write_json, write_text
    from runout.studies.work_precision import machine, versions

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of members, table and record")
    parser.add_argument("--members", type=int, default=MEMBERS, help="of the reference, a power of two")
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=SIZES, help="members of the sub-ensembles, powers of two from 16 on"
    )
    parser.add_argument("--sites", nargs="+", default=SITES, help="names below sites/, or paths")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--workers", type=int, help="members that run at once")
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="settings in place of those of site.yaml")
    words = list(sys.argv[1:] if arguments is None else arguments)
    chosen = parser.parse_args(words)
    logging.basicConfig(level=logging.ERROR)
    rows, seconds = [], {}
    for name in chosen.sites:
        path, started = FOLDER / name if (FOLDER / name).is_dir() else Path(name), time.perf_counter()
        run = simulated(path, chosen.out / path.name, chosen.members, chosen.device, chosen.workers, chosen.set)
        seconds[path.name] = round(time.perf_counter() - started, 1)
        rows += rows_of(*run, chosen.sizes)
        record = {"machine": machine(), "versions": versions(), "device": chosen.device, "members": chosen.members}
        record |= {"options": " ".join(words).replace(str(chosen.out), "DIR"), "seconds": seconds}
        record |= {"bounds": BOUNDS, "summary": summary(rows, chosen.sizes), "rows": rows}
        write_json(record, chosen.out / f"{NAME}.json")
        write_text(table(rows), chosen.out / f"{NAME}.md")
    print(table(rows))
    for line in record["summary"]:
        print(line)
    return record


if __name__ == "__main__":
    main()
