"""Joint conditions: thresholds of several quantities that a member reaches together.

Thickness and speed count at one time (:func:`runout.quantities.thickness_and_speed.at_one_time`), maxima of others at any time.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.quantities import ALL_QUANTITIES
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

Condition = Mapping[str, float]  # smallest values by the name of the quantity


def stated_conditions(hazard: Any) -> list[dict[str, float]]:
    """Joint conditions in the settings ``hazard`` of a site."""
    return [{name: limit for name, limit in dict(one).items() if limit is not None} for one in hazard.joint or ()]


def require_conditions(conditions: Sequence[Condition]) -> None:
    """Raise ValueError unless every condition holds positive thresholds of two or more known quantities."""
    for condition in conditions:
        if len(condition) < 2 or not condition.keys() <= ALL_QUANTITIES.keys() or min(condition.values()) <= 0:
            known = ", ".join(ALL_QUANTITIES)
            raise ValueError(f"joint condition {dict(condition)}: positive thresholds of two or more of {known} are needed")


def in_words(condition: Condition) -> str:
    """A condition as text, such as "maximum flow thickness >= 1 m and maximum flow speed >= 1 m s-1"."""
    return " and ".join(
        f"{ALL_QUANTITIES[name].extreme} >= {limit:g} {ALL_QUANTITIES[name].units}" for name, limit in condition.items()
    )


def with_conditions(dataset: "xr.Dataset", conditions: Sequence[Condition]) -> "xr.Dataset":
    """The dataset with the dimension ``joint``: numbers from 1 on, words and thresholds of the conditions."""
    coordinates: dict[str, Any] = {"joint": np.arange(1, len(conditions) + 1, dtype=np.int32)}
    coordinates["joint_condition"] = ("joint", np.array([in_words(condition) for condition in conditions], dtype=object))
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
