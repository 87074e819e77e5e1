"""Write the generated pages of the documentation from the records of their studies: ``python -m runout.studies.documentation``."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from runout.studies import commands_page, error_bar_page, error_page, gpu_page, skip, transfers
from runout.studies.seed_cases import page as published_page
from runout.studies.stability_cases import page as stability_page
from runout.studies.study_page import StudyPage
from runout.studies.validation import RECORD
from runout.studies.validation_cases import CASES
from runout.studies.verification_cases import page as verification_page
from runout.studies.work_report import draw

ROOT = Path(__file__).parents[2]
RECORDS = ROOT / "tests" / "benchmarks" / "records"
DOCS = ROOT / "docs"
ONE_RECORD: dict[str, tuple[str, Callable[[Mapping[str, Any]], StudyPage]]] = {  # folder below docs, and the writer
    "verification": (".", verification_page.page),
    "stress": (".", stability_page.page),
    "work_precision": ("benchmarks", error_page.page),
    "error_bars": ("benchmarks", error_bar_page.page),
    "whole_commands": ("benchmarks", commands_page.page),
    "skip": ("benchmarks", skip.page),
    "transfers": ("benchmarks", transfers.page),
}


def pages() -> dict[Path, StudyPage]:
    """Every generated page, by the folder that it is written to and its name."""
    found = {DOCS / folder / name: write(_record(name)) for name, (folder, write) in ONE_RECORD.items()}
    found |= {DOCS / "validation" / name: CASES[name].page(_record(record)) for name, record in _validated()}
    folder, known = DOCS / "benchmarks", [name for name in published_page.RECORDS if (RECORDS / f"{name}.json").is_file()]
    return found | {
        folder / "gpu": gpu_page.page({name: _record(name) for name in gpu_page.RECORDS}),
        folder / "published": published_page.page([_record(name) for name in known]),
    }


def _validated() -> Iterator[tuple[str, str]]:
    """Cases of the validation that have a record, and its name."""
    records = ((name, RECORD.format(name).removesuffix(".json")) for name in CASES)
    return ((name, record) for name, record in records if (RECORDS / f"{record}.json").is_file())


def _record(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    return content


def main() -> None:
    """Write every page with its tables and figures, and the figure of the benchmark."""
    draw(_record("bench"), DOCS / "benchmarks" / "bench.png")
    for path, page in pages().items():
        print(f"wrote {page.write(path.parent).relative_to(ROOT)}")


if __name__ == "__main__":
    main()
