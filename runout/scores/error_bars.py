"""Numerical error bars of scores, from the convergence study of a site."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from runout.scores.contingency import Contingency


@dataclass(frozen=True)
class ErrorBars:
    """What ``convergence.json`` of a site says of the errors of its maps.

    The study is that of the median scenario (``runout verify SITE --convergence``). A score inherits it to first order:

    ==================  ===========================================================================================
    score               error bar
    ==================  ===========================================================================================
    front error         error of the front of 99 % of the mass
    area bias           error of the area over the observed area
    POD                 d over observed area; d = (1 - CSI of the two finest grids) times the modelled area
    FAR, CSI            d over modelled area; d over the area that either reaches
    ==================  ===========================================================================================

    Attributes
    ----------
    content : mapping
        The file, or empty.
    """

    content: Mapping[str, Any]

    def front(self) -> float | None:
        """Error of the front [m]."""
        return self._error("f99")

    def of_contingency(self, table: Contingency, quantity: str, threshold: float) -> dict[str, float | None]:
        """Errors of the scores of a table by name, for the map "flow_thickness" or "deposit" at a threshold [m]."""
        agreement = self._agreement(quantity, threshold)
        area = self._error(f"area_above_{threshold:g}_m") if quantity == "flow_thickness" else None
        changed = None if agreement is None else (1.0 - agreement) * table.modelled
        either = table.hits + table.misses + table.false_alarms
        return {
            "csi": _over(changed, either),
            "pod": _over(changed, table.observed),
            "far": _over(changed, table.modelled),
            "area_bias": _over(area, table.observed),
        }

    def _error(self, quantity: str) -> float | None:
        quantities = self.content.get("quantities")
        entry = quantities.get(quantity) if isinstance(quantities, Mapping) else None
        return float(entry["error"]) if isinstance(entry, Mapping) and isinstance(entry.get("error"), int | float) else None

    def _agreement(self, quantity: str, threshold: float) -> float | None:
        """Critical success index between the two finest grids."""
        fields = self.content.get("fields")
        for field in fields if isinstance(fields, list) else ():
            if isinstance(field, Mapping) and (field.get("level"), field.get("map")) == (1, quantity):
                index = field.get("critical_success_index")
                found = index.get(f"{threshold:g}") if isinstance(index, Mapping) else None
                return float(found) if isinstance(found, int | float) else None
        return None


def _over(error: float | None, whole: float) -> float | None:
    return None if error is None or not whole or not math.isfinite(error) else error / whole
