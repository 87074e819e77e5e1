"""Two events on ramps of different slabs share their friction: one posterior from both, and what cannot be shared is refused."""

import json

import pandas as pd
import pytest
from ramp_site import SITE, slab, write_site
from test_calibration import SAMPLED, observe

import runout
from runout import cli
from runout.errors import ExitCode

FRICTION, THICKNESSES = 17.0, {"ramp_a": 8.0, "ramp_b": 5.0}
FEW = SAMPLED.replace("members: 32", "members: 16")
VOLUME = "    release_volume_factor: {distribution: uniform, low: 0.9, high: 1.1}\nhazard:"
ARGUMENTS = ("--rounds", "1", "--points", "2", "--rows", "32", "--workers", "1")


@pytest.fixture(scope="module")
def events(tmp_path_factory):
    """Folder with two calibrated sites, of which the second also samples its volume, and their joint results."""
    folder = tmp_path_factory.mktemp("events")
    for name, thickness in THICKNESSES.items():
        text = FEW.replace("name: ramp", f"name: {name}")
        site = write_site(folder / name, text, thickness=slab() * thickness / 8.0)
        observe(site, FRICTION, text.replace("hazard:", VOLUME, 1) if name == "ramp_b" else text)
    sites = [str(folder / name) for name in THICKNESSES]
    own = ("--own", "release_volume_factor", "--without", "deposit.volume")
    assert cli.main(["calibrate", *sites, "--out", str(folder / "joint"), *own, *ARGUMENTS]) == 0
    return folder


def record(events):
    return json.loads((events / "joint" / "calibration" / "calibration.json").read_text())


def test_shared_friction_lies_in_its_interval_and_the_volume_of_one_event_is_its_own(events):
    found = record(events)["parameters"]
    assert list(found) == ["basal_friction_angle_deg", "ramp_b: release_volume_factor"]
    friction = found["basal_friction_angle_deg"]
    assert friction["p5"] <= FRICTION <= friction["p95"]
    assert friction["standard_deviation_over_prior"] < 0.2


def test_each_event_has_its_own_runs_and_is_predicted_from_the_other(events):
    found = record(events)["events"]
    assert set(found) == set(THICKNESSES)
    for name, one in found.items():
        assert one["members"] == 18
        assert one["grid_error"] is None
        assert set(one["validation"]) == set(one["observations"])
        assert len(list((events / "joint" / "calibration" / name / "members").glob("*.nc"))) == 2
    assert all(abs(row["deviation"]) < 2.5 for one in found.values() for row in one["validation"].values())


def test_tables_hold_shared_parameters_and_those_of_each_event(events):
    folder = events / "joint" / "calibration"
    assert list(pd.read_csv(folder / "posterior.csv").columns) == ["basal_friction_angle_deg"]
    assert list(pd.read_csv(folder / "posterior_ramp_b.csv").columns) == ["basal_friction_angle_deg", "release_volume_factor"]
    assert not (folder / "posterior_ramp_a.csv").exists()
    assert set(record(events)["tables"]) == {"posterior.csv", "posterior_ramp_b.csv"}


def test_another_site_takes_the_joint_table_as_its_ensemble(events):
    text = SITE[: SITE.index("ensemble:")] + "ensemble: {table: inputs/posterior.csv}\n" + SITE[SITE.index("hazard:") :]
    site = write_site(events / "other", text)
    (site / "inputs" / "posterior.csv").write_bytes((events / "joint" / "calibration" / "posterior.csv").read_bytes())
    assert cli.main(["check", str(site)]) == 0


def test_a_second_call_runs_no_member_and_gives_the_same_table(events, monkeypatch, capsys):
    def fail(**_):
        raise AssertionError("a member ran again")

    before = (events / "joint" / "calibration" / "posterior.csv").read_bytes()
    monkeypatch.setattr(runout, "simulate", fail)
    sites = [str(events / name) for name in THICKNESSES]
    own = ("--own", "release_volume_factor", "--without", "deposit.volume")
    assert cli.main(["calibrate", *sites, "--out", str(events / "joint"), *own, *ARGUMENTS]) == 0
    assert (events / "joint" / "calibration" / "posterior.csv").read_bytes() == before
    printed = capsys.readouterr().out
    assert "2 events, 36 members" in printed
    assert "ramp_a: validation, each predicted from the other events:" in printed
    assert "ramp_b: error of the grid: not in these numbers" in printed


def refusal(capsys, *arguments):
    assert cli.main(list(arguments)) == ExitCode.CONFIGURATION
    return capsys.readouterr().err


def test_a_parameter_that_a_site_lacks_or_with_another_range_is_named_with_the_remedy(events, capsys):
    sites, out = [str(events / name) for name in THICKNESSES], ("--out", str(events / "refused"))
    message = refusal(capsys, "calibrate", *sites, *out)
    assert (
        "release_volume_factor: sampled by ramp_b, not by ramp_a; sample it in all sites, or write --own release_volume_factor"
        in message
    )
    text = (events / "ramp_b" / "site.yaml").read_text()
    other = write_site(events / "ramp_c", text.replace("name: ramp_b", "name: ramp_c").replace("high: 26", "high: 24"))
    for file in ("outline.gpkg", "deposit.tif"):
        (other / "inputs" / file).write_bytes((events / "ramp_b" / "inputs" / file).read_bytes())
    message = refusal(capsys, "calibrate", sites[1], str(other), *out)
    assert "basal_friction_angle_deg: a shared parameter has one prior, but the sites state several" in message
    assert "ramp_b uniform 10 26; ramp_c uniform 10 24" in message
    assert not (events / "refused").exists()


def test_wrong_use_of_several_sites_is_refused(events, capsys):
    sites, out = [str(events / name) for name in THICKNESSES], ("--out", str(events / "refused"))
    assert "2 sites have one posterior; write --out FOLDER for it" in refusal(capsys, "calibrate", *sites)
    assert "is named ramp_a as well" in refusal(capsys, "calibrate", sites[0], sites[0], *out)
    assert "--own density: no site samples it" in refusal(
        capsys, "calibrate", *sites, *out, "--own", "density", "release_volume_factor"
    )
    every = ("--own", "basal_friction_angle_deg", "release_volume_factor")
    assert "no parameter is left that the sites share" in refusal(capsys, "calibrate", *sites, *out, *every)
    own = ("--own", "release_volume_factor")
    assert "--without gauges: no observation of any site" in refusal(capsys, "calibrate", *sites, *out, *own, "--without", "gauges")
    assert "one site shares no parameter" in refusal(capsys, "calibrate", sites[0], "--own", "density")
