"""Measure reports for docs/guide/outputs/report.md: ``python docs/measure_reports.py SITE RESULTS [SITE RESULTS ...]``.

Each pair is a site and a folder of its results. A fresh process reads the site and writes the report, three times. The table holds
the least processor time; it goes to docs/guide/outputs/report_sizes.csv.
"""

import csv
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from runout.io.member_maps import member_table

TABLE = Path(__file__).parent / "guide" / "outputs" / "report_sizes.csv"
HEAD = ("site", "members", "size [MB]", "processor time [s]", "most memory [MB]")
PROGRAM = """
from runout.processes.imports import collect_rarely, hide_dask
collect_rarely()  # as the command does
hide_dask()
import sys
from pathlib import Path
from runout.config.site import read_site
from runout.report.html import write_report
write_report(read_site(Path(sys.argv[1])), Path(sys.argv[2]))
"""
REPEATS = 3


def row(site: Path, results: Path) -> tuple[str, int, str, str, str]:
    """A line of the table."""
    figures = [measured(site, results) for _ in range(REPEATS)]
    members = int((member_table(results / "members.nc")["status"] == "valid").sum())
    megabytes = (results / "report.html").stat().st_size / 1e6
    return site.name, members, f"{megabytes:.1f}", f"{min(seconds for seconds, _ in figures):.1f}", f"{figures[0][1] / 1e6:.0f}"


def measured(site: Path, results: Path) -> tuple[float, float]:
    """Processor time [s] of a process that writes a report, and its largest resident memory [byte]."""
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, str(site), str(results)])
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{results}: the report was not written")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024.0


def rows(paths: list[str]) -> Iterator[tuple[str, int, str, str, str]]:
    """Lines of pairs of site and results."""
    for site, results in zip(paths[::2], paths[1::2], strict=True):
        yield row(Path(site), Path(results))


if __name__ == "__main__":
    lines = [HEAD, *rows(sys.argv[1:])]
    with TABLE.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    print(TABLE.read_text())
