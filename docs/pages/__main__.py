"""Write the generated pages of the documentation from the records of their studies: ``python -m docs.pages``."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from docs.pages import (
    avakot,
    cascades_2021,
    cascades_2021_fit,
    columns,
    commands,
    error_bars,
    error_factors,
    flume,
    frank_slide,
    gpu,
    gpu_wet_flows,
    iseesnow,
    maipo,
    one_answer,
    peak_maps,
    published,
    skip,
    stress,
    substeps,
    verification,
    work_precision,
)
from docs.pages.bench_figure import draw
from docs.pages.study_page import StudyPage

DOCS = Path(__file__).parents[1]
RECORDS = DOCS.parent / "tests" / "benchmarks" / "records"
Page = Callable[[Mapping[str, Any]], StudyPage]
VALIDATION: dict[str, Page] = {
    "coulomb_only": iseesnow.coulomb_page,
    "idealized_topo": iseesnow.topo_page,
    "frank_slide": frank_slide.page,
    "cascades_2021": cascades_2021.page,
    "cascades_2021_fit": cascades_2021_fit.page,
    "maipo": maipo.page,
    "avakot": avakot.page,
    "flume": flume.page,
    "columns": columns.page,
}
PAGES: dict[str, tuple[str, Page]] = {  # by record: the folder below docs, and the writer
    "verification": (".", verification.page),
    "stress": (".", stress.page),
    "work_precision": ("benchmarks", work_precision.page),
    "error_bars": ("benchmarks", error_bars.page),
    "error_factors": ("benchmarks", error_factors.page),
    "one_answer": ("benchmarks", one_answer.page),
    "peak_maps": ("benchmarks", peak_maps.page),
    "whole_commands": ("benchmarks", commands.page),
    "skip": ("benchmarks", skip.page),
    "substeps": ("benchmarks", substeps.page),
    "gpu_wet_flows": ("benchmarks", gpu_wet_flows.page),
    **{f"validation_{name}": ("validation", page) for name, page in VALIDATION.items()},
}


def pages() -> list[tuple[Path, StudyPage]]:
    """Every generated page, with the folder that it is written to."""
    made = [(DOCS / folder, page(record(name))) for name, (folder, page) in PAGES.items()]
    of_cards = gpu.page({name: record(name) for name in gpu.RECORDS})
    return [*made, *((DOCS / "benchmarks", page) for page in (of_cards, published.page([record(n) for n in published.RECORDS])))]


def record(name: str) -> dict[str, Any]:
    """Content of a record."""
    content: dict[str, Any] = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    return content


def main() -> None:
    """Write every page with its tables and figures, and the figure of the benchmark."""
    draw(record("bench"), DOCS / "benchmarks" / "bench.png")
    for folder, page in pages():
        print(f"wrote {page.write(folder).relative_to(DOCS.parent)}")


if __name__ == "__main__":
    main()
