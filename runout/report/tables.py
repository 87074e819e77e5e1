"""Tables of the report as text: key figures, warnings, members, balances, settings and provenance."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.friction import OF_RELEASE
from runout.config.parameter_variables import parameter_variable
from runout.config.scenarios import FAILS
from runout.forecast.accuracy import BOUNDS, EXPECTED, error_statement
from runout.forecast.numerical_error import statements
from runout.forecast.stiffness import sentence_of
from runout.hazard.figures import FIGURES, VOLUMES, Ledger, has_volumes, percentiles_of
from runout.model.depth_resolution import WORST, DepthResolution
from runout.quantities import ALL_QUANTITIES, QUANTITIES
from runout.report.figures import parameter_label, released_energy
from runout.report.study import Study
from runout.report.wording import UNKNOWN, area, number, percent, quantity, span, unit, volume
from runout.scores.members import BOOKKEEPING
from runout.terrain.roughness import Roughness
from runout.variables import VARIABLES

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

# entries of run.json that the report prints in another place
ELSEWHERE = (
    *("inputs", "configuration", "ensemble", "products", "changes", "metadata", "observations", "releases", "inflows"),
    *("resolution", "relief", "stiffness"),
)
ABBREVIATIONS = {
    "crs": "CRS",
    "dem": "DEM",
    "cfl": "CFL number",
    "runout": "Version of runout",
    "configuration sha256": "SHA-256 of the configuration",
    "sha256": "SHA-256",
    "url": "URL",
}
SETTING_UNITS = {
    "cell_size": "m",
    "smoothing": "m",
    "end_time": "s",
    "arrival_threshold": "m",
    "thickness": "m",
    "volume": "m3",
    "youngs_modulus": "Pa",
    "density": "kg m-3",
    "cohesion": "Pa",
    **{q.setting: VARIABLES[q.threshold].printed[0] for q in ALL_QUANTITIES.values()},
    **{q.name: q.units for q in ALL_QUANTITIES.values()},
    "percentiles": "%",
    "hours": "h",
}
LARGEST_RESIDUAL = 0.01  # of the released potential energy
ESCAPED_PERCENT = 0.1
RELEASED = "Released volume"


def sampled_parameters(study: Study) -> list[str]:
    """Names of the sampled parameters; which releases fail is told by the scenario."""
    others = {*BOOKKEEPING, *FIGURES, *VOLUMES}
    return [c for c in study.members.columns if c not in others and not str(c).endswith(OF_RELEASE + FAILS)]


def sensitivity(record: Mapping[str, Any]) -> dict[str, Any] | None:
    """Table of total Sobol indices: titles of the quantities, a row for each parameter, and what was refused; None without."""
    if not record:
        return None
    quantities = list(record["quantities"].values())
    rows = []
    for name in quantities[0]["parameters"]:
        of_parameter = [one["parameters"][name] for one in quantities]
        cells = ["{:.2f} ({:.2f} to {:.2f})".format(values["total"], *values["total_5_95"]) for values in of_parameter]
        rows.append((parameter_variable(name).long_name, cells))
    return {"titles": [one["title"] for one in quantities], "rows": rows, "refused": list(record["refused"].items())}


def key_figures(study: Study) -> list[tuple[str, str, str]]:
    """Key figures of the report: label, value, remark. All areas and distances are those of one threshold of thickness."""
    hazard, valid = study.hazard, study.valid
    released, inflows = hazard_volume(hazard["release_thickness"], hazard), study.run.get("inflows", [])
    limit = f"{quantity(study.threshold, 'm')} thick or more"
    likely, half = hazard_extent(hazard, hazard["inundation_probability"].values, 0.5), "half of the members (by weight) reach it"
    runouts, angles = (list(valid.get(name, [])) for name in ("runout_distance", "reach_angle_deg"))
    reached = area(hazard_extent(hazard, hazard["members_reached"].values, 1))
    starts = [(RELEASED, released, "release_volume_factor")] if released > 0 or not inflows else []
    starts += [("Inflow volume", sum(one["volume"] for one in inflows), "discharge_factor")] if inflows else []
    annual = [
        (f"Area reached once in {years:g} years or more often", area(_area_at(hazard, study.threshold, years)), limit)
        for years in (hazard["return_period"].values if "return_period" in hazard.coords else ())
    ]
    cards = [
        (
            "Simulations in the maps",
            f"{len(valid)} of {len(study.members)}",
            "each is one complete 3D run, a member of the ensemble",
        ),
        *((label, volume(size), factor_in_words(study, name)) for label, size, name in starts),
        (
            "Run-out" if study.is_single else "Run-out of the members",
            span(runouts, "m"),
            f"plan distance from the {start_of(study)} to the farthest cell, {limit}",
        ),
        ("Angle of reach", span(angles, "°"), f"from the highest point of the {start_of(study)} to that cell"),
        ("Area reached" if study.is_single else "Area reached by any member", reached, limit),
        *([] if study.is_single else [("Area of probability 0.5 or more", area(likely), f"{half}, {limit}{_sampled(hazard)}")]),
        *annual,
    ]
    if not has_volumes(valid):
        return cards
    return [*(card for card in cards if card[0] != RELEASED), *volumes(valid)]


def start_of(study: Study) -> str:
    """Where the mass comes from: the release, or the inflow where no member has a release."""
    return "inflow" if study.run.get("inflows") and not float(study.hazard["release_thickness"].sum()) > 0.0 else "release"


def hazard_extent(hazard: "xr.Dataset", values: Any, least: float) -> float:
    """Area [km2] of the cells with at least ``least``."""
    return float(np.nansum(np.asarray(values) >= least)) * _cell_area(hazard) / 1e6


def volumes(valid: "pd.DataFrame") -> list[tuple[str, str, str]]:
    """Key figures of an erodible bed: label, median of the members, and remark with their 90 % range; of one member its own."""
    cards = []
    for figure, column in VOLUMES.items():
        low, middle, high = percentiles_of(valid, figure)
        ends = number(low), quantity(high, "m³")
        scope = f"{ends[0]} to {ends[1]}" if ends[1] != quantity(low, "m³") else "the same"
        median, members = (", median", f"; {scope} in 90 % of the members") if len(valid) > 1 else ("", "")
        cards.append((f"{column.heading}{median}", quantity(middle, "m³"), f"{VARIABLES[figure].long_name}{members}"))
    return cards


def _area_at(hazard: "xr.Dataset", threshold: float, years: float) -> float:
    """Area [km2] of the cells that reach a threshold of thickness [m] at a return period."""
    values = hazard[QUANTITIES["thickness"].at_return_period].sel(return_period=years).values
    return hazard_extent(hazard, values, threshold)


def factor_in_words(study: Study, name: str) -> str:
    """By what a volume differs between the members; empty for that of a single member without a factor."""
    factor = study.members.get(name)
    if factor is None:
        return "" if study.is_single else "in every member"
    return f"times {span(list(factor.fillna(1.0)))}" + ("" if study.is_single else " in the members")


def _sampled(hazard: "xr.Dataset") -> str:
    """Standard error of the area of probability 0.5 or more: half the area between the outlines of P + s and P - s."""
    lowest = {"thickness_threshold": float(hazard["thickness_threshold"].values.min())}
    error = hazard["thickness_exceedance_standard_error"].sel(lowest).values
    p = hazard["thickness_exceedance_probability"].sel(lowest).values
    band = hazard_extent(hazard, p + error, 0.5) - hazard_extent(hazard, p - error, 0.5)
    return f"; standard error from the number of members {area(band / 2)}"


def heading(study: Study) -> list[tuple[str, str]]:
    """Author, date, version and purpose of the study as labels and values; items that are not stated are left out."""
    entries = study.run.get("metadata", {})
    author = ", ".join(entries[key] for key in ("author", "institution", "email") if key in entries)
    created, version = study.run.get("created", ""), study.run.get("runout", "")
    when = created.replace("T", " ").replace("+00:00", " UTC") + (f", runout {version}" if version else "")
    lines = [("Made by", author), ("Date", when), ("Project", entries.get("project", "")), ("Purpose", entries.get("purpose", ""))]
    return [(words, value) for words, value in lines if value]


def hazard_volume(thickness: "xr.DataArray", hazard: "xr.Dataset") -> float:
    """Volume [m3] of a thickness map."""
    return float(np.nansum(thickness.values)) * _cell_area(hazard)


def _cell_area(hazard: "xr.Dataset") -> float:
    x, y = hazard["x"].values, hazard["y"].values
    return abs(float(x[1] - x[0]) * float(y[1] - y[0]))


def warnings(study: Study, settings: dict[str, Any]) -> list[str]:
    """Warnings for readers of the maps, one sentence each."""
    of_the_grid = [*_coarse(study), *_thin(study), *_oscillating(study), *_unclosed(study)]
    return [*_incomplete(study), *_lost_mass(study), *_never_released(study), *_unfinished(study, settings), *of_the_grid]


def _incomplete(study: Study) -> list[str]:
    missing = len(study.members) - len(study.valid)
    if not missing:
        return []
    share = 1.0 - float(study.valid["weight"].sum()) / float(study.members["weight"].sum())
    return [
        f"{_count(missing)} of {len(study.members)} {_are(missing)} not in the maps ({percent(share)} of the weight); "
        "the table of members says why. If they failed for a physical reason, e.g. the largest volumes, the maps are biased."
    ]


def _lost_mass(study: Study) -> list[str]:
    lost = study.valid[study.valid["escaped_fraction"] > ESCAPED_PERCENT] if len(study.valid) else study.valid
    if not len(lost):
        return []
    return [
        f"In {_count(len(lost))} mass left the elevation raster (up to {number(lost['escaped_fraction'].max())} %)"
        f"{_open_cells(study)}; beyond the edge the runout is not known. Use a larger raster."
    ]


def _never_released(study: Study) -> list[str]:
    """Members in which a release waited for the flow of another until the end."""
    shares = [
        float(ledger["waiting_mass"][-1] / (ledger["waiting_mass"][-1] + ledger["mass"][-1] + ledger["escaped_mass"][-1]))
        for ledger in study.ledgers.values()
        if "waiting_mass" in ledger and ledger["waiting_mass"][-1] > 0.0
    ]
    if not shares:
        return []
    return [
        f"In {_count(len(shares))} a release that waits for the flow of another never started (up to {percent(max(shares))} of the "
        "mass): the flow did not arrive, and the maps of these members are without it."
    ]


def _open_cells(study: Study) -> str:
    unknown = int(np.isnan(study.hazard["elevation"].values).sum())
    return f", over its rim or into its {unknown} cells without elevation" if unknown else ""


def _unfinished(study: Study, settings: dict[str, Any]) -> list[str]:
    moving = [m for m, ledger in study.ledgers.items() if _still_moving(ledger)]
    if not moving:
        return []
    end = settings.get("simulation", {}).get("end_time")
    after = f" of {quantity(end, 's')}" if end else ""
    return [
        f"{_count(len(moving))} still moved at the end time{after} (kinetic energy above 1 % of its peak); "
        "the runout may be too short. Raise simulation.end_time."
    ]


def _count(members: int) -> str:
    return "1 member" if members == 1 else f"{members} members"


def _are(members: int) -> str:
    return "is" if members == 1 else "are"


def _still_moving(ledger: Ledger) -> bool:
    kinetic = ledger["kinetic_energy"]
    return bool(kinetic[-1] > 0.01 * kinetic.max())


def _coarse(study: Study) -> list[str]:
    resolution = depth_resolution(study)
    if not resolution or not (coarse := DepthResolution(**resolution).warning()):
        return []
    return [f"The member that is resolved least has {coarse}."]


def _thin(study: Study) -> list[str]:
    """Warning of thresholds of inundation below the least thickness that the maps can show."""
    least = depth_resolution(study).get("least_thickness", 0.0)
    low = [number(float(value)) for value in study.hazard["thickness_threshold"].values if value < least]
    if not low:
        return []
    return [
        f"The least thickness that the grid can show is {quantity(least, 'm', 2)}, since single particles have none; areas and "
        f"probabilities over {' and '.join(low)} m are those over that thickness. Use smaller cells, or larger thresholds."
    ]


def _oscillating(study: Study) -> list[str]:
    """Sentence on a raster that oscillates."""
    relief = Roughness.recorded(study.run.get("relief", {}))
    return [f"{relief.warning()}."] if relief and relief.wave else []


def depth_resolution(study: Study) -> dict[str, float]:
    """Cells through the depth, numerical viscosity [m2/s] and decay time of shear [s] of the member with the fewest cells.

    They are read from ``run.json``; empty if it does not contain all of them.
    """
    resolution = study.run.get("resolution", {})
    return dict(resolution) if set(WORST) <= {*resolution, "smallest_feature", "least_thickness"} else {}


def _unclosed(study: Study) -> list[str]:
    worst = max((energy_residual(ledger) for ledger in study.ledgers.values()), default=0.0)
    if worst <= LARGEST_RESIDUAL:
        return []
    return [
        f"The scheme itself lost up to {percent(worst)} of the released potential energy (numerical dissipation); "
        "the runout is shortened accordingly."
    ]


def energy_residual(ledger: Ledger) -> float:
    """Final energy loss of the scheme as a share of the released potential energy [1]; 0 if the ledger does not contain it."""
    if "numerical_dissipation" not in ledger:
        return 0.0
    released = float(released_energy(ledger).max())
    return abs(float(ledger["numerical_dissipation"][-1])) / released if released > 0 else 0.0


def mass_error(ledger: Ledger) -> float:
    """Largest relative change of the mass on the raster and beyond its edge, less that which entered later or from a bed [1]."""
    whole = ledger["mass"] + ledger["escaped_mass"]
    total = whole - ledger.get("entered_mass", 0.0) - ledger.get("entrained_mass", 0.0)
    return float(np.abs(total - total[0]).max() / (whole.max() or 1.0))


def balance(study: Study) -> dict[str, str]:
    """Largest errors of mass and energy of all members, and the resolution of the grid."""
    ledgers = study.ledgers.values()
    mass = max((mass_error(ledger) for ledger in ledgers), default=math.nan)
    energy = max((energy_residual(ledger) for ledger in ledgers), default=math.nan)
    kept = "exactly" if mass < 1e-15 else f"to {mass:.0e} of the released one"
    return {
        "mass": kept if math.isfinite(mass) else UNKNOWN,
        "energy": percent(energy),
        "resolution": _resolved(depth_resolution(study)),
        "relief": f"{relief.statement()}." if (relief := Roughness.recorded(study.run.get("relief", {}))) else "",
    }


def _resolved(found: dict[str, float]) -> str:
    """Sentence on the resolution; empty if ``run.json`` does not contain it."""
    if not found:
        return ""
    viscosity, time = quantity(found["numerical_viscosity"], "m2 s-1", 2), quantity(found["shear_decay_time"], "s", 2)
    cells, width = number(found["cells_through_depth"], 2), found.get("smallest_feature")
    feature = f" The smallest feature that the maps can show is {quantity(width, 'm', 2)} wide." if width else ""
    least = found.get("least_thickness")
    feature += f" The least thickness that they can show is {quantity(least, 'm', 2)}." if least else ""
    return (
        f"The member that is resolved least has {cells} cells through its depth; there the scheme acts like a viscosity of "
        f"{viscosity}, which stops shear through the depth in {time}.{feature}"
    )


def members(study: Study) -> dict[str, Any]:
    """Table of members: headings with unit and meaning, and rows; rows of failed members state the reason."""
    parameters = sampled_parameters(study)
    weighted = study.members["weight"].nunique() > 1
    headings = [("Member", "", "number of the realization")]
    headings += [("Weight", "", "share of the ensemble")] if weighted else []
    told = {"scenario": ("Scenario", "", ""), "annual_rate": ("Annual rate", "1/a", VARIABLES["annual_rate"].long_name)}
    told = {name: heading for name, heading in told.items() if name in study.members}
    headings += list(told.values())
    headings += [(_heading(p), _unit(p), "sampled parameter") for p in parameters]
    figures = FIGURES | (VOLUMES if has_volumes(study.valid) else {})
    headings += [(c.heading, c.units, VARIABLES[name].long_name) for name, c in figures.items()]
    rows = []
    for member, row in study.members.iterrows():
        given = [number(row["weight"])] if weighted else []
        given += [row[name] if name == "scenario" else number(float(row[name])) for name in told]
        given += [number(float(row[p])) for p in parameters]
        ended = row["status"] == "valid"
        result = [number(float(row[f])) for f in figures] if ended else []
        reason = "" if ended else f"{row['status']}: {row['failure_reason'] or 'it has not run'}"
        rows.append({"member": member, "given": given, "result": result, "reason": reason})
    growth = study.run.get("ensemble", {}).get("growth", "")
    return {
        "headings": headings,
        "rows": rows,
        "given": len(parameters) + len(told) + weighted,
        "figures": len(figures),
        "growth": growth,
    }


def _heading(parameter: str) -> str:
    return parameter_label(parameter).split(" [")[0].capitalize()


def _unit(parameter: str) -> str:
    return unit(parameter_variable(parameter).units)


def settings(resolved: dict[str, Any]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Sections of the configuration, each a list of labels and values."""
    sections = []
    scalars = []
    for key, value in resolved.items():
        if key == "description":  # printed at the head of the page
            continue
        if isinstance(value, dict):
            sections.append((_words(key), _lines(value)))
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            sections += [(f"{_words(key)} {i + 1}: {v.get('name', '')}".rstrip(": "), _lines(v)) for i, v in enumerate(value)]
        elif value not in (None, "", []):
            scalars.append((_words(key), _value(key, value)))
    return [("General", scalars), *sections]


def _lines(section: dict[str, Any], before: str = "") -> list[tuple[str, str]]:
    lines = []
    for key, value in section.items():
        if isinstance(value, dict) and "distribution" in value:
            lines.append((_words(key), _distribution(value)))
        elif isinstance(value, dict):
            lines += _lines(value, "" if key == "parameters" else f"{_words(key)}: ")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [line for i, v in enumerate(value) for line in _lines(v, f"{_words(key)} {i + 1}: ")]
        elif value == []:
            lines.append((before + _words(key), "none"))
        elif value not in (None, "", {}):
            lines.append((before + _words(key), _value(key, value)))
    return lines


def _distribution(value: dict[str, Any]) -> str:
    known = {k: v for k, v in value.items() if k != "distribution" and v is not None}
    return f"{value['distribution']}: " + ", ".join(f"{_words(k).lower()} {_value(k, v)}" for k, v in known.items())


def _words(key: str) -> str:
    words = key.replace("youngs", "Young's").replace("_deg", " [°]").replace("_gb", " [GB]").replace("_", " ")
    return ABBREVIATIONS.get(words, words[:1].upper() + words[1:])


def _value(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return quantity(value, SETTING_UNITS.get(key, "1"), 10)
    divisor = next((VARIABLES[q.threshold].printed[1] for q in ALL_QUANTITIES.values() if q.setting == key), 1.0)
    value = [limit / divisor for limit in value] if divisor != 1.0 else value
    if isinstance(value, list):
        listed = ", ".join(_value("", v) for v in value)
        return f"{listed} {unit(SETTING_UNITS[key])}" if key in SETTING_UNITS else listed
    return str(value)


def provenance(run: dict[str, Any]) -> dict[str, Any]:
    """Inputs with checksums, changes to the inputs, and the other entries of ``run.json``, as lines."""
    inputs = [entry for entry in run.get("inputs", []) if isinstance(entry, dict)]
    rest = {k: v for k, v in run.items() if k not in ELSEWHERE}
    rest |= {"members": run["ensemble"]["statement"]} if "ensemble" in run else {}
    rest |= {"stiffness of the members": sentence_of(run["stiffness"])} if run.get("stiffness") else {}
    rest |= {k: ", ".join(f"{n} {_value('', e)}" for n, e in v.items()) for k, v in rest.items() if isinstance(v, dict)}
    return {"inputs": inputs, "lines": _lines(rest), "changes": run.get("changes", [])}


def numerical_error(study: Study, settings: Mapping[str, Any]) -> str:
    """Sentences on the numerical error: that measured on the site, or else that expected of its grid."""
    if study.convergence is not None:
        size = quantity(study.convergence["levels"][-1]["cell_size"][0], "m")
        said = f"Of the median scenario on cells of {size}, from runs on several grids: {'; '.join(statements(study.convergence))}."
        return f"{said} {BOUNDS}"
    return f"{error_statement(cells_through(study, settings)).capitalize()}. {EXPECTED} {BOUNDS}"


def cells_through(study: Study, settings: Mapping[str, Any]) -> float:
    """Cells of the grid through the mean thickness of the release."""
    masses, inflows = study.run.get("releases", {}).get("masses"), study.run.get("inflows")
    thickness = study.hazard["release_thickness"].values
    if masses:
        mean = sum(one["volume"] for one in masses) / sum(one["area"] for one in masses)
    elif inflows:
        mean = max(one["thickness"] for one in inflows)
    else:
        mean = float(thickness[thickness > 0].mean())  # of runs that recorded no masses
    return mean / float(np.ravel(settings["simulation"]["cell_size"])[-1])


def release_statements(study: Study) -> list[str]:
    """What is stated of each release and each inflow, and what starts together."""
    recorded, inflows = study.run.get("releases", {}), study.run.get("inflows", [])
    together = (f"{said[:1].upper()}{said[1:]}." for said in recorded.get("start", []))
    return [*map(_mass, recorded.get("masses", [])), *map(_inflow, inflows), *together]


def _inflow(one: Mapping[str, Any]) -> str:
    """Sentence on one inflow, as site.yaml states it."""
    times = f"from {one['begin']:g} to {quantity(one['end'], 's')}"
    flow = f"{quantity(one['width'], 'm')} wide, {quantity(one['thickness'], 'm')} thick at most"
    return f"Inflow {one['name']}: {volume(one['volume'])} {times}, at most {quantity(one['peak_discharge'], 'm3 s-1')}, {flow}."


def _mass(one: Mapping[str, Any]) -> str:
    """Sentence on one release."""
    mean, most = (quantity(one[name], "m") for name in ("mean_thickness", "largest_thickness"))
    size = f"{volume(one['volume'])} on {quantity(one['area'], 'm2')}"
    return f"Release {one['name']}: {size}, {mean} thick on average, {most} at most, {one['shape']}."
