"""From a site to hazard maps: DEM -> terrain -> release -> ensemble -> NetCDF products -> report.

    python pipelines/hazard_map.py sites/jacksboro

These are the stages of `runout run`, one call each. The command also skips stages that are up to date, checks the inputs first,
locks the results and keeps a log. Copy this file to build a study of your own.
"""

import sys
from pathlib import Path

from runout.config.site import read_site
from runout.ensemble.member import planned_table
from runout.hazard.products import write_products
from runout.report.html import write_report
from runout.workflow.growth import grow


def main(site_folder: Path, results: Path) -> Path:
    """The report of a site, after simulating all members that are missing; products go to ``results``."""
    site = read_site(site_folder)
    terrain = site.terrain()
    for release in site.releases(terrain):
        print(f"release {release.name}: {release.volume:.4g} m3 on {release.area:.4g} m2")
    finished = grow(site, results)
    write_products(site, results, planned_table(site, finished.members), finished)
    return write_report(site, results)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    print(main(folder, Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "results"))
