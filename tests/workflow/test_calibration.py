"""A synthetic event on the ramp: its friction is found again, runs are kept, and what cannot be calibrated is refused."""

import json
from functools import wraps

import geopandas
import numpy as np
import pandas as pd
import pytest
import rasterio.features
import rasterio.transform
import shapely
from ramp_site import CELL, NORTH, SITE, WEST, write_raster, write_site

import runout
from runout import cli
from runout.config.site import read_site
from runout.errors import ExitCode
from runout.workflow import calibration, calibration_record

FRICTION = 17.0
SAMPLED = SITE.replace("members: 4", "members: 32").replace("low: 12, high: 22", "low: 10, high: 26")
OBSERVED = """\
observations:
  outline: {polygons: inputs/outline.gpkg}
  deposit: {raster: inputs/deposit.tif}
"""
FOLDER = "calibration"


def observe(folder, friction, text=SAMPLED):
    """Write the observations of an event with a friction angle [deg], of a seed that no member has."""
    event = runout.simulate(**{**read_site(folder).member_arguments({"basal_friction_angle_deg": friction}), "seed": 987})
    reached = (event.fields["max_flow_thickness"] >= 0.1).astype("uint8")
    place = rasterio.transform.from_origin(WEST, NORTH, CELL, CELL)
    parts = [shapely.geometry.shape(one) for one, value in rasterio.features.shapes(reached, transform=place) if value]
    outline = geopandas.GeoDataFrame(geometry=[shapely.union_all(parts)], crs="EPSG:32632")
    outline.to_file(folder / "inputs" / "outline.gpkg")
    write_raster(folder / "inputs" / "deposit.tif", event.fields["deposit_thickness"])
    (folder / "site.yaml").write_text(text + OBSERVED)
    return folder


def record(folder):
    return json.loads((folder / "results" / FOLDER / "calibration.json").read_text())


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    folder = observe(write_site(tmp_path_factory.mktemp("calibrated") / "ramp", SAMPLED), FRICTION)
    assert cli.main(["calibrate", str(folder), "--rounds", "1", "--points", "4", "--rows", "32", "--workers", "1"]) == 0
    return folder


def test_friction_of_the_event_lies_in_its_interval(calibrated):
    found = record(calibrated)["parameters"]["basal_friction_angle_deg"]
    assert found["p5"] <= FRICTION <= found["p95"]
    assert found["p95"] - found["p5"] < 3.0
    assert found["standard_deviation_over_prior"] < 0.2


def test_record_says_what_was_fitted_what_was_not_and_what_it_predicts(calibrated):
    found = record(calibrated)
    assert found["members"] == 36
    assert {"outline.area", "outline.runout", "deposit.distance"} <= set(found["observations"])
    assert {*found["observations"], *found["left_out_of_the_likelihood"]} - {"deposit.volume"} == {
        *("outline.area", "outline.runout", "deposit.distance"),
    }
    assert all(abs(one["deviation"]) < 2.0 for one in found["validation"].values())
    assert all(one["held_out_q2"] > 0.9 for one in found["observations"].values())
    assert found["grid_error"] is None
    for shares in found["marginals"].values():
        assert len(shares["edges"]) == len(shares["prior"]) + 1
        assert sum(shares["prior"]) == pytest.approx(1.0)
        assert sum(shares["posterior"]) == pytest.approx(1.0)


def test_boundary_in_parts_takes_the_place_of_the_area(calibrated, monkeypatch):
    monkeypatch.setattr(calibration, "write", lambda folder, posterior, content, rows, tables: seen.append(content) or [])
    seen = []
    arguments = ["--rounds", "0", "--without", "deposit", "--outline", "boundary"]
    assert cli.main(["calibrate", str(calibrated), *arguments]) == 0
    (found,) = seen
    friction = found["parameters"]["basal_friction_angle_deg"]
    assert friction["p5"] <= FRICTION <= friction["p95"]
    assert friction["p95"] - friction["p5"] < 3.0
    assert "outline.area" not in {*found["observations"], *found["left_out_of_the_likelihood"]}
    assert "outline.position.1" in found["observations"]  # the front
    assert "outline.runout" in found["observations"]


def test_table_of_the_posterior_has_the_names_that_an_ensemble_samples(calibrated):
    table = pd.read_csv(calibrated / "results" / FOLDER / "posterior.csv")
    assert list(table.columns) == ["basal_friction_angle_deg"]
    assert len(table) == 32
    assert table.mean().item() == pytest.approx(record(calibrated)["parameters"]["basal_friction_angle_deg"]["mean"], abs=0.3)
    assert (calibrated / "results" / FOLDER / "posterior.png").stat().st_size > 5000


def test_a_second_call_runs_no_member(calibrated, monkeypatch, capsys):
    def fail(**_):
        raise AssertionError("a member ran again")

    before = (calibrated / "results" / FOLDER / "posterior.csv").read_bytes()
    monkeypatch.setattr(runout, "simulate", fail)
    assert cli.main(["calibrate", str(calibrated), "--rounds", "1", "--points", "4", "--rows", "32"]) == 0
    assert (calibrated / "results" / FOLDER / "posterior.csv").read_bytes() == before
    said = capsys.readouterr().out
    assert "basal_friction_angle_deg" in said
    assert "error of the grid: not in these numbers" in said
    assert "validation, each predicted from the other observations:" in said


def test_a_round_that_was_broken_off_goes_on_with_the_same_members(calibrated, monkeypatch):
    arguments = ["calibrate", str(calibrated), "--rounds", "2", "--points", "4", "--workers", "1"]
    simulate, angles = runout.simulate, []

    @wraps(simulate)
    def twice(**scenario):
        if len(angles) == 2:
            raise KeyboardInterrupt
        angles.append(scenario["basal_friction_angle"])
        return simulate(**scenario)

    monkeypatch.setattr(runout, "simulate", twice)
    assert cli.main(arguments) == cli.INTERRUPTED
    rounds = json.loads((calibrated / "results" / FOLDER / "rounds.json").read_text())["rounds"]
    rest = []

    @wraps(simulate)
    def counted(**scenario):
        rest.append(scenario["basal_friction_angle"])
        return simulate(**scenario)

    monkeypatch.setattr(runout, "simulate", counted)
    assert cli.main(arguments) == 0
    assert len(rest) == 2
    planned = 10.0 + 16.0 * np.array(rounds[1])[:, 0]
    np.testing.assert_allclose(angles + rest, planned, rtol=1e-12)
    assert record(calibrated)["members"] == 40


def test_options_leave_out_observations_and_state_errors(calibrated, monkeypatch):
    monkeypatch.setattr(calibration, "write", lambda folder, posterior, content, rows, tables: seen.append(content) or [])
    seen = []
    arguments = ["--rounds", "0", "--without", "deposit", "outline.area", "--error", "outline.runout=20"]
    assert cli.main(["calibrate", str(calibrated), *arguments]) == 0
    (found,) = seen
    assert found["members"] == 32
    assert found["observations"]["outline.runout"]["standard_error"] == 20.0
    assert list(found["observations"]) == ["outline.runout"]
    assert found["validation"] == {}


def test_pairs_on_halved_cells_are_run_and_counted(calibrated):
    arguments = ["--rounds", "0", "--fine-pairs", "8", "--threads", "1", "--workers", "1", "--device", "cpu"]
    assert cli.main(["calibrate", str(calibrated), "--out", str(calibrated / "results"), *arguments]) == 0
    found = record(calibrated)["grid_error"]
    assert found["pairs"] == 8
    assert abs(found["offset"]["basal_friction_angle_deg"]) < 4.0
    assert len(list((calibrated / "results" / FOLDER / "fine" / "members").glob("*.nc"))) == 8


def test_indices_of_the_ramp_are_in_its_report(calibrated):
    assert cli.main(["sensitivity", str(calibrated)]) == 0
    found = json.loads((calibrated / "results" / "sensitivity" / "sensitivity.json").read_text())
    assert found["quantities"]["runout_distance"]["parameters"]["basal_friction_angle_deg"]["total"] > 0.95
    assert (calibrated / "results" / "sensitivity" / "tornado.png").stat().st_size > 5000
    table = pd.read_csv(calibrated / "results" / "sensitivity" / "sensitivity.csv")
    assert set(table["parameter"]) == {"basal_friction_angle_deg"}
    assert cli.main(["run", str(calibrated)]) == 0
    page = (calibrated / "results" / "report.html").read_text()
    assert "Which parameters matter" in page
    assert "Prior and posterior of basal friction angle" in page
    assert "Validation, each predicted from the other observations alone" in page


def refusal(capsys, *arguments):
    assert cli.main(list(arguments)) == ExitCode.CONFIGURATION
    return capsys.readouterr().err


def test_all_that_keeps_a_site_from_a_calibration_is_said_at_once(tmp_path, capsys):
    text = SITE[: SITE.index("  parameters:")] + SITE[SITE.index("hazard:") :]
    said = refusal(capsys, "calibrate", str(write_site(tmp_path / "ramp", text)))
    assert "observations: nothing was observed; state one of outline, deposit, difference, gauges" in said
    assert "no parameter is sampled; add one" in said
    assert "site.yaml:13: ensemble.members: 4 members; a calibration needs 16, better 32" in said


def test_an_observation_beside_the_dem_is_refused_before_any_run(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SAMPLED)
    beside = geopandas.GeoDataFrame(geometry=[shapely.box(WEST - 900, NORTH, WEST - 500, NORTH + 50)], crs="EPSG:32632")
    beside.to_file(folder / "inputs" / "outline.gpkg")
    (folder / "site.yaml").write_text(SAMPLED + "observations:\n  outline: {polygons: inputs/outline.gpkg}\n")
    assert "outline" in refusal(capsys, "calibrate", str(folder))
    assert not (folder / "results" / "members").exists()


def test_few_pairs_and_no_members_are_refused(tmp_path, capsys):
    folder = write_site(tmp_path / "ramp", SAMPLED)
    assert "--fine-pairs 3: their covariance needs 8" in refusal(capsys, "calibrate", str(folder), "--fine-pairs", "3")
    assert cli.main(["sensitivity", str(folder)]) == ExitCode.PARTIAL_ENSEMBLE
    assert "no member has run with these settings; run `runout ensemble" in capsys.readouterr().err


def test_an_event_beyond_all_members_is_named(calibrated):
    event = calibration.Event.of(read_site(calibrated), calibration.CalibrationChoices())
    event.scalars = [calibration.replace(one, value=one.value + 5000.0) for one in event.scalars if one.name == "outline.runout"]
    event.modelled = [{"outline.runout": 100.0 + 10.0 * k} for k in range(16)]
    event.members = calibration.plan_members(event.site)[:16]
    order = np.argsort([-one.parameters["basal_friction_angle_deg"] for one in event.members])
    event.members = [event.members[k] for k in order]
    likelihood, scalars = event.likelihood()
    (said,) = calibration_record._misfits(event, likelihood, scalars)
    assert "outline.runout: observed 52" in said
    assert "all 16 members lie between 100 and 250" in said
