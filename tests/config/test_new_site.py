"""A new site folder: it can be read at once, its comments are the descriptions, and nothing half-made is left."""

import errno
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from pyproj import CRS

from runout import read_site
from runout.config.material import sampled_ranges
from runout.config.read import load
from runout.config.scaffold import commented_yaml, new_site
from runout.config.schema import SiteSettings
from runout.errors import ConfigError, DemError, InputError, StorageError
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
        short |= {"stability", "pore_pressure", "velocity", "starts_when", "scenarios", "bed", "inflow"}
        in_one_line = short & set(path[:-1])
        if not in_one_line:
            assert field.description in joined, f"{path} is not described"


def test_every_optional_setting_is_valid_when_its_comment_sign_is_removed(site_folder):
    text = commented_yaml(load(site_folder))
    offered = [line for line in text.splitlines() if line.lstrip().startswith("# ") and ": " in line]
    unchanged = load(site_folder)
    for key in ("resolution: 10", "volume: 1e5", "budget: {hours: 1, memory_gb: 8, disk_gb: 2}"):
        (line,) = [line for line in offered if line.strip() == f"# {key}"]
        (site_folder / "site.yaml").write_text(text.replace(line, line.replace("# ", "", 1)), encoding="utf-8")
        assert load(site_folder) != unchanged, key


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


@pytest.mark.parametrize(
    ("dem", "release", "said"),
    [
        ("none.asc", "gone.gpkg", r"none\.asc: there is no such elevation file.*\n.*gone\.gpkg: there is no such release file"),
        ("/vsizip/a.zip/dem.tif", "release.geojson", "is no file on this machine; download or unpack it"),
        ("https://example.org/dem.tif", "release.geojson", "is no file on this machine; download or unpack it"),
        (".", "release.geojson", "is a folder; name the elevation file in it"),
        ("dem.asc", ".", "is a folder; name the release file in it"),
        ('NETCDF:"none.nc":z', "release.geojson", r"none\.nc: there is no such elevation file"),
    ],
)
def test_inputs_that_are_no_files_are_named_all_at_once(tmp_path, inputs, monkeypatch, dem, release, said):
    monkeypatch.chdir(inputs)
    with pytest.raises(InputError, match=said):
        new_site(tmp_path / "site", dem, release)
    assert not (tmp_path / "site").exists()


@pytest.mark.parametrize("kind", ["LineString", "Point"])
def test_a_release_of_lines_or_points_is_refused_with_the_remedy(tmp_path, inputs, outline, kind):
    import geopandas

    frame = geopandas.read_file(outline())
    line = frame.geometry.exterior.apply(lambda ring: type(ring.centroid)(ring.coords[0]) if kind == "Point" else ring)
    if kind == "LineString":
        from shapely import LineString

        line = line.apply(LineString)
    frame.set_geometry(line).to_file(tmp_path / "line.gpkg", engine="pyogrio")
    with pytest.raises(InputError, match=f"line.gpkg: holds {kind}; draw polygons"):
        new_site(tmp_path / "site", inputs / "dem.asc", tmp_path / "line.gpkg")
    assert not (tmp_path / "site").exists()


def test_a_named_pipe_is_refused_at_once(tmp_path, inputs):
    os.mkfifo(tmp_path / "pipe.gpkg")
    for sources in ((inputs / "dem.asc", tmp_path / "pipe.gpkg"), (tmp_path / "pipe.gpkg", inputs / "release.geojson")):
        with pytest.raises(InputError, match=r"pipe\.gpkg: is a named pipe, not a file"):
            new_site(tmp_path / "site", *sources)


def test_one_of_several_layers_is_named_and_stated(tmp_path, inputs, outline):
    import geopandas

    frame = geopandas.read_file(outline(depth=[3.0]))
    for layer in ("old", "new"):
        frame.to_file(tmp_path / "two.gpkg", layer=layer, engine="pyogrio")
    with pytest.raises(InputError, match=r"holds 2 layers \(old, new\); name the one with the release, for example --layer old"):
        new_site(tmp_path / "site", inputs / "dem.asc", tmp_path / "two.gpkg")
    release = load(new_site(tmp_path / "site", inputs / "dem.asc", tmp_path / "two.gpkg", layer="new")).release[0]
    assert (release.polygons, release.layer, release.thickness) == ("inputs/release.gpkg", "new", "depth")


def test_a_release_raster_of_any_form_of_a_dem_is_accepted(tmp_path, inputs):
    import rasterio.shutil

    for number, (driver, name) in enumerate({"GSAG": "h.grd", "SAGA": "h.sdat", "XYZ": "h.xyz", "BT": "h.bt"}.items()):
        rasterio.shutil.copy(inputs / "dem.asc", tmp_path / name, driver=driver)
        release = load(new_site(tmp_path / f"site{number}", inputs / "dem.asc", tmp_path / name)).release[0]
        assert release.raster == f"inputs/release{name[1:]}"
    for option in ({"thickness": "3"}, {"layer": "a"}):
        with pytest.raises(InputError, match=f"is a raster, .* leave --{next(iter(option))} out"):
            new_site(tmp_path / "other", inputs / "dem.asc", tmp_path / "h.xyz", **option)


def degrees(path):
    """An ASCII grid in degrees that states no coordinate system, with 3 m a cell to the east."""
    rows = "\n".join(" ".join(str(1500 + 9 * row + 5 * column) for column in range(40)) for row in range(40))
    head = "ncols 40\nnrows 40\nxllcorner 10.73\nyllcorner 46.85\ncellsize 0.000833333333\n"
    path.write_text(head + rows + "\n", encoding="utf-8")
    return path


def test_a_system_that_the_raster_does_not_state_is_stated_for_the_site(tmp_path):
    import geopandas
    from shapely import box

    dem = degrees(tmp_path / "srtm.asc")
    geopandas.GeoDataFrame({"h": [3.0]}, geometry=[box(10.74, 46.86, 10.75, 46.87)], crs="EPSG:4326").to_file(tmp_path / "r.gpkg")
    with pytest.raises(DemError, match=r"state crs: EPSG:4326; `runout new --crs EPSG:CODE` states it"):
        new_site(tmp_path / "site", dem, tmp_path / "r.gpkg")
    site = read_site(new_site(tmp_path / "site", dem, tmp_path / "r.gpkg", crs="EPSG:4326"))
    assert site.settings.terrain.crs == "EPSG:4326"
    assert site.terrain().crs.startswith('PROJCRS["WGS 84 / UTM zone 32N"')
    assert site.releases(site.terrain())[0].volume > 0
    with pytest.raises(DemError, match="crs 'EPSG:1' is not known"):
        new_site(tmp_path / "other", dem, tmp_path / "r.gpkg", crs="EPSG:1")


def test_a_system_beside_that_of_the_file_is_refused(tmp_path, inputs):
    (inputs / "dem.prj").write_text(CRS.from_epsg(32632).to_wkt("WKT1_ESRI"), encoding="utf-8")
    with pytest.raises(DemError, match=r"the file states WGS.* zone.32N, crs says WGS 84 / UTM zone 33N; leave crs away"):
        new_site(tmp_path / "site", inputs / "dem.asc", inputs / "release.geojson", crs="EPSG:32633")
    made = new_site(tmp_path / "site", inputs / "dem.asc", inputs / "release.geojson", crs="EPSG:32632")
    assert read_site(made).terrain().crs.startswith('PROJCRS["WGS 84 / UTM zone 32N"')


def test_inputs_that_share_their_name_and_side_file_are_kept_apart(tmp_path, inputs):
    (inputs / "dem.prj").write_text(CRS.from_epsg(32632).to_wkt("WKT1_ESRI"), encoding="utf-8")
    made = new_site(tmp_path / "site", inputs / "dem.asc", inputs / "dem.asc")
    assert {p.name for p in (made.parent / "inputs").iterdir()} == {"dem.asc", "dem.prj", "release.asc", "release.prj"}


def test_a_variable_of_a_netcdf_file_is_an_input_of_the_site(tmp_path, inputs):
    import netCDF4

    with netCDF4.Dataset(tmp_path / "two.nc", "w") as file:
        for name, values in {"y": 5000195.0 - 10 * np.arange(20), "x": 500005.0 + 10 * np.arange(30)}.items():
            file.createDimension(name, len(values))
            file.createVariable(name, "f8", (name,))[:] = values
            file[name].standard_name = f"projection_{name}_coordinate"
        for name in ("ground", "canopy"):
            file.createVariable(name, "f4", ("y", "x"))[:] = np.add.outer(np.arange(20.0), 5 * np.arange(30.0)) + 100
            file[name].grid_mapping = "crs"
        file.createVariable("crs", "i4").spatial_ref = "EPSG:32632"
    name = f'NETCDF:"{tmp_path / "two.nc"}":ground'
    site = read_site(new_site(tmp_path / "site", name, inputs / "release.geojson", "3"))
    assert site.settings.terrain.dem == 'NETCDF:"inputs/dem.nc":ground'
    assert [p.name for p in site.inputs()] == ["dem.nc", "release.geojson"]
    assert site.terrain().shape == (20, 30)
    (site.folder / "inputs" / "dem.nc").unlink()
    with pytest.raises(ConfigError, match=r"terrain\.dem: there is no file 'NETCDF"):
        load(site.folder)


def test_the_folder_in_which_a_shell_stands_is_filled_and_stays(tmp_path, inputs, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert read_site(new_site(".", inputs / "dem.asc", inputs / "release.geojson")).name == "here"
    assert sorted(os.listdir(".")) == [".site.schema.json", "inputs", "site.yaml"]
    assert not [name for name in os.listdir(tmp_path) if name.endswith(".part")]


def test_inputs_in_the_folder_of_the_site_are_not_to_be_removed(tmp_path, inputs):
    with pytest.raises(InputError, match=r"is there already; choose another name or remove it; move .*dem\.asc elsewhere before"):
        new_site(inputs, inputs / "dem.asc", inputs / "release.geojson")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows names files in Unicode")
def test_names_outside_of_ascii_are_read_in_any_locale(tmp_path, inputs):
    (inputs / "dem.asc").rename(inputs / "Höhe;1.asc")
    (inputs / "release.geojson").rename(inputs / "Anriß.geojson")
    ascii_only = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "runout", "new", "Süd hang", "--dem", "inputs/Höhe;1.asc", "--release", "inputs/Anriß.geojson"]
    done = subprocess.run([part.encode() if isinstance(part, str) else part for part in command], env=ascii_only,
                          cwd=inputs.parent, capture_output=True)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "then: runout check 'Süd hang'" in done.stderr.decode() + done.stdout.decode()
    assert load(inputs.parent / "Süd hang").terrain.dem == "inputs/dem.asc"


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


def test_cells_that_no_run_can_have_are_refused(tmp_path, inputs):
    text = (inputs / "dem.asc").read_text(encoding="utf-8").replace("cellsize 10", "cellsize 20000")
    (tmp_path / "coarse.asc").write_text(text, encoding="utf-8")
    with pytest.raises(DemError, match=r"coarse\.asc: size of the cells is 20000 m; it must be"):
        new_site(tmp_path / "site", tmp_path / "coarse.asc", inputs / "release.geojson")
    assert not (tmp_path / "site").exists()


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
    with pytest.raises(InputError, match="thickness is 0 m; it must be at least 1e-05"):
        new_site(tmp_path / "none", inputs / "dem.asc", path, "0")
    assert (
        load(new_site(tmp_path / "four", inputs / "dem.asc", outline(depth=[3.0], thickness=[4.0]))).release[0].thickness
        == "thickness"
    )


def test_attribute_that_holds_no_thickness_is_left_and_said(tmp_path, inputs, outline, caplog):
    made = new_site(tmp_path / "site", inputs / "dem.asc", outline(depth=["deep"], height=[8848.0]))
    assert load(made).release[0].thickness == 10.0
    assert "'depth' is not taken for the thickness" in caplog.text
    assert "site.yaml states 10 m: edit it, or make the site anew with --thickness" in caplog.text
