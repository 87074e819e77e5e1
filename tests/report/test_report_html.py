import json
import re
import shutil
from html.parser import HTMLParser

import netCDF4
import numpy as np
import pytest
import xarray as xr

from runout.errors import StorageError
from runout.forecast.accuracy import BOUNDS, expected_errors
from runout.report import tables
from runout.report.html import render, write_report
from runout.report.sheets import printed_sheets
from runout.report.study import read_study
from runout.report.wording import area
from runout.terrain.roughness import Roughness


@pytest.fixture(scope="module")
def text(site, results):
    return write_report(site, results).read_text(encoding="utf-8")


@pytest.fixture
def copy(results, tmp_path):
    return shutil.copytree(results, tmp_path / "results")


def change_ledger(results, member, **series):
    """Replace series of a member's ledger."""
    with netCDF4.Dataset(results / "members.nc", "a") as file:
        group = file.groups["ledgers"]
        ends = np.cumsum(group["records"][:])
        for name, values in series.items():
            group[name][ends[member] - group["records"][member] : ends[member]] = values


def test_the_page_is_one_file_that_asks_for_nothing_else(text):
    page = re.sub(r"<script\b[^>]*>.*?</script>", "", text, flags=re.DOTALL)
    assert re.findall(r"<script\b[^>]*>", text)
    assert not re.findall(r"<script\b[^>]*\bsrc=", text)
    sources = re.findall(r'(?:src|href|action|poster|data)="([^"]{0,60})', page)
    assert sources
    assert all(s.startswith(("data:image/png;base64,", "data:image/jpeg;base64,", "#")) for s in sources)
    assert "@import" not in page
    assert not re.findall(r"url\((?!#|['\"]?data:)", page)


def test_every_picture_has_a_description(text):
    page = re.sub(r"<script\b[^>]*>.*?</script>", "", text, flags=re.DOTALL)
    assert page.count('<svg class="map"') == len(re.findall(r'<svg class="map"[^>]* role="img" aria-label="Map: [^"]+"', page)) == 5
    assert page.count('<svg class="chart"') == len(re.findall(r'<svg class="chart"[^>]* aria-label="[^"]+"', page)) == 4
    assert all('alt="' in tag for tag in re.findall("<img[^>]*>", page))


def test_the_hillshade_is_in_the_file_once_for_all_sheets(text):
    page = re.sub(r"<script\b[^>]*>.*?</script>", "", text, flags=re.DOTALL)
    assert page.count("data:image/jpeg") == 1
    assert page.count('<use href="#map-ground"/>') == 5


def test_every_tag_that_opens_closes(text):
    class Balance(HTMLParser):
        def __init__(self):
            super().__init__()
            self.open = []

        def handle_starttag(self, tag, attrs):
            if tag not in ("meta", "img", "br", "input", "link"):
                self.open.append(tag)

        def handle_endtag(self, tag):
            assert self.open.pop() == tag

    balance = Balance()
    balance.feed(text)
    assert balance.open == []


def test_the_title_of_the_site_is_escaped(text):
    assert "Invented valley &lt;test&gt;" in text
    assert "<test>" not in text


def test_the_maps_that_matter_are_printed_with_their_threshold(text):
    titles = re.findall(r'<div class="sheet[ a-z]*">\s*<h3>([^<]*)</h3>', text)
    assert titles == [
        "Probability of a flow thickness of 0.1\u202fm or more",
        "Peak flow thickness, 95th percentile of the members",
        "Peak flow speed, 95th percentile of the members",
        "First arrival",
        "Deposit, mean of the members",
    ]


def test_maps_and_areas_state_their_sampling_error(results, text):
    study = read_study(results)
    error = study.hazard["thickness_exceedance_rms_error"]
    value = tables.number(float(error.sel(thickness_threshold=0.1)), 2)
    assert f"from the number of members alone is {value} (that of independent members" in text
    error.attrs["estimator"] = "spread over 4 consecutive blocks"
    assert f"{value} (that of the spread over blocks of the net" in printed_sheets(study)[0].caption
    remark = {label: remark for label, _, remark in tables.key_figures(study)}["Area of probability 0.5 or more"]
    p, s = (study.hazard[f"thickness_exceedance_{kind}"][0].values for kind in ("probability", "standard_error"))
    half = ((p + s >= 0.5).sum() - (p - s >= 0.5).sum()) / 2 * 0.02**2
    assert half > 0
    assert remark.endswith(f"standard error from the number of members {area(half)}")


def test_a_failed_member_stands_in_the_table_with_its_reason_and_is_warned_of(text):
    assert "failed: StabilityError: speed 950 m/s at step 12; lower simulation.cfl" in text
    assert "1 member of 8 is not in the maps (12\u202f% of the weight)" in text


def test_the_description_of_the_site_heads_the_page(text):
    assert "<p>The release is hypothetical.</p>" in text


def test_limits_of_use_are_stated(text):
    for words in ("conditional", "No annual probability", "single buildings", "Barnhart et al. 2024", "hypothetical"):
        assert words in text


def test_inputs_are_listed_with_their_checksum(text):
    assert "inputs/dem.tif" in text
    assert "ab" * 32 in text
    assert "<li>rows were turned to north up</li>" in text


def test_settings_are_listed_with_units(text):
    assert "<td>Cell size</td><td>4\u202fm</td>" in text
    assert "uniform: low 12, high 22" in text
    assert "5\u202f000\u202f000\u202fPa" in text


def test_figures_of_a_member_agree_with_its_maps(results):
    study = read_study(results)
    row = study.members.loc[0]
    with xr.open_dataset(results / "members" / "0000.nc") as maps:
        assert row["highest_speed"] == pytest.approx(float(maps["max_speed"].max()))
        assert row["reached_area"] == pytest.approx(
            float((maps["max_flow_thickness"] >= np.float32(study.threshold)).sum()) * 400 / 1e6
        )
        outside = maps["deposit_thickness"].values[study.hazard["release_thickness"].values == 0].sum()
    assert row["deposit_volume"] == pytest.approx(outside * 400, rel=1e-5)
    assert 15 < row["reach_angle_deg"] < 35


def test_friction_shortens_the_runout_of_the_members(results):
    valid = read_study(results).valid
    assert (np.diff(valid["runout_distance"]) < 0).all()


def test_mass_over_the_edge_is_warned_of(site, copy):
    n = len(read_study(copy).ledgers[2]["time"])
    change_ledger(copy, 2, mass=np.linspace(3e9, 2.7e9, n), escaped_mass=np.linspace(0, 0.3e9, n))
    with netCDF4.Dataset(copy / "members.nc", "a") as file:
        file["escaped_fraction"][2] = 10.0
    study = read_study(copy)
    assert any("left the elevation raster (up to 10 %)" in w for w in tables.warnings(study, site.resolved()))
    assert tables.mass_error(study.ledgers[2]) < 1e-12


def test_a_member_that_still_moves_at_the_end_is_warned_of(site, copy):
    n = len(read_study(copy).ledgers[3]["time"])
    change_ledger(copy, 3, kinetic_energy=np.linspace(0, 1e12, n))
    assert any("still moved at the end time of 90\u202fs" in w for w in tables.warnings(read_study(copy), site.resolved()))


def test_lost_energy_is_warned_of_and_printed(site, copy):
    n = len(read_study(copy).ledgers[0]["time"])
    change_ledger(copy, 0, numerical_dissipation=np.linspace(0, 0.4e12, n))
    study = read_study(copy)
    assert tables.energy_residual(study.ledgers[0]) == pytest.approx(0.1, rel=0.02)
    assert any("numerical dissipation" in w for w in tables.warnings(study, site.resolved()))


def test_cells_through_the_depth_are_those_of_the_record(site, copy):
    def change(**resolution):
        run = json.loads((copy / "run.json").read_text(encoding="utf-8"))
        (copy / "run.json").write_text(json.dumps(run | {"resolution": {**run["resolution"], **resolution}}), encoding="utf-8")
        return read_study(copy)

    study = change(cells_through_depth=1.5, smallest_feature=12.0)
    assert "The smallest feature that the maps can show is 12\u202fm wide" in tables.balance(study)["resolution"]
    assert "has 1.5 cells through its depth" in tables.balance(study)["resolution"]
    assert "a viscosity of 4\u202fm² s⁻¹, which stops shear through the depth in 0.15\u202fs" in tables.balance(study)["resolution"]
    (said,) = [w for w in tables.warnings(study, site.resolved()) if "through a depth" in w]
    assert "has 1.5 cells through a depth of" in said
    assert "stops shear through the depth in 0.15 s; with fewer than 4 cells the velocity profile and the shear" in said
    assert not any("least thickness" in w for w in tables.warnings(study, site.resolved()))
    thin = change(least_thickness=20.0)
    assert "The least thickness that they can show is 20\u202fm." in tables.balance(thin)["resolution"]
    assert sum("The least thickness that the grid can show" in w for w in tables.warnings(thin, site.resolved())) == 1
    deep = change(cells_through_depth=5.0)
    assert not any("through a depth" in w for w in tables.warnings(deep, site.resolved()))
    assert "has 5 cells through its depth" in tables.balance(deep)["resolution"]


def test_relief_is_said_as_check_says_it(site, copy):
    run = json.loads((copy / "run.json").read_text(encoding="utf-8"))
    relief = Roughness(carried=0.52, removed=1.14, friction=0.02, wave=10.0)
    (copy / "run.json").write_text(json.dumps({k: v for k, v in run.items() if k != "relief"}), encoding="utf-8")
    assert tables.balance(read_study(copy))["relief"] == ""
    assert not any("oscillate" in w for w in tables.warnings(read_study(copy), site.resolved()))
    (copy / "run.json").write_text(json.dumps(run | {"relief": relief.record()}), encoding="utf-8")
    assert tables.balance(read_study(copy))["relief"] == f"{relief.statement()}."
    assert "has 0.52 m (rms)" in relief.statement()
    assert "act like 0.69 to 2.5 degrees of friction more" in relief.statement()
    assert f"{relief.warning()}." in tables.warnings(read_study(copy), site.resolved())


def test_a_record_without_a_resolution_says_nothing_of_it(site, copy):
    run = json.loads((copy / "run.json").read_text(encoding="utf-8"))
    del run["resolution"]
    (copy / "run.json").write_text(json.dumps(run), encoding="utf-8")
    assert tables.balance(read_study(copy))["resolution"] == ""
    assert not any("through its depth" in w for w in tables.warnings(read_study(copy), site.resolved()))


def test_who_when_with_what_and_what_for_head_the_page(text, copy, site):
    head = text[text.index('<header class="top">') : text.index("</header>")]
    for words, value in (
        ("Made by", "A. Name, A survey"),
        ("Date", "2026-05-04 10:20:30 UTC, runout 0.1.0"),
        ("Purpose", "screening &lt;of&gt; a road"),
    ):
        assert f" · {words}: {value}" in head
    assert "Project" not in head, "nobody stated one"
    assert "probabilities" in head


def test_obstacles_and_zones_are_labelled_and_explained(text, results):
    basemap = read_study(results).basemap
    assert [mark.label for mark in basemap.obstacles] == ["+8 m"]
    assert [mark.label for mark in basemap.zones] == ["friction × 1.5", "friction 8°"]  # noqa: RUF001
    assert "hatched areas are obstacles" in text
    assert "dashed lines are those of friction zones" in text


def test_pressure_thresholds_are_printed_in_kilopascal():
    lines = dict(tables.settings({"hazard": {"pressure_thresholds": [3e3, 3e4]}})[1][1])
    assert lines == {"Pressure thresholds": "3, 30 kPa"}


def test_a_folder_without_maps_names_the_command_that_makes_them(copy):
    (copy / "hazard.nc").unlink()
    with pytest.raises(StorageError, match="runout hazard"):
        read_study(copy)


def test_damaged_provenance_names_the_file(copy):
    (copy / "run.json").write_text("{", encoding="utf-8")
    with pytest.raises(StorageError, match=r"run\.json: not valid JSON"):
        read_study(copy)


def test_a_full_disk_leaves_the_old_report_alone(site, results, text, monkeypatch):
    before = (results / "report.html").read_bytes()
    monkeypatch.setattr("runout.report.html.page", lambda *_: {})
    monkeypatch.setattr("runout.report.html.render", lambda _: "another page")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(StorageError, match="disk is full"):
        write_report(site, results)
    assert (results / "report.html").read_bytes() == before == text.encode()
    assert not list(results.glob(".*.part"))


def test_the_same_study_gives_the_same_page(site, results, text):
    assert write_report(site, results).read_text(encoding="utf-8") == text


def test_provenance_is_printed_without_the_whole_configuration(results):
    run = json.loads((results / "run.json").read_text(encoding="utf-8")) | {"configuration": {"secret": "x" * 99}}
    lines = dict(tables.provenance(run)["lines"])
    assert lines["Versions"] == "runout 0.1.0, numpy 2.4"
    assert "Configuration" not in lines
    assert lines["Members"] == "7 of 8 members are valid"


def test_a_template_name_without_a_value_is_an_error():
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        render({"title": "x"})


def test_numerical_error_is_that_of_the_site_where_it_was_measured_or_else_the_expected_one(site, results, copy, text):
    expected = re.search(
        r"The grid itself has an error\.</b> Expected numerical error ± (\S+) % of the run-out, ± (\S+) % of", text
    )
    thickness = read_study(results).hazard["release_thickness"].values
    of_map, of_runout = expected_errors(thickness[thickness > 0].mean() / site.resolved()["simulation"]["cell_size"])
    assert [float(part) for part in expected.groups()] == pytest.approx([100 * of_runout, 100 * of_map], rel=0.06)
    assert BOUNDS in text
    front = {"title": "run-out of 99 % of the mass", "unit": "m", "fine": 1234.0, "error": 21.4}
    depth = {"title": "map of flow thickness (relative L1)", "unit": "", "fine": None, "error": 0.08}
    found = {"quantities": {"f99": front, "thickness_map": depth}, "levels": [{"cell_size": [8.0] * 3}, {"cell_size": [4.0] * 3}]}
    (copy / "convergence.json").write_text(json.dumps(found), encoding="utf-8")
    said = write_report(site, copy).read_text(encoding="utf-8").replace("\u202f", " ")
    assert "The grid itself has an error.</b> Of the median scenario on cells of 4 m, from runs on several grids: " in said
    assert "run-out of 99 % of the mass 1234 ± 21 m (1.7 %); map of flow thickness (relative L1) ± 8 %. " + BOUNDS in said


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "holds no quantities"),
        ({"quantities": {"f99": {"title": "front", "unit": "m", "fine": 1.0}}, "levels": []}, "quantities.f99.error is missing"),
        ({"quantities": {"f99": 3}, "levels": []}, "quantities.f99.fine is missing"),
        ({"quantities": {"f99": {"title": "x", "unit": "m", "fine": "1", "error": 1}}}, "quantities.f99.fine is '1'"),
        ({"quantities": {"f99": {"title": "x", "unit": "m", "fine": 1, "error": 1}}, "levels": [{}]}, "has no cell_size"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_study_of_convergence_that_lacks_an_entry_is_named_with_the_remedy(site, copy, content, said):
    (copy / "convergence.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(StorageError, match=rf"convergence.json: .*{said}.*; run `runout verify --convergence`"):
        write_report(site, copy)


def test_a_members_file_of_an_earlier_version_is_refused_with_the_remedy(copy):
    with netCDF4.Dataset(copy / "members.nc", "a") as file:
        file.renameVariable("runout_distance", "other")
    with pytest.raises(StorageError, match="has no runout_distance of the members; run `runout hazard`"):
        read_study(copy)


def test_a_members_file_without_ledgers_is_refused_with_the_remedy(copy):
    with xr.open_dataset(copy / "members.nc") as opened:
        table = opened.load()
    table.to_netcdf(copy / "members.nc")
    with pytest.raises(StorageError, match="holds no ledgers; run `runout hazard`"):
        read_study(copy)
