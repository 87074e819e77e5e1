"""Forces on structures in the report: tables by facade and by dam, and force against time."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from runout.forecast.accuracy import FEWEST_MEASURED, expected_errors
from runout.report.chart import Chart
from runout.report.figures import TIME
from runout.report.wording import digits_within, number, number_within, percent, volume
from runout.simulation.structure_forces import AXES, SERIES

if TYPE_CHECKING:
    import xarray as xr

LINES = ("#1f7fa3", "#c98b4b", "#5e8c61", "#8f3b3b", "#7b5ea7", "#7a5c3e", "#b0568b", "#8a939d")  # colours of structures
KILO = 1e3
LEAST_SHARE = 1e-3  # of the largest volume behind a dam; less is printed as 0
ROUNDED = (
    "Loads, times and volumes are rounded to the digits that a numerical error of {error} leaves ({of}); the error of single "
    "facades is not measured."
)


@dataclass(frozen=True)
class Loads:
    """Forces on structures: the content of ``structures.nc``, with the series of one member."""

    over: "xr.Dataset"  # maxima and what follows from them over the members
    series: "xr.Dataset"  # forces (record, facade) of the member ``chosen`` against ``record_time``
    chosen: int  # its number


def read_loads(path: Path, chosen: int) -> Loads | None:
    """The forces in a results folder; None without structures."""
    import xarray as xr

    from runout.io import netcdf

    if not path.is_file():
        return None
    with netcdf.reading(path), xr.open_dataset(path, engine="netcdf4", decode_timedelta=False) as file:
        stacks = ["record_time", *SERIES]
        series = file[[*stacks, "structure_name"]].sel(realization=chosen).load()
        return Loads(file.drop_vars(stacks).load(), series.isel(record=np.isfinite(series["record_time"].values)), chosen)


@dataclass(frozen=True)
class LoadError:
    """Relative numerical error by which loads are rounded."""

    share: float | None  # [1]; None where it is not known
    statement: str  # sentence on the rounding

    @classmethod
    def of(cls, convergence: Mapping[str, Any] | None, cells: float) -> "LoadError":
        """Error of the pressure map of a site where it was measured; else that expected of the thickness map of its grid.

        Parameters
        ----------
        convergence : mapping or None
            Content of ``convergence.json``.
        cells : float
            Cells through the mean thickness of the release.
        """
        fields = (convergence or {}).get("fields", [])
        measured = next((one for one in fields if one.get("map") == "pressure" and "error_over_difference" in one), None)
        if measured is not None:
            share = float(measured["relative_l1"]) * float(measured["error_over_difference"])
            return cls(share, ROUNDED.format(error=percent(share), of="measured for the pressure map of this site"))
        if cells < FEWEST_MEASURED:
            return cls(None, "Loads have one digit, since the numerical error of so few cells through the release is not known.")
        share = expected_errors(cells)[0]
        return cls(share, ROUNDED.format(error=percent(share), of="expected for the thickness map of this grid"))


def structure_section(loads: Loads | None, error: LoadError) -> dict[str, Any] | None:
    """Content of the section, with loads rounded to the digits that an error leaves; None without structures."""
    if loads is None:
        return None
    over = loads.over
    reached = np.flatnonzero(over["max_facade_force"].max("realization").values > 0)
    return {
        "headings": _headings(over),
        "rows": [_row(over.isel(facade=k), error.share) for k in reached],
        "rounding": error.statement,
        "untouched": over.sizes["facade"] - len(reached),
        "dams": _dams(over, error.share),
        "chosen": loads.chosen,
        "figure": force_chart(loads) if len(reached) else None,
    }


def _headings(over: "xr.Dataset") -> list[tuple[str, str]]:
    """Heading and unit of each column."""
    middle = [(f"Force, {p:g} %", "kN") for p in over["percentile"].values]
    chance = [(f"P(pressure ≥ {number(t / KILO)})", "kPa") for t in over["pressure_threshold"].values]
    largest = [("Force, largest", "kN"), ("at", "s"), ("Moment", "kN m"), ("Pressure, mean", "kPa"), ("95 % of area", "kPa")]
    return [("Structure", ""), ("Facade", ""), ("Area", "m²"), *middle, *largest, *chance]


def _row(facade: "xr.Dataset", error: float | None) -> list[str]:
    """Cells of a facade; loads and times with the digits that a relative error leaves."""
    force = facade["max_facade_force"].fillna(-1.0).values
    when = float(facade["time_of_max_facade_force"].values[force.argmax()])
    largest = [float(facade[f"max_facade_{name}"].max()) / KILO for name in ("moment", "pressure", "high_pressure")]
    return [
        str(facade["structure_name"].values),
        str(facade["facade_name"].values),
        number(float(facade["facade_area"])),
        *(number_within(float(v) / KILO, error) for v in facade["facade_force_at_percentile"].values),
        number_within(float(force.max()) / KILO, error),
        number_within(when, error),
        *(number_within(value, error) for value in largest),
        *(percent(float(p)) for p in facade["facade_pressure_probability"].values),
    ]


def _dams(over: "xr.Dataset", error: float | None) -> list[tuple[str, str]]:
    """Sentence on the volume behind each dam, with the digits that a relative error leaves."""
    if "protected_area" not in over:
        return []
    found = []
    for k, name in enumerate(over["protected_area"].values):
        volumes = over["overtopping_volume_at_percentile"].values[:, k]
        most = float(over["overtopping_volume"].values[:, k].max())
        volumes = np.where(volumes < LEAST_SHARE * most, 0.0, volumes)
        parts = [f"{p:g} %: {_volume(float(v), error)}" for p, v in zip(over["percentile"].values, volumes, strict=True)]
        largest = _volume(most, error)
        chance = percent(float(over["overtopping_probability"].values[k]))
        by_percentile = f"volume behind it at the end by percentile, {', '.join(parts)}"
        found.append((str(name), f"probability {chance}; {by_percentile}; most {largest}"))
    return found


def _volume(value: float, error: float | None) -> str:
    return volume(value, digits_within(value, error))


def force_chart(loads: Loads) -> Markup:
    """Force on each structure, all its facades together, against time: the member of the series."""
    time, forces = loads.series["record_time"].values, forces_over_time(loads)
    most = max((float(force.max()) for force in forces.values()), default=1.0)
    chart = Chart(TIME, "force [kN]", (0.0, float(time[-1]) if len(time) else 1.0), (0.0, 1.05 * most))
    for (name, force), colour in zip(forces.items(), LINES, strict=False):
        chart.line(time, force, colour, name)
    return chart.svg("Force on structures over time")


def forces_over_time(loads: Loads) -> dict[str, np.ndarray]:
    """Force [kN] (time,) on the structures that are reached, all facades together, the largest first and eight at most."""
    owners = loads.series["structure_name"].values.astype(str)
    forces = np.stack([loads.series[f"facade_force_{axis}"].values for axis in AXES], axis=-1)
    sums = {name: np.linalg.norm(forces[:, owners == name].sum(1), axis=1) / KILO for name in dict.fromkeys(owners)}
    reached = [name for name in sums if sums[name].max(initial=0.0) > 0]
    return {name: sums[name] for name in sorted(reached, key=lambda name: -float(sums[name].max()))[: len(LINES)]}
