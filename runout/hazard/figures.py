"""Key figures of one member: run-out, deposit and, with a bed, volumes. They are columns of ``members.nc``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runout.hazard.order import weighted_percentiles
from runout.hazard.reach import Reach
from runout.quantities import ARRIVAL, CHANGE, DEPOSIT, ERODED, QUANTITIES

if TYPE_CHECKING:
    import pandas as pd

    from runout.io.member_maps import MemberMaps, StackedMember


@dataclass(frozen=True)
class Column:
    """Heading and printed unit of a figure in a table of members; :data:`~runout.variables.VARIABLES` says what it is."""

    heading: str
    units: str


FIGURES = {
    "runout_distance": Column("Runout", "m"),
    "reach_angle_deg": Column("Angle of reach", "°"),
    "reached_area": Column("Area reached", "km²"),
    "highest_speed": Column("Peak speed", "m s⁻¹"),
    "deposit_volume": Column("Deposit beyond", "m³"),
    "escaped_fraction": Column("Escaped", "%"),
    "end_time": Column("End", "s"),
}
VOLUMES = {  # of members with an erodible bed
    "released_volume": Column("Released", "m³"),
    "eroded_volume": Column("Eroded", "m³"),
    "whole_deposit_volume": Column("Deposited", "m³"),
    "left_volume": Column("Left the site", "m³"),
    "lowered_volume": Column("Net erosion", "m³"),
    "raised_volume": Column("Net deposition", "m³"),
}
Ledger = Mapping[str, np.ndarray]  # mass and energy, each (time,), by name
WITHOUT_LEDGER: Ledger = {name: np.array([np.nan]) for name in ("time", "mass", "escaped_mass")}


def member_figures(
    member: "MemberMaps | StackedMember", ledger: Ledger, reach: Reach, least: float | None = None, inflow: float = 0.0
) -> dict[str, float]:
    """Values of :data:`FIGURES` for one member in SI units; area in km², escaped share in percent.

    The flow reaches cells in which it is ``least`` [m] thick or more at any time; None: those with a time of arrival.
    ``inflow`` [m3] is the volume of the inflows, which is part of no map.
    """
    thickness = QUANTITIES["thickness"].member_map
    decides = ARRIVAL if least is None else thickness
    maps = {name: member.within(name, reach.part) for name in (decides, "max_speed", "deposit_thickness")}
    reached = np.isfinite(maps[ARRIVAL]) if least is None else np.nan_to_num(maps[thickness]) >= np.float32(least)
    distance, angle = reach.runout(reached)
    deposit = np.nan_to_num(maps["deposit_thickness"][~reach.released])
    mass, escaped = float(ledger["mass"][-1]), float(ledger["escaped_mass"][-1])
    share = escaped / (mass + escaped) if mass + escaped != 0.0 else 0.0  # no mass has started
    of_bed = _volumes(member, share, reach, inflow) if CHANGE in member.held() else {}
    return {
        "runout_distance": distance,
        "reach_angle_deg": math.degrees(angle),
        "reached_area": float(reached.sum()) * reach.cell_area / 1e6,
        "highest_speed": float(np.nanmax(maps["max_speed"])),
        "deposit_volume": float(deposit.sum(dtype=np.float64)) * reach.cell_area,
        "escaped_fraction": 100.0 * share,
        "end_time": float(ledger["time"][-1]),
        **of_bed,
    }


def _volumes(member: "MemberMaps | StackedMember", escaped: float, reach: Reach, inflow: float) -> dict[str, float]:
    """Values of :data:`VOLUMES` [m3] for a member of which the share ``escaped`` [1] of all mass left the raster.

    The change of elevation is the deposit less release and eroded depth: so the release is what they leave.
    """
    eroded, change, deposit = (
        np.nan_to_num(member.within(name, reach.part)).astype(np.float64) * reach.cell_area
        for name in (ERODED, CHANGE, QUANTITIES[DEPOSIT].member_map)
    )
    released = float((deposit - change - eroded).sum()) + inflow
    return {
        "released_volume": released,
        "eroded_volume": float(eroded.sum()),
        "whole_deposit_volume": float(deposit.sum()),
        "left_volume": escaped * (released + float(eroded.sum())),
        "lowered_volume": float(np.maximum(-change, 0.0).sum()),
        "raised_volume": float(np.maximum(change, 0.0).sum()),
    }


def has_volumes(members: "pd.DataFrame") -> bool:
    """Whether the valid members have an erodible bed."""
    return "eroded_volume" in members and bool(members["eroded_volume"].notna().any())


def percentiles_of(members: "pd.DataFrame", figure: str) -> tuple[float, float, float]:
    """Percentiles 5, 50 and 95 of a figure over the valid members, by weight."""
    known = members[members[figure].notna()]
    weights = known["weight"].to_numpy(np.float64)
    low, middle, high = weighted_percentiles(known[[figure]].to_numpy(np.float64), weights / weights.sum(), (5.0, 50.0, 95.0))
    return float(low[0]), float(middle[0]), float(high[0])
