"""A small site on disk: a tilted plane, one square release, one site.yaml that can be edited."""

import os
from pathlib import Path

import numpy as np
import pytest

SITE = """\
name: slope
title: A tilted plane
terrain:
  dem: inputs/dem.asc
release:
  - name: scar
    polygons: inputs/release.geojson
    thickness: 4.0
material:
  density: 2000
  youngs_modulus: 5.0e6
  friction_angle_deg: 30
basal_friction_angle_deg: 20
simulation:
  cell_size: 10
  end_time: 30
ensemble:
  members: 4
  parameters:
    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}
"""
SQUARE = """\
{"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}, "features": [
  {"type": "Feature", "properties": {"depth": 4.0}, "geometry": {"type": "Polygon", "coordinates":
    [[[500040, 5000040], [500080, 5000040], [500080, 5000080], [500040, 5000080], [500040, 5000040]]]}}]}
"""


def write_inputs(folder: Path) -> Path:
    """A DEM of 20 x 30 cells of 10 m that falls 0.3 m per metre eastwards, and a square of 40 m x 40 m."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = "\n".join(" ".join(f"{100 - 3 * c + 0.01 * r:.3f}" for c in range(30)) for r in range(20))
    head = "ncols 30\nnrows 20\nxllcorner 500000\nyllcorner 5000000\ncellsize 10\nNODATA_value -9999\n"
    (folder / "dem.asc").write_text(head + rows + "\n", encoding="utf-8")
    (folder / "release.geojson").write_text(SQUARE, encoding="utf-8")
    return folder


@pytest.fixture
def site_folder(tmp_path: Path) -> Path:
    """Folder of the small site."""
    folder = tmp_path / "slope"
    write_inputs(folder / "inputs")
    (folder / "site.yaml").write_text(SITE.replace("dem.asc\n", "dem.asc\n  crs: EPSG:32632\n"), encoding="utf-8")
    return folder


@pytest.fixture
def edited(site_folder: Path):
    """A function that replaces text of the site's site.yaml and returns its folder."""

    def edit(old: str, new: str) -> Path:
        file = site_folder / "site.yaml"
        text = file.read_text(encoding="utf-8")
        assert old in text, f"the test replaces {old!r}, which the site.yaml does not hold"
        file.write_text(text.replace(old, new), encoding="utf-8")
        return site_folder

    return edit


@pytest.fixture
def data_folder() -> Path:
    """The folder with the rasters of the real sites."""
    stated = os.environ.get("RUNOUT_DATA")
    if not stated or not Path(stated, "frank_slide_1903").is_dir():
        pytest.skip("RUNOUT_DATA does not name a folder with the rasters of the real sites")
    return Path(stated)


@pytest.fixture
def mass_weighted_slope():
    """A function: mean slope [deg] of the terrain under a release, weighted by thickness."""

    def slope(release) -> float:
        north, east = np.gradient(release.terrain.elevation, *release.terrain.cell_size[::-1])
        mass = release.thickness > 0
        return float(np.degrees(np.average(np.arctan(np.hypot(east, north))[mass], weights=release.thickness[mass])))

    return slope
