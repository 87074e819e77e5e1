"""The first screen: what was assumed, what the flow reaches, one threshold, what the maps do not support, ten questions."""

import re
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
import xarray as xr

from runout.config.process_ranges import process_named
from runout.report import first_screen, sheets, tables
from runout.report.html import page, write_report
from runout.report.study import read_study
from runout.report.wording import area


@pytest.fixture(scope="module")
def study(results):
    return read_study(results)


@pytest.fixture(scope="module")
def text(site, results):
    return write_report(site, results).read_text(encoding="utf-8")


@pytest.fixture
def settings(site):
    return site.resolved()


def test_volume_friction_and_its_origin_are_stated_as_assumptions(study, settings):
    sentence = first_screen.assumed(study, settings)
    volume = float(study.hazard["release_thickness"].sum()) * 400
    assert sentence == (
        f"Assumed: {tables.volume(volume)} released, times 0.5 to 1 in the members; basal friction angle 12 to 22°, a range "
        "stated in site.yaml, not calibrated; no annual rates."
    )


def test_an_erodible_bed_is_an_assumption(study, settings):
    bed = {"depth": 2.0, "erosion": {"law": "ramms", "rate": 0.025}}
    assert "; an erodible bed of 2\u202fm, law ramms; " in first_screen.assumed(study, settings | {"bed": bed})
    assert "; an erodible bed; " in first_screen.assumed(study, settings | {"bed": {"depth": "depth.tif"}})


def test_a_single_run_has_values_in_place_of_probabilities(study, site, settings):
    number = study.valid.index[0]
    single = replace(study, members=study.members.loc[[number]], ledgers={number: study.ledgers[number]})
    sentences = f"{first_screen.assumed(single, settings)} {first_screen.outcome(single)}"
    assert "drawn from a range stated in site.yaml" in sentences
    assert "member" not in sentences
    cards = {label: value for label, value, _ in tables.key_figures(single)}
    assert cards["Area reached"] in first_screen.outcome(single)
    assert "Area of probability 0.5 or more" not in cards
    first, *rest = sheets.printed_sheets(single)
    assert first.title == "Peak flow thickness"
    assert not any("percentile" in sheet.title for sheet in (first, *rest))
    np.testing.assert_array_equal(first.values, study.hazard["peak_flow_thickness"].values)
    content = page(site, single, "")
    assert content["dependence"] == []
    assert content["budget"] is not None


@pytest.mark.parametrize(
    ("table", "origin"),
    [
        (
            "results/calibration/posterior.csv",
            "calibrated against the observations of the site (results/calibration/posterior.csv)",
        ),
        ({"path": "mine.csv"}, "taken from the table mine.csv"),
    ],
)
def test_friction_of_a_table_names_the_table(study, settings, table, origin):
    assert origin in first_screen.assumed(study, settings | {"ensemble": {"table": table}})


@pytest.mark.parametrize("name", ["basal_mu", "slab.basal_mu"])
def test_sampled_parameters_of_a_law_of_friction_are_stated_as_a_range(study, settings, name):
    """They are named after the block that states them, and after a release where only one has the law."""
    members = study.members.rename(columns={"basal_friction_angle_deg": name}).assign(
        **{name: np.linspace(0.05, 0.4, len(study.members))}
    )
    sentence = first_screen.assumed(replace(study, members=members), settings | {"basal_friction": {"law": "voellmy"}})
    assert "0.05 to 0.4, a range stated in site.yaml, not calibrated" in sentence
    assert "in every member" not in sentence


def test_published_ranges_of_friction_name_their_sources(study, settings):
    ranges = {r.key: r.distribution for r in process_named("snow_avalanche").variant.ranges}

    def answer(parameters):
        return first_screen.questions(study, settings | {"ensemble": settings["ensemble"] | {"parameters": parameters}}, "")[5].text

    assert "published for other events (dense snow avalanche). " in answer(ranges)
    assert "Buser & Frutiger 1980, J. Glaciol. 26:121" in answer(ranges)
    assert "Martinelli et al. 1980" in answer(ranges)
    changed = ranges | {"basal_mu": ranges["basal_mu"] | {"low": 0.01}}
    assert "26:121" not in answer(changed)
    assert "1360 for extreme avalanches" in answer(changed)
    assert answer(settings["ensemble"]["parameters"]).endswith("stated in site.yaml, not calibrated.")


def test_friction_that_no_member_changes_is_stated_with_its_value(study, settings):
    fixed = replace(study, members=study.members.drop(columns=["basal_friction_angle_deg", "release_volume_factor"]))
    sentence = first_screen.assumed(fixed, settings | {"basal_friction_angle_deg": 18.0})
    assert "released in every member; basal friction angle 18° in every member, stated in site.yaml and not calibrated" in sentence
    sentence = first_screen.assumed(fixed, settings | {"basal_friction": {"law": "voellmy"}})
    assert "basal friction by voellmy" in sentence


def test_areas_and_run_out_of_the_first_screen_are_those_of_one_threshold(study, text):
    assert study.threshold == 0.1
    reached = study.hazard["thickness_exceedance_probability"].sel(thickness_threshold=0.1).values
    half, ever = (area(float((reached >= least).sum()) * 0.02**2) for least in (0.5, 1e-9))
    sentence = first_screen.outcome(study)
    assert sentence.startswith(
        f"A flow of 0.1\u202fm or more reaches {half} in at least half of the members (by weight) and {ever} in any, "
    )
    cards = {label: (value, remark) for label, value, remark in tables.key_figures(study)}
    assert cards["Area reached by any member"] == (ever, "0.1\u202fm thick or more")
    assert cards["Area of probability 0.5 or more"][0] == half
    assert "0.1\u202fm thick or more" in cards["Run-out of the members"][1]
    assert re.findall(r"<h2>(Key figures: .*?)</h2>", text) == ["Key figures: flow of 0.1\u202fm or more"]
    assert "Probability of a flow thickness of 0.1\u202fm or more</h3>" in text


def test_points_that_the_flow_reaches_are_named_with_their_share(study):
    probes = xr.Dataset({"arrival_probability": ("station", [0.25, 1.0])}, {"station_name": ("station", ["road", "farm"])})
    sentence = first_screen.outcome(replace(study, probes={"points": probes}))
    assert sentence.endswith("; it arrives at farm in 100\u202f% of the members; it arrives at road in 25\u202f% of the members.")


def test_limits_are_short_true_and_depend_on_the_study(study, settings):
    sentence = first_screen.unsupported(study, settings)
    assert 4 <= len(sentence) <= 5
    assert any("none of 7 simulations reaches the place" in one for one in sentence)
    assert any("cells of 4\u202fm" in one for one in sentence)
    assert not any("reference system" in one for one in sentence)
    assert not any("thinner than" in one for one in sentence)
    local = replace(study, hazard=study.hazard.drop_vars("crs"))
    local.run["resolution"] = study.run["resolution"] | {"least_thickness": 0.8, "smallest_feature": 12.0}
    sentence = first_screen.unsupported(local, settings)
    assert any("local, without a reference system" in one for one in sentence)
    assert any("no flow thinner than 0.8\u202fm: 0.1\u202fm or more means 0.8\u202fm or more" in one for one in sentence)
    one_volume = replace(study, members=study.members.drop(columns="release_volume_factor"))
    assert any("one volume on one outline" in one for one in first_screen.unsupported(one_volume, settings))
    rates = replace(study, hazard=study.hazard.assign_attrs(scenarios="rare: 0.01 events a year"))
    assert "No events beyond the scenarios" in first_screen.unsupported(rates, settings)[0]
    assert "rare: 0.01 events a year" in first_screen.assumed(rates, settings)


def test_each_of_the_ten_questions_has_a_place_or_a_command(study, settings, text):
    answers = first_screen.questions(study, settings, "sure")
    assert len(answers) == 10
    for answer in answers:
        assert answer.text
        assert not answer.place or f'id="{answer.place}"' in text
        assert not answer.command or answer.command.startswith("runout ")
    commands = [answer.command for answer in answers]
    assert "runout check valley --budget 30min" in commands
    assert "runout what-if valley release_volume_factor=1,2" in commands
    assert all(f"<dt>{answer.question}</dt>" in text for answer in answers)


def test_names_of_sites_in_commands_are_quoted(study, settings):
    commands = [answer.command for answer in first_screen.questions(study, settings | {"name": "a b; rm"}, "")]
    assert "runout check 'a b; rm'" in commands


def test_answers_on_volume_follow_the_kind_of_ensemble(study, settings):
    def doubled(**ensemble):
        return first_screen.questions(study, settings | {"ensemble": ensemble}, "")[3]

    assert "add one to ensemble.scenarios" in doubled(scenarios=[{"name": "rare"}]).text
    assert "add rows" in doubled(table="members.csv").text
    assert doubled().command


def test_water_is_answered_from_the_settings(study, settings):
    assert first_screen.questions(study, settings, "")[7].text.startswith("Not by itself")
    wet = {"release": [{"name": "scar", "pore_pressure": {"ratio": 0.4}}, {"name": "dry"}]}
    assert first_screen.questions(study, settings | wet, "")[7].text == "Yes: pore pressure in scar."
    bed = {"bed": {"depth": 1.0, "pore_pressure": {"ratio": 0.5}}}
    assert first_screen.questions(study, settings | wet | bed, "")[7].text == "Yes: pore pressure in scar, the bed."
    assert "; pore pressure in scar, the bed; an erodible bed of " in first_screen.assumed(study, settings | wet | bed)
    assert "pore pressure" not in first_screen.assumed(study, settings | bed)
    assert first_screen.questions(study, settings | bed, "")[7].text.startswith("Not by itself: the bed is wet, but what joins")


def test_fixed_parameters_are_not_called_a_range(study, settings):
    fixed = replace(study, members=study.members.drop(columns=["basal_friction_angle_deg", "release_volume_factor"]))
    assert first_screen.questions(fixed, settings, "")[6].text.startswith("No: no parameter is sampled. Sample friction")


def test_run_out_of_an_inflow_alone_counts_from_the_inflow(study):
    alone = replace(study, hazard=study.hazard.assign(release_thickness=0.0 * study.hazard["release_thickness"]))
    alone = replace(alone, run=study.run | {"inflows": [{"name": "gauge", "volume": 10.0}]})
    assert "in plan beyond the inflow" in first_screen.outcome(alone)
    assert "in plan beyond the release" in first_screen.outcome(study)
    remarks = {label: remark for label, _, remark in tables.key_figures(alone)}
    assert remarks["Run-out of the members"].startswith("plan distance from the inflow to the farthest cell")
    assert remarks["Angle of reach"] == "from the highest point of the inflow to that cell"


def test_print_has_sheets_with_title_block_and_the_screen_the_map(text, results):
    assert ".sheets, #a3, .hidden { display: none; }" in text
    assert "@page { size: A4;" in text
    assert "@page large { size: A3; }" in text
    printed = text[text.index("@media print {") :]
    assert ".sheets { display: block; }" in printed
    assert ".screen" in printed[: printed.index("display: none")]
    sheet = re.findall(r'<div class="sheet[ a-z]*">.*?</table>', text, re.DOTALL)[0]
    for words in ("<small>Site</small>valley", "2026-05-04 10:20:30 UTC, runout 0.1.0", "WGS 84 / UTM zone 16N", "1 of 5"):
        assert words in sheet
    checksum = sha256((results / "hazard.nc").read_bytes()).hexdigest()
    assert f"SHA-256 of hazard.nc</small>{checksum}<" in sheet


def test_titles_are_escaped_in_the_foot_of_printed_pages(text):
    foot = re.findall(r"@bottom-left \{ content: (\".*?\");", text)
    assert foot == ['"Invented valley \\3c test\\3e "']


def test_the_file_is_small(site, results):
    assert write_report(site, results).stat().st_size < 1.5e6


def test_headings_are_in_order_and_landmarks_are_there(text):
    page = re.sub(r"<script\b[^>]*>.*?</script>", "", text, flags=re.DOTALL)
    levels = [int(level) for level in re.findall(r"<h([1-6])\b", page)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert (np.diff(levels) <= 1).all()
    for landmark in ("<header", "<nav aria-label", '<main class="wide" id="main"', '<html lang="en">', 'href="#main"'):
        assert page.count(landmark) == 1
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(identifiers)
