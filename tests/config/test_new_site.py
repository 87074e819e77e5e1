"""A new site folder: it can be read at once, its comments are the descriptions, and nothing half-made is left."""

import errno
import shutil

import numpy as np
import pytest

from runout import read_site
from runout.config.material import sampled_ranges
from runout.config.read import load
from runout.config.scaffold import commented_yaml, new_site
from runout.config.schema import SiteSettings
from runout.errors import DemError, InputError, StorageError
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS


@pytest.fixture
def inputs(site_folder):
    return site_folder / "inputs"


def test_new_site_can_be_read_and_releases_its_mass(tmp_path, inputs):
    import geopandas

    outline = geopandas.read_file(inputs / "release.geojson").rename(columns={"depth": "thickness"})
    outline.set_crs("EPSG:32632", allow_override=True).to_file(tmp_path / "scar.gpkg")
    made = new_site(tmp_path / "sites" / "my slope", inputs / "dem.asc", tmp_path / "scar.gpkg")
    site = read_site(made)
    assert site.name == "my-slope"
    assert [p.name for p in site.inputs()] == ["dem.asc", "release.gpkg"]
    assert site.settings.simulation.cell_size == 10.0
    assert site.settings.release[0].thickness == "thickness"
    assert site.releases(site.terrain())[0].volume == pytest.approx(6400.0)


def test_parts_of_a_shapefile_come_along_under_the_new_name(tmp_path, inputs):
    import geopandas

    geopandas.read_file(inputs / "release.geojson").to_file(tmp_path / "a.b.shp")
    made = new_site(tmp_path / "site", inputs / "dem.asc", tmp_path / "a.b.shp")
    copied = {p.name for p in (made.parent / "inputs").iterdir()}
    assert copied == {"dem.asc", "release.shp", "release.shx", "release.dbf", "release.prj", "release.cpg"}


def test_thickness_raster_and_sample_elevation_are_accepted(tmp_path, inputs):
    made = new_site(tmp_path / "site", "matplotlib:jacksboro_fault_dem", inputs / "dem.asc")
    settings = load(made)
    assert settings.terrain.dem == "matplotlib:jacksboro_fault_dem"
    assert settings.release[0].raster == "inputs/release.asc"
    assert settings.simulation.cell_size == pytest.approx(83.0)


def every_field(model, path=()):
    from runout.config.problems import inner_model

    for name, field in model.model_fields.items():
        yield (*path, name), field
        inner = inner_model(field.annotation)
        if inner and name not in ("dem", "raster", "material", "basal_friction", "parameters"):
            yield from every_field(inner, (*path, name))


def test_every_setting_is_in_the_new_file_with_its_description(site_folder):
    text = commented_yaml(load(site_folder))
    joined = " ".join(line.strip().removeprefix("#").strip() for line in text.splitlines())
    fields = list(every_field(SiteSettings))
    assert len(fields) > 35
    for path, field in fields:
        assert field.description, f"{path} has no description"
        short = {"budget", "metadata", "friction_zones", "obstacles", "structures", "observations", "report", "joint", "probes"}
        short.add("stability")
        in_one_line = short & set(path[:-1])
        if not in_one_line:
            assert field.description in joined, f"{path} is not described"


def test_every_optional_setting_is_valid_when_its_comment_sign_is_removed(site_folder):
    text = commented_yaml(load(site_folder))
    offered = [line for line in text.splitlines() if line.lstrip().startswith("# ") and ": " in line]
    for key in ("resolution: 10", "volume: 1e5", "budget: {hours: 1, memory_gb: 8, disk_gb: 2}"):
        (line,) = [line for line in offered if line.strip() == f"# {key}"]
        (site_folder / "site.yaml").write_text(text.replace(line, line.replace("# ", "", 1)), encoding="utf-8")
        load(site_folder)


def test_written_settings_read_back_as_they_were(edited):
    edited("title: A tilted plane", 'title: "A \\"steep\\" slope: no, 100 %"\ndescription: "12"')
    edited("density: 2000", "density: 1850.5")
    folder = edited("thickness: 4.0", "thickness: 4.125")
    before = load(folder)
    (folder / "site.yaml").write_text(commented_yaml(before), encoding="utf-8")
    assert load(folder) == before


def test_every_parameter_that_may_be_sampled_is_named_in_the_comment(site_folder):
    text = commented_yaml(load(site_folder))
    assert all(name in text for name in sampled_ranges(LAWS.find("granular_flow"), FRICTIONS.find("coulomb")))


def test_folder_in_use_is_left_as_it_is(site_folder, inputs):
    before = (site_folder / "site.yaml").read_bytes()
    with pytest.raises(InputError, match="is there already; choose another name or remove it"):
        new_site(site_folder, inputs / "dem.asc", inputs / "release.geojson")
    assert (site_folder / "site.yaml").read_bytes() == before


def test_empty_folder_is_filled(tmp_path, inputs):
    (tmp_path / "empty").mkdir()
    assert new_site(tmp_path / "empty", inputs / "dem.asc", inputs / "release.geojson").is_file()


@pytest.mark.parametrize(
    ("dem", "release", "error", "said"),
    [
        ("dme.asc", "release.geojson", InputError, r"no such elevation file; did you mean .*dem\.asc"),
        ("dem.asc", "relase.geojson", InputError, r"no such release file; did you mean .*release\.geojson"),
        ("dem.asc", "notes.txt", InputError, r"notes.txt: cannot be read as a raster .* a release is polygons \(GeoPackage,"),
        ("dem.asc", "broken.gpkg", InputError, "cannot be read"),
        ("release.geojson", "release.geojson", DemError, "release.geojson"),
    ],
)
def test_input_that_cannot_be_used_is_refused_and_nothing_is_made(tmp_path, inputs, dem, release, error, said):
    for name in ("notes.txt", "broken.gpkg"):
        (inputs / name).write_text("nothing", encoding="utf-8")
    with pytest.raises(error, match=said):
        new_site(tmp_path / "made" / "site", inputs / dem, inputs / release)
    assert not (tmp_path / "made").exists() or not list((tmp_path / "made").iterdir())


def test_full_disk_is_said_and_nothing_half_made_is_left(tmp_path, inputs, monkeypatch):
    def full(source, target):
        raise OSError(errno.ENOSPC, "No space left on device", str(target))

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(StorageError, match="the disk is full"):
        new_site(tmp_path / "made" / "site", inputs / "dem.asc", inputs / "release.geojson")
    assert list((tmp_path / "made").iterdir()) == []


def test_cell_size_is_rounded_to_two_digits(tmp_path, inputs):
    text = (inputs / "dem.asc").read_text(encoding="utf-8").replace("cellsize 10", "cellsize 4.9977")
    (tmp_path / "fine.asc").write_text(text, encoding="utf-8")
    made = new_site(tmp_path / "site", tmp_path / "fine.asc", inputs / "release.geojson")
    np.testing.assert_allclose(load(made).simulation.cell_size, 5.0, rtol=1e-12)


@pytest.fixture
def outline(tmp_path, inputs):
    """Writes the release polygon with other attributes; returns its path."""
    import geopandas

    def write(name="scar.gpkg", **attributes):
        frame = geopandas.read_file(inputs / "release.geojson").set_crs("EPSG:32632", allow_override=True)
        geopandas.GeoDataFrame(attributes, geometry=frame.geometry.tolist(), crs=frame.crs).to_file(tmp_path / name)
        return tmp_path / name

    return write


@pytest.mark.parametrize("name", ["depth", "Height", "THICK", "h", "d0", "relTh", "Mächtigkeit", "rel_th", "épaisseur"])
def test_thickness_attribute_is_found_under_its_usual_names(tmp_path, inputs, outline, caplog, name):
    with caplog.at_level("INFO"):
        made = new_site(tmp_path / "site", inputs / "dem.asc", outline(**{"id": [7], name: [3.5]}))
    assert load(made).release[0].thickness == name
    assert f"thickness from the attribute {name!r}, 3.5 to 3.5 m" in caplog.text


def test_long_name_cut_by_a_shapefile_and_number_as_text_are_found(tmp_path, inputs, outline):
    made = new_site(tmp_path / "site", inputs / "dem.asc", outline("scar.shp", release_thickness=["3.5"]))
    assert load(made).release[0].thickness == "release_th"


def test_several_thickness_attributes_are_named_and_one_is_asked_for(tmp_path, inputs, outline):
    path = outline(depth=[3.0], height=[4.0])
    with pytest.raises(InputError, match=r"2 attributes may hold the thickness: 'depth', 'height'; name .* --thickness depth"):
        new_site(tmp_path / "site", inputs / "dem.asc", path)
    assert load(new_site(tmp_path / "one", inputs / "dem.asc", path, "height")).release[0].thickness == "height"
    assert load(new_site(tmp_path / "two", inputs / "dem.asc", path, "6.5")).release[0].thickness == 6.5
    with pytest.raises(InputError, match="no attribute 'tihckness' for the thickness; attributes: 'depth', 'height'"):
        new_site(tmp_path / "three", inputs / "dem.asc", path, "tihckness")
    assert (
        load(new_site(tmp_path / "four", inputs / "dem.asc", outline(depth=[3.0], thickness=[4.0]))).release[0].thickness
        == "thickness"
    )


def test_attribute_that_holds_no_thickness_is_left_and_said(tmp_path, inputs, outline, caplog):
    made = new_site(tmp_path / "site", inputs / "dem.asc", outline(depth=["deep"], height=[8848.0]))
    assert load(made).release[0].thickness == 10.0
    assert "'depth' is not taken for the thickness" in caplog.text
    assert "site.yaml states 10 m: edit it, or make the site anew with --thickness" in caplog.text
