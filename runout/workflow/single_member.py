"""Simulates one member of a site with snapshots, outside the ensemble."""

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout import log
from runout.errors import ConfigError
from runout.workflow.study import Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member

LOGGER = logging.getLogger("runout.single_member")


def run(
    site_path: Path | str,
    out: Path | None = None,
    *,
    member: int = 0,
    snapshots: int = 20,
    particles: int = 0,
    device: str | None = None,
    cell_size: Sequence[float] | None = None,
) -> Path:
    """Simulate one member with all cores and write its maps, ledger and snapshots; returns the file.

    Parameters
    ----------
    site_path : Path or str
        Site folder or its site.yaml.
    out : Path or None
        Results folder; the file goes to its ``simulations``, apart from the ensemble's members.
    member : int
        Row of the table of members.
    snapshots : int
        Number of snapshots, evenly spaced over the simulated time.
    particles : int
        Most particles whose positions and speeds each snapshot keeps.
    device : str or None
        "cpu", "cuda:N" or "auto" instead of what site.yaml says.
    cell_size : sequence of float or None
        Grid spacing [m], one number or three, instead of what site.yaml says; the name and the attributes of the file tell.

    Raises
    ------
    ConfigError, DeviceError
        If there is no such member, a number of snapshots or particles is negative, the cell size is out of range, or the device
        does not exist.
    """
    from runout.config.member_arguments import even_times
    from runout.ensemble.work_log import log_work
    from runout.io.atomic import whole_file
    from runout.simulation.single import simulate

    study = Study.open(site_path, out, device=device)
    site, overrides = study.site, {} if cell_size is None else {"cell_size": list(cell_size)}
    if cell_size is not None:
        site = site.with_settings(simulation=site.settings.simulation.with_cell_size(cell_size))
    chosen = chosen_member(site, member)
    if snapshots < 0:
        raise ConfigError(f"snapshots is {snapshots}; it must be 0 or more")
    file = simulation_file(study.results, member, _suffix(overrides))
    with log.to_file(study.results / "run.log"), log.progress(f"member {member}") as bar:
        arguments = {**site.member_arguments(chosen.parameters), "seed": chosen.seed}
        arguments |= {"snapshot_times": even_times(arguments["end_time"], snapshots), "snapshot_particles": particles}
        stated = [f"{name} {value:.4g}" for name, value in chosen.parameters.items()]
        LOGGER.info("member %d: %s", member, ", ".join([*stated, *(f"{name} {value}" for name, value in overrides.items())]))
        result = simulate(**arguments, progress=bar)
        log_work(member, result.series)
        with whole_file(file) as temporary:
            result.to_netcdf(temporary, attrs={**_attributes(site, chosen, overrides), "snapshots_planned": snapshots})
        LOGGER.info("wrote %s: %d particles, %d steps, stopped: %s", file, result.n_particles, result.steps, result.stop_reason)
    return file


def simulation_file(results: Path, member: int, suffix: str = "") -> Path:
    """Where the simulation of one member goes."""
    return Path(results) / "simulations" / f"{member:04d}{suffix}.nc"


def chosen_member(site: "Site", number: int) -> "Member":
    """A member of a site by its number.

    Raises ConfigError if there is no such member.
    """
    from runout.ensemble.member import plan_members

    members = plan_members(site)
    if not 0 <= number < len(members):
        raise ConfigError(f"member is {number}; the site has members 0 to {len(members) - 1}, see `runout status`")
    return members[number]


def _suffix(overrides: dict[str, list[float]]) -> str:
    """Settings of the command line as part of a file name, such as ``_cell_size_10``."""
    return "".join(f"_{name}_{'x'.join(f'{number:g}' for number in numbers)}" for name, numbers in overrides.items())


def _attributes(site: "Site", member: "Member", overrides: dict[str, list[float]]) -> dict[str, Any]:
    """Provenance of the file; one with settings of the command line says so."""
    origin = site.provenance(site.inputs(), member.seed)
    attributes: dict[str, Any] = {"member": member.number, "parameters": json.dumps(member.parameters), "seed": member.seed}
    attributes |= {name: json.dumps(origin[name]) for name in ("inputs", "configuration", "versions")}
    attributes |= {name: origin[name] for name in ("site", "device", "command", "configuration_sha256")}
    if not overrides:
        attributes["member_key"] = member.key
    if overrides:
        attributes["overrides"] = json.dumps({f"simulation.{name}": numbers for name, numbers in overrides.items()})
        named = ", ".join(overrides)
        attributes["summary"] = f"Simulation with settings of the command line ({named}); it is no member of the ensemble"
    return attributes
