"""Members of a site: material, releases, grid and arguments of :func:`runout.simulate`, from settings and sampled parameters."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from runout.config import bed, inflow
from runout.config.friction import OF_RELEASE, SiteFriction
from runout.config.material import sampled_ranges
from runout.config.pore_pressure import sampled_pores
from runout.config.release_laws import OwnLaws, laws_of, own_ranges
from runout.config.release_start import sampled_ranges as sampled_starts_of
from runout.config.release_start import sampled_starts
from runout.config.scenarios import FAILS
from runout.config.schema import SiteSettings
from runout.errors import ConfigError
from runout.forecast.accuracy import CellSize, chosen_cell_size
from runout.model.laws import LAWS
from runout.model.limits import Range, spacing_of
from runout.model.numerics import Numerics

if TYPE_CHECKING:
    from runout.config.site import SiteData
    from runout.model.inflow import Inflow
    from runout.model.materials import Material
    from runout.model.release import Release

    Mass = TypeVar("Mass", Release, Inflow)

Sample = Mapping[str, float]  # sampled parameters by name
ROW_EXTRAS = ("weight", "annual_rate", "scenario", "seed", "file")  # columns of the table of members besides the parameters
OF_SIMULATION = {  # settings that are arguments under the same name
    *Numerics.names().difference(("cell_size", "particles_per_cell", "seed")),
    *("end_time", "backend", "device", "arrival_threshold"),
}


def sampled(settings: SiteSettings, sample: Sample | None) -> dict[str, float]:
    """The sampled parameters of a row of the table of members; an unknown name is refused."""
    if not sample:  # a site with an invalid material block has no material
        return {}
    ranges = member_ranges(settings)
    unknown = [name for name in sample if name not in ranges and name not in ROW_EXTRAS]
    if unknown:
        raise ConfigError(f"{unknown[0]}: not a parameter of a member; choose among {', '.join(ranges)}")
    values = {name: float(value) for name, value in sample.items() if name in ranges}
    return {name: value for name, value in values.items() if not math.isnan(value)}


def member_ranges(settings: SiteSettings) -> dict[str, Range]:
    """Range of every parameter that a member may have, by its name in the table of members."""
    ranges = sampled_ranges(LAWS.find(settings.material.law), SiteFriction(settings).law, bed.law_of(settings))
    failing = {name + OF_RELEASE + FAILS: Range(0, 1) for name in SiteFriction(settings).masses}
    return ranges | own_ranges(laws_of(settings)) | sampled_starts_of(settings.release) | failing


def failing(masses: "Sequence[Mass]", sample: Sample) -> "list[Mass]":
    """The releases or inflows that fail in a member: those that it names, all if it names none."""
    named = {name: value for name, value in sample.items() if name.endswith(OF_RELEASE + FAILS)}
    return [mass for mass in masses if not named or named.get(mass.name + OF_RELEASE + FAILS) == 1.0]


def material(settings: SiteSettings, sample: Sample | None = None) -> "Material":
    """The material; sampled parameters replace the stated ones."""
    return settings.material.material(sampled(settings, sample))


def sampled_releases(settings: SiteSettings, releases: "Sequence[Release]", sample: Sample | None = None) -> "list[Release]":
    """Releases that were read with a volume factor of 1, with their own laws of site.yaml and the sampled volume."""
    parameters = sampled(settings, sample)
    factor = parameters.get("release_volume_factor", 1.0)
    wetted = sampled_pores(OwnLaws(settings).under(failing(releases, parameters), parameters), parameters)
    return sampled_starts([r.scaled(factor) if factor != 1.0 else r for r in wetted], parameters)


def sampled_inflows(settings: SiteSettings, inflows: "Sequence[Inflow]", sample: Sample | None = None) -> "list[Inflow]":
    """Inflows that were read as stated, with their own laws of site.yaml and the sampled discharge and delay."""
    if not inflows:
        return []
    parameters = sampled(settings, sample)
    wetted = sampled_pores(OwnLaws(settings).under(failing(inflows, parameters), parameters), parameters)
    return inflow.of_member(wetted, parameters)


def sampled_masses(settings: SiteSettings, data: "SiteData", sample: Sample | None = None) -> "list[Release]":
    """Releases of a member, and the masses of its inflows at their lines as forecasts see them."""
    from runout.release.inlet import mass_at

    inflows = sampled_inflows(settings, data.inflows, sample)
    return [*sampled_releases(settings, data.releases, sample), *map(mass_at, inflows)]


def cell_size(settings: SiteSettings, releases: "Sequence[Release]") -> CellSize:
    """Cell size [m], one number or a list of three: as stated, else from simulation.accuracy and releases of volume factor 1.

    All members have the same grid, whatever their volume factor.
    """
    simulation = settings.simulation
    if simulation.cell_size is not None:
        return simulation.cell_size  # type: ignore[return-value]
    return chosen_cell_size(simulation.accuracy, releases)  # type: ignore[return-value]


def grid_spacing(settings: SiteSettings, releases: "Sequence[Release]") -> tuple[float, float, float]:
    """:func:`cell_size` east, north and up [m]."""
    return spacing_of(_fixed(cell_size(settings, releases)))


def default_particles(
    settings: SiteSettings, data: "SiteData", size: CellSize | Sequence[float], sample: Sample | None = None
) -> tuple[int, int, int]:
    """Default particles per cell (px, py, pz) for cells of ``size`` [m]."""
    from runout.release import arrangement

    parameters = sampled(settings, sample)
    height = size[2] if isinstance(size, Sequence) else size
    releases, basal = sampled_masses(settings, data, parameters), SiteFriction(settings).of_run(parameters)
    return arrangement.default_particles(releases, material(settings, parameters), basal, height, data.friction_zones)


def member_arguments(settings: SiteSettings, data: "SiteData", sample: Sample | None = None) -> dict[str, Any]:
    """Arguments of :func:`runout.simulate` for a member with the parameters of ``sample``, and its seed if it holds one."""
    parameters, simulation = sampled(settings, sample), settings.simulation
    size = cell_size(settings, data.masses)
    count = _fixed(simulation.particles_per_cell)
    arguments = {
        "terrain": data.terrain,
        "release": sampled_releases(settings, data.releases, parameters),
        "material": material(settings, parameters),
        **SiteFriction(settings).arguments(parameters),
        "friction_zones": data.friction_zones,
        "cell_size": _fixed(size),
        "particles_per_cell": default_particles(settings, data, size, parameters) if count is None else count,
        "seed": int((sample or {}).get("seed", settings.ensemble.seed)),
        "stop": simulation.stop_when_at_rest,
        **{name: getattr(simulation, name) for name in OF_SIMULATION},
    }
    more: dict[str, Any] = {"structures": data.structures, "probes": data.probes, **bed.of_member(settings, data.bed, parameters)}
    more["inflow"] = sampled_inflows(settings, data.inflows, parameters)
    if simulation.snapshots:
        more["snapshot_times"] = even_times(simulation.end_time, simulation.snapshots)
    return arguments | {name: value for name, value in more.items() if value}


def even_times(end_time: float, count: int) -> tuple[float, ...]:
    """Times [s] of ``count`` snapshots from 0 to ``end_time`` [s]."""
    return tuple(end_time * k / max(1, count - 1) for k in range(count))


def _fixed(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
