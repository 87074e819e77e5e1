"""Settings that change and change back simulate nothing; files of other settings are counted, and removed on demand."""

import shutil
from pathlib import Path

import pytest
from ramp_site import SITE, member_file

from runout import cli
from runout.errors import ExitCode
from runout.workflow import hazard_map
from runout.workflow.study import STAGES, Study

OTHER = SITE.replace("end_time: 20", "end_time: 2")


@pytest.fixture
def site(finished_site, tmp_path):
    """A copy of the finished site."""
    return Path(shutil.copytree(finished_site[0], tmp_path / "ramp"))


def said(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_a_setting_that_is_changed_and_changed_back_simulates_no_member(site, capsys, monkeypatch):
    own = {member_file(site, number) for number in range(4)}
    (site / "site.yaml").write_text(OTHER)
    assert Study.open(site).left == [0, 1, 2, 3]
    assert "not run yet with these inputs and settings" in Study.open(site).standings[0].reason
    assert hazard_map.run(site, stages=("ensemble",), workers=1).done == ("ensemble",)
    (site / "site.yaml").write_text(SITE)
    monkeypatch.setattr("runout.simulate", None)  # not called
    assert "ensemble" not in hazard_map.run(site, stages=STAGES[:-1], workers=1).done
    assert Study.open(site).left == []
    assert own < set((site / "results" / "members").glob("*.nc"))
    assert len(list((site / "results" / "members").glob("*.nc"))) == 8
    capsys.readouterr()
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert f"4 files of members that these settings do not use ({unused_size(site, own):.3g} MB) are kept" in said(capsys)


def unused_size(site, own):
    return sum(path.stat().st_size for path in set((site / "results" / "members").glob("*.nc")) - own) / 1e6


def test_clean_removes_the_members_of_other_settings_and_no_others(site, capsys):
    own = {member_file(site, number) for number in range(4)}
    (site / "site.yaml").write_text(OTHER)
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert "4 files of members that these settings do not use" in said(capsys)
    (site / "site.yaml").write_text(SITE)
    assert cli.main(["clean", str(site)]) == ExitCode.OK
    assert "removed 0 files" in said(capsys)
    assert hazard_map.run(site, workers=1).done == ()
    (site / "site.yaml").write_text(OTHER)
    assert cli.main(["clean", str(site)]) == ExitCode.OK
    assert "removed 4 files" in said(capsys)
    assert not any(path.exists() for path in own)
