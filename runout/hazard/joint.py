"""Joint conditions of an ensemble: which of them its members record at one time, and the dimension of their maps."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.model.joint_conditions import Condition, Key, flow_part, is_bounded
from runout.quantities import ALL_QUANTITIES
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

NOWHERE: Mapping[Key, int] = {}
BOUNDED = "; only bounded, so that the area is too large rather than too small: members do not record it"


def require_conditions(conditions: Sequence[Condition]) -> None:
    """Raise ValueError unless every condition holds positive thresholds of two or more known quantities."""
    for condition in conditions:
        if len(condition) < 2 or not condition.keys() <= ALL_QUANTITIES.keys() or min(condition.values()) <= 0:
            known = ", ".join(ALL_QUANTITIES)
            raise ValueError(f"joint condition {dict(condition)}: positive thresholds of two or more of {known} are needed")


def in_words(condition: Condition, places: Mapping[Key, int]) -> str:
    """A condition as text, such as "flow thickness >= 1 m and flow speed >= 1 m s-1 at one time"; whether it is only bounded."""
    flow = flow_part(condition)
    thresholds = [(ALL_QUANTITIES[name], limit) for name, limit in (flow | dict(condition)).items()]
    parts = [f"{quantity.words} >= {limit:g} {quantity.units}" for quantity, limit in thresholds]
    parts[len(flow) - 1] += " at one time" if flow else ""
    return " and ".join(parts) + (BOUNDED if is_bounded(condition, places) else "")


def with_conditions(dataset: "xr.Dataset", conditions: Sequence[Condition], places: Mapping[Key, int] = NOWHERE) -> "xr.Dataset":
    """The dataset with the dimension ``joint``: numbers from 1 on, words and thresholds of the conditions."""
    coordinates: dict[str, Any] = {"joint": np.arange(1, len(conditions) + 1, dtype=np.int32)}
    coordinates["joint_condition"] = ("joint", np.array([in_words(condition, places) for condition in conditions], dtype=object))
    for name, quantity in ALL_QUANTITIES.items():
        limits = np.array([condition.get(name, np.nan) for condition in conditions])
        if np.isfinite(limits).any():
            coordinates[quantity.joint_threshold] = ("joint", limits, VARIABLES[quantity.joint_threshold].attributes())
    return dataset.assign_coords(coordinates)


def conditions_of(dataset: "xr.Dataset") -> list[dict[str, float]]:
    """Conditions of a dataset of :func:`with_conditions` in the order of its dimension; none without that dimension."""
    if "joint" not in dataset.dims:
        return []
    limits = {name: dataset[q.joint_threshold].values for name, q in ALL_QUANTITIES.items() if q.joint_threshold in dataset.coords}
    places = range(dataset.sizes["joint"])
    return [{name: float(values[k]) for name, values in limits.items() if np.isfinite(values[k])} for k in places]
