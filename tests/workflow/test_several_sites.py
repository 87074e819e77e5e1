"""Several sites in one command."""

import pytest
import ramp_site

from runout import cli
from runout.errors import ExitCode
from runout.io import netcdf

TEXT = ramp_site.SITE.replace("members: 4", "members: 1").replace("end_time: 20", "end_time: 1")


@pytest.fixture
def sites(tmp_path):
    return [ramp_site.write_site(tmp_path / name, TEXT.replace("name: ramp", f"name: {name}")) for name in ("east", "west")]


def test_sites_run_one_after_the_other(sites, capsys):
    assert cli.main(["run", *map(str, sites), "--workers", "1"]) == ExitCode.OK
    told = capsys.readouterr().err
    assert [line for line in told.splitlines() if line.startswith("site ")] == [
        f"site {n} of 2: {s}" for n, s in enumerate(sites, 1)
    ]
    assert "2 of 2 sites done" in told
    for site in sites:
        assert netcdf.read(site / "results" / "hazard.nc").attrs["title"]
        assert (site / "results" / "report.html").is_file()


def test_a_site_that_fails_does_not_keep_the_others_from_running(sites, capsys):
    broken, sound = sites
    (broken / "site.yaml").write_text(TEXT.replace("density:", "densty:"))
    assert cli.main(["run", *map(str, sites), "--workers", "1"]) == ExitCode.CONFIGURATION
    told = capsys.readouterr().err
    assert f"{broken}: " in told
    assert "did you mean 'density'?" in told
    assert "1 of 2 sites done" in told
    assert (sound / "results" / "hazard.nc").is_file()
    assert not (broken / "results" / "hazard.nc").exists()


def test_one_results_folder_for_several_sites_is_refused(sites, tmp_path, capsys):
    assert cli.main(["run", *map(str, sites), "--out", str(tmp_path / "results")]) == ExitCode.CONFIGURATION
    assert "is one folder, and 2 sites are given; remove it, or run one site" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()
