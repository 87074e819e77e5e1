"""Command ``runout what-if``: runs a site for values of its parameters on coarse cells, and draws what they change."""

import json
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runout import log
from runout.ensemble.design import member_seed
from runout.ensemble.sweep import Sweep, read_sweep
from runout.errors import ExitCode
from runout.io.atomic import read_json, write_json, write_text
from runout.io.places import require_results
from runout.io.provenance import checksum
from runout.log import duration
from runout.workflow import hazard_map
from runout.workflow.opening import open_page
from runout.workflow.sensitivity import finished_members, member_scalars
from runout.workflow.study import Study
from runout.workflow.time_budget import Choice, TimeBudget

if TYPE_CHECKING:
    import pandas as pd

    from runout.config.site import Site

LOGGER = logging.getLogger("runout.what_if")
FOLDER, MEMBERS, CELLS, TABLE, PAGE = "results_what_if", "sweep.csv", "cells.json", "what_if.csv", "what_if.html"
STAGES = ("terrain", "release", "ensemble", "hazard")
ANNUAL = ("return_periods", "scheme")  # keys of hazard that need annual rates, which a sweep has not


@dataclass(frozen=True)
class WhatIf:
    """What ``runout what-if`` was asked for."""

    values: tuple[str, ...]  # each ``KEY=LOW:HIGH:STEP`` or ``KEY=A,B,C``
    one_at_a_time: bool = False  # vary one parameter after the other instead of all combinations
    scenario: str | None = None  # scenario whose values the other parameters have
    cell_size: float | None = None  # grid spacing [m]; None: the cells of the site, or coarser ones that fit into the budget
    budget: str = "5min"  # time such as "5min"


def run(
    site_path: Path,
    out: Path | None,
    asked: WhatIf,
    *,
    workers: int | None = None,
    threads: int | None = None,
    device: str | None = None,
    show: bool = False,
) -> int:
    """Run a sweep, and write its table and page; the exit code.

    Members that have run with the same settings are not run again, also those of an earlier sweep over the same parameters.

    Raises ConfigError, BudgetError or PartialEnsembleError if a key or its values cannot be used, the runs exceed the budget, or
    none has a result.
    """
    study, sweep, notes = prepared(site_path, out, asked, workers, device)
    for line in notes:
        LOGGER.info("%s", line)
    how = {"workers": workers, "threads": threads, "device": device}
    hazard_map.run(site_path, study.results, STAGES, changes=study.site.changes, **how)  # type: ignore[arg-type]
    study.refresh()
    page = write_products(study, sweep, notes)
    LOGGER.info("wrote %s", page)
    if show:
        open_page(page)
    return ExitCode.PARTIAL_ENSEMBLE if study.failed else ExitCode.OK


def prepared(
    site_path: Path, out: Path | None, asked: WhatIf, workers: int | None, device: str | None
) -> tuple[Study, Sweep, list[str]]:
    """The study of a sweep, whose table is written, the sweep, and notes on its values and cells; arguments as of :func:`run`."""
    from runout.config.site import read_site

    site = read_site(site_path)
    sweep = read_sweep(site.settings, asked.values, asked.scenario, asked.one_at_a_time)
    results = Path(out) if out else site.folder / FOLDER / "+".join(sweep.varied)
    require_results("--out" if out else "--out [default]", results)
    table = write_text(sweep.table(member_seed(site.settings.ensemble.seed, 0)), results / MEMBERS)
    changes = _changes(site, table)
    with log.muted():
        site = read_site(site_path, changes)
        limit = TimeBudget.of(site if device is None else site.on_device(device), asked.budget, results, workers=workers)
        cells = _cells(limit, asked.cell_size)
        study = Study.open(site_path, results, device=device, changes=(*changes, *limit.settings(cells)))
        limit.require_time(study.site, study.left)
        return study, sweep, list(statements(sweep, cells, limit))


def _changes(site: "Site", table: Path) -> tuple[str, ...]:
    """Settings of the command line that give a site the members of a table, and a title that says so."""
    stated = site.stated()
    title = json.dumps(f"{site.settings.title or site.name}: what if")
    of_members = [f"ensemble.{key}=" for key in stated.get("ensemble", {}) if key not in ("seed", "table")]
    annual = [f"hazard.{key}=" for key in ANNUAL if key in stated.get("hazard", {})]
    return (f"title={title}", f"ensemble.table={json.dumps(str(table.absolute()))}", *of_members, *annual)


def _cells(limit: TimeBudget, cell_size: float | None) -> Choice:
    """Cells of a sweep: stated, or those of an earlier sweep of the folder with the same budget and site, or new ones."""
    if cell_size is not None:
        return limit.of_size((cell_size,) * 3)
    key = checksum([limit.seconds, limit.site.stated()])
    stored = read_json(limit.results / CELLS)
    if stored.get("key") == key:
        east, north, up = stored["cell_size"]
        return limit.of_size((east, north, up))
    cells = limit.coarsened()
    write_json({"key": key, "cell_size": list(cells.cell_size)}, limit.results / CELLS)
    return cells


def statements(sweep: Sweep, cells: Choice, limit: TimeBudget) -> Iterator[str]:
    """What a sweep varies and what it keeps, its cells, and the error that these cost."""
    for name, values in sweep.varied.items():
        yield f"{name}: {', '.join(f'{value:g}' for value in values)}"
    constant = [f"{name} {value:g}" for name, value in sweep.constant.items() if sweep.one_at_a_time or name not in sweep.varied]
    if constant:
        yield f"other sampled parameters have their medians: {', '.join(constant)}"
    own = limit.of_size(limit.site_size())
    size = f"cells of {cells.cells} m" + ("" if cells.cell_size == own.cell_size else f" in place of {own.cells} m")
    yield f"{size}, {cells.through:.2g} through the mean thickness: {_error(cells)}"
    if cells.cell_size != own.cell_size:
        yield f"the cells of the site: {_error(own)}, about {duration(own.seconds)}; --cell-size {own.cells} takes them"


def _error(cells: Choice) -> str:
    if math.isnan(cells.numerical):
        return "their numerical error is not known, because so few cells through the mass were not measured"
    return f"numerical error ± {100 * cells.numerical:.2g} % of the run-out (holds 9 of 10 cases)"


def write_products(study: Study, sweep: Sweep, notes: Sequence[str]) -> Path:
    """Path of the page, after writing it and the table."""
    from runout.report.what_if import page

    outcomes = sweep_table(study)
    write_text(str(outcomes.to_csv(index_label="member")), study.results / TABLE)
    return write_text(page(study.site, study.results, sweep, outcomes, notes), study.results / PAGE)


def sweep_table(study: Study) -> "pd.DataFrame":
    """Parameters of each member with a result, area reached [km2], run-out [m] and volumes [m3]; indexed by member."""
    import pandas as pd

    members = finished_members(study)
    scalars = member_scalars(study.site, study.results, members)
    parameters = pd.DataFrame([member.parameters for member in members])
    table = pd.concat([parameters, pd.DataFrame(scalars)], axis=1)
    table.index = pd.Index([member.number for member in members], name="member")
    return table
