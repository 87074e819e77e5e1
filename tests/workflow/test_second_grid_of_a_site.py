"""`runout verify SITE --second-grid`: the members on coarser cells, and maps of the numerical error."""

import numpy as np
import pytest
import xarray as xr
from ramp_site import SITE, write_site

from runout import cli
from runout.errors import ExitCode
from runout.workflow.study import Study

SHORT = SITE.replace("end_time: 20", "end_time: 6").replace("members: 4", "members: 2")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_site(tmp_path_factory.mktemp("grids") / "ramp", SHORT)
    assert cli.main(["verify", str(folder), "--second-grid"]) == ExitCode.OK
    return folder


def test_maps_have_errors_of_each_cell(site):
    with xr.open_dataset(site / "results" / "hazard.nc") as maps:
        error, reached = maps["flow_thickness_numerical_error"].values, maps["members_reached"].values > 0
        assert (error[reached] > 0).mean() > 0.9
        assert set(np.unique(maps["deciding_error"])) <= {0, 1, 2, 3}
        assert "thickness_exceedance_numerical_error" in maps
        second = xr.open_dataset(next((site / "results" / "second_grid" / "members").glob("*.nc")))
        assert "max_flow_thickness" in second


def test_everything_is_up_to_date_and_stays_so(site, capsys):
    study = Study.open(site)
    assert [stage for stage in ("hazard", "report") if study.why_stale(next(s for s in _plan() if s.name == stage))] == []
    assert cli.main(["run", str(site)]) == ExitCode.OK
    assert not study.unused


def test_members_of_other_settings_give_no_errors(site, tmp_path):
    """The second grid belongs to its settings: another friction leaves the maps without errors rather than with wrong ones."""
    import shutil

    other = tmp_path / "other"
    shutil.copytree(site, other)
    text = (other / "site.yaml").read_text()
    (other / "site.yaml").write_text(text.replace("low: 12, high: 22", "low: 14, high: 22"))
    assert cli.main(["run", str(other)]) == ExitCode.OK
    with xr.open_dataset(other / "results" / "hazard.nc") as maps:
        assert "flow_thickness_numerical_error" not in maps
        assert "flow_thickness_standard_error" in maps


@pytest.mark.parametrize("options", [["--second-grid", "--convergence"], ["--second-grid"]])
def test_what_contradicts_itself_is_refused(options, tmp_path, capsys):
    arguments = ["verify", *([str(tmp_path)] if len(options) > 1 else []), *options]
    assert cli.main(arguments) == ExitCode.CONFIGURATION
    assert "--second-grid" in capsys.readouterr().err


def _plan():
    from runout.workflow.study import PLAN

    return PLAN
