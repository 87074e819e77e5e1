"""The sites of the repository: they can be read, their masses are the stated ones, and they run at coarse resolution."""

import filecmp
import runpy
from pathlib import Path

import numpy as np
import pytest

from runout import read_site, simulate
from runout.workflow.check import inspect

SITES = Path(__file__).parents[2] / "sites"
GRAVITY = 9.81


@pytest.mark.parametrize("name", ["jacksboro", "frank_slide", "cascades_2021"])
def test_site_is_valid_and_says_where_it_comes_from(name):
    site = read_site(SITES / name)
    readme = (SITES / name / "README.md").read_text(encoding="utf-8")
    assert site.name == name
    assert site.settings.ensemble.members == 8
    assert f"runout run sites/{name}" in readme
    assert "hypothetical" in (site.settings.description + readme).lower() or "Not calibrated" in readme


@pytest.mark.parametrize("name", ["frank_slide", "cascades_2021"])
def test_public_files_are_pinned_to_a_commit(name):
    settings = read_site(SITES / name).settings
    sources = [settings.terrain.dem, *(r.raster for r in settings.release)]
    assert len(sources) == 2
    for source in sources:
        assert any(commit in source.url for commit in ("62c76bc", "33b6215"))
        assert source.path.split("/")[-1] == source.url.split("/")[-1]


def test_jacksboro_release_is_called_hypothetical_wherever_it_is_named():
    import geopandas

    site = read_site(SITES / "jacksboro")
    assert "hypothetical" in site.settings.title.lower()
    assert "HYPOTHETICAL" in site.settings.description
    assert "hypothetical" in site.settings.release[0].name
    outline = geopandas.read_file(SITES / "jacksboro" / "inputs" / "release.gpkg")
    assert "HYPOTHETICAL" in outline.remark[0]
    assert outline.crs.to_epsg() == 32616


def test_jacksboro_release_lies_on_a_steep_slope_far_from_the_edge(mass_weighted_slope):
    site = read_site(SITES / "jacksboro")
    terrain = site.terrain()
    (release,) = site.releases(terrain)
    assert release.volume == pytest.approx(release.outline.area * 35.0, rel=1e-9)
    assert 5e6 < release.volume < 6.5e6
    assert mass_weighted_slope(release) > 23.0
    west, south, east, north = release.outline.bounds
    edges = terrain.extent
    assert min(west - edges[0], south - edges[1], edges[2] - east, edges[3] - north) > 3000.0


def test_jacksboro_release_is_what_its_script_draws():
    script = runpy.run_path(str(SITES / "jacksboro" / "inputs" / "make_release.py"))
    site = read_site(SITES / "jacksboro")
    (release,) = site.releases(site.terrain())
    assert release.outline.symmetric_difference(script["egg"]()).area == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("name", ["jacksboro", "frank_slide", "cascades_2021"])
def test_stiffness_of_a_site_is_chosen_by_its_flow_and_its_mass(name, request):
    """Waves at least four times as fast as the energy line, strain at most 2 %, and one of the two no more than that."""
    from runout.workflow.check_stiffness import member_stiffness

    if name != "jacksboro":
        monkeypatch = request.getfixturevalue("monkeypatch")
        monkeypatch.setenv("RUNOUT_DATA", str(request.getfixturevalue("data_folder")))
    site = read_site(SITES / name)
    assert site.settings.material.youngs_modulus == "auto"
    slow, fast = member_stiffness(
        site, site.releases(site.terrain()), None, [{"basal_friction_angle_deg": 19.0}, {"basal_friction_angle_deg": 10.0}]
    )
    for found in (slow, fast):
        assert found.wave_ratio > 3.99
        assert found.weight_strain < 0.0201
        assert found.wave_ratio < 4.05 or found.weight_strain > 0.0195
    assert fast.wave_speed >= slow.wave_speed


def test_frank_slide_raster_is_the_sliding_surface(data_folder, monkeypatch):
    """The authors' code starts from the thickness normal to its bed: the pile times the cosine of this raster's slope."""
    monkeypatch.setenv("RUNOUT_DATA", str(data_folder))
    site = read_site(SITES / "frank_slide")
    terrain = site.terrain()
    (release,) = site.releases(terrain)
    frames = np.fromfile(data_folder / "frank_slide_1903/shaltop_ref/delta_15/rho.bin", np.float32).reshape(-1, *terrain.shape)
    normal_thickness = frames[0, ::-1]  # stored south first
    thick = release.thickness > 20.0

    def mismatch(bed: np.ndarray) -> float:
        north, east = np.gradient(bed, *terrain.cell_size)
        vertical = normal_thickness * np.sqrt(1 + north**2 + east**2)
        return float(np.abs(vertical[thick] / release.thickness[thick] - 1).max())

    assert release.placement == "on_surface"
    assert release.volume == pytest.approx(36.0e6, rel=1e-4)
    assert mismatch(terrain.elevation) < 1e-5
    assert mismatch(terrain.elevation + release.thickness) > 0.1
    assert mismatch(terrain.elevation - release.thickness) > 0.1


def test_cascades_release_is_the_mapped_loss_of_elevation(data_folder, monkeypatch, mass_weighted_slope):
    monkeypatch.setenv("RUNOUT_DATA", str(data_folder))
    site = read_site(SITES / "cascades_2021")
    (release,) = site.releases(site.terrain())
    assert release.placement == "excavated"
    assert release.volume == pytest.approx(22_481.0, rel=1e-4)
    assert int((release.thickness > 0).sum()) == 30
    assert release.thickness.max() == pytest.approx(15.6922)
    assert mass_weighted_slope(release) > 25.0


@pytest.mark.parametrize("name", ["jacksboro", "frank_slide", "cascades_2021"])
def test_check_finds_no_problem_in_a_site(name, request):
    if name != "jacksboro":
        monkeypatch = request.getfixturevalue("monkeypatch")
        monkeypatch.setenv("RUNOUT_DATA", str(request.getfixturevalue("data_folder")))
    assert inspect(SITES / name).problems == []


@pytest.mark.parametrize(("name", "cell_size"), [("frank_slide", 60.0), ("cascades_2021", 8.0)])
def test_real_site_runs_at_coarse_resolution_and_keeps_its_mass(data_folder, monkeypatch, name, cell_size):
    monkeypatch.setenv("RUNOUT_DATA", str(data_folder))
    arguments = read_site(SITES / name).member_arguments({"basal_friction_angle_deg": 15.0})
    result = simulate(**{**arguments, "cell_size": cell_size, "end_time": 20.0, "threads": 1})
    mass = arguments["material"].density * sum(release.volume for release in arguments["release"])
    total = result.ledger.mass + result.ledger.escaped_mass
    np.testing.assert_allclose(total, mass, rtol=1e-5)
    drop = result.ledger.potential_energy[0] - result.ledger.potential_energy[-1]
    assert float(drop) > mass * GRAVITY * 20.0  # the mass fell by more than 20 m on average
    assert float(result.maps.max_speed.max()) > 5.0


def test_copies_in_the_cache_and_in_the_data_folder_are_the_same_inputs(data_folder, monkeypatch, tmp_path):
    from runout.config.fetch import cached_path

    site = read_site(SITES / "cascades_2021")
    monkeypatch.setenv("RUNOUT_DATA", str(data_folder))
    given = site.inputs()
    monkeypatch.delenv("RUNOUT_DATA")
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path))
    remotes = [site.settings.terrain.dem, site.settings.release[0].raster]
    for source, remote in zip(given, remotes, strict=True):
        cached_path(remote).write_bytes(source.read_bytes())
    cached = read_site(SITES / "cascades_2021").inputs()
    assert all(path.parent == tmp_path for path in cached)
    assert all(filecmp.cmp(a, b, shallow=False) for a, b in zip(given, cached, strict=True))
