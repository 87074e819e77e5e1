"""Releases of several laws in a site: the example of the documentation, what check says, an ensemble, an erodible bed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml
from ramp_site import CELL, NORTH, SITE, WEST, write_site

import runout
from runout import Bed, DruckerPrager, EnergyErosion, GranularFlow, HerschelBulkley, Voellmy, cli
from runout.errors import ExitCode
from runout.forecast.engine_notes import laws_of
from runout.simulation.single import simulate
from runout.workflow.check import inspect
from runout.workflow.check_physics import least_friction
from runout.workflow.compilation import _Kernels

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "site_yaml" / "release.md"


def example():
    """The block of the documentation."""
    section = PAGE.read_text(encoding="utf-8").split("## Laws of a release", 1)[1]
    return yaml.safe_load(section.split("```yaml\n", 1)[1].split("```", 1)[0])


def square(folder, name, row, column):
    """A square of 60 m whose north-western corner is a corner of the raster's cells."""
    x, y = WEST + column * CELL, NORTH - row * CELL
    ring = [[x, y], [x + 60, y], [x + 60, y - 60], [x, y - 60], [x, y]]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})
    (folder / "inputs" / f"{name}.geojson").write_text(text)


@pytest.fixture
def folder(tmp_path):
    """The site of the ramp with the releases of the documentation."""
    site, stated = yaml.safe_load(SITE), example()
    for release in stated["release"]:
        release["polygons"] = release["polygons"].replace(".gpkg", ".geojson")
    site["release"] = stated["release"]
    site["ensemble"] |= {"members": 2, "parameters": site["ensemble"]["parameters"] | stated["ensemble"]["parameters"]}
    site["simulation"] |= {"backend": "reference", "end_time": 2, "particles_per_cell": [1, 1, 2]}
    made = write_site(tmp_path / "site", yaml.safe_dump(site, sort_keys=False))
    square(made, "rock", 3, 5)
    square(made, "mud", 14, 5)
    return made


def test_check_accepts_the_example_and_names_what_each_release_has(folder, capsys):
    found = inspect(folder)
    assert found.problems == []
    site = found.site
    assert [m.law for m in site.materials(found.releases)] == ["drucker_prager", "herschel_bulkley"]
    assert least_friction(site, found.releases) == pytest.approx(np.arctan(0.03), abs=0.02)
    assert cli.main(["check", str(folder)]) == ExitCode.OK
    said = capsys.readouterr().out
    assert "stiffness rock: youngs_modulus 2e+06 Pa (stated)" in said
    assert "stiffness mud: youngs_modulus" in said


def test_forecasts_know_the_laws_of_releases(folder):
    site = runout.read_site(folder)
    kernels = _Kernels.of(site.with_settings(simulation=site.settings.simulation.model_copy(update={"backend": "scan"})))
    assert [m.law for m in kernels.materials] == ["drucker_prager", "herschel_bulkley"]
    assert [f.law for f in kernels.frictions] == ["coulomb", "voellmy"]
    assert len(laws_of(site.member_arguments())) == 4


def test_an_ensemble_of_the_example_samples_one_release(folder):
    assert cli.main(["run", str(folder), "--workers", "1"]) == ExitCode.OK
    members = xr.open_dataset(folder / "results" / "members.nc")
    stresses = members["mud.yield_stress"]
    assert (stresses.attrs["units"], stresses.sizes) == ("Pa", {"realization": 2})
    assert np.all((stresses.values >= 1000) & (stresses.values <= 2000))
    assert np.ptp(stresses.values) > 0
    assert "release mud" in members["mud.basal_mu"].attrs["long_name"]


def test_a_zone_with_an_angle_is_refused_beside_a_law_without_one(folder):
    text = (folder / "site.yaml").read_text()
    zone = "terrain:\n  friction_zones:\n  - {polygons: inputs/rock.geojson, basal_friction_angle_deg: 30}\n"
    (folder / "site.yaml").write_text(text.replace("terrain:\n", zone))
    (problem,) = inspect(folder).problems
    assert "terrain.friction_zones[0].basal_friction_angle_deg: release mud follows the friction law voellmy" in str(problem)
    assert "write factor" in str(problem)


def test_a_bed_is_eroded_by_the_friction_of_the_mass_above(folder):
    """Erosion by the energy that the friction of the flow takes: each mass has its own law."""
    site = runout.read_site(folder)
    arguments = site.member_arguments()
    bed = Bed(depth=4.0, erosion=EnergyErosion(specific_energy=200.0))
    result = simulate(**{**arguments, "bed": bed, "end_time": 3.0, "particles_per_cell": (2, 2, 2)})
    series = result.series
    assert series["entrained_mass"][-1] > 0
    total = series["mass"] + series["escaped_mass"] - series["entrained_mass"]
    np.testing.assert_allclose(total, total[0], rtol=1e-12)


def test_python_takes_releases_of_several_laws():
    terrain = runout.Terrain(np.repeat(np.linspace(60.0, 0.0, 31)[None, :], 24, 0), (5.0, 5.0))
    thickness = np.zeros((2, 24, 31))
    thickness[0, 4:8, 3:7], thickness[1, 14:18, 3:7] = 2.0, 2.0
    grains = GranularFlow(static_friction=0.4, dynamic_friction=0.7, grain_size=0.1)
    mud = HerschelBulkley(yield_stress=1500.0, consistency=200.0)
    releases = [
        runout.Release(t, terrain, placement="on_surface", name=name, material=material, basal_friction=friction)
        for t, name, material, friction in zip(thickness, "ab", (grains, mud), (None, Voellmy(mu=0.05, xi=300.0)), strict=True)
    ]
    run = {"cell_size": 5.0, "end_time": 2.0, "backend": "reference", "particles_per_cell": (1, 1, 2)}
    result = simulate(terrain, releases, DruckerPrager(friction_angle=30.0), basal_friction_angle=25.0, **run)
    assert result.series["mass"][-1] == pytest.approx(result.series["mass"][0], rel=1e-12)
    lost = result.series["basal_dissipation"] + result.series["plastic_dissipation"]
    assert np.all(np.diff(lost) >= 0)
    like = [replace(r, material=None, basal_friction=None) for r in releases]
    other = simulate(terrain, like, DruckerPrager(friction_angle=30.0), basal_friction_angle=25.0, **run)
    assert abs(other.series["kinetic_energy"][-1] / result.series["kinetic_energy"][-1] - 1) > 0.02
