"""Validation: runs beside published tools, experiments and observed events, each as a record."""

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runout.errors import ConfigError, ExitCode
from runout.io.atomic import write_json
from runout.studies.validation_cases import (
    avakot,
    cascades_2021,
    cascades_2021_fit,
    columns,
    flume,
    frank_slide,
    iseesnow,
    maipo,
)
from runout.studies.validation_cases.case import ValidationCase
from runout.studies.work_precision import machine, versions

LOGGER = logging.getLogger("runout.validation")
RECORD = "validation_{}.json"
CASES: dict[str, ValidationCase] = {
    case.name: case
    for case in (
        iseesnow.COULOMB_ONLY,
        iseesnow.IDEALIZED_TOPO,
        ValidationCase("frank_slide", "Frank Slide beside SHALTOP, frame by frame", frank_slide.measure),
        ValidationCase("cascades_2021", "Cascades 2021 beside the DEM of difference", cascades_2021.measure),
        ValidationCase("cascades_2021_fit", "Cascades 2021 fitted on half of the reaches", cascades_2021_fit.measure),
        ValidationCase("maipo", "Six debris flows of the upper Maipo, each from the other five", maipo.measure),
        ValidationCase("avakot", "AvaFrame's avaKot with its own friction, beside com1DFA", avakot.measure),
        ValidationCase("flume", "Gate releases at the USGS debris-flow flume", flume.measure),
        ValidationCase("columns", "Columns of rods and of sand beside experiments", columns.measure),
    )
}


def run(case: ValidationCase, full: bool = False, out: Path | None = None) -> dict[str, Any]:
    """Record of a case: ``results``, and with what they were made; written to ``out`` as ``validation_NAME.json``.

    A ``full`` case has the sizes of the documentation (minutes), otherwise those of CI (a minute at most). Raises InputError if its
    files are not there and cannot be fetched.
    """
    started = time.process_time()
    results = case.measure(full)
    record = {
        "case": case.name,
        "title": case.title,
        "full": full,
        "command": f"runout validate {case.name}{' --full' if full else ''} --out DIR",
        "machine": machine(),
        "versions": versions(),
        "processor_seconds": time.process_time() - started,
        "results": results,
    }
    if out is not None:
        LOGGER.info("wrote %s", write_json(record, out / RECORD.format(case.name)))
    return record


def command(cases: Sequence[str], full: bool, out: Path | None) -> ExitCode:
    """Command ``runout validate``: runs the cases and prints their rows; without a case it lists them."""
    chosen = [named(name) for name in cases]
    if not chosen:
        for case in CASES.values():
            LOGGER.info("%s: %s", case.name, case.title)
        return ExitCode.OK
    for case in chosen:
        record = run(case, full, out)
        LOGGER.info("%s\n%s", case.title, "\n".join(record["results"]["lines"]))
    return ExitCode.OK


def named(name: str) -> ValidationCase:
    """The case of a name. Raises ConfigError if there is none."""
    case = CASES.get(name.lower().replace("-", "_"))
    if case is None:
        raise ConfigError(f"there is no case {name!r}; choose among {', '.join(CASES)}")
    return case
