"""Section of the report on classes of intensity and levels of danger: maps in the colours of the scheme, legend, matrix."""

from collections.abc import Iterator
from typing import Any

from runout.config.scheme import CHECKED
from runout.hazard.danger import INTENSITY, LEVEL, PERIOD, entries_of, scheme_record
from runout.report.study import Study
from runout.report.vector_map import DrawnMap, VectorMaps
from runout.report.wording import number


def danger_section(study: Study, maps: VectorMaps) -> dict[str, Any] | None:
    """Content of the section; None for a site without a scheme."""
    record = scheme_record(study.hazard)
    if record is None:
        return None
    years = [number(one, 6) for one in record["return_periods"]["years"]]
    matrix = record["matrix"]
    return {
        **record,
        "source": " · ".join(record["source"].values()),
        "periods": f"{', '.join(years)} years (checked: {record['return_periods']['checked']})",
        "risk": risk_statement(record["risk"]),
        "words": CHECKED,
        "headings": years,
        "rows": [(one["name"], matrix["rows"][one["name"]]) for one in reversed(record["classes"])] if matrix else [],
        "colour_of": {one["name"]: one["colour"] for one in record["levels"]},
        "matrix_checked": matrix["checked"] if matrix else "",
        "figures": list(_figures(study, maps)),
    }


def risk_statement(risk: dict[str, Any] | None) -> str:
    """Sentence on the person for whom an individual risk was computed; empty for schemes of return periods."""
    if risk is None:
        return ""
    levels = ", ".join(f"{level:g}" for level in risk["annual"])
    return (
        f"Individual risk is the annual rate of being reached, times presence ({risk['presence']:g}), times vulnerability "
        f"({risk['vulnerability']:g}); both are stated in the scheme. Levels: {levels} a year."
    )


def _figures(study: Study, maps: VectorMaps) -> Iterator[tuple[str, DrawnMap]]:
    """Title and map: the level of danger, then the class at each return period."""
    hazard = study.hazard
    if LEVEL in hazard:
        title = "Level of danger"
        yield title, maps.classes(hazard[LEVEL].values, entries_of(hazard, LEVEL), title)
    classes = [{**one, "text": ""} for one in entries_of(hazard, INTENSITY)]
    for years in hazard[PERIOD].values:
        title = f"Intensity at a return period of {number(float(years), 6)} years"
        yield title, maps.classes(hazard[INTENSITY].sel({PERIOD: years}).values, classes, title)
