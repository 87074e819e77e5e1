"""Finds all problems of a site without changing anything."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.config.member_arguments import grid_spacing
from runout.config.pore_pressure import SAMPLED as PORES
from runout.config.pore_pressure import sampled_pores
from runout.errors import ConfigError, InputError, MaterialError, ReleaseError, RunoutError, StructureError
from runout.model.basal_strength import resting_strength
from runout.workflow import check_observations, check_physics, check_stiffness

if TYPE_CHECKING:
    from runout.config.observations import ObservationSettings
    from runout.config.probes import ProbeSettings
    from runout.config.site import Site
    from runout.config.structures import StructureSettings
    from runout.forecast.stiffness import Stiffness
    from runout.model.bed import Bed
    from runout.model.depth_resolution import DepthResolution
    from runout.model.friction import FrictionZones
    from runout.model.release import Release
    from runout.model.terrain import Terrain

MOST_TRAPPED = 0.05  # largest share of a release trapped in its scar without a warning


@dataclass
class Findings:
    """Result of an inspection: problems prevent a run, warnings do not, notes state changes to the DEM."""

    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    site: "Site | None" = None
    terrain: "Terrain | None" = None
    releases: "list[Release]" = field(default_factory=list)
    masses: "list[Release]" = field(default_factory=list)  # releases, and those of inflows at their lines
    zones: "FrictionZones | None" = None
    bed: "Bed | None" = None
    stiffness: "list[Stiffness]" = field(default_factory=list)  # of the site as stated, then of each member
    resolution: "DepthResolution | None" = None  # forecast, of the member that is resolved least

    def note(self, error: RunoutError) -> None:
        """Add an error, or each of the problems that it lists; what was found before is not repeated."""
        listed = error.problems if isinstance(error, ConfigError | StructureError) else []
        problems = map(str, listed) if listed else [str(error)]
        self.problems += [problem for problem in dict.fromkeys(problems) if problem not in self.problems]

    def name_files_as_stated(self, folder: Path) -> None:
        """Shorten the paths of input files in all warnings and notes to those that site.yaml in a folder states."""
        from runout.config.fetch import without_fetched_folders
        from runout.config.stated_at import within_site

        for texts in (self.warnings, self.notes):
            texts[:] = [without_fetched_folders(within_site(text, folder)) for text in texts]


def inspect(checked: "Path | Site", *, forecast: bool = True, changes: Sequence[str] = ()) -> Findings:
    """Problems and warnings of the configuration, the DEM and the releases of a site, or of a folder or site.yaml with ``changes``.

    With ``forecast``, also the depth of the flow, which takes up to some seconds.
    """
    from runout.config.read import files_outside
    from runout.config.site import read_site

    findings = Findings()
    readable: Site | None
    try:
        findings.site = readable = read_site(checked, changes) if isinstance(checked, Path) else checked
    except ConfigError as error:
        findings.note(error)
        assert isinstance(checked, Path)  # the settings of a site have been checked
        readable = _readable_part(checked, [problem.key for problem in error.problems], changes)
    if readable is not None:
        _inspect_inputs(findings, readable)
        if forecast and findings.site is not None and findings.masses and not findings.problems:
            _forecast_depth(findings, findings.site)
        findings.name_files_as_stated(readable.folder)
        findings.notes[:0] = files_outside(readable.settings, readable.folder) if findings.terrain else []
    return findings


def _inspect_inputs(findings: Findings, readable: "Site") -> None:
    """Add what is to be said of the input files of a site or of a readable part of it."""
    try:
        findings.terrain = readable.terrain()
    except InputError as error:
        findings.note(error)
        _note_structures(findings, readable)
        return
    findings.notes += [f"{findings.terrain.source}: {change}" for change in findings.terrain.changes]
    _read_releases(findings, readable, findings.terrain)
    _read_inflows(findings, readable)
    _read_zones(findings, readable, findings.terrain)
    _read_observations(findings, readable, findings.terrain)
    _read_probes(findings, readable, findings.terrain)
    _read_bed(findings, readable, findings.terrain)
    _inspect_overlaps(findings, readable, findings.terrain)
    _inspect_structures(findings, readable, findings.terrain)
    if findings.site is not None:
        _inspect_classes(findings, findings.site)
        _inspect_obstacles(findings, findings.site, findings.terrain)
        try:
            _inspect_resolution(findings, findings.site)
            _inspect_reach(findings, findings.site, findings.terrain)
            findings.warnings += check_physics.warnings(findings.site, findings.masses, findings.zones)
            findings.notes += check_physics.wet_masses(findings.site, findings.masses)
            findings.notes += check_physics.standing_layers(findings.site, findings.releases)
        except (MaterialError, ReleaseError) as error:  # of a member
            findings.note(error)


def _readable_part(site_path: Path, wrong: list[str], changes: Sequence[str]) -> "Site | None":
    """Site with the terrain, the masses and the bed whose settings are valid, so that their files can be inspected as well."""
    from runout.config.bed import BedSettings
    from runout.config.friction import BLOCK
    from runout.config.inflow import InflowSettings
    from runout.config.read import changed_document, site_file
    from runout.config.schema import ReleaseSettings, SiteSettings, TerrainSettings
    from runout.config.site import Site

    if not wrong or any(key == "" or key.startswith("terrain") for key in wrong):
        return None
    file = site_file(site_path)
    sections = changed_document(file, changes).values
    if not isinstance(sections, dict):
        return None
    terrain = TerrainSettings.model_validate(sections["terrain"])
    if any(key.startswith("basal_friction") for key in wrong):  # the law decides what zones and rasters of friction mean
        terrain = terrain.model_copy(update={"friction_zones": None, "friction_rasters": None})
    settings = SiteSettings.model_construct(
        structures=_readable_structures(sections.get("structures"), wrong),
        terrain=terrain,
        basal_friction=BLOCK.validated(sections["basal_friction"]) if _is_right("basal_friction", sections, wrong) else None,
        release=[ReleaseSettings.model_validate(values) for values in _right_entries("release", sections, wrong)],
        inflow=[InflowSettings.model_validate(values) for values in _right_entries("inflow", sections, wrong)],
        bed=BedSettings.model_validate(sections["bed"]) if _is_right("bed", sections, wrong) else None,
        observations=_readable_observations(sections.get("observations"), wrong),
        probes=_readable_probes(sections.get("probes"), wrong),
    )
    return Site(file.parent, file, file.parent.name, settings)


def _is_right(section: str, sections: dict[str, Any], wrong: list[str]) -> bool:
    return sections.get(section) is not None and not any(key.startswith(section) for key in wrong)


def _right_entries(section: str, sections: dict[str, Any], wrong: list[str]) -> list[Any]:
    """Entries of a list of site.yaml whose settings are valid."""
    entries = sections.get(section) if section not in wrong else None
    return [values for i, values in enumerate(entries or ()) if not any(key.startswith(f"{section}[{i}]") for key in wrong)]


def _readable_observations(section: Any, wrong: list[str]) -> "ObservationSettings | None":
    """Observations whose settings are valid."""
    from runout.config.observations import ObservationSettings

    if not isinstance(section, dict) or "observations" in wrong:
        return None
    right = {name: values for name, values in section.items() if not any(key.startswith(f"observations.{name}") for key in wrong)}
    if "thalweg" not in right and isinstance(right.get("difference"), dict):  # reaches lie along it
        right["difference"] = {name: value for name, value in right["difference"].items() if name != "reaches"}
    return ObservationSettings.model_validate(right)


def _readable_structures(section: Any, wrong: list[str]) -> "list[StructureSettings] | None":
    """Structures whose settings are valid."""
    from runout.config.structures import StructureSettings

    if not isinstance(section, list) or "structures" in wrong:
        return None
    right = _right_entries("structures", {"structures": section}, wrong)
    return [StructureSettings.model_validate(values) for values in right]


def _readable_probes(section: Any, wrong: list[str]) -> "ProbeSettings | None":
    """Probes whose settings are valid."""
    from runout.config.probes import ProbeSettings

    sound = isinstance(section, dict) and not any(key.startswith("probes") for key in wrong)
    return ProbeSettings.model_validate(section) if sound else None


def _read_releases(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Read the releases, and note the problems of each."""
    from runout.config.member_arguments import sampled_releases
    from runout.model.release_start import StartVelocity
    from runout.release.statements import start_sentences

    reading = site.files.releases()
    findings.releases += sampled_releases(site.settings, reading.content)
    for problem in reading.problems:
        findings.note(problem)
    findings.notes += [f"release {release.name}: {change}" for release in findings.releases for change in release.changes]
    findings.notes += start_sentences(findings.releases, site.settings.ensemble.fail_apart)
    for release in findings.releases:
        try:
            if isinstance(release.velocity, StartVelocity):
                release.velocity.direction(release)
        except ReleaseError as error:
            findings.note(error)


def _read_inflows(findings: Findings, site: "Site") -> None:
    """Read the inflows, and note the problems of each. Forecasts see the masses at their lines beside those of the releases."""
    from runout.config.member_arguments import sampled_inflows
    from runout.config.stated_at import entry_number, stated_place
    from runout.model.pore_pressure import unused
    from runout.release.inlet import mass_at

    reading = site.files.inflows()
    inflows = sampled_inflows(site.settings, reading.content)
    for problem in reading.problems:
        findings.note(problem)
    findings.notes += [f"inflow {one.name}: {change}" for one in inflows for change in one.changes]
    findings.masses += [*findings.releases, *map(mass_at, inflows)]
    for number, mass in enumerate(findings.masses):
        block = "release" if number < len(findings.releases) else "inflow"
        if mass.pore_pressure:
            place = stated_place(site.file, block, entry_number(site.file, block, mass.name), "pore_pressure")
            sentences = [*mass.pore_pressure.changes, *unused(mass.pore_pressure, mass.thickness, mass.terrain)]
            findings.warnings += [f"{place}: {sentence}" for sentence in sentences]


def _inspect_inflows(findings: Findings, site: "Site", spacing: tuple[float, float, float]) -> None:
    """Refuse lines narrower than a cell, and hydrographs of which nothing enters in some member.

    Warn of what does not enter with the largest delay of any member, and of flows thinner than a cell at the line.
    """
    from runout.config.inflow import DELAY, of_member, placed
    from runout.config.member_arguments import sampled_inflows
    from runout.release.inlet import require_entering, require_wide

    latest = max(check_physics.samples_of(site), key=lambda sample: sample.get(DELAY, 0.0))
    delay = {DELAY: latest[DELAY]} if DELAY in latest else {}
    end_time, inflows = site.settings.simulation.end_time, site.files.inflows().content
    largest = f" with {DELAY} {delay[DELAY]:.4g}, the largest" if delay else ""
    stated = sampled_inflows(site.settings, inflows)
    for one, late in zip(stated, of_member(stated, delay), strict=True):
        try:
            with placed(site.file, one.name, "polygon" if one.line is None else "line"):
                require_wide(one, spacing)
            with placed(site.file, one.name, "hydrograph"):
                require_entering(late, end_time, largest)
        except ConfigError as error:
            findings.note(error)
            continue
        sentences = one.sentences(end_time, spacing)
        of_delay = [sentence for sentence in late.sentences(end_time, spacing) if sentence not in sentences]
        findings.warnings += [*sentences, *(f"{sentence};{largest}" for sentence in of_delay)]


def _read_zones(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    try:
        findings.zones = site.files.zones()
    except InputError as error:
        findings.note(error)
    if findings.zones:
        findings.notes += [change for change in findings.zones.changes if change not in findings.zones.warnings]
        findings.warnings += findings.zones.warnings


def _read_observations(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Read the observations, and note the problems of each."""
    reading = site.files.observations()
    observed = reading.content
    for problem in reading.problems:
        findings.note(problem)
    if observed is not None:
        findings.notes += [observed.statement(), *observed.changes]
    whole = findings.site is not None
    findings.warnings += check_observations.warnings(site, observed, terrain, findings.releases, whole=whole)


def _read_probes(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    try:
        probes = site.files.probes()
    except InputError as error:
        findings.note(error)
    else:
        findings.notes += [probes.statement(), *probes.changes] if probes else []


def _read_bed(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Read the bed, and warn of what excavated releases cut off and of a depth that particles do not resolve."""
    from runout.config.bed import wide_ratios

    try:
        bed = site.files.bed()
    except InputError as error:
        findings.note(error)
        return
    if bed is None or findings.site is None or not findings.masses:
        return
    findings.bed = bed
    size = grid_spacing(site.settings, findings.masses)
    volume = check_physics.particle_volume(site, findings.masses, findings.zones)
    findings.warnings += [*bed.changes, *bed.sentences(terrain, findings.masses, size, volume)]
    findings.warnings += wide_ratios(site.settings, site.file)


def _inspect_classes(findings: Findings, site: "Site") -> None:
    """Refuse scenarios whose members have other volumes than the class that their rate counts."""
    from runout.config.scenarios import volume_conflicts

    ensemble, volumes = site.settings.ensemble, {release.name: release.volume for release in findings.releases}
    for scenario in ensemble.scenarios or ():
        findings.problems += volume_conflicts(scenario, ensemble.parameters, volumes)


def _fail_together(site: "Site", pair: "tuple[Release, Release]") -> bool:
    """Whether two releases fail in the same member."""
    from runout.config.member_arguments import failing

    return any(len(failing(pair, sample)) == len(pair) for sample in check_physics.samples_of(site))


def _inspect_overlaps(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    from runout.release.sample import may_overlap

    for one, other in combinations(findings.releases, 2):
        if may_overlap(one, other):
            continue
        shared = int(((one.thickness > 0) & (other.thickness > 0)).sum())
        if shared and one.outline is not None and other.outline is not None:
            from runout.io.polygons import SLIVER

            cells = one.outline.intersection(other.outline).area / terrain.cell_area
            shared = math.ceil(cells) if cells >= SLIVER else 0
        if shared and _fail_together(site, (one, other)):
            findings.problems.append(f"releases {one.name} and {other.name} overlap on {shared} cells; cut one of them back")


def _inspect_resolution(findings: Findings, site: "Site") -> None:
    if not findings.masses:
        return
    spacing = grid_spacing(site.settings, findings.masses)
    findings.stiffness = check_stiffness.site_stiffness(site, findings.masses, findings.zones)
    _inspect_inflows(findings, site, spacing)
    findings.warnings += check_stiffness.warnings(findings.stiffness)
    for release in findings.releases:
        findings.problems += _too_coarse(release, spacing)
        findings.warnings += _below_the_threshold(release, site.settings.simulation.arrival_threshold)
        findings.warnings += _trapped(release, site)


def _forecast_depth(findings: Findings, site: "Site") -> None:
    """Forecast how the flow will be resolved, and warn of few cells through its depth."""
    from runout.workflow.flow_forecast import least_resolved

    findings.resolution = least_resolved(site, findings.stiffness[1:])
    if coarse := findings.resolution.warning():
        findings.warnings.append(f"the member that is resolved least is forecast to have {coarse}")


def _inspect_obstacles(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Warn of obstacles narrower than two cells of the grid, and of dams lower than one."""
    if not site.settings.terrain.obstacles:
        return
    from runout.structures.inspection import LOW

    spacing = grid_spacing(site.settings, findings.masses) if findings.masses else (0.0, 0.0, 0.0)
    cell = max(*spacing[:2], *terrain.cell_size)
    for obstacle, built in zip(site.settings.terrain.obstacles, site.files.obstacles(), strict=True):
        heights, width = [height for height in built.heights if height > 0], built.narrowest
        if heights and min(heights) < spacing[2]:
            low = LOW.format(height=min(heights), cell=spacing[2])
            findings.warnings.append(f"{obstacle.polygons}: the lowest obstacle {low}")
        if width < 2 * cell:
            findings.warnings.append(
                f"{obstacle.polygons}: the narrowest obstacle is about {width:.3g} m wide, less than two cells of {cell:.4g} m; "
                "its volume is kept, its crest is lower than stated: use smaller cells, or draw it wider"
            )


def _inspect_structures(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Read the structures; on a site whose grid is known, measure their walls too."""
    from runout.config.site_files import may_hold_bodies, sound_bodies

    if not may_hold_bodies(site.settings):
        return
    from runout.structures.inspection import low_structures

    known = findings.site is not None and findings.masses
    spacing = grid_spacing(site.settings, findings.masses) if known else None
    try:
        bodies = sound_bodies(site.files, spacing)
        findings.notes += [f"structures: {change}" for change in bodies.changes]
        findings.warnings += low_structures(bodies.solids, terrain, spacing) if spacing else []
    except InputError as error:
        findings.note(error)


def _note_structures(findings: Findings, site: "Site") -> None:
    """Note what is wrong with the files of the structures themselves, where no ground is known to place them on."""
    from runout.config.structures import require_readable

    try:
        require_readable(site.settings, site.file)
    except InputError as error:
        findings.note(error)


def _too_coarse(release: "Release", spacing: Sequence[float]) -> Iterator[str]:
    cells = release.area / (spacing[0] * spacing[1])
    if cells < 1:
        finer = math.sqrt(release.area) / 4
        area = f"its area of {release.area:.4g} m2 is {cells:.2g} cells"
        yield f"release {release.name}: {area}; set simulation.cell_size to {finer:.2g} or less"


def _below_the_threshold(release: "Release", threshold: float) -> Iterator[str]:
    """Warn if a mass is so thin that maps of speed, pressure and arrival stay empty."""
    thickest = float(release.thickness.max())
    if thickest <= threshold:
        yield (
            f"release {release.name}: its greatest thickness of {thickest:.3g} m is not above simulation.arrival_threshold of "
            f"{threshold:g} m, so that speed, pressure and arrival count nowhere; arrival_threshold: {thickest / 10:.1g} avoids it"
        )


def _trapped(release: "Release", site: "Site") -> Iterator[str]:
    """Warn of mass that cannot slide out of its scar, for the stated release or, if there is none, for the worst member."""
    from runout.config.friction import OF_RELEASE, PREFIX, sampled_ranges
    from runout.model.release import Edge, Placement
    from runout.release.taper import trapped_share

    if release.placement is Placement.ON_SURFACE:
        return
    members = check_physics.samples_of(site)
    angle_of_site = _resting_angle(release, site, {})
    own = release.name + OF_RELEASE + PREFIX
    of_all = sampled_ranges(site.friction.law)
    acting = [
        {n: value for n, value in row.items() if n in of_all or n.rpartition(OF_RELEASE)[2] in PORES or n.startswith(own)}
        for row in members
    ]
    worst_angle = max((_resting_angle(release, site, row) for row in acting), default=angle_of_site)
    largest = max(row.get("release_volume_factor", 1.0) for row in members)
    for factor, angle in dict.fromkeys([(1.0, angle_of_site), (largest, worst_angle)]):
        scaled = release.scaled(factor) if factor != 1.0 else release
        below, at_friction = trapped_share(scaled, 0.0), trapped_share(scaled, angle)
        if max(below, at_friction) > MOST_TRAPPED:
            times = f" with volume factor {factor:.3g}" if factor != 1.0 else ""
            wet = ", pore pressure included" if release.pore_pressure else ""
            thins = "edge: tapered" if release.outline is not None else "a raster that thins out to its rim"
            fix = thins if release.edge is Edge.VERTICAL else "a longer outline, or less volume,"
            yield (
                f"release {release.name}{times}: {at_friction:.0%} of {scaled.volume:.4g} m3 lie below the lines that rise from "
                f"the rim of the scar at the basal friction angle of {math.degrees(angle):.3g} deg{wet}, {below:.0%} below its "
                f"lowest outlet; this mass is trapped unless the rest carries it along; {fix} avoids it"
            )
            return


def _resting_angle(release: "Release", site: "Site", sample: "dict[Any, Any]") -> float:
    """Angle [rad] at which a release stands in a member, by ground and yield stress, with the lowest pore pressure at the start."""
    (friction,), (wet,) = site.friction.of_releases([release], sample), sampled_pores([release], sample)
    ground = math.tan(friction) if isinstance(friction, float) else friction.at_rest
    at_rest = min(ground, resting_strength(release.material or site.material(), release))
    return math.atan((1.0 - wet.pore_pressure.lowest) * at_rest) if wet.pore_pressure else math.atan(at_rest)


def _inspect_reach(findings: Findings, site: "Site", terrain: "Terrain") -> None:
    """Warn of edges of the DEM, and of cells without elevation, over which mass may leave."""
    from runout.model.release import thickness_of
    from runout.terrain import open_edge, prepare

    if not findings.masses:
        return
    thickness = thickness_of(findings.masses, terrain)
    reach = prepare.reachable(terrain, thickness, check_physics.least_friction(site, findings.masses, findings.zones))
    findings.notes += open_edge.note(terrain)
    _inspect_relief(findings, site, terrain, reach)
    if (bed := findings.bed) is not None and not (bed.depth_on(terrain, findings.releases) * reach).any():
        findings.warnings.append(f"{bed.source}: none of the bed lies where the mass can come (energy line); nothing is eroded")
    cells = open_edge.open_cells(terrain, reach)
    if cells.any():
        findings.warnings.append(open_edge.statement(terrain, cells))
    rims = {"north": reach[0], "south": reach[-1], "west": reach[:, 0], "east": reach[:, -1]}
    sides = [side for side, rim in rims.items() if rim.any()]
    if sides:
        findings.warnings.append(
            f"{terrain.source}: the mass may leave the DEM in the {' and '.join(sides)} (energy line); mass that leaves is "
            "booked as escaped mass; a larger DEM avoids it"
        )


def _inspect_relief(findings: Findings, site: "Site", terrain: "Terrain", reach: np.ndarray) -> None:
    """Note what relief in reach of the mass costs; warn of elevations that oscillate."""
    from runout.terrain.roughness import of_ground

    speed = math.sqrt(0.5) * findings.stiffness[0].flow_speed
    relief = of_ground(terrain, grid_spacing(site.settings, findings.masses)[:2], reach, speed)
    if relief is not None:
        findings.notes.append(relief.statement())
        findings.warnings += [relief.warning()] if relief.wave else []


def require_sound(site: "Path | Site", changes: Sequence[str] = ()) -> None:
    """Raise ConfigError with all problems of a site, or of a folder or site.yaml with ``changes``, if there are any."""
    problems = inspect(site, forecast=False, changes=changes).problems
    if problems:
        raise ConfigError("\n".join(problems))
