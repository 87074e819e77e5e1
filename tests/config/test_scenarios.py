"""Scenarios and tables of members in site.yaml: what is read, and what is refused with line, value and remedy."""

import pytest
from refused_site import problems

from runout.config.read import load
from runout.config.site import read_site
from runout.ensemble.design import member_table
from runout.ensemble.member import plan_members
from runout.errors import ConfigError
from runout.workflow.check import inspect

RELEASES = """\
release:
  - name: scar
    polygons: inputs/release.geojson
    thickness: 4.0
  - name: lower
    polygons: inputs/lower.geojson
    thickness: 2.0
"""
LAW = "power_law: {coefficient: 2, exponent: 0.5"


@pytest.fixture
def with_scenarios(site_folder):
    """A function that gives the ensemble of the site, of two releases, more lines; returns the folder."""

    def write(*lines: str, hazard: str = "", parameters: bool = True, members: bool = True):
        file = site_folder / "site.yaml"
        text = file.read_text()
        first = text.index("release:\n"), text.index("material:")
        text = text[: first[0]] + RELEASES + text[first[1] :]
        if not parameters:
            text = text[: text.index("  parameters:")]
        text = text if members else text.replace("  members: 4\n", "  seed: 1\n")
        file.write_text(text + "".join(f"  {line}\n" for line in lines) + hazard)
        square = (site_folder / "inputs" / "release.geojson").read_text()
        (site_folder / "inputs" / "lower.geojson").write_text(square.replace("5000040", "5000120").replace("5000080", "5000160"))
        return site_folder

    return write


def test_scenarios_are_read_and_members_have_the_releases_that_fail(with_scenarios):
    folder = with_scenarios(
        "scenarios:",
        "  - {name: often, exceedance_return_period: 30, releases: [scar]}",
        "  - {name: rare, exceedance_return_period: 300, releases: [scar], members: 2, parameters: {release_volume_factor: 2}}",
        "  - {name: both, annual_rate: 0.001, members: 1, parameters: {basal_friction_angle_deg: 15}}",
    )
    site = read_site(folder)
    assert site.settings.ensemble.size == 7
    members = plan_members(site)
    assert [[r.name for r in site.member_arguments(m.parameters)["release"]] for m in members] == [["scar"]] * 6 + [
        ["scar", "lower"]
    ]
    assert [m.parameters.get("release_volume_factor") for m in members] == [None] * 4 + [2.0] * 2 + [None]
    assert members[-1].parameters["basal_friction_angle_deg"] == 15.0
    whole, doubled = (site.member_arguments(members[k].parameters)["release"][0].volume for k in (0, 4))
    assert doubled == pytest.approx(2.0 * whole)
    assert len({m.key for m in members}) == 7
    table = member_table(site.settings.ensemble)
    assert table["annual_rate"].sum() == pytest.approx(1 / 30 + 0.001)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["  - {name: a}"], "ensemble.scenarios[0]: no rate is given; give one of return_period, annual_rate"),
        (["  - {name: a, return_period: 30, annual_rate: 0.1}"], "return_period and annual_rate are both given"),
        (["  - {name: a, annual_rate: 0}"], "scenarios[0].annual_rate: 0 1/a is out of range; it must be above 0"),
        (["  - {name: a, annual_rate: -0.1}"], "scenarios[0].annual_rate: -0.1 1/a is out of range"),
        (["  - {name: a, return_period: -3}"], "scenarios[0].return_period: -3 a is out of range"),
        (
            ["  - {name: a, return_period: 3, releases: [skar]}"],
            "scenarios[0].releases: no release is called 'skar'; did you mean 'scar'?",
        ),
        (["  - {name: a, return_period: 3, releases: [scar, scar]}"], "scenarios[0].releases: a release is listed twice"),
        (["  - {name: a, return_period: 3}", "  - {name: a, return_period: 9}"], "scenarios[1].name: two scenarios are called 'a'"),
        (
            ["  - {name: a, exceedance_return_period: 100}", "  - {name: b, exceedance_return_period: 30}"],
            "scenarios[1].exceedance_return_period: 30 a is not longer than that of scenario a before it",
        ),
        (
            [f"  - {{name: a, {LAW}, low: 100, high: 1000}}}}", f"  - {{name: b, {LAW}, low: 900}}}}"],
            "scenarios[1].power_law: its volumes overlap with those of scenario a",
        ),
        ([f"  - {{name: a, {LAW}, low: 100, high: 10}}}}"], "scenarios[0].power_law.low: low (100) is not below high (10)"),
        (
            ["  - {name: a, return_period: 3, parameters: {basal_friction_angel_deg: 20}}"],
            "scenarios[0].parameters.basal_friction_angel_deg: unknown key; did you mean 'basal_friction_angle_deg'?",
        ),
        (
            ["  - {name: a, return_period: 3, parameters: {basal_friction_angle_deg: 0.3}}"],
            "scenarios[0].parameters.basal_friction_angle_deg: 0.3 deg is suspiciously small",
        ),
        (
            ["  - {name: a, return_period: 3, parameters: {basal_mu: 0.2}}"],
            "scenarios[0].parameters.basal_mu: the friction law coulomb has no such parameter",
        ),
        (
            ["  - {name: a, return_period: 3, releases: [scar], parameters: {lower.friction_angle_deg: 30}}"],
            "scenarios[0].parameters.lower.friction_angle_deg: release lower does not fail in this scenario",
        ),
        (["  - {name: a, return_period: 3, members: 0}"], "scenarios[0].members: 0 is out of range"),
        (
            [
                "  - {name: a, exceedance_return_period: 30, parameters: {release_volume_factor: 1.5}}",
                "  - {name: b, exceedance_return_period: 300, parameters: {release_volume_factor: 0.5}}",
            ],
            "scenarios[1].parameters.release_volume_factor: it has volumes below the largest of scenario a",
        ),
    ],
)
def test_contradictions_of_scenarios_are_refused_with_their_place(with_scenarios, lines, said):
    (found,) = problems(with_scenarios("scenarios:", *lines))
    assert said in found


def test_all_problems_of_scenarios_are_listed_at_once(with_scenarios):
    found = problems(
        with_scenarios(
            "scenarios:",
            "  - {name: a, exceedance_return_period: 100, releases: [none]}",
            "  - {name: a, exceedance_return_period: 300, releases: [other]}",
        )
    )
    assert len(found) == 3


def test_a_trigger_that_does_not_fail_is_refused(with_scenarios):
    folder = with_scenarios("scenarios:", "  - {name: a, return_period: 3, releases: [lower]}")
    file = folder / "site.yaml"
    file.write_text(file.read_text().replace("    thickness: 2.0\n", "    thickness: 2.0\n    starts_when: {arrives: scar}\n"))
    (found,) = problems(folder)
    assert "release lower waits for the flow of scar, which does not fail in this scenario" in found


def test_members_with_other_volumes_than_their_class_are_refused_by_check(with_scenarios):
    volume = 4.0 * 1600.0  # [m3] of the scar
    sampled = "parameters: {release_volume_factor: {distribution: uniform, low: 0.5, high: 2}}"
    good = with_scenarios(
        "scenarios:", f"  - {{name: a, releases: [scar], {LAW}, low: {volume / 2}, high: {2 * volume}}}, {sampled}}}"
    )
    assert not inspect(good, forecast=False).problems
    file = good / "site.yaml"
    file.write_text(file.read_text().replace(f"high: {2 * volume}", f"high: {1.5 * volume}"))
    (found,) = inspect(good, forecast=False).problems
    assert "its members have 3200 to 1.28e+04 m3" in found


def test_alternative_scars_may_overlap_if_they_never_fail_together(with_scenarios):
    apart = ["  - {name: a, return_period: 30, releases: [scar]}", "  - {name: b, return_period: 90, releases: [lower]}"]
    folder = with_scenarios("scenarios:", *apart)
    (folder / "inputs" / "lower.geojson").write_text((folder / "inputs" / "release.geojson").read_text())
    assert not inspect(folder, forecast=False).problems
    file = folder / "site.yaml"
    file.write_text(file.read_text().replace("releases: [lower]", "releases: [lower, scar]"))
    assert any("overlap on" in problem for problem in inspect(folder, forecast=False).problems)


def test_return_periods_without_rates_are_refused_and_must_rise(with_scenarios):
    (found,) = problems(with_scenarios(hazard="hazard: {return_periods: [30, 100]}\n"))
    assert "hazard.return_periods: the ensemble has no annual rates" in found
    assert "ensemble.scenarios" in found


def test_return_periods_that_do_not_rise_are_refused(with_scenarios):
    (found,) = problems(with_scenarios(hazard="hazard: {return_periods: [100, 30]}\n"))
    assert "[100.0, 30.0] does not rise" in found or "[100, 30] does not rise" in found


TABLE = "table: inputs/members.csv"


@pytest.fixture
def with_table(with_scenarios):
    """A function that writes the table of members and returns the folder."""

    def write(text: str, **more: str):
        folder = with_scenarios(TABLE, parameters=False, members=False, **more)
        (folder / "inputs" / "members.csv").write_text(text)
        return folder

    return write


def test_a_table_gives_members_weights_rates_and_failing_releases(with_table):
    folder = with_table(
        "basal_friction_angle_deg,annual_rate,scenario,seed,scar.fails,lower.fails\n20,0.03,often,4,1,0\n,0.01,rare,5,1,1\n",
        hazard="hazard: {return_periods: [50]}\n",
    )
    site = read_site(folder)
    table = member_table(site.settings.ensemble)
    assert table["weight"].tolist() == [0.75, 0.25]
    assert table["scenario"].tolist() == ["often", "rare"]
    first, second = plan_members(site)
    assert first.parameters == {"basal_friction_angle_deg": 20.0, "scar.fails": 1.0, "lower.fails": 0.0}
    assert second.parameters == {"scar.fails": 1.0, "lower.fails": 1.0}, "an empty cell is the value of the site"
    assert [r.name for r in site.member_arguments(first.parameters)["release"]] == ["scar"]
    assert (first.seed, second.seed) == (4, 5)
    assert not inspect(folder, forecast=False).problems


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frction\n20\n", "members.csv:1: frction: no parameter of the members has this name"),
        ("basal_friction_angle_deg\n20\nabc\n", "members.csv:3: basal_friction_angle_deg: 'abc' is no number"),
        (
            "basal_friction_angle_deg\n70\n",
            "members.csv:2: basal_friction_angle_deg: 70 is out of range; it must be at least 0 and at most 60",
        ),
        ("basal_friction_angle_deg\n0.3\n", "members.csv:2: basal_friction_angle_deg: 0.3 deg is suspiciously small"),
        ("basal_friction_angle_deg,weight\n20,0.5\n21,0.4\n", "members.csv:1: weight: the weights add up to 0.9"),
        ("basal_friction_angle_deg,weight\n20,0\n", "members.csv:2: weight: 0 is out of range; it must be above 0"),
        ("basal_friction_angle_deg,annual_rate\n20,-1\n", "members.csv:2: annual_rate: -1 is out of range"),
        (
            "basal_friction_angle_deg,weight,annual_rate\n20,0.5,0.03\n21,0.5,0.01\n",
            "members.csv:2: weight: 0.5 is not the share of its rate, 0.75",
        ),
        ("basal_friction_angle_deg,seed\n20,1\n21,1\n20,1\n", "members.csv:4: repeats the member of line 2"),
        ("basal_friction_angle_deg,seed\n20,1.5\n", "members.csv:2: seed: 1.5 is no whole number"),
        ("basal_friction_angle_deg,scenario\n20\n", "members.csv:2: has 1 cells; the heading has 2"),
        ("basal_friction_angle_deg\n", "members.csv:1: has 1 lines; write a heading"),
        ("basal_mu\n0.2\n", "members.csv:1: basal_mu: no parameter of the members has this name"),
        ("scar.fails\n1\n", "members.csv:1: lower.fails: is missing"),
        ("scar.fails,lower.fails\n1,0\n0,0\n", "members.csv:1: scar.fails: no release fails in member 1"),
    ],
)
def test_faults_of_a_table_are_refused_with_line_and_column(with_table, text, said):
    (found,) = problems(with_table(text))
    assert said in found


def test_every_fault_of_a_table_is_listed(with_table):
    found = problems(with_table("basal_friction_angle_deg,weight\n70,0.5\n20,abc\n,\n"))
    assert [line.split(":")[1] for line in found] == ["2", "3", "4"]


def test_a_table_stands_alone(with_scenarios):
    folder = with_scenarios(TABLE)
    (folder / "inputs" / "members.csv").write_text("basal_friction_angle_deg\n20\n")
    assert any("ensemble.members: the table states the members" in line for line in problems(folder))


def test_a_table_that_was_not_read_is_no_ensemble(with_table):
    settings = load(with_table("basal_friction_angle_deg\n20\n"))
    bare = type(settings.ensemble).model_validate(settings.ensemble.model_dump(exclude_unset=True))
    with pytest.raises(ConfigError, match="was not read"):
        member_table(bare)
