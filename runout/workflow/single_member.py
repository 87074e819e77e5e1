"""Simulates one member of a site with snapshots, outside the ensemble."""

import json
import logging
from pathlib import Path

import numpy as np

from runout import log
from runout.errors import ConfigError
from runout.workflow.study import Study

LOGGER = logging.getLogger("runout.single_member")


def run(site_path: Path | str, out: Path | None = None, *, member: int = 0, snapshots: int = 20, device: str | None = None) -> Path:
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
    device : str or None
        "cpu", "cuda:N" or "auto" instead of what site.yaml says.

    Raises
    ------
    ConfigError, DeviceError
        If there is no such member, the number of snapshots is negative, or the device does not exist.
    """
    from runout.ensemble.member import plan_members
    from runout.io.atomic import whole_file
    from runout.simulation import simulate

    study = Study.open(site_path, out, device=device)
    members = plan_members(study.site)
    if not 0 <= member < len(members):
        raise ConfigError(f"member is {member}; the site has members 0 to {len(members) - 1}, see `runout status`")
    if snapshots < 0:
        raise ConfigError(f"snapshots is {snapshots}; it must be 0 or more")
    chosen, file = members[member], study.results / "simulations" / f"{member:04d}.nc"
    with log.to_file(study.results / "run.log"), log.progress(f"member {member}") as bar:
        arguments = {**study.site.member_arguments(chosen.parameters), "seed": chosen.seed}
        times = np.linspace(0.0, arguments["end_time"], snapshots)
        LOGGER.info("member %d: %s", member, ", ".join(f"{name} {value:.4g}" for name, value in chosen.parameters.items()))
        result = simulate(**arguments, snapshot_times=tuple(times), progress=bar)
        with whole_file(file) as temporary:
            result.to_netcdf(temporary, attrs={"member": member, "parameters": json.dumps(chosen.parameters), "seed": chosen.seed})
        LOGGER.info("wrote %s: %d particles, %d steps, stopped: %s", file, result.n_particles, result.steps, result.stop_reason)
    return file
