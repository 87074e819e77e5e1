"""Validation beyond `runout validate`: studies of many runs, which make the records of pages. Their inputs are in RUNOUT_DATA.

    python -m tests.benchmarks.validation_studies NAME --out DIR [--coarse]

NAME is `avakot`, `cascades_2021_fit` or `maipo`. A study takes minutes to hours on all processors; `--coarse` makes one run of it.
"""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from typing import Any

from runout.studies.validation_cases.case import ValidationCase

NAMES = ("avakot", "cascades_2021_fit", "maipo")


def study(name: str) -> ValidationCase:
    """The study of a name."""
    case: ValidationCase = import_module(f"{__name__}.{name}").CASE
    return case


def on_all_processors(function: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    """Results of a function of a module for each of many jobs, in their order, in one process a processor."""
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn")) as workers:
        return list(workers.map(function, jobs))
