"""A site with friction zones and with obstacles: from site.yaml to maps, and every way in which they can be wrong."""

import geopandas
import numpy as np
import pytest
import shapely
from ramp_site import CELL, COLUMNS, NORTH, ROWS, SITE, WEST, write_site

import runout
from runout import cli
from runout.config.site import read_site
from runout.errors import ConfigError
from runout.workflow import hazard_map
from runout.workflow.check import inspect

SOUTH = NORTH - ROWS * CELL
PLAIN = shapely.box(WEST + 250.0, SOUTH, WEST + COLUMNS * CELL + 50.0, NORTH)
DAM = shapely.box(WEST + 300.0, SOUTH, WEST + 330.0, NORTH)
DAMMED = SITE.replace("tif\nrelease", "tif\n  obstacles: [{polygons: inputs/zones.gpkg, height: height}]\nrelease")
ZONED = SITE.replace("tif\nrelease", "tif\n  friction_zones:\n    - {polygons: inputs/zones.gpkg, ZONE}\nrelease")


def write_zoned(folder, zone, text=ZONED, polygons=(PLAIN,), **attributes):
    write_site(folder, text.replace("ZONE", zone))
    frame = geopandas.GeoDataFrame(attributes, geometry=list(polygons), crs="EPSG:32632")
    frame.to_file(folder / "inputs" / "zones.gpkg", engine="pyogrio")
    return folder


def front(folder):
    """Easting [m] that the first member reaches."""
    site = read_site(folder)
    peak = runout.simulate(**site.member_arguments()).fields["max_flow_thickness"]
    return WEST + CELL * (1 + np.flatnonzero((peak > 0.1).any(axis=0)).max())


def test_rough_ground_stops_the_flow_earlier_and_smooth_ground_later(tmp_path):
    fronts = {}
    for name, zone, attributes in (
        ("rough", "basal_friction_angle_deg: 45", {}),
        ("plain", "factor: 1.0", {}),
        ("smooth", "factor: friction", {"friction": [0.5]}),
    ):
        fronts[name] = front(write_zoned(tmp_path / name, zone, **attributes))
    assert fronts["plain"] == front(write_site(tmp_path / "without"))
    assert fronts["rough"] < fronts["plain"] < fronts["smooth"]


def test_zones_are_in_the_plan_the_products_and_the_report(tmp_path, capsys):
    folder = write_zoned(tmp_path / "ramp", "factor: 1.5", ZONED.replace("members: 4", "members: 2"))
    assert cli.main(["check", str(folder)]) == 0
    assert "friction zones: 1 on 6e+04 m2; friction times 1.5 to 1.5" in " ".join(capsys.readouterr().out.split())
    hazard_map.run(folder, workers=1)
    drawn = geopandas.read_file(folder / "results" / "outlines.gpkg", layer="friction_zones")
    assert drawn.geometry[0].area == pytest.approx(6e4)
    assert drawn["factor"].tolist() == [1.5]
    assert drawn["basal_friction_angle_deg"].isna().all()
    report = (folder / "results" / "report.html").read_text()
    assert "dashed lines are those of friction zones" in report
    assert "inputs/zones.gpkg" in report
    assert [p.name for p in read_site(folder).inputs()] == ["dem.tif", "thickness.tif", "zones.gpkg"]
    assert "nothing: it is up to date" in (cli.main(["check", str(folder)]), capsys.readouterr().out)[1]
    frame = geopandas.GeoDataFrame(geometry=[PLAIN.buffer(-20.0)], crs="EPSG:32632")
    frame.to_file(folder / "inputs" / "zones.gpkg", engine="pyogrio")
    cli.main(["check", str(folder)])
    assert "2 of 2 members to simulate" in capsys.readouterr().out


def test_every_problem_of_zones_is_named(tmp_path):
    both = ZONED.replace("ZONE", "factor: 2, basal_friction_angle_deg: 30}\n    - {polygons: inputs/zone.gpkg")
    folder = write_zoned(tmp_path / "ramp", "", both)
    with pytest.raises(ConfigError) as found:
        read_site(folder)
    said = [str(problem) for problem in found.value.problems]
    assert any("terrain.friction_zones[0]: factor and basal_friction_angle_deg are both given" in line for line in said)
    none = "terrain.friction_zones[1]: none of factor, basal_friction_angle_deg and basal_friction is given"
    assert any(none in line for line in said)
    assert any("there is no file 'inputs/zone.gpkg'; did you mean 'inputs/zones.gpkg'?" in line for line in said)
    wrong = write_zoned(tmp_path / "wrong", "factor: friction", friction=[-1.0])
    assert any(
        "attribute 'friction' of polygon 1 is -1; it must be at least 0 and at most 10" in problem
        for problem in inspect(wrong).problems
    )


def test_a_dam_holds_the_flow_and_a_low_one_is_overrun(tmp_path, capsys):
    high, low = (write_zoned(tmp_path / name, "", DAMMED, (DAM,), height=[up]) for name, up in (("high", 20.0), ("low", 0.5)))
    without = front(write_site(tmp_path / "without"))
    assert without > WEST + 340.0
    assert front(high) <= WEST + 320.0  # up its side, not over it
    assert WEST + 320.0 < front(low) <= without
    assert cli.main(["check", str(high)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "obstacles on 7200 m2 change the ground by 20 to 20 m" in out
    assert "the narrowest obstacle is about 26.7 m wide" not in out
    assert "the lowest obstacle" not in out
    assert "the lowest obstacle is 0.5 m high, less than one cell of 10 m" in " ".join(inspect(low, forecast=False).warnings)
    wide = write_zoned(tmp_path / "wide", "", DAMMED.replace("cell_size: 10", "cell_size: 20"), (DAM,), height=[20.0])
    assert any(
        "the narrowest obstacle is about 26.7 m wide, less than two cells of 20 m" in line for line in inspect(wide).warnings
    )
