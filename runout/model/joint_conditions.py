"""Joint conditions: thresholds of several quantities, of which those of the flow count at one time.

A run records where the flow reached all of them at one moment, for each condition that is asked for: bit k of the map
:data:`MET` is that of condition k, which the attribute :data:`ATTRIBUTE` of the file lists. Conditions of equal thresholds of
thickness and speed need no record, since they have a map (:mod:`runout.quantities.thickness_and_speed`). A file without the record
of a condition has bounds of it only.

A condition may also be the strength of a house: ``{"house_force": F, "house_height": h}``, see
:func:`runout.quantities.pressure.share_of_house_strength`.
"""

import json
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from runout.errors import ConfigError
from runout.quantities import ALL_QUANTITIES, MET, peak_quantities
from runout.quantities.pressure import share_of_house_strength
from runout.quantities.thickness_and_speed import at_one_time

Condition = Mapping[str, float]  # smallest values by the name of the quantity
Key = tuple[tuple[str, float], ...]
ATTRIBUTE = "joint_conditions"
HOUSE = "house_force", "house_height"  # F [N] and h [m] of a condition that is the strength of a house
MOST = 24  # bits of a number that single precision holds


def flow_part(condition: Condition) -> dict[str, float]:
    """The thresholds that count at one time: those of the flow, if there are two or more; a deposit has one time, its end."""
    of_flow = {name: limit for name, limit in condition.items() if name in HOUSE or ALL_QUANTITIES[name].formula}
    return of_flow if len(of_flow) > 1 else {}


def key_of(condition: Condition) -> Key:
    """What is the same for conditions whose thresholds at one time are the same; empty if none count at one time."""
    return tuple(sorted(flow_part(condition).items()))


def is_bounded(condition: Condition, places: Mapping[Key, int]) -> bool:
    """Whether maps of members only bound a condition, whose record is at none of the ``places``."""
    part, key = flow_part(condition), key_of(condition)
    has_map = part.keys() == {"thickness", "speed"} and len(set(part.values())) == 1
    return bool(part) and not has_map and key not in places


def maps_of(condition: Condition) -> tuple[str, ...]:
    """Names of the quantities whose maps decide a condition, or bound it."""
    return ("pressure", "thickness") if is_of_house(condition) else tuple(at_one_time(condition) | dict(condition))


def is_of_house(condition: Condition) -> bool:
    """Whether a condition is the strength of a house."""
    return condition.keys() == set(HOUSE)


def to_record(conditions: Iterable[Condition]) -> list[dict[str, float]]:
    """What a run has to record for some conditions: thresholds that count at one time and have no map, each once."""
    return [dict(key) for key in dict.fromkeys(key_of(one) for one in conditions if is_bounded(one, {}))][:MOST]


def checked_conditions(conditions: Sequence[Condition]) -> tuple[dict[str, float], ...]:
    """The conditions; ConfigError unless each has positive thresholds of two or more quantities of the flow."""
    known = [q.name for q in peak_quantities()]
    for one in conditions:
        several = len(one) > 1 and one.keys() <= set(known)
        if not (several or is_of_house(one)) or not all(0 < limit < np.inf for limit in one.values()):
            choices = f"two or more of {', '.join(known)}, or {' and '.join(HOUSE)}"
            raise ConfigError(f"joint_conditions: {dict(one)}; state positive thresholds of {choices}")
    if len(conditions) > MOST:
        raise ConfigError(f"joint_conditions: {len(conditions)} conditions; a run records {MOST} at most")
    return tuple(dict(one) for one in conditions)


def limits_of(conditions: Sequence[Condition]) -> np.ndarray:
    """Thresholds (conditions, quantities + 2), of :func:`runout.quantities.peak_quantities` and :data:`HOUSE`; 0 for none."""
    names = [*(q.name for q in peak_quantities()), *HOUSE]
    return np.array([[one.get(name, 0.0) for name in names] for one in conditions]).reshape(len(conditions), len(names))


def met_map(shares: Iterable[np.ndarray]) -> np.ndarray:
    """The map :data:`MET` from the largest share of its thresholds that each condition reached, (rows, columns) each."""
    return sum(2.0**k * (share.astype(np.float32) >= 1.0) for k, share in enumerate(shares))  # type: ignore[return-value]


def attribute_of(conditions: Sequence[Condition]) -> str:
    """The attribute of a file with the record of some conditions."""
    return json.dumps(conditions)


def places_in(attribute: str) -> dict[Key, int]:
    """Bit of each condition that a file records, from its attribute."""
    return {key_of(one): place for place, one in enumerate(json.loads(attribute))}


def meets(condition: Condition, values: Mapping[str, np.ndarray], places: Mapping[Key, int]) -> np.ndarray:
    """Where members meet a condition, from their maps by the name of the quantity, of one shape, and :data:`MET`.

    A condition whose record is at none of the ``places`` has bounds (:func:`runout.quantities.thickness_and_speed.at_one_time`),
    so that it is met too often rather than too rarely. A quantity without a map counts as 0. That of a house is bounded by the
    largest pressure against the strength at the largest thickness, which is the least one that the flow met.
    """
    if is_of_house(condition) and key_of(condition) not in places:
        force, height = (condition[name] for name in HOUSE)
        pressure, depth = (values[name].astype(np.float64) for name in ("pressure", "thickness"))
        return share_of_house_strength(pressure, depth, force, height) >= 1.0  # type: ignore[no-any-return]
    bounds, met = at_one_time(condition), np.ones(next(iter(values.values())).shape, bool)
    if (key := key_of(condition)) in places:
        bounds = {name: limit for name, limit in condition.items() if name not in dict(key)}
        met = values[MET].astype(np.int32) >> places[key] & 1 == 1
    for name, limit in bounds.items():
        met &= values[name] >= np.float32(limit) if name in values else False
    return met
