"""`runout what-if`: values of parameters become runs on coarse cells, a table and a page; others are refused with a remedy."""

import re
import webbrowser

import numpy as np
import pandas as pd
import pytest
from ramp_site import SITE, write_site

from runout import cli
from runout.config.site import read_site
from runout.ensemble.sweep import median_parameters, read_sweep
from runout.errors import BudgetError, ConfigError, ExitCode
from runout.forecast.engine_notes import StepCost
from runout.workflow.time_budget import TimeBudget

SHORT = SITE.replace("end_time: 20", "end_time: 8")
SCENARIOS = SHORT.replace("  members: 4\n", "").replace(
    "hazard:",
    """  scenarios:
    - {name: rare, return_period: 300, members: 2, parameters: {release_volume_factor: {distribution: uniform, low: 1, high: 2}}}
    - {name: frequent, return_period: 30, members: 2}
hazard:""",
)
PROBED = SHORT.replace("20\nsim", "20\nprobes: {cross_sections: inputs/line.gpkg}\nsim")
FINE = SITE.replace("cell_size: 10", "cell_size: 2").replace("end_time: 20", "end_time: 3")
ANGLE, VOLUME = "basal_friction_angle_deg", "release_volume_factor"


def swept(folder, *values, out=None, options=()):
    where = [] if out is None else ["--out", str(out)]
    return cli.main(["what-if", str(folder), *values, "--cell-size", "20", "--workers", "1", *where, *options])


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Folder of a site, and of its sweep over the friction angle."""
    folder = write_site(tmp_path_factory.mktemp("sweep") / "ramp", PROBED)
    import geopandas
    import shapely

    line = shapely.LineString([(500_200.0, 4_999_800.0), (500_200.0, 4_999_960.0)])
    lines = geopandas.GeoDataFrame({"name": ["road <&$>"]}, geometry=[line], crs="EPSG:32632")
    lines.to_file(folder / "inputs" / "line.gpkg", engine="pyogrio")
    assert swept(folder, "friction.basal=15:25:5") == ExitCode.OK
    return folder, folder / "results_what_if" / ANGLE


def test_area_and_run_out_fall_with_the_friction_angle(done):
    folder, results = done
    table = pd.read_csv(results / "what_if.csv")
    assert list(table[ANGLE]) == [15.0, 20.0, 25.0]
    assert (np.diff(table["reached_area"]) < 0).all()
    assert (np.diff(table["runout_distance"]) <= 0).all()
    assert (np.diff(table["passed road <&$>"]) <= 0).all()
    assert not (folder / "results").exists(), "the results of site.yaml stay"


def test_page_is_one_file_with_a_place_on_each_curve_for_each_run(done):
    text = (done[1] / "what_if.html").read_text()
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", text)
    assert "road <&$>" not in text
    assert "volume past road &lt;&amp;$&gt;" in text
    places = eval(re.search(r'"places": (\[.*?\])\}', text)[1])
    assert [len(of_run) for of_run in places] == [3, 3, 3]  # area, run-out, volume
    across = np.array(places)[:, 0, 0]
    assert (np.diff(across) > 0).all()
    assert np.diff(across)[0] == pytest.approx(np.diff(across)[1], abs=0.2)  # equal steps of the angle
    assert (np.diff(np.array(places)[:, 0, 1]) > 0).all()  # the area falls: places of the SVG count downwards
    for angle in ("15", "20", "25"):
        assert f"<td>{angle}</td>" in text


def test_a_longer_range_runs_the_new_values_alone(done, tmp_path, monkeypatch, capsys):
    folder, results = done
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s" "$1" > "{tmp_path}/opened"\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    monkeypatch.setattr(webbrowser, "_tryorder", None)  # which it made of the environment of an earlier test
    before = {path: path.stat().st_mtime_ns for path in (results / "members").glob("*.nc")}
    assert len(before) == 3
    options = ["--open", "--threads", "1", "--device", "cpu"]
    assert swept(folder, f"{ANGLE}=15:30:5", options=options) == ExitCode.OK
    assert (tmp_path / "opened").read_text() == (results / "what_if.html").as_uri()
    assert "1 of 4 members to simulate" in capsys.readouterr().err
    assert before.items() <= {path: path.stat().st_mtime_ns for path in (results / "members").glob("*.nc")}.items()
    assert list(pd.read_csv(results / "what_if.csv")[ANGLE]) == [15.0, 20.0, 25.0, 30.0]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("friction=10:20:5", "friction: members have no such parameter (did you mean basal_friction_angle_deg or "),
        ("simulation.cell_size=10,20", "runout run SITE --set simulation.cell_size=VALUE --out DIR"),
        ("basal_fricton_angle_deg=10:20:5", "did you mean 'basal_friction_angle_deg'?"),
        (f"{ANGLE}=20:10:5", "the step 5 does not lead from 20 to 10; write 20:10:-5"),
        (f"{ANGLE}=10:20:-5", "the step -5 does not lead from 10 to 20; write 10:20:5"),
        (f"{ANGLE}=10:20:0", "the step of 10:20:0 is 0"),
        (f"{ANGLE}=10:20:30", "the step 30 is longer than the range"),
        (f"{ANGLE}=10:20:0.001", "more than 500"),
        (f"{ANGLE}=20:20:1", "has one value"),
        (f"{ANGLE}=10:20", "add a step, such as 10:20:1"),
        (f"{ANGLE}=", "'' holds no values"),
        (f"{ANGLE}=10,ten", "'10,ten' holds no values"),
        (f"{ANGLE}=10,20:30:5", "holds no values; write KEY=LOW:HIGH:STEP or KEY=A,B,C"),
        (f"{ANGLE}=nan,20", "holds no values"),
        (f"{ANGLE}=20,20", "repeats a value"),
        (f"{ANGLE}=0.2,0.3", "angles are in degrees here"),
        (f"{ANGLE}=50:70:20", "70 is out of range"),
        (f"{ANGLE}=20", "makes 1 run; two values are needed"),
        ("=1,2", "there is no key"),
    ],
)
def test_keys_and_values_that_make_no_sweep_are_refused_with_a_remedy(done, value, message, capsys):
    assert swept(done[0], value) == ExitCode.CONFIGURATION
    printed = capsys.readouterr().err
    assert "what-if: " in printed
    assert message in printed


def test_all_problems_are_named_at_once(done, capsys):
    assert swept(done[0], "foo=1,2", f"{VOLUME}=2:1:1") == ExitCode.CONFIGURATION
    assert [line.count("what-if: ") for line in capsys.readouterr().err.splitlines()] == [1, 1]


def test_values_are_combined_or_varied_one_at_a_time(done):
    settings = read_site(done[0]).settings
    grid = read_sweep(settings, [f"{ANGLE}=15:25:5", f"{VOLUME}=0.5,1"])
    assert [(row[ANGLE], row[VOLUME]) for row in grid.rows()] == [(a, v) for a in (15, 20, 25) for v in (0.5, 1.0)]
    each = read_sweep(settings, [f"{ANGLE}=15:25:5", f"{VOLUME}=0.5,1"], one_at_a_time=True)
    median = pytest.approx(17.0)
    assert each.rows() == [{ANGLE: 15.0}, {ANGLE: 20.0}, {ANGLE: 25.0}, {ANGLE: median, VOLUME: 0.5}, {ANGLE: median, VOLUME: 1.0}]


def test_tenths_are_exact():
    from runout.ensemble.sweep import _values
    from runout.model.limits import Range

    assert list(_values("0.1:0.7:0.1", "x", Range(0, 1))) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    assert list(_values("1:0:-0.25", "x", Range(0, 1))) == [1.0, 0.75, 0.5, 0.25, 0.0]


def test_other_parameters_have_the_medians_of_a_scenario(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SCENARIOS)
    assert median_parameters(read_site(folder).settings, "rare") == {ANGLE: pytest.approx(17.0), VOLUME: pytest.approx(1.5)}
    assert swept(folder, f"{ANGLE}=15,20") == ExitCode.CONFIGURATION
    assert "name the one whose values the other parameters have: --scenario rare" in capsys.readouterr().err
    assert swept(folder, f"{ANGLE}=15,20", options=["--scenario", "rear"]) == ExitCode.CONFIGURATION
    assert "did you mean 'rare'?" in capsys.readouterr().err


def test_a_scenario_of_a_site_without_any_is_refused(done):
    with pytest.raises(ConfigError, match="remove --scenario"):
        read_sweep(read_site(done[0]).settings, [f"{ANGLE}=15,20"], "rare")


def test_more_runs_than_fit_into_the_budget_are_refused(done, tmp_path, capsys):
    options = ["--budget", "0.01s"]
    assert swept(done[0], f"{ANGLE}=15:25:1", out=tmp_path / "out", options=options) == ExitCode.OVER_BUDGET
    printed = capsys.readouterr().err
    assert "11 members on cells of 20 m need about" in printed
    assert "fits, or fewer values" in printed
    assert not (tmp_path / "out" / "members").exists()


@pytest.mark.parametrize(("seconds", "coarser"), [(1e6, False), (40.0, True)])
def test_cells_are_those_of_the_site_or_coarser_ones_that_fit(tmp_path, seconds, coarser):
    site = read_site(write_site(tmp_path / "ramp", FINE))
    limit = TimeBudget(site, seconds, tmp_path, 1, lambda _: StepCost(1e-2, 2e-6))
    cells = limit.coarsened()
    assert (cells.cell_size[0] > 2.0) == coarser
    assert cells.seconds <= seconds
    assert cells.numerical == pytest.approx(limit.numerical_error(cells.cell_size, cells.through))
    if coarser:
        assert cells.numerical > limit.of_size((2.0, 2.0, 2.0)).numerical


def test_a_time_that_holds_no_cells_is_refused(tmp_path):
    site = read_site(write_site(tmp_path / "ramp", SITE.replace("cell_size: 10", "cell_size: 2")))
    with pytest.raises(BudgetError, match="the coarsest whose error is known"):
        TimeBudget(site, 1.0, tmp_path, 1, lambda _: StepCost(1e-2, 2e-6)).coarsened()
