"""A site of three classes of volume and two sources, from site.yaml to annual maps; every number is compared with the members."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import ramp_site

from runout.config.site import read_site
from runout.ensemble.member import plan_members
from runout.io import netcdf
from runout.io.member_maps import MemberMaps
from runout.quantities import MET
from runout.workflow.hazard_map import run

ROOT = Path(__file__).parents[2]
RELEASES = """\
  - {name: upper, raster: inputs/thickness.tif, placement: on_surface}
  - {name: side, raster: inputs/side.tif, placement: on_surface}
"""
ENSEMBLE = """\
ensemble:
  members: 1
  seed: 1
  scenarios:
    - {name: small, exceedance_return_period: 30, releases: [upper], parameters: {release_volume_factor: 0.3}}
    - name: middle
      exceedance_return_period: 100
      releases: [upper]
      members: 2
      parameters: {basal_friction_angle_deg: {distribution: uniform, low: 18, high: 22}}
    - {name: large, exceedance_return_period: 300, releases: [upper], parameters: {release_volume_factor: 1.5}}
    - {name: side, return_period: 50, releases: [side]}
hazard:
  thickness_thresholds: [0.1, 1]
  speed_thresholds: [1]
  unit_discharge_thresholds: [1]
  thickness_and_speed_thresholds: [1]
  joint: [{thickness: 0.5, speed: 4}, {thickness: 1, speed: 1}]
  percentiles: [50]
  return_periods: [30, 100, 300]
"""
RATES = np.array([1 / 30 - 1 / 100, 0.5 * (1 / 100 - 1 / 300), 0.5 * (1 / 100 - 1 / 300), 1 / 300, 1 / 50])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    text = ramp_site.SITE[: ramp_site.SITE.index("ensemble:")].replace("end_time: 20", "end_time: 6") + ENSEMBLE
    first, last = text.index("  - name: slab"), text.index("material:")
    folder = ramp_site.write_site(tmp_path_factory.mktemp("classes") / "site", text[:first] + RELEASES + text[last:])
    side = np.zeros((ramp_site.ROWS, ramp_site.COLUMNS))
    side[2:5, 12:16] = 5.0
    ramp_site.write_raster(folder / "inputs" / "side.tif", side)
    assert run(folder, workers=1).exit_code == 0
    return folder


def test_members_hold_the_releases_of_their_scenario_alone(site):
    members = netcdf.read(site / "results" / "members.nc")
    thickness = members["max_flow_thickness"].fillna(0.0).values
    on_upper, on_side = (thickness[:, rows, columns] for rows, columns in ((11, 7), (3, 13)))
    assert (on_upper > 0).tolist() == [True, True, True, True, False]
    assert (on_side > 0).tolist() == [False, False, False, False, True]
    np.testing.assert_allclose(members["annual_rate"], RATES, rtol=1e-12)
    np.testing.assert_allclose(members["weight"], RATES / (1 / 30 + 1 / 50), rtol=1e-12)


def test_members_are_events_for_climada(site):
    """What its reader of rasters takes: a map by event, north and east, rates by event, and the coordinate system."""
    members = netcdf.read(site / "results" / "members.nc")
    for name in ("max_flow_thickness", "max_speed", "max_pressure", "deposit_thickness"):
        assert members[name].dims == ("realization", "y", "x")
    assert members["annual_rate"].dims == members["scenario"].dims == ("realization",)
    assert len(set(members["realization"].values.tolist())) == members.sizes["realization"]
    assert members["crs"].attrs["crs_wkt"]


@pytest.mark.skipif("RUNOUT_CLIMADA" not in os.environ, reason="RUNOUT_CLIMADA names no Python that has the package climada")
def test_climada_reads_the_members_as_the_guide_says(site, tmp_path):
    """With the package itself, in an environment of its own: its GDAL and that of runout do not go together in one process."""
    guide = (ROOT / "docs" / "guide" / "outputs" / "members.md").read_text(encoding="utf-8").split("## In CLIMADA")[1]
    example = guide.split("```python")[1].split("```")[0]
    saved = f"import numpy\nnumpy.savez({str(tmp_path / 'read.npz')!r}, hazard.intensity.toarray(), hazard.frequency)\n"
    subprocess.run([os.environ["RUNOUT_CLIMADA"], "-c", example + saved], cwd=site, check=True, env={"PATH": os.environ["PATH"]})
    read, members = np.load(tmp_path / "read.npz"), netcdf.read(site / "results" / "members.nc")
    largest = members["max_flow_thickness"].fillna(0.0).values
    np.testing.assert_array_equal(read["arr_0"], largest.reshape(len(largest), -1))
    np.testing.assert_allclose(read["arr_1"], members["annual_rate"])


def test_annual_maps_are_those_of_the_members(site):
    results = site / "results"
    hazard, members = netcdf.read(results / "hazard.nc"), netcdf.read(results / "members.nc")
    thickness = members["max_flow_thickness"].fillna(0.0).values
    for k, limit in enumerate((0.1, 1.0)):
        rate = np.einsum("m,mij->ij", RATES, thickness >= np.float32(limit))
        np.testing.assert_allclose(hazard["thickness_annual_exceedance"].values[k], rate, rtol=1e-5)
    rarest = thickness.max(axis=0)  # every member is as frequent as once in 300 years
    np.testing.assert_array_equal(hazard["flow_thickness_at_return_period"].sel(return_period=300).fillna(0.0), rarest)
    yearly = hazard["flow_thickness_at_return_period"].sel(return_period=30).fillna(0.0).values
    together = thickness[:4].min(axis=0)  # source upper reaches 1 / 30 only with all of its members, source side never
    np.testing.assert_array_equal(yearly[:, :3], together[:, :3])
    assert (yearly > 0).any()
    text = (results / "report.html").read_text(encoding="utf-8")
    assert "annual rates and conditional probabilities" in text
    assert "Area reached once in 100 years or more often" in text
    assert "No events beyond the scenarios" in text


def test_joint_conditions_are_those_that_members_record_at_one_time(site):
    """Of unequal thresholds: by the record of each member. Its cells are fewer than those of both maxima."""
    hazard, table = netcdf.read(site / "results" / "hazard.nc"), netcdf.read(site / "results" / "members.nc")
    met, both = [], []
    for file in table["file"].values:
        with MemberMaps(site / "results" / "members" / file) as member:
            assert json.loads(member.attributes["joint_conditions"]) == [{"speed": 4.0, "thickness": 0.5}]
            met.append(member.layer(MET, None) == 1)
            both.append((member.layer("max_flow_thickness", None) >= 0.5) & (member.layer("max_speed", None) >= 4.0))
    assert 0 < np.sum(met) < np.sum(both)
    assert not (np.array(met) & ~np.array(both)).any()
    rate = np.einsum("m,mij->ij", RATES, met)
    np.testing.assert_allclose(hazard["joint_annual_exceedance"].values[0], rate, rtol=1e-5, atol=1e-9)
    assert hazard["joint_condition"].values.tolist() == [
        "flow thickness >= 0.5 m and flow speed >= 4 m s-1 at one time",
        "flow thickness >= 1 m and flow speed >= 1 m s-1 at one time",
    ]


@pytest.mark.parametrize("name", ["unit_discharge", "thickness_and_speed"])
def test_thickness_and_speed_together_have_thresholds(site, name):
    hazard, members = (netcdf.read(site / "results" / file) for file in ("hazard.nc", "members.nc"))
    largest = members[f"max_{name}"].fillna(0.0).values
    peaks = members["max_flow_thickness"].fillna(0.0).values, members["max_speed"].fillna(0.0).values
    bound = peaks[0] * peaks[1] if name == "unit_discharge" else np.minimum(*peaks)
    assert (largest <= 1.001 * bound + 1e-6).all()  # of one time, and not of the maxima
    assert (largest < 0.9 * bound).any()
    rate = np.einsum("m,mij->ij", RATES, largest >= np.float32(1.0))
    assert 0.0 < rate.max() <= RATES.sum() * 1.001
    np.testing.assert_allclose(hazard[f"{name}_annual_exceedance"].values[0], rate, rtol=1e-5)


def test_a_change_of_rates_makes_new_maps_of_the_same_members(site):
    before = [member.key for member in plan_members(read_site(site))]
    file = site / "site.yaml"
    file.write_text(file.read_text().replace("return_period: 50, releases", "return_period: 25, releases"))
    assert [member.key for member in plan_members(read_site(site))] == before
    outcome = run(site, stages=("ensemble", "hazard"), workers=1)
    assert outcome.done == ("hazard",)
    hazard = netcdf.read(site / "results" / "hazard.nc")
    assert float(hazard["thickness_annual_exceedance"].values[0, 3, 13]) == pytest.approx(1 / 25)
