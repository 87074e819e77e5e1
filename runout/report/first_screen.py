"""Sentences of the first screen of a report: what was assumed, what the flow reaches, what the maps do not support, questions."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from shlex import quote
from typing import Any

import numpy as np

from runout.config.process_ranges import published_friction
from runout.hazard.danger import scheme_record
from runout.report import tables
from runout.report.figures import parameter_label
from runout.report.study import Study
from runout.report.wording import area, number, percent, quantity, span, volume

OF_FRICTION = re.compile(r"(.+\.)?basal_")  # names of sampled parameters of the law of friction, of all releases or of one
VOLUME, DISCHARGE = "release_volume_factor", "discharge_factor"
POSTERIOR = "posterior.csv"  # rows of `runout calibrate`
LAPTOP = "The check forecasts it for the machine that it runs on."
NO_STRUCTURES = (
    "No structures are in site.yaml; with the block structures, facades have loads. Pressure of the undisturbed flow is a layer of "
    "the map, and this command writes it at the points of a layer."
)
DOUBLED = "This command runs both, on cells that fit into five minutes, and shows them on one map."
MOST_NAMES, MOST_PARTS = 6, 3  # places of a sentence that as many members reach, and groups of them


@dataclass(frozen=True)
class Answer:
    """Answer to a question of a decision maker."""

    # question, text: question, and answer in words
    question: str
    text: str
    # place, words: section of the report with the answer, and its name; empty without
    place: str = ""
    words: str = ""
    command: str = ""  # command with the name of the site that gives the answer; empty without


def assumed(study: Study, settings: Mapping[str, Any]) -> str:
    """Sentence on the assumptions: released volume, friction with its source, pore pressure, erodible bed, and rates."""
    wet = _wet_masses(settings)
    pores = f"pore pressure in {', '.join(wet)}" if wet else ""
    parts = [part for part in (_released(study), friction(study, settings), pores, _bed(settings)) if part]
    rates = re.sub(r"\d+\.\d+(e-\d+)?", lambda rate: number(float(rate[0])), study.hazard.attrs.get("scenarios", ""))
    parts.append(f"scenarios with the rates of site.yaml ({rates})" if rates else "no annual rates")
    return f"Assumed: {'; '.join(parts)}."


def _released(study: Study) -> str:
    """Volume of releases and inflows, with the range of their factors."""
    parts, inflows = [], study.run.get("inflows", [])
    released = tables.hazard_volume(study.hazard["release_thickness"], study.hazard)
    if released > 0 or not inflows:
        parts.append(f"{volume(released)} released{_times(study, VOLUME)}")
    if inflows:
        parts.append(f"{volume(sum(one['volume'] for one in inflows))} of inflow{_times(study, DISCHARGE)}")
    return " and ".join(parts)


def _wet_masses(settings: Mapping[str, Any]) -> list[str]:
    """Names of the releases and inflows with a pore pressure; with them the bed, if it is wet: dry mass takes up dry mass."""
    masses = [one for block in ("release", "inflow") for one in settings.get(block) or []]
    wet = [f"{one.get('name') or 'the mass'}" for one in masses if one.get("pore_pressure")]
    return [*wet, "the bed"] if wet and (settings.get("bed") or {}).get("pore_pressure") else wet


def _bed(settings: Mapping[str, Any]) -> str:
    """The erodible bed, if there is one; its depth if that is one number."""
    bed = settings.get("bed")
    if not isinstance(bed, Mapping):
        return ""
    depth, erosion = bed.get("depth"), bed.get("erosion")
    deep = f" of {quantity(depth, 'm')}" if isinstance(depth, (int, float)) else ""
    law = erosion.get("law") if isinstance(erosion, Mapping) else None
    return f"an erodible bed{deep}" + (f", law {law}" if law else "")


def _times(study: Study, factor: str) -> str:
    words = tables.factor_in_words(study, factor)
    return f"{',' if factor in study.members else ''} {words}" if words else ""


def friction(study: Study, settings: Mapping[str, Any]) -> str:
    """Friction of the members and where it comes from."""
    sampled = [name for name in tables.sampled_parameters(study) if "friction" in name or OF_FRICTION.match(name)]
    if not sampled:
        angle, block = settings.get("basal_friction_angle_deg"), settings.get("basal_friction")
        law = block.get("law") if isinstance(block, Mapping) else ""
        fixed = f"basal friction angle {quantity(angle, 'degree')}" if angle is not None else f"basal friction by {law or 'law'}"
        return f"{fixed}{'' if study.is_single else ' in every member'}, stated in site.yaml and not calibrated"
    ranges = [_range(study, name) for name in sampled]
    drawn = "drawn from " if study.is_single and not settings.get("ensemble", {}).get("table") else ""
    return f"{', '.join(ranges)}, {drawn}{origin(settings)}"


def _range(study: Study, name: str) -> str:
    label, _, units = parameter_label(name).partition(" [")
    return f"{label} {span(list(study.members[name].astype(float)), units.rstrip(']'))}"


def origin(settings: Mapping[str, Any]) -> str:
    """Where the sampled parameters come from."""
    table = settings.get("ensemble", {}).get("table")
    if not table:
        return "a range stated in site.yaml, not calibrated"
    name = str(table.get("path", table) if isinstance(table, Mapping) else table)
    if name.endswith(POSTERIOR):
        return f"calibrated against the observations of the site ({name})"
    return f"taken from the table {name}"


def outcome(study: Study) -> str:
    """Sentence on what the flow reaches: area at the threshold of the maps, run-out, structures and points."""
    if not len(study.valid):
        return "No member is valid, so nothing is known of what the flow reaches."
    limit, hazard = quantity(study.threshold, "m"), study.hazard
    half = tables.hazard_extent(hazard, hazard["inundation_probability"].values, 0.5)
    ever = tables.hazard_extent(hazard, hazard["members_reached"].values, 1)
    runout = span(list(study.valid["runout_distance"].astype(float)), "m")
    start = tables.start_of(study)
    some = "" if study.is_single else f"{area(half)} in at least half of the members (by weight) and "
    parts = [
        f"A flow of {limit} or more reaches {some}{area(ever)}{' in any' if some else ''}, {runout} in plan beyond the {start}"
    ]
    by_share: dict[str, list[str]] = {}
    for name, share in _places(study):
        by_share.setdefault("" if study.is_single else f" in {percent(share)} of the members", []).append(name)
    parts += [f"it arrives at {_listed(names)}{share}" for share, names in by_share.items()]
    return "; ".join(parts[: MOST_PARTS + 1]) + ("; further places are below." if len(parts) > MOST_PARTS + 1 else ".")


def _listed(names: list[str]) -> str:
    """Names in words, the first ones of many."""
    if len(names) > MOST_NAMES:
        return f"{', '.join(names[:MOST_NAMES])} and {len(names) - MOST_NAMES} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _places(study: Study) -> list[tuple[str, float]]:
    """Structures, points and cross-sections that the flow reaches, with the share of the members; the most frequent first."""
    shares = [*_structures(study)]
    for dataset in study.probes.values():
        if "arrival_probability" in dataset:
            shares += zip(dataset["station_name"].values, dataset["arrival_probability"].values, strict=True)
    return sorted(((str(name), float(share)) for name, share in shares if share > 0), key=lambda pair: -pair[1])


def _structures(study: Study) -> Iterator[tuple[str, float]]:
    """Structures with the share of the members that touch them."""
    if study.loads is None:
        return
    over = study.loads.over
    weights = study.members["weight"].reindex(over["realization"].values).fillna(0.0).to_numpy(float)
    touched, owners = over["max_facade_force"].fillna(0.0).values > 0, over["structure_name"].values.astype(str)
    axis = over["max_facade_force"].dims.index("facade")
    for name in dict.fromkeys(owners):
        members = np.compress(owners == name, touched, axis).any(axis)
        yield name, float(weights[members].sum() / weights.sum())


def unsupported(study: Study, settings: Mapping[str, Any]) -> list[str]:
    """Short sentences on what the maps do not support, from the settings of the study."""
    return [
        _no_rate(study),
        _no_other_release(study),
        _grid(study, settings),
        _no_colour(study),
        _no_damage(study),
        *_no_place(study),
    ]


def _no_rate(study: Study) -> str:
    if "scenarios" in study.hazard.attrs:
        return "No events beyond the scenarios: annual maps add up the rates of site.yaml and are as good as these."
    return "No annual probability: the maps hold if the release happens. Its frequency is not in them."


def _no_other_release(study: Study) -> str:
    factor = next((name for name in (VOLUME, DISCHARGE) if name in study.members), None)
    if factor is None or study.members[factor].nunique() < 2:
        return "No other release: one volume on one outline was simulated, not a larger failure and none elsewhere."
    return (
        "No other release: volumes differ by the factor above on the outlines of site.yaml; a failure elsewhere is not in the maps."
    )


def _grid(study: Study, settings: Mapping[str, Any]) -> str:
    size = quantity(float(np.ravel(settings["simulation"]["cell_size"])[0]), "m")
    resolution = tables.depth_resolution(study)
    least, width = resolution.get("least_thickness", 0.0), resolution.get("smallest_feature", 0.0)
    detail = f", such as features narrower than {quantity(width, 'm', 2)}" if width else ""
    thin = ""
    if least > study.threshold:
        shown = quantity(least, "m", 2)
        thin = f" The grid shows no flow thinner than {shown}: {quantity(study.threshold, 'm')} or more means {shown} or more."
    return f"No detail below the grid: cells of {size} do not resolve houses, walls and culverts{detail}.{thin}"


def _no_colour(study: Study) -> str:
    count = len(study.valid)
    members = "the one simulation" if count == 1 else f"none of {count} simulations"
    does = "does not reach" if count == 1 else "reaches"
    return f"No proof of safety: where a map has no colour, {members} {does} the place. Rarer events may."


def _no_damage(study: Study) -> str:
    if study.loads is not None:
        return "No damage: loads are those on rigid bodies as they are drawn; they do not say which building fails."
    return "No damage to single buildings: pressure is that of the flow as if no building stood there."


def _no_place(study: Study) -> Iterator[str]:
    if "crs" not in study.hazard:
        yield "No place on other maps: the coordinates are local, without a reference system."


def questions(study: Study, settings: Mapping[str, Any], sure: str) -> list[Answer]:
    """Ten questions of a decision maker, each with the place of its answer or the command that gives it."""
    site = quote(str(settings["name"]))
    grid = f"Cells are now {_cells(settings)}. The check lists grids that fit into a time, with the error of each."
    return [
        _class(study),
        _period(study),
        _buildings(study, site),
        _doubled(study, settings, site),
        Answer("How sure is the run-out?", sure or "Nothing is known: no member has run out.", "sure" if sure else "", "How sure"),
        Answer("Which friction, and why?", f"{_start(friction(study, settings))}.{_published(settings)}", "settings", "Settings"),
        _calibrated(study, settings, site),
        _water(study, settings),
        Answer("How long does a run take on a laptop?", LAPTOP, command=f"runout check {site}"),
        Answer("What is the finest grid in 30 minutes?", grid, command=f"runout check {site} --budget 30min"),
    ]


def _published(settings: Mapping[str, Any]) -> str:
    """Sentence on the sources of the sampled ranges of friction that are published ones of a process, with a space before it."""
    title, ranges = published_friction(settings.get("ensemble", {}).get("parameters") or {})
    sources = [_start(f"{parameter_label(r.key).partition(' [')[0]}: {r.words()}.") for r in ranges]
    return " ".join(["", f"The ranges are those published for other events ({title}).", *sources]) if ranges else ""


def _start(text: str) -> str:
    return text[:1].upper() + text[1:]


def _cells(settings: Mapping[str, Any]) -> str:
    return " by ".join(quantity(float(size), "m") for size in np.ravel(settings["simulation"]["cell_size"]))


def _class(study: Study) -> Answer:
    record, question = scheme_record(study.hazard), "Which danger class is a place in?"
    if record is None:
        text = "None is mapped: a scheme needs scenarios with rates. Set hazard.scheme; this command lists the schemes."
        return Answer(question, text, command="runout schemes")
    return Answer(question, f"Classes by {record['title']}.", "danger", "Map of the classes")


def _period(study: Study) -> Answer:
    question = "What is its return period?"
    if "scenarios" not in study.hazard.attrs:
        return Answer(question, "Not known. State ensemble.scenarios with return periods in site.yaml.", "limits", "Why")
    years = ", ".join(number(float(one), 6) for one in study.hazard["return_period"].values)
    return Answer(question, f"The map has annual rates, and values at return periods of {years} years.", "maps", "Map")


def _buildings(study: Study, site: str) -> Answer:
    question = "Which buildings are reached, with which pressure?"
    if study.loads is None:
        return Answer(question, NO_STRUCTURES, "maps", "Map", f"runout probe {site} --points points.gpkg")
    reached = "; ".join(f"{name} in {percent(share)} of the members" for name, share in _structures(study) if share > 0)
    untouched = [name for name, share in _structures(study) if share == 0]
    none = f"No member reaches {_listed(untouched)}" if untouched else ""
    answer = ". ".join(_start(part) for part in (reached, none) if part)
    return Answer(question, f"{answer}.", "structures", "Forces and pressures")


def _doubled(study: Study, settings: Mapping[str, Any], site: str) -> Answer:
    question = "What if twice as much is released?"
    factor = DISCHARGE if not settings.get("release") else VOLUME
    if settings.get("ensemble", {}).get("scenarios"):
        return Answer(
            question, f"The volumes belong to the scenarios: add one to ensemble.scenarios with {factor}: 2 and its rate."
        )
    if settings.get("ensemble", {}).get("table"):
        return Answer(question, f"The table of members states the volumes: add rows with {factor} of 2.")
    known = f"The members have {_range(study, factor)}. " if factor in study.members else "Not in these maps. "
    return Answer(question, known + DOUBLED, command=f"runout what-if {site} {factor}=1,2")


def _calibrated(study: Study, settings: Mapping[str, Any], site: str) -> Answer:
    question, where = "Is it calibrated, and how?", origin(settings)
    if not tables.sampled_parameters(study):
        text = "No: no parameter is sampled. Sample friction under ensemble.parameters; this command then fits it to observations."
        return Answer(question, text, command=f"runout calibrate {site}")
    if where.startswith("calibrated"):
        return Answer(question, f"{_start(where)}; calibration.json beside it has errors and limits.", "observations", "Scores")
    if settings.get("observations"):
        text = f"No: {where}. The scores compare it with the observations; this command fits the sampled parameters to them."
        return Answer(question, text, "observations", "Scores", f"runout calibrate {site}")
    return Answer(
        question, f"No: {where}. Calibration needs observations of an event in site.yaml.", command=f"runout calibrate {site}"
    )


def _water(study: Study, settings: Mapping[str, Any]) -> Answer:
    question = "Does water play a role?"
    sampled = [_range(study, name) for name in tables.sampled_parameters(study) if "pore_pressure" in name]
    wet = _wet_masses(settings)
    if not wet and (settings.get("bed") or {}).get("pore_pressure"):
        text = "Not by itself: the bed is wet, but what joins a dry mass is dry. State pore_pressure of the release or inflow."
        return Answer(question, text, "settings", "Settings")
    if wet or sampled:
        parts = [f"in {', '.join(wet)}"] if wet else []
        return Answer(question, f"Yes: pore pressure {'; '.join(parts + sampled)}.", "settings", "Settings")
    return Answer(question, "Not by itself: no pore pressure is set, so water acts only through the friction that was chosen.")
