"""Start time, velocity and trigger of releases in site.yaml: values, refusals, and what an ensemble samples of each release."""

import pytest
from refused_site import problems

from runout import Arrival, StartVelocity, read_site
from runout.config.parameter_variables import parameter_variable
from runout.errors import ConfigError

SCAR = "    thickness: 4.0\n"
SECOND = "  - name: second\n    polygons: inputs/release.geojson\n    thickness: 2.0\n    placement: on_surface\n"
LINE = "basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"


def with_starts(edited, first="", second="", sampled=""):
    """The site with two releases and what each states of its start, line by line."""
    first, second, sampled = ("".join(f"    {line}\n" for line in lines.splitlines()) for lines in (first, second, sampled))
    edited(SCAR, f"{SCAR}{first}{SECOND}{second}")
    return edited(LINE, f"{LINE}{sampled}")


def test_releases_have_the_starts_that_site_yaml_states(edited):
    first = "velocity: {speed: 5, azimuth_deg: 90}"
    folder = with_starts(edited, first, "starts_when: {arrives: scar, thickness: 0.3}\nvelocity: [3.0, 0, -1]")
    one, other = read_site(folder).releases()
    assert (one.start_time, one.velocity, one.starts_when, one.waits) == (0.0, StartVelocity(5.0, 90.0), None, False)
    assert (other.velocity, other.starts_when, other.waits) == ((3.0, 0.0, -1.0), Arrival("scar", 0.3), True)
    edited("starts_when: {arrives: scar, thickness: 0.3}", "start_time: 12.0")
    edited("velocity: [3.0, 0, -1]", "velocity: 8")
    other = read_site(folder).releases()[1]
    assert (other.start_time, other.velocity, other.starts_when) == (12.0, StartVelocity(8.0), None)
    assert "start_time" not in read_site(folder).resolved()["release"][0]


def test_releases_without_a_start_have_none(site_folder):
    (release,) = read_site(site_folder).releases()
    assert (release.start_time, release.velocity, release.starts_when, release.waits) == (0.0, None, None, False)
    assert not {"start_time", "velocity", "starts_when"} & read_site(site_folder).resolved()["release"][0].keys()


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        ("start_time: -1", "", "release[0].start_time: -1 s is out of range; it must be at least 0 and at most 86400 s"),
        ("", "start_time: 30", "release[1].start_time: starts at 30 s, the run ends at 30 s; start it earlier"),
        ("velocity: -2", "", "release[0].velocity: -2 m/s is out of range"),
        (
            "velocity: fast",
            "",
            "velocity: 'fast' is text; a number or a block {key: value, ...} or a list is needed",
        ),
        ("velocity: [1, 2]", "", "release[0].velocity: a list of 2; 3 values are needed"),
        (
            "velocity: {azimuth_deg: 3}",
            "",
            "velocity.speed: required key is missing; add it: speed along the ground",
        ),
        (
            "velocity: {speed: 3, azimut_deg: 3}",
            "",
            "velocity.azimut_deg: unknown key; did you mean 'azimuth_deg'?",
        ),
        ("velocity: {speed: 3, azimuth_deg: 400}", "", "release[0].velocity.azimuth_deg: 400 deg is out of range"),
        ("", "starts_when: {thickness: 1}", "release[1].starts_when.arrives: required key is missing"),
        ("", "starts_when: {arrives: scar, thickness: 0}", "release[1].starts_when.thickness: 0 m is out of range"),
        ("", "starts_when: {arrives: second}", "release[1].starts_when: waits for its own flow; name another release (scar)"),
        (
            "",
            "starts_when: {arrives: scarp}",
            "starts_when: waits for 'scarp', which is no release; name another release (scar)",
        ),
        (
            "",
            "starts_when: {arrives: scar}\nstart_time: 3",
            "release[1].starts_when: start_time is given too; remove one of the two",
        ),
    ],
)
def test_starts_that_cannot_be_are_refused_in_one_line(edited, first, second, message):
    (line,) = problems(with_starts(edited, first, second))
    assert message in line
    assert line.startswith("site.yaml:")


def test_releases_that_wait_for_each_other_are_refused_together(edited):
    both = with_starts(edited, "starts_when: {arrives: second}", "starts_when: {arrives: scar}")
    first, second = problems(both)
    assert "release[0].starts_when: waits for second, which never starts before it; let one of" in first
    assert "release[1].starts_when: waits for scar, which never starts before it" in second


SAMPLED = (
    "second.start_time: {distribution: uniform, low: 0, high: 20}\n"
    "scar.start_speed: {distribution: discrete, values: [2, 4], frequencies: [1, 1]}"
)


def test_an_ensemble_samples_the_start_of_each_release(edited):
    folder = with_starts(edited, "velocity: {speed: 5, azimuth_deg: 90}", sampled=SAMPLED)
    site = read_site(folder)
    assert list(site.settings.ensemble.parameters) == ["basal_friction_angle_deg", "second.start_time", "scar.start_speed"]
    one, other = site.releases(sample={"second.start_time": 7.5, "scar.start_speed": 4.0})
    assert (one.start_time, one.velocity) == (0.0, StartVelocity(4.0, 90.0))
    assert (other.start_time, other.velocity) == (7.5, None)
    one, other = site.member_arguments({"second.start_time": 0.0, "scar.start_speed": 2.0})["release"]
    assert not other.waits
    with pytest.raises(ConfigError, match=r"scarp\.start_time: not a parameter of a member"):
        site.releases(sample={"scarp.start_time": 7.5})
    for name, units, words in (
        ("second.start_time", "s", "start time of release second"),
        ("scar.start_speed", "m s-1", "speed at the start of release scar"),
    ):
        variable = parameter_variable(name)
        assert (variable.units, variable.long_name) == (units, words)


@pytest.mark.parametrize(
    ("first", "second", "sampled", "message"),
    [
        ("", "", "third.start_time: {distribution: uniform, low: 1, high: 2}", "third.start_time: no release is called 'third'"),
        (
            "",
            "",
            "second.start_time: {distribution: uniform, low: 1, high: 40}",
            "it can give 40 s; the run ends at 30 s; narrow it",
        ),
        (
            "",
            "",
            "second.start_time: {distribution: uniform, low: -1, high: 2}",
            "it can give -1 s; the parameter must be at least 0",
        ),
        (
            "",
            "starts_when: {arrives: scar}",
            "second.start_time: {distribution: uniform, low: 1, high: 2}",
            "release second starts_when the flow of another arrives, not at a time; remove one of the two",
        ),
        (
            "",
            "velocity: [1, 2, 0]",
            "second.start_speed: {distribution: uniform, low: 1, high: 2}",
            "the velocity of release second has three components; state velocity: {speed, azimuth_deg}",
        ),
    ],
)
def test_samples_of_starts_that_are_not_there_are_refused(edited, first, second, sampled, message):
    (line,) = problems(with_starts(edited, first, second, sampled))
    assert message in line


def test_an_ensemble_samples_the_pore_pressure_of_one_release_alone(edited):
    """A number of one release goes before that of all; what a release does not state is refused with its key."""
    wet = "pore_pressure: {ratio: 0.4, decay_time: 20}"
    sampled = (
        "pore_pressure_ratio: {distribution: uniform, low: 0.1, high: 0.3}\n"
        "second.pore_pressure_ratio: {distribution: uniform, low: 0.5, high: 0.7}\n"
        "second.pore_pressure_decay_time: {distribution: uniform, low: 5, high: 9}"
    )
    site = read_site(with_starts(edited, wet, wet, sampled))
    sample = {"pore_pressure_ratio": 0.2, "second.pore_pressure_ratio": 0.6, "second.pore_pressure_decay_time": 7.0}
    one, other = (release.pore_pressure for release in site.releases(sample=sample))
    assert (one.ratio, one.decay_time, other.ratio, other.decay_time) == (0.2, 20.0, 0.6, 7.0)
    variable = parameter_variable("second.pore_pressure_decay_time")
    assert (variable.units, variable.long_name.partition(",")[0]) == ("s", "release second")


@pytest.mark.parametrize(
    ("second", "key", "said"),
    [
        ("", "second.pore_pressure_ratio", "the pore pressure of release second does not state it"),
        ("pore_pressure: {ratio: 0.4, decay_time: 20}", "second.pore_pressure_diffusivity", "of release second does not state it"),
        ("", "third.pore_pressure_ratio", "no release or inflow is called 'third'"),
    ],
)
def test_a_sampled_pore_pressure_that_a_release_does_not_have_is_refused(edited, second, key, said):
    folder = with_starts(edited, "", second, f"{key}: {{distribution: uniform, low: 0.1, high: 0.2}}")
    (problem,) = problems(folder)
    assert f"ensemble.parameters.{key}: {said}" in problem or (key in problem and said in problem)
