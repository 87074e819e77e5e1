"""Classes of intensity and levels of danger against hand calculations."""

from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from synthetic_ensemble import make_site, make_table, make_terrain, member_maps, write_member, write_part

from runout.config.scheme import FOLDER, names, read_scheme, site_problems
from runout.errors import ConfigError
from runout.hazard.danger import INTENSITY, LEVEL, DangerClasses
from runout.hazard.exceedance import aggregate
from runout.io import netcdf
from runout.model.joint_conditions import key_of, to_record
from runout.quantities import MET, peak_quantities

PERIODS = (30, 100, 300)
RISK = "risk:\n  annual: [1.0e-4, 1.0e-5]"


def scheme_of(folder, text):
    """A scheme from its text."""
    (folder / "own.yaml").write_text(text)
    return read_scheme("own.yaml", folder)


def three_classes(rates):
    """The flood scheme, of three classes and as many return periods."""
    return DangerClasses(read_scheme("swiss_flood"), np.asarray(rates, float), 0.1)


def test_every_cell_of_the_matrix_equals_the_scheme():
    """A member for each class and period, alone in its cell, whose rate is that of the period."""
    of_flood = {1: ("blue", "yellow", "yellow"), 2: ("blue", "blue", "yellow"), 3: ("red", "red", "red")}
    level = {"residual": 1, "yellow": 2, "blue": 3, "red": 4}
    for number, row in of_flood.items():
        for k, name in enumerate(row):
            danger = three_classes([1.0 / PERIODS[k]])
            maps = danger.at_periods(np.full((1, 1), number, np.uint8))
            assert maps[INTENSITY][:, 0].tolist() == [0] * k + [number] * (3 - k)
            assert maps[LEVEL].tolist() == [max(level[one] for one in row[k:])], (number, name)


def test_classes_at_return_periods_are_those_of_summed_rates():
    """Weak at 1/40 a year, medium at 1/120, strong at 1/600 and 1/600: exceeded at 1/40 + ..., by hand."""
    danger = three_classes([1 / 40, 1 / 120, 1 / 600, 1 / 600])
    maps = danger.at_periods(np.array([[1, 0], [2, 0], [3, 3], [3, 0]], np.uint8))
    # first cell: any class 0.0367 >= 1/30 -> weak; medium or more 0.01167 >= 1/100; strong 1/300
    assert maps[INTENSITY][:, 0].tolist() == [1, 2, 3]
    assert maps[LEVEL][0] == 4  # blue, blue and red
    assert maps[INTENSITY][:, 1].tolist() == [0, 0, 0]
    assert maps[LEVEL][1] == 1  # residual


def test_a_member_without_a_rate_makes_no_residual_danger():
    maps = three_classes([0.0]).at_periods(np.array([[3]], np.uint8))
    assert maps[LEVEL][0] == 0


def test_every_threshold_of_the_flood_classes_counts():
    danger = three_classes([1.0])
    values = {
        "thickness": np.array([0.0, 0.1, 0.49, 0.5, 1.99, 2.0, 0.2, 0.2, 0.2], np.float32),
        "unit_discharge": np.array([0, 0, 0, 0, 0, 0, 0.5, 2.0, 0], np.float32),
        "eroded_depth": np.array([0, 0, 0, 0, 0, 0, 0, 0, 2.0], np.float32),
    }
    assert danger.classes(values).tolist() == [0, 1, 1, 2, 2, 3, 2, 3, 3]


def test_thickness_and_speed_count_at_one_time_and_not_as_peaks_of_different_times():
    """Peaks of 3 m and 4 m/s of different moments, never both above 1: medium, as in the criterion of Swiss debris flows."""
    danger = DangerClasses(read_scheme("swiss_debris_flow"), np.ones(1), 0.1)
    values = {name: np.array([one], np.float32) for name, one in (("thickness", 3.0), ("speed", 4.0), ("thickness_and_speed", 0.9))}
    assert danger.classes(values).tolist() == [1]
    values["thickness_and_speed"][:] = 1.0
    assert danger.classes(values).tolist() == [2]
    assert not danger.scheme.remarks(has_bed=False, places={})


def test_unequal_thresholds_are_bounded_by_maxima_of_one_time_and_said_so(tmp_path):
    """1 m thick at 0.3 m/s, later 0.4 m thick at 1.5 m/s: both peaks are reached, never together, and hv says so."""
    text = (read_text("swiss_debris_flow")).replace("{thickness: 1, speed: 1}", "{thickness: 1, speed: 1.5}")
    danger = DangerClasses(scheme_of(tmp_path, text), np.ones(1), 0.1)
    for flows, expected in (([(1.0, 1.5)], 2), ([(1.0, 0.3), (0.4, 1.5)], 1), ([(1.2, 0.3), (1.0, 2.0)], 2)):
        maxima = {
            "thickness": max(h for h, _ in flows),
            "speed": max(v for _, v in flows),
            "thickness_and_speed": max(min(h, v) for h, v in flows),
            "unit_discharge": max(h * v for h, v in flows),
            "momentum_flux": max(h * v**2 for h, v in flows),
        }
        assert danger.classes({name: np.array([one], np.float32) for name, one in maxima.items()}).tolist() == [expected]
    assert "too large rather than too small" in danger.scheme.remarks(has_bed=False, places={})[0]


def test_unequal_thresholds_that_members_record_are_exact(tmp_path):
    """0.8 m at 9 m/s, then 2 m at 1.2 m/s: all bounds of 1 m and 1.5 m/s are passed, the pair never; only the record knows."""
    text = (read_text("swiss_debris_flow")).replace("{thickness: 1, speed: 1}", "{thickness: 1, speed: 1.5}")
    danger = DangerClasses(scheme_of(tmp_path, text), np.ones(1), 0.1)
    flows = [(0.8, 9.0), (2.0, 1.2)]
    values = {q.name: np.array([max(q.formula(h, v, 2000.0) for h, v in flows)], np.float32) for q in peak_quantities()}
    assert danger.classes(values).tolist() == [2]
    places = {(("speed", 1.5), ("thickness", 1.0)): 3}
    exact = DangerClasses(danger.scheme, np.ones(1), 0.1, places=places)
    assert exact.classes(values | {MET: np.array([7.0], np.float32)}).tolist() == [1]
    assert exact.classes(values | {MET: np.array([8.0], np.float32)}).tolist() == [2]
    assert exact.record()["remarks"] == []
    assert "flow thickness of 1 m or more and flow speed of 1.5 m/s or more at one time" in exact.record()["classes"][1]["text"]


def test_a_house_resists_thin_flows_and_never_counts_too_late():
    """35.3 / (1 (5.6 - 1)) = 7.674 kPa at 1 m; above 2.8 m the least strength 35.3 / 2.8^2 = 4.503 kPa counts."""
    danger = DangerClasses(read_scheme("japan_house"), np.ones(1), 0.1)
    thickness, pressure = np.array([1, 1, 4, 4, 5.6, 0], np.float32), np.array([7670, 7680, 4500, 4510, 4510, 9e9], np.float32)
    assert danger.classes({"thickness": thickness, "pressure": pressure}).tolist() == [1, 2, 1, 2, 2, 0]


def test_a_house_that_members_record_is_exact():
    """0.5 m at 8 kPa, then 4 m at 3.9 kPa: the maxima pass the least strength of 4.5 kPa, no moment does; only the record knows."""
    danger = DangerClasses(read_scheme("japan_house"), np.ones(1), 0.1)
    values = {"thickness": np.array([4.0], np.float32), "pressure": np.array([8e3], np.float32)}
    assert danger.classes(values).tolist() == [2]
    remark, *others = danger.scheme.remarks(has_bed=False, places={})
    assert "the largest pressure is compared with the strength at the largest thickness; its area is too large" in remark
    assert not others
    (condition,) = danger.scheme.conditions
    assert to_record([condition]) == [{"house_force": 35300.0, "house_height": 5.6}]
    exact = DangerClasses(danger.scheme, np.ones(1), 0.1, places={key_of(condition): 2})
    assert exact.classes(values | {MET: np.array([3.0], np.float32)}).tolist() == [1]
    assert exact.classes(values | {MET: np.array([4.0], np.float32)}).tolist() == [2]
    assert exact.record()["remarks"] == []
    assert "35.3 / (H (5.6 - H)) kPa or more at a thickness H in m at one time" in exact.record()["classes"][1]["text"]


def test_individual_risk_is_rate_times_presence_times_vulnerability(tmp_path):
    text = read_text("british_columbia_risk").replace(RISK, f"{RISK}\n  presence: 0.5\n  vulnerability: 0.2")
    scheme = scheme_of(tmp_path, text)
    assert scheme.years == pytest.approx([1000.0, 10000.0])
    for rate, level in ((0.0011, 2), (0.0009, 1), (0.00011, 1), (0.00009, 0)):  # times 0.1 against 1e-4 and 1e-5
        maps = DangerClasses(scheme, np.array([rate]), 0.1).at_periods(np.ones((1, 1), np.uint8))
        assert maps[LEVEL][0] == level


def test_maps_of_an_ensemble_equal_those_of_its_members(tmp_path):
    """Tile by tile, from files of whole rasters and of parts of them; unknown cells have no class."""
    files = [write_member(tmp_path, 0, make_terrain()), write_part(tmp_path, 1, make_terrain(), member_maps(1))]
    files.append(write_member(tmp_path, 2, make_terrain()))
    danger = three_classes([1 / 50, 1 / 60, 1 / 250])
    hazard = aggregate(files, [1.0] * 3, {"thickness": [0.1]}, [50.0], danger=danger)
    of_members = np.stack([
        danger.classes({name: member_maps(k)[of].astype(np.float32) for name, of in MAPS.items()}) for k in range(3)
    ])  # fmt: skip
    expected = danger.at_periods(of_members)
    known = np.isfinite(make_terrain().elevation)
    assert {0, 2, 3} == set(np.unique(of_members))
    assert (hazard[INTENSITY].values[:, known] == expected[INTENSITY][:, known]).all()
    assert (hazard[LEVEL].values[known] == expected[LEVEL][known]).all()
    assert (hazard[LEVEL].values[~known] == 255).all()
    assert hazard[LEVEL].dtype == np.uint8
    assert hazard[LEVEL].attrs["flag_meanings"] == "not_in_danger residual yellow blue red"


MAPS = {"thickness": "max_flow_thickness", "unit_discharge": "max_unit_discharge"}


def read_text(name):
    """Text of a scheme of runout."""
    return (FOLDER / f"{name}.yaml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("{thickness: 1, speed: 1}", "{thickness: 1, speed: }", r"own.yaml:13: .*speed: a threshold without a number"),
        ("{thickness: 1, speed: 1}", "{thickness: 1, speed: null}", r"own.yaml:13: .*speed: a threshold without a number"),
        (
            "medium: [blue, blue, yellow]",
            "medium: [yellow, blue, blue]",
            r"own.yaml:36: .*medium: rarer events have a higher level",
        ),
        (
            "strong: [red, red, red]",
            "strong: [red, yellow, residual]",
            r"own.yaml:37: .*'strong' has a lower level than a weaker class",
        ),
        ("beyond: residual", "beyond: red", r"own.yaml:36: .*medium: rarer events have a higher level"),
    ],
)
def test_criteria_without_numbers_and_levels_out_of_order_are_refused(tmp_path, old, new, said):
    with pytest.raises(ConfigError, match=said):
        scheme_of(tmp_path, read_text("swiss_debris_flow").replace(old, new))


@pytest.mark.parametrize("name", names())
def test_schemes_of_runout_are_complete(name):
    scheme = read_scheme(name)
    stated = scheme.return_periods.years if scheme.return_periods else scheme.risk.annual
    assert all(a != b for a, b in pairwise(stated))
    if scheme.matrix:
        assert {len(row) for row in scheme.matrix.rows.values()} == {len(stated)}
        assert set(scheme.matrix.rows) == {one.name for one in scheme.classes}
        used = {level for row in scheme.matrix.rows.values() for level in row} | {scheme.beyond}
        assert {level.name for level in scheme.levels} <= used
        for row in scheme.matrix.rows.values():  # rarer is not more dangerous
            numbers = [[level.name for level in scheme.levels].index(level) for level in row]
            assert numbers == sorted(numbers, reverse=True)


WRONG = {
    "overlap": ("medium\n    when: [{thickness: 0.5}", "medium\n    when: [{thickness: 3}", "15: classes[2].when: the classes o"),
    "missing cell": ("weak: [blue, yellow, yellow]", "weak: [blue, yellow]", "matrix.rows.weak: 2 levels for 3 return periods"),
    "missing row": ("    weak: [blue, yellow, yellow]\n", "", "class 'weak' has no row"),
    "order": ("[30, 100, 300]", "[30, 300, 100]", "own.yaml:17: return_periods.years: [30.0, 300.0, 100.0] does not rise"),
    "level": ("[red, red, red]", "[red, rde, red]", "matrix.rows.strong[1]: 'rde' is none of the levels; did you mean 'red'?"),
    "twice": ("name: medium", "name: strong", "the name 'strong' stands twice"),
    "key": ("    when: [{reached: true}]", "    wehn: [{reached: true}]", "classes[0].wehn: unknown key; did you mean 'when'?"),
    "quantity": ("{eroded_depth: 0.5}", "{erodeddepth: 0.5}", "unknown key; did you mean 'eroded_depth'?"),
    "nothing": ("{eroded_depth: 0.5}", "{}", "a criterion without thresholds"),
    "colour": ('"#d7191c"', '"crimson"', "'crimson' cannot be used; write it as"),
    "status": ("matrix:\n", "matrix:\n  checked: certain\n", "already given"),
    "checked": ("checked: memory", "checked: perhaps", "'perhaps' is not known; choose one of primary, secondary, memory"),
    "beyond": ("beyond: residual", "beyond: rest", "'rest' is none of the levels"),
    "limits": ("does_not_say:", "says:", "does_not_say: required key is missing"),
    "negative": ("{thickness: 2}", "{thickness: -2}", "-2 m is out of range"),
}  # fmt: skip


@pytest.mark.parametrize("fault", WRONG)
def test_faults_of_an_own_scheme_are_refused_with_line_and_key(tmp_path, fault):
    before, after, message = WRONG[fault]
    text = read_text("swiss_flood")
    assert before in text
    with pytest.raises(ConfigError) as refused:
        scheme_of(tmp_path, text.replace(before, after))
    assert message in str(refused.value)
    assert "own.yaml:" in str(refused.value)


def test_all_problems_are_listed_together(tmp_path):
    text = read_text("swiss_flood").replace("weak: [blue, yellow, yellow]", "weak: [blue]").replace("[red, red, red]", "[red, red]")
    with pytest.raises(ConfigError) as refused:
        scheme_of(tmp_path, text)
    assert len(refused.value.problems) == 2


def write_products_of(folder, scheme, **columns):
    """Results folder of the synthetic ensemble with a scheme."""
    from dataclasses import replace
    from types import SimpleNamespace

    from runout.hazard.products import write_products

    site, results = make_site(folder)
    hazard = SimpleNamespace(**{**vars(site.settings.hazard), "scheme": scheme})
    site = replace(site, settings=SimpleNamespace(**{**vars(site.settings), "hazard": hazard}))
    write_products(site, results, make_table().assign(**columns), None)
    return results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Products of the flood scheme: two members of 2 m and more at 0.01 a year, the longest at 0.001 a year."""
    return write_products_of(tmp_path_factory.mktemp("flood"), "swiss_flood", annual_rate=[0.02, 0.009, 0.001, 0.0, 0.0])


def test_rasters_and_styles_have_the_numbers_and_colours_of_the_scheme(results):
    import rasterio

    hazard = netcdf.read(results / "hazard.nc")
    with rasterio.open(results / "maps" / "danger_level.tif") as raster:
        assert raster.dtypes == ("uint8",)
        assert raster.nodata == 255
        level = raster.read(1)
        assert raster.tags()["checked"] == "residual: secondary; yellow: memory; blue: memory; red: memory"
        assert raster.tags()["flag_meanings"] == "not_in_danger residual yellow blue red"
    assert set(np.unique(level)) == {0, 1, 4}
    assert (np.nan_to_num(hazard[LEVEL].values, nan=255) == level).all()
    for years in PERIODS:
        assert (results / "maps" / "danger" / f"intensity_class_{years}.tif").is_file()
    style = ElementTree.fromstring((results / "maps" / "danger_level.qml").read_text().split("\n", 1)[1])
    entries = {int(one.get("value")): (one.get("color"), one.get("label")) for one in style.iter("paletteEntry")}
    assert entries[4] == ("#d7191c", "red (checked: memory)")
    assert entries.keys() == {1, 2, 3, 4}


def test_polygons_cover_the_cells_of_their_level(results):
    import geopandas

    hazard = netcdf.read(results / "hazard.nc")
    levels = geopandas.read_file(results / "outlines.gpkg", layer="danger_level").set_index("level")
    cell = 10.0 * 12.0
    for name, number in (("red", 4), ("residual", 1)):
        cells = int((hazard[LEVEL].values == number).sum())
        assert levels.geometry[name].area == pytest.approx(cells * cell)
        assert levels["area_m2"][name] == pytest.approx(cells * cell)
    assert levels["checked"]["red"] == "memory"
    classes = geopandas.read_file(results / "outlines.gpkg", layer="intensity_class")
    assert set(classes["return_period_years"]) == {100.0, 300.0}  # 0.03 a year in all, less than 1/30


def test_a_scheme_without_rates_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"swiss_flood.*no annual rates.*state ensemble\.scenarios"):
        write_products_of(tmp_path, "swiss_flood")


def test_the_scheme_of_a_site_is_checked_with_its_file(tmp_path):
    """Name, rates, inputs that nobody states, and the lines of an own file."""
    from runout.config.document import read_document

    def problems(lines, scheme=""):
        (tmp_path / "site.yaml").write_text(lines)
        (tmp_path / "mine.yaml").write_text(scheme)
        return [str(one) for one in site_problems(read_document(tmp_path / "site.yaml"), tmp_path)]

    rates = "ensemble: {scenarios: [{name: a}]}\n"
    assert problems(rates + "hazard: {scheme: swiss_debris_flow}\n") == []
    assert "did you mean 'swiss_flood'" in problems(rates + "hazard: {scheme: swis_flood}\n")[0]
    (of_rates,) = problems("hazard:\n  scheme: swiss_debris_flow\n")
    assert of_rates.startswith("site.yaml:2: hazard.scheme: ")
    assert "ensemble.scenarios" in of_rates
    (of_risk,) = problems(rates + "hazard: {scheme: british_columbia_risk}\n")
    assert "risk.presence and risk.vulnerability" in of_risk
    (of_bed,) = problems(
        rates + "hazard: {scheme: mine.yaml}\n", read_text("swiss_flood").replace("{thickness: 2}, {unit_discharge: 2}, ", "")
    )
    assert "class strong needs an erodible bed" in of_bed
    (of_file,) = problems(
        rates + "hazard: {scheme: mine.yaml}\n", read_text("swiss_flood").replace("[30, 100, 300]", "[30, 300, 100]")
    )
    assert of_file.startswith("mine.yaml:17: return_periods.years")
