"""One member of a site by itself: site -> parameters of the member -> simulation -> NetCDF with snapshots.

    python pipelines/single_member.py sites/jacksboro 3

`runout simulate SITE --member 3` does the same with a log and a progress bar.
"""

import sys
from pathlib import Path

import numpy as np

from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.simulation.single import simulate

SNAPSHOTS = 20


def main(site_folder: Path, number: int, file: Path) -> Path:
    """The NetCDF file of a member: maps, ledger and snapshots."""
    site = read_site(site_folder)
    member = plan_members(site)[number]
    arguments = {**site.member_arguments(member.parameters), "seed": member.seed}
    times = np.linspace(0.0, arguments["end_time"], SNAPSHOTS)
    result = simulate(**arguments, snapshot_times=tuple(times))
    file.parent.mkdir(parents=True, exist_ok=True)
    result.to_netcdf(file)
    return file


if __name__ == "__main__":
    folder, chosen = Path(sys.argv[1]), int(sys.argv[2])
    print(main(folder, chosen, folder / "results" / "simulations" / f"{chosen:04d}.nc"))
