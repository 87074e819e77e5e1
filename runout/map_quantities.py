"""Names of the maps of the quantities of :mod:`runout.quantities`."""

from runout.quantities import QUANTITIES, MapQuantity

DEPOSIT = "deposit"
ARRIVAL, FIRST_ARRIVAL, ARRIVAL_PERCENTILE = "arrival_time", "first_arrival_time", "arrival_time_percentile"
UNTIL_ARRIVAL = (ARRIVAL, FIRST_ARRIVAL, ARRIVAL_PERCENTILE)  # maps that hold no value, not 0, where no flow arrives


def peak_quantities() -> list[MapQuantity]:
    """Quantities whose largest value over time is mapped; thickness is the first."""
    return [q for q in QUANTITIES.values() if q.formula]


def member_map_names() -> tuple[str, ...]:
    """Names of the maps of a member: peaks, arrival, and the deposit."""
    return (*(q.member_map for q in peak_quantities()), ARRIVAL, QUANTITIES[DEPOSIT].member_map)


def quantity_of(variable: str) -> MapQuantity | None:
    """The quantity whose values a map shows, None for probabilities, times and the ground."""
    shown = {name: q for q in QUANTITIES.values() for name in (q.member_map, q.percentile, q.peak, q.mean) if name}
    return shown.get(variable)
