"""Forces on structures over the members of a site: structures.nc, layers of the GeoPackage, overtopping, report."""

import re
import sys
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import COLUMNS, NORTH, ROWS, SITE, WEST, write_site

from runout.hazard.structure_products import maxima_of
from runout.io import netcdf
from runout.simulation.structure_forces import StructureForces, facade_series
from runout.structures.build import build_structures


@pytest.fixture(scope="module")
def walled(tmp_path_factory):
    """The ramp with a wall across its foot, two members, after a whole run."""
    from runout.workflow import hazard_map

    text = SITE.replace("members: 4", "members: 2").replace("end_time: 20", "end_time: 12")
    text += "structures:\n  - {file: inputs/wall.gpkg, name: wall, height: 25, protects: inputs/behind.gpkg}\n"
    site = write_site(tmp_path_factory.mktemp("walled") / "ramp", text)
    south = NORTH - 10 * ROWS
    wall = shapely.box(WEST + 280, south + 60, WEST + 300, south + 180)
    behind = shapely.box(WEST + 300, south, WEST + 10 * COLUMNS, NORTH)
    for name, shape in (("wall", wall), ("behind", behind)):
        gpd.GeoDataFrame(geometry=[shape], crs="EPSG:32632").to_file(site / "inputs" / f"{name}.gpkg")
    return site, hazard_map.run(site, workers=1)


def test_a_run_writes_the_forces_of_every_member_and_their_maxima(walled):
    site, outcome = walled
    assert outcome.failed == {}
    found = netcdf.read(site / "results" / "structures.nc")
    assert found["facade_force_east"].dims == ("realization", "record", "facade")
    west = list(found["facade_name"].values).index("west")
    assert (found["max_facade_force"].values[:, west] > 1e6).all()
    east = found["facade_force_east"].values[:, :, west]
    assert np.nanmax(east) <= found["max_facade_force"].values[:, west].max() * (1 + 1e-6)
    assert (found["facade_force_at_percentile"].values[:, west] <= found["max_facade_force"].values[:, west].max()).all()
    assert found["facade_pressure_probability"].values[west, 0] == 1.0
    assert found["facade_area"].values[west] == pytest.approx(120 * 25)
    assert found["max_facade_force"].attrs["units"] == "N"
    time = found["record_time"].values
    assert (np.diff(time[0][np.isfinite(time[0])]) > 0).all()


def test_the_volume_behind_the_wall_is_what_lies_there(walled):
    site, _ = walled
    results = site / "results"
    found, members = netcdf.read(results / "structures.nc"), netcdf.read(results / "members.nc")
    behind = members["x"].values > WEST + 300
    wanted = members["deposit_thickness"].fillna(0).values[:, :, behind].sum((1, 2)) * 100.0
    assert found["overtopping_volume"].values[:, 0] == pytest.approx(wanted, rel=1e-5)
    assert found["overtopping_probability"].values[0] == np.mean(wanted >= 0.1 * 100)


def test_the_geopackage_holds_structures_and_facades_with_their_largest_values(walled):
    site, _ = walled
    path = site / "results" / "outlines.gpkg"
    structures, facades = gpd.read_file(path, layer="structures"), gpd.read_file(path, layer="facades")
    assert structures.geometry[0].area == pytest.approx(20 * 120)
    west = facades[facades.facade == "west"].iloc[0]
    assert west.geometry.length == pytest.approx(120)
    assert west.max_force_n == structures.max_force_n[0] > 1e6
    assert west["probability_of_3000_pa"] == 1.0
    assert 0 < west.time_of_max_force_s <= 12


def test_the_report_has_a_section_on_structures(walled):
    site, _ = walled
    page = (site / "results" / "report.html").read_text()
    assert '<section id="structures">' in page
    assert '<td data-label="Structure">wall</td><td data-label="Facade">west</td>' in page
    assert 'data-label="Area [m²]"' in page  # narrow screens show the headings beside the values
    assert "Overtopping" in page
    assert "Force over time" in page
    assert re.search("rounded to the digits that a numerical error of [0-9.]+\u202f% leaves", page)
    assert "does not say which building is damaged" in page
    assert re.search("Release slab: [0-9\u202f]+m³ on [0-9\u202f]+m², .* thick on average", page)


def test_another_protected_area_makes_the_products_again_and_no_member(walled):
    from runout.workflow.study import PLAN, Study

    site, _ = walled
    assert [stage.name for stage in PLAN if Study.open(site).why_stale(stage)] == []
    path = site / "inputs" / "behind.gpkg"
    half = gpd.read_file(path)
    path.unlink()
    half.set_geometry(half.scale(0.5, 1.0, origin=(WEST + 500, NORTH))).to_file(path)
    assert [stage.name for stage in PLAN if Study.open(site).why_stale(stage)] == ["hazard", "report"]


def test_maxima_are_those_of_the_series(level):
    from structure_bodies import body, box

    made = build_structures([body(box((100, 100, 105), (20, 10, 18)))], level, (2.0, 2.0, 2.0))
    impulses = np.zeros((3, len(made.field.patches.area), 3))
    impulses[1] = -2.0 * made.field.patches.area[:, None] * made.field.patches.normal  # 4 Pa for half a second
    series = facade_series(StructureForces(made, np.array([0.0, 1.0, 1.5, 2.0]), impulses))
    found = maxima_of(series)
    assert found["max_facade_pressure"] == pytest.approx([4.0])
    assert found["max_facade_high_pressure"] == pytest.approx([4.0])
    assert found["time_of_max_facade_force"] == pytest.approx([1.5])
    assert found["max_facade_force"] == pytest.approx([4.0 * 200], rel=1e-5)  # that of the top: walls cancel
