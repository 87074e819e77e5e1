"""Adds a row to the table of map quantities, then runs a site from its members to the report; prints what holds the quantity."""

import json
import sys
from pathlib import Path

from runout.map_quantities import QUANTITIES, MapQuantity

NAME, GRAVITY = "kinetic_head", 9.81


def kinetic_head(depth, speed, density):
    """Height v^2 / (2 g) [m] to which a flow may climb."""
    return speed * speed / (2.0 * GRAVITY)


QUANTITIES[NAME] = MapQuantity(NAME, "m", "kinetic head", "kinetic head (speed squared over 2 g)", kinetic_head, (0.5, 2.0))


def main(folder: Path) -> dict:
    """Maps of the first member, and in which products the quantity is."""
    import numpy as np

    from runout.config.site import read_site
    from runout.ensemble.member import plan_members, planned_table, simulate_member
    from runout.hazard.products import write_products
    from runout.io import netcdf
    from runout.report.html import write_report
    from runout.simulation.single import simulate

    site, results, quantity = read_site(folder), folder / "results", QUANTITIES[NAME]
    members = plan_members(site)
    for member in members:
        simulate_member(site, member, results)
    write_products(site, results, planned_table(site))
    fields = simulate(**site.member_arguments(members[0].parameters) | {"seed": members[0].seed}).fields
    hazard, stack = (netcdf.read(results / name) for name in ("hazard.nc", "members.nc"))
    return {
        "head": float(fields[quantity.member_map].max()),
        "of_speed": float(np.max(fields["max_speed"]) ** 2 / (2.0 * GRAVITY)),
        "in_members_nc": float(stack[quantity.member_map].sel(realization=0).max()),
        "hazard": sorted(str(name) for name in hazard.variables if NAME in str(name)),
        "maps": sorted(path.name for path in (results / "maps").iterdir() if NAME in path.name),
        "resolved": site.resolved()["hazard"][quantity.setting],
        "report": write_report(site, results).read_text(encoding="utf-8").count("kinetic head"),
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
