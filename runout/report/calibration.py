"""Section of the report on a calibration: prior and posterior, pairs of parameters, and what was observed against the prediction.

It is shown by a site that was calibrated with these members, and by one whose table of members is a posterior. Its numbers are
those of ``calibration.json``; a record that does not belong to the table beside it is not shown.
"""

from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from runout.io.atomic import read_json
from runout.report.chart import Chart
from runout.report.figures import COLOUR, parameter_label
from runout.report.wording import MINUS, number

if TYPE_CHECKING:
    import pandas as pd

    from runout.report.study import Study

FOLDER, RECORD, TABLE = "calibration", "calibration.json", "posterior.csv"  # of `runout calibrate`
GREY, VALIDATED = "#a9c1cf", "#c0392b"
MOST_DRAWN = 4  # parameters in the charts
OF_EVENT = ": "  # between the name of an event and that of its own parameter
DEVIATIONS = 3.0  # range of the chart of deviations, unless one is larger


def record_of(results: Path, files: set[str], table: Path | None) -> tuple[dict[str, Any], "pd.DataFrame"] | None:
    """Record and table of the calibration that a report shows; None without.

    Parameters
    ----------
    results : Path
    files : set of str
        Names of the files of the valid members.
    table : Path or None
        Table of members of the site.
    """
    import pandas as pd

    place = Path(results) / FOLDER / TABLE if table is None else table
    record = read_json(place.with_name(RECORD))
    if not place.is_file() or record.get("tables", {}).get(place.name) != sha256(place.read_bytes()).hexdigest():
        return None
    if table is None and not files & set(record.get("files_of_the_ensemble", ())):
        return None
    return record, pd.read_csv(place)


def calibration_section(study: "Study", table: Path | None) -> dict[str, Any] | None:
    """Content of the section; None for a site that neither was calibrated nor reads a posterior."""
    shown = record_of(study.results, set(study.valid["file"]), table)
    if shown is None:
        return None
    record, sample = shown
    events = record.get("events", {"": record})
    names = [name for name in record["parameters"] if name in sample or OF_EVENT in name]
    return {
        "source": "of this site" if table is None else f"that {table.name} comes from",
        "events": list(record.get("events", ())),
        "parameters": [_row(name, record["parameters"][name]) for name in record["parameters"]],
        "marginals": [_marginal(name, record["marginals"][name]) for name in names[:MOST_DRAWN]],
        "pairs": [_pair(a, b, sample, record) for a, b in combinations([n for n in names if n in sample][:MOST_DRAWN], 2)],
        "deviations": _deviations(events),
        "comparisons": [(title, rows) for title, rows in _comparisons(events) if rows],
        "statements": [*record["statements"], *(sentence for one in events.values() for sentence in one["misfits"])],
        "on_these_cells": all(one["grid_error"] is None for one in events.values()),
    }


def _label(name: str) -> str:
    event, of_event, own = name.rpartition(OF_EVENT)
    return event + of_event + parameter_label(own)


def _row(name: str, one: Mapping[str, float]) -> tuple[str, list[str]]:
    share = f"{one['standard_deviation_over_prior']:.0%}"
    return _label(name), [*(number(one[key]) for key in ("p5", "p50", "p95", "standard_deviation")), share]


def _marginal(name: str, shares: Mapping[str, list[float]]) -> Markup:
    """Chart of prior and posterior of a parameter."""
    edges, top = np.array(shares["edges"]), 1.08 * max(*shares["prior"], *shares["posterior"])
    chart = Chart(_label(name), "share of the sample", (float(edges[0]), float(edges[-1])), (0.0, top), 200.0)
    steps = np.repeat(edges, 2)[1:-1]
    posterior, prior = (np.repeat(shares[of], 2) for of in ("posterior", "prior"))
    chart.area(steps, np.zeros(len(steps)), posterior, COLOUR, "posterior")
    chart.line(steps, prior, "currentColor", "prior", 1.3)
    return chart.svg(f"Prior and posterior of {_label(name)}")


def _pair(across: str, up: str, sample: "pd.DataFrame", record: Mapping[str, Any]) -> Markup:
    """Chart of the rows of the table over the range of the prior of two parameters."""
    x, y = ((edges[0], edges[-1]) for edges in (record["marginals"][name]["edges"] for name in (across, up)))
    chart = Chart(_label(across), _label(up), x, y)
    chart.points(sample[across].clip(*x), sample[up].clip(*y), COLOUR)
    return chart.svg(f"Posterior of {_label(across)} and {_label(up)}")


def _comparisons(events: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, list[tuple[str, list[str]]]]]:
    """Title and rows of a table for calibration and for validation of each event."""
    for event, one in events.items():
        begin = f"{event}: " if event else ""
        others = "the other events" if event else "the other observations"
        yield f"{begin}calibration, predicted from all observations", _compared(one["observations"])
        yield f"{begin}validation, each predicted from {others} alone", _compared(one["validation"])


def _compared(rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
    return [
        (
            f"{name.replace('.', ' ').replace('_', ' ')} [{row['units']}]",
            [
                *(number(row[key]) for key in ("observed", "standard_error", "predicted", "standard_deviation")),
                f"{row['deviation']:+.1f}".replace("-", MINUS),
            ],
        )
        for name, row in rows.items()
    ]


def _deviations(events: Mapping[str, Mapping[str, Any]]) -> Markup | None:
    """Chart of observed minus predicted in standard deviations, of calibration and validation."""
    names = [(event, name) for event, one in events.items() for name in one["observations"]]
    if not names:
        return None
    kinds = {
        of: np.array([events[event][of].get(name, {}).get("deviation", np.nan) for event, name in names])
        for of in ("observations", "validation")
    }
    most = max(DEVIATIONS, 1.1 * float(np.nanmax(np.abs(np.concatenate(list(kinds.values()))))))
    ticks = [(float(k), str(k + 1)) for k in range(len(names))]
    chart = Chart("row of the tables below", "observed minus predicted [sd]", (-0.6, len(names) - 0.4), (-most, most), names=ticks)
    chart.area([-0.6, len(names) - 0.4], [-2.0, -2.0], [2.0, 2.0], GREY, "2 standard deviations")
    chart.points(np.arange(len(names)) - 0.08, kinds["observations"], COLOUR, "calibration")
    chart.points(np.arange(len(names)) + 0.08, kinds["validation"], VALIDATED, "validation")
    return chart.svg("Observed against predicted")
