"""Reads site.yaml and reports all its problems together, each with line, value and remedy."""

import difflib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from shlex import quote
from typing import Any

from pydantic import ValidationError

from runout.config import bed, inflow, release_start, scheme
from runout.config.design_table import DesignTable, as_stated, read_design
from runout.config.document import Document, Location, read_document, set_values, shortened
from runout.config.friction import ANGLE, KEY, OF_RELEASE, PREFIX, sampled_ranges, stated_law
from runout.config.hazard import without_a_bed
from runout.config.law_block import in_keys
from runout.config.material import foreign_parameters, known_law
from runout.config.member_arguments import member_ranges
from runout.config.pore_pressure import ratio_conflicts, unused_samples
from runout.config.problems import problems_of
from runout.config.release_laws import OwnLaws, idle_parameters, laws_of, names_law, own_ranges, stated_laws, unknown_own
from runout.config.scenarios import FAILS, scenario_conflicts, with_fixed
from runout.config.schema import (
    SAMPLE_DEMS,
    SiteSettings,
    accuracy_conflicts,
    device_conflicts,
    friction_conflicts,
    mass_conflicts,
    release_conflicts,
    zone_conflicts,
)
from runout.config.site_files import named_inputs
from runout.config.structures import repeated_structures, structure_conflicts
from runout.config.wording import choice_fix
from runout.errors import ConfigError, InputError, Problem
from runout.io.boundary import exists, kind_of, names_in
from runout.io.georeference import file_named_by
from runout.io.references import file_in
from runout.model.friction_laws import DEFAULT_FRICTION

FILE_NAME = "site.yaml"
MOST_NAMES, LONGEST_NAME = 1000, 255  # names of a folder that are compared with a missing one; characters of a name


def load(path: Path | str, changes: Sequence[str] = ()) -> SiteSettings:
    """Settings of a site.yaml (or of the folder that holds one), with ``changes`` of the command line.

    Raises ConfigError with all problems of the file: YAML syntax, unknown, repeated or missing keys, wrong types, values out of
    range, keys that contradict each other, input files that do not exist.
    """
    file = site_file(path)
    return checked(changed_document(file, changes), file.parent)


def changed_document(file: Path, changes: Sequence[str] = ()) -> Document:
    """Content of a site.yaml with ``changes`` of the command line, each ``KEY=VALUE`` (:mod:`runout.config.document`)."""
    document = read_document(file)
    set_values(document, changes)
    return document


def checked(document: Document, folder: Path) -> SiteSettings:
    """Settings of a document whose inputs lie in a folder; errors as of :func:`load`."""
    problems = list(document.problems)
    settings = None
    if isinstance(document.values, dict):
        try:
            laws: dict[str, Any] = {"law": known_law(document.value(("material",))), "friction": stated_law(document.values)}
            laws["erosion"] = bed.stated_law(document.values)
            laws["own"] = own_ranges(stated_laws(document.values)) | release_start.stated_ranges(document.values)
            settings = SiteSettings.model_validate(document.values, context=laws)
        except ValidationError as error:
            problems += problems_of(error, document)
        problems += [*_contradictions(document), *_unusable_files(document, folder), *_coordinate_system(document)]
        problems += scheme.site_problems(document, folder)
        if settings and not problems:
            problems += [*_unfit_releases(document, settings), *_unfit_scenarios(document, settings)]
        if settings and not problems:
            settings, unfit = _with_table(document, settings, folder)
            problems += [*unfit, *_without_rates(document, settings if not unfit else None)]
        told = {problem.key for problem in document.problems}
        problems = document.problems + [problem for problem in problems if problem.key not in told]
    elif not problems:
        what = "is empty" if document.values is None else "holds no `key: value` lines"
        problems.append(Problem(document.name, None, "", f"the file {what}", "`runout new` writes a commented one to start from"))
    if problems or settings is None:
        raise ConfigError(sorted(dict.fromkeys(problems), key=lambda p: p.line or 0))
    return settings


def site_file(path: Path | str) -> Path:
    """Path of the site.yaml: ``path`` itself, or the one in the folder ``path``."""
    path = Path(path)
    is_folder = exists(path) and path.is_dir()
    if is_folder and (path / FILE_NAME).is_file():
        return path / FILE_NAME
    if exists(path) and path.is_file():
        return path
    kind, named = kind_of(path), kind_of(path / FILE_NAME)
    if kind or named:
        raise ConfigError(f"{path if kind else path / FILE_NAME}: is {kind or named}, not a file; copy its content to a site.yaml")
    if is_folder:
        sites = [name for name in names_in(path) if (path / name / FILE_NAME).is_file()]
        new = f"`runout new {quote(str(path))} --dem ... --release ...` makes a site"
        fix = f"name one of its sites: {', '.join(sites)}" if sites else new
        raise ConfigError(f"{path}: the folder holds no {FILE_NAME}; {fix}")
    near = nearest_file(path)
    raise ConfigError(
        f"{shortened(str(path))}: no such site; " + (f"did you mean {near}?" if near else "name a folder with a site.yaml")
    )


def nearest_file(path: Path) -> Path | None:
    """Existing path most similar to a missing one: a similar name in its folder, or the same name one folder up or down."""
    parent = path.parent
    while not (exists(parent) and parent.is_dir()):
        parent = parent.parent
    beside = [name for name in names_in(parent)[:MOST_NAMES] if not name.startswith(".") and name != path.name]
    match = difflib.get_close_matches(path.name[:LONGEST_NAME], beside, n=1)
    if match:
        return parent / match[0]
    elsewhere = [*(parent / name / path.name for name in beside), parent.parent / path.name]
    return next((place for place in elsewhere if exists(place)), None)


def _contradictions(document: Document) -> Iterator[Problem]:
    """Problems of settings that contradict each other."""
    sampled = {key: one for _, block in _sampled_blocks(document) for key, one in block.items()}
    releases = document.value(("release",))
    releases = [r if isinstance(r, dict) else {} for r in releases] if isinstance(releases, list) else []
    names = [r.get("name", "release") for r in releases]
    simulation = document.value(("simulation",))
    for conflicts in (device_conflicts, accuracy_conflicts) if isinstance(simulation, dict) else ():
        yield from _problems(document, ("simulation",), conflicts(_stated(simulation)))
    for i, release in enumerate(releases):
        yield from _problems(document, ("release", i), release_conflicts(_stated(release)) if release else ())
        ratio = _stated(_stated(release.get("pore_pressure")).get("ratio"))
        yield from _problems(document, ("release", i, "pore_pressure", "ratio"), ratio_conflicts(ratio) if ratio else ())
        if names[i] in names[:i]:
            place: Location = ("release", i, "name")
            yield document.problem(place, f"two releases are called {names[i]!r}", "give each its own name")
        yield from _own_friction(document, ("release", i), release, sampled)
    inflows = _blocks(document, (inflow.INFLOW,))
    yield from _inflows(document, inflows, names, sampled)
    for i, key, message, fix in release_start.start_conflicts(document.values):
        yield document.problem(("release", i, key), message, fix)
    for i, zone in enumerate(_overlays(document, "friction_zones")):
        yield from _problems(document, ("terrain", "friction_zones", i), zone_conflicts(_stated(zone)) if zone else ())
        yield from _zone_of_laws(document, ("terrain", "friction_zones", i), zone)
    for i, structure in enumerate(_blocks(document, ("structures",))):
        yield from _problems(document, ("structures", i), structure_conflicts(_stated(structure)))
    for i, first in repeated_structures(_blocks(document, ("structures",))):
        yield document.problem(("structures", i, "file"), f"structures[{first}] states the same bodies", "remove one of the two")
    rasters = document.value(("terrain", "friction_rasters"))
    yield from _rasters_of_law(document, rasters if isinstance(rasters, dict) else {})
    yield from _contradictions_of_the_site(document)
    for place, block in _sampled_blocks(document):
        yield from _problems(document, place, sample_conflicts(document, block, [*releases, *inflows]))


def _sampled_blocks(document: Document) -> list[tuple[Location, dict[str, Any]]]:
    """Parameters that the ensemble and each of its scenarios sample, as they are stated, with their places."""
    places: list[Location] = [("ensemble",), *(("ensemble", "scenarios", i) for i in range(len(_scenarios(document))))]
    blocks = [((*place, "parameters"), with_fixed(document.value((*place, "parameters")))) for place in places]
    return [(place, block) for place, block in blocks if isinstance(block, dict)]


def _scenarios(document: Document) -> list[dict[str, Any]]:
    return _blocks(document, ("ensemble", "scenarios"))


def _contradictions_of_the_site(document: Document) -> Iterator[Problem]:
    """Problems of settings that concern all masses, or the bed."""
    yield from _problems(document, (), friction_conflicts(_stated(document.values)))
    yield from _problems(document, (), mass_conflicts(_stated(document.values)))
    yield from _problems(document, (bed.BED,), bed.bed_conflicts(_stated(document.value((bed.BED,)))))
    if not document.value((bed.BED,)):
        yield from _problems(document, ("hazard",), without_a_bed(_stated(document.value(("hazard",)))))


def sample_conflicts(
    document: Document, sampled: dict[str, Any], masses: list[dict[str, Any]]
) -> Iterator[tuple[str, str, str]]:  # fmt: skip
    """Sampled parameters that a site does not have, or of which it has no use: key, message and remedy."""
    yield from unused_samples(masses, sampled)
    for part in (inflow, bed, release_start):
        yield from part.foreign_parameters(document.values, sampled)
    yield from foreign_parameters(document.value(("material",)), stated_law(document.values), sampled)
    for own in (unknown_own, idle_parameters):
        yield from own(document.values, sampled)


def _unfit_scenarios(document: Document, settings: SiteSettings) -> Iterator[Problem]:
    """Scenarios that contradict each other or the releases."""
    return (document.problem(place, message, fix) for place, message, fix in scenario_conflicts(settings))


def _with_table(document: Document, settings: SiteSettings, folder: Path) -> tuple[SiteSettings, list[Problem]]:
    """The settings with the members of the table of the ensemble, if it has one, and the problems of the table."""
    name = settings.ensemble.table
    if name is None:
        return settings, []
    rows, problems = read_design(folder / name, name, member_ranges(settings))
    if rows is not None:
        masses = [*_blocks(document, ("release",)), *_blocks(document, (inflow.INFLOW,))]
        plain = {key: one for key, one in as_stated(rows).items() if not key.endswith(OF_RELEASE + FAILS)}
        conflicts = [*sample_conflicts(document, plain, masses), *_unfit_sources(rows, settings)]
        problems = [Problem(name, 1, key, message, fix) for key, message, fix in conflicts]
        settings = settings.model_copy(update={"ensemble": settings.ensemble.with_rows(rows)})
    return settings, problems


def _unfit_sources(rows: DesignTable, settings: SiteSettings) -> Iterator[tuple[str, str, str]]:
    """Columns of a table that do not say of every release whether it fails: key, message and remedy."""
    names = [mass.name + OF_RELEASE + FAILS for mass in (*settings.release, *(settings.inflow or ()))]
    columns = {name: rows.parameters[name] for name in names if name in rows.parameters}
    for name in names if columns else ():
        if name not in columns:
            yield name, "is missing, but other releases have such a column", "add it: 1 where the release fails, 0 where not"
        elif not set(columns[name]) <= {0.0, 1.0}:
            yield name, "holds other values than 0 and 1", "write 1 where the release fails, 0 where not"
    if columns and (idle := [k for k, fails in enumerate(zip(*columns.values(), strict=True)) if 1.0 not in fails]):
        yield next(iter(columns)), f"no release fails in member {idle[0]}", "let one fail, or remove the row"


def _without_rates(document: Document, settings: SiteSettings | None) -> Iterator[Problem]:
    """Annual maps that are asked for without annual rates."""
    for key in ("return_periods", "scheme") if settings and not settings.ensemble.has_rates else ():
        if document.value(("hazard", key)) is not None:
            missing = "the ensemble has no annual rates, so that its probabilities are conditional on the release"
            fix = "state ensemble.scenarios, or a column annual_rate in ensemble.table, or remove it"
            yield document.problem(("hazard", key), missing, fix)


def _unfit_releases(document: Document, settings: SiteSettings) -> Iterator[Problem]:
    """Parameters of a release or inflow that make no material or friction with the others of the site."""
    own = OwnLaws(settings)
    of_masses = laws_of(settings)
    places: list[tuple[str, int, Any]] = [("release", i, mass) for i, mass in enumerate(settings.release)]
    places += [(inflow.INFLOW, i, mass) for i, mass in enumerate(settings.inflow or ())]
    for section, i, release in places:
        laws = of_masses[release.name]
        blocks: Any = ("material", own.material_of, laws[0]), (KEY, own.friction_of, laws[1])
        for key, make, law in blocks:
            try:
                make(release, {})
            except InputError as error:
                yield document.problem((section, i, key), *in_keys(error, law.parameters))


def _inflows(
    document: Document, inflows: list[dict[str, Any]], names: list[Any], sampled: dict[str, Any]
) -> Iterator[Problem]:  # fmt: skip
    """Problems of inflows that contradict themselves, or have a name among ``names`` or that of another."""
    for i, one in enumerate(inflows):
        place: Location = (inflow.INFLOW, i)
        yield from _problems(document, place, inflow.inflow_conflicts(_stated(one)) if one else ())
        others = names + [other.get("name", inflow.INFLOW) for other in inflows[:i]]
        if (name := one.get("name", inflow.INFLOW)) in others:
            yield document.problem((*place, "name"), f"two masses are called {name!r}", "give each its own name")
        yield from _own_friction(document, place, one, sampled)


def _stated(block: Any) -> dict[str, Any]:
    """Keys of a block that have a value; none if it is no block."""
    return {key: value for key, value in block.items() if value is not None} if isinstance(block, dict) else {}


def _problems(document: Document, place: Location, conflicts: Iterable[tuple[str, str, str]]) -> Iterator[Problem]:
    """Problems of a block at a ``place`` from conflicts: key in it, empty for the block itself, message and remedy."""
    for key, message, fix in conflicts:
        yield document.problem((*place, key) if key else place, message, fix)


def _rasters_of_law(document: Document, rasters: dict[str, Any]) -> Iterator[Problem]:
    """Rasters of parameters that the law of friction does not have."""
    law = stated_law(document.values)
    keys = [p.key for p in law.parameters] if law else list(rasters)
    for key in rasters:
        if key not in keys:
            message = f"the friction law {law.name if law else ''} has no such parameter"
            yield document.problem(("terrain", "friction_rasters", key), message, choice_fix(key, keys))


def _zone_of_laws(document: Document, place: Location, zone: dict[str, Any]) -> Iterator[Problem]:
    """A friction angle of a zone that the law of the site or of a release does not have."""
    yield from _own_friction(document, place, zone, {})
    site = stated_law(document.values)
    for name, (_, law) in stated_laws(document.values).items() if ANGLE in zone else ():
        if law and law is not site and ANGLE not in sampled_ranges(law):
            message = f"release {name} follows the friction law {law.name}, which has no friction angle"
            yield document.problem((*place, ANGLE), message, "write factor, which multiplies the coefficients of any law")
            return


def _own_friction(document: Document, place: Location, block_of_mass: dict[str, Any], sampled: dict[str, Any]) -> Iterator[Problem]:
    """Friction of a release or a zone that the law of the site does not have; what the ensemble samples too, also of a material."""
    law = stated_law(document.values)
    if ANGLE in block_of_mass and law and ANGLE not in sampled_ranges(law):
        names = ", ".join(p.key for p in law.parameters)
        message = f"the friction law {law.name} has no friction angle"
        other = f", or {KEY}: {{law: {DEFAULT_FRICTION}, friction_angle_deg: ...}}" if place[0] == "release" else ""
        yield document.problem((*place, ANGLE), message, f"write {KEY}: {{...}} with parameters of that law: {names}{other}")
    if ANGLE in block_of_mass and ANGLE in sampled:
        yield document.problem((*place, ANGLE), "the ensemble samples this angle too", "remove one of the two")
    for block, prefix in ((KEY, PREFIX), ("material", "")):
        own = block_of_mass.get(block)
        for key in own if isinstance(own, dict) and not names_law(own) else ():
            if f"{prefix}{key}" in sampled:
                yield document.problem((*place, block, key), "the ensemble samples this parameter too", "remove one of the two")


def _overlays(document: Document, key: str) -> list[dict[str, Any]]:
    """Friction zones or obstacles of the document; an entry that is not a block becomes an empty one."""
    return _blocks(document, ("terrain", key))


def _blocks(document: Document, place: Location) -> list[dict[str, Any]]:
    """Entries of a list; one that is not a block becomes an empty one."""
    entries = document.value(place)
    return [part if isinstance(part, dict) else {} for part in entries] if isinstance(entries, list) else []


def _unusable_files(document: Document, folder: Path) -> Iterator[Problem]:
    for location, name in named_inputs(document.values):
        path = folder / file_in(name)
        if name.startswith("matplotlib:"):
            if name not in SAMPLE_DEMS:
                message = f"{name!r} is not a sample elevation raster"
                yield document.problem(location, message, f"the only one is {SAMPLE_DEMS[0]!r}")
        elif not exists(path):
            near = nearest_file(path)
            fix = f"did you mean {_relative(near, folder)!r}?" if near else "paths are relative to the folder of site.yaml"
            yield document.problem(location, f"there is no file {name!r}", fix)
        elif kind_of(path):
            yield document.problem(location, f"{name!r} is {kind_of(path)}, not a file", "copy its content to a file and name that")
        elif path.is_file() and path.stat().st_size == 0:
            yield document.problem(location, f"{name!r} is empty (0 bytes)", "copy or export it again")


def files_outside(settings: SiteSettings, folder: Path) -> list[str]:
    """One sentence for each input of site.yaml that lies outside the site folder, after symbolic links are resolved."""
    names = (name for _, name in named_inputs(settings) if isinstance(name, str) and not name.startswith("matplotlib:"))
    root = folder.resolve()
    places = {name: (folder / file_in(name)).resolve() for name in dict.fromkeys(names)}
    return [f"{name}: lies outside the folder of the site, at {p}" for name, p in places.items() if not p.is_relative_to(root)]


def _relative(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _coordinate_system(document: Document) -> Iterator[Problem]:
    for place in (("terrain", "crs"), *(("structures", i, "crs") for i in range(len(_blocks(document, ("structures",)))))):
        text: Any = document.value(place)
        if isinstance(text, str):
            yield from _unknown_system(document, place, text)


def _unknown_system(document: Document, place: Location, text: str) -> Iterator[Problem]:
    named = file_named_by(text)
    if named:
        yield document.problem(place, f"names the file {named!r}, which is not read", "write a code, for example EPSG:32632")
        return
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        CRS.from_user_input(text)
    except CRSError:
        message = f"{text!r} is not a coordinate reference system"
        yield document.problem(place, message, "write its code, for example EPSG:32632")
