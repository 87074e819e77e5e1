"""Kills at every stage, damaged files, changed inputs: the next run makes what an undisturbed one makes."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import xarray as xr
from netCDF4 import Dataset
from ramp_site import SITE, member_file, slab, write_raster, write_site

from runout import cli
from runout.errors import ExitCode, InputError, StorageError
from runout.hazard.exceedance import aggregate
from runout.io.lock import exclusive
from runout.workflow import hazard_map
from runout.workflow.study import STAGES, Study

OTHER = SITE.replace("thickness_thresholds: [0.1, 1]", "thickness_thresholds: [0.3, 2]")
THIRD = SITE.replace("thickness_thresholds: [0.1, 1]", "thickness_thresholds: [0.7, 3]")
kills = pytest.mark.skipif(not hasattr(os, "fork"), reason="kills a copy of this process")


@pytest.fixture
def site(finished_site, tmp_path):
    """A copy of the finished site."""
    return Path(shutil.copytree(finished_site[0], tmp_path / "ramp"))


@pytest.fixture(scope="module")
def undisturbed(finished_site):
    """Products of the finished site."""
    return products(finished_site[0])


def values(file):
    """Everything that a product holds but when and by which command it was made."""
    if file.suffix == ".nc":
        groups = {None: xr.open_dataset(file)}
        with Dataset(file) as content:
            groups |= {name: xr.open_dataset(file, group=name) for name in content.groups}
        return {name: group.load().map(np.asarray).drop_attrs().to_dict(data="array") for name, group in groups.items()}
    if file.suffix == ".tif":
        with rasterio.open(file) as raster:
            return raster.read().tobytes(), raster.transform, raster.nodata
    if file.suffix == ".gpkg":
        return {name: geopandas.read_file(file, layer=name).to_wkt().to_dict() for name in ("release", "inundation")}
    if file.suffix == ".html":
        return re.sub(r"data:image/png;base64,[^\"]*|\d{4}-\d\d-\d\d[T ][^<]*|[0-9a-f]{64}", "", file.read_text())
    return file.read_bytes() if file.suffix == ".qml" else None


def products(site):
    results = site / "results"
    files = [file for file in results.rglob("*") if file.is_file() and not file.match(".lock") and ".locks" not in file.parts]
    return {file.relative_to(results).as_posix(): values(file) for file in sorted(files)}


def assert_same(one, other):
    assert list(one) == list(other)
    for name, content in one.items():
        np.testing.assert_equal(content, other[name], err_msg=name)


def killed(site, stage, replacement):
    """Do one stage in a copy of this process, which is killed before it puts a file in its place."""
    process = os.fork()
    if process == 0:
        replace, count = os.replace, iter(range(1, 1000))

        def die(*paths):
            if next(count) == replacement:
                os.kill(os.getpid(), signal.SIGKILL)
            replace(*paths)

        try:
            os.replace = die
            hazard_map.run(site, stages=(stage,), workers=1, force=True)
        finally:
            os._exit(1)
    assert os.WTERMSIG(os.waitpid(process, 0)[1]) == signal.SIGKILL


@kills
@pytest.mark.parametrize(
    ("stage", "replacement"),
    [("hazard", 1), ("hazard", 3), ("hazard", 36), ("terrain", 2), ("release", 3), ("report", 3)],
)
def test_a_stage_killed_with_other_settings_is_done_again_with_those_of_before(
    site, finished_site, undisturbed, stage, replacement
):
    """The files of the killed run, of other thresholds and another thickness, never count for those of site.yaml."""
    if stage == "release":
        write_raster(site / "inputs" / "thickness.tif", 2 * slab())
    elif stage != "report":
        (site / "site.yaml").write_text(OTHER.replace("title: Slab on a ramp", "title: Another"))
    killed(site, stage, replacement)
    assert Study.open(site).why_stale(next(s for s in hazard_map.PLAN if s.name == stage))
    shutil.copytree(finished_site[0] / "inputs", site / "inputs", dirs_exist_ok=True)
    (site / "site.yaml").write_text(SITE)
    stages = STAGES if stage == "report" else STAGES[:-1]  # a report takes time
    done = hazard_map.run(site, stages=stages, workers=1).done
    assert (stage in done) == (replacement > 1)
    assert not list(site.rglob("*.part"))
    assert_same(products(site), undisturbed)
    assert hazard_map.run(site, stages=stages, workers=1).done == ()


@kills
def test_maps_of_a_killed_run_do_not_stay_beside_those_of_the_next(site):
    (site / "site.yaml").write_text(OTHER)
    killed(site, "hazard", 36)
    kept = site / "results" / "maps" / "my_own.tif"
    kept.touch()
    (site / "results" / "maps" / "peak_speed.tif.aux.xml").touch()
    (site / "site.yaml").write_text(THIRD)
    hazard_map.run(site, stages=("hazard",), workers=1)
    names = {path.name for path in (site / "results" / "maps").rglob("*")}
    assert kept.name in names
    assert not {name for name in names if re.search(r"thickness_exceedance.*_(0\.1|0\.3|1|2)\.(tif|qml)|aux", name)}


@kills
def test_an_ensemble_killed_at_a_member_ends_like_an_undisturbed_one(tmp_path, undisturbed):
    folder = write_site(tmp_path / "ramp")
    program = (
        "import os, signal, sys\nreplace = os.replace\n"
        "def die(old, new):\n"
        "    if str(new).endswith(sys.argv[2]): os.kill(os.getpid(), signal.SIGKILL)\n"
        "    replace(old, new)\n"
        "os.replace = die\n"
        "from runout.cli import main\nmain(['run', sys.argv[1], '--workers', '1'])"
    )
    third = member_file(folder, 2)
    dead = subprocess.run([sys.executable, "-c", program, str(folder), third.name], check=False, capture_output=True)
    assert dead.returncode == -signal.SIGKILL
    assert list((folder / "results" / "members").glob(f".{third.name}.*.part"))
    assert set((folder / "results").glob("members/*.nc")) == {member_file(folder, number) for number in range(2)}
    assert hazard_map.run(folder, workers=1).done == ("ensemble", "hazard", "report")
    assert not list(folder.rglob("*.part"))
    assert_same(products(folder), undisturbed)


def shift(file):
    """Move the eastings by 1 km; nothing of HDF5 or of the compression finds that."""
    with Dataset(file, "a") as content:
        content["x"][:] = content["x"][:] + 1000.0


def truncate(file):
    file.write_bytes(file.read_bytes()[:-1000])


def flip(file):
    """Change one byte; size and time of the content stay."""
    content, times = bytearray(file.read_bytes()), os.stat(file)
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("terrain.nc", truncate, "has [0-9]+ bytes where [0-9]+ were written"),
        ("hazard.nc", flip, "does not hold what was written"),
        ("maps/peak_speed.tif", Path.unlink, "is missing"),
    ],
)
def test_a_damaged_product_is_made_again(site, undisturbed, name, damage, said, capsys):
    damage(site / "results" / name)
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert re.search(f"{name} {said}", " ".join(capsys.readouterr().out.split()))
    stage = "terrain" if name == "terrain.nc" else "hazard"
    assert hazard_map.run(site, stages=STAGES[:-1], workers=1).done == (stage,)
    assert_same(products(site), undisturbed)
    assert (Study.open(site).why_stale(hazard_map.PLAN[-1]) is None) == (stage == "terrain")


def test_a_damaged_report_is_made_again(site, undisturbed):
    truncate(site / "results" / "report.html")
    assert hazard_map.run(site, workers=1).done == ("report",)
    assert_same(products(site), undisturbed)


def test_a_member_with_damaged_coordinates_heals_where_the_record_is_lost(site, undisturbed, capsys):
    shift(member_file(site, 2))
    (site / "results" / "checksums.json").unlink()
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert "3 members done, 0 members failed, 1 members left" in capsys.readouterr().out
    assert cli.main(["ensemble", str(site), "--workers", "1"]) == ExitCode.OK
    assert "member 2: its file does not hold what was written; it is simulated again" in " ".join(capsys.readouterr().err.split())
    hazard_map.run(site, stages=STAGES[:-1])
    assert_same(products(site), undisturbed)


def test_a_damaged_member_is_named_where_the_maps_are_made(site):
    """Of files that are put together in Python, without a record."""
    files = [member_file(site, number) for number in range(3)]
    shift(files[1])
    said = rf"{files[1].name}: its grid .* the file is damaged, remove it and run the ensemble again"
    with pytest.raises(StorageError, match=said):
        aggregate(files, [1, 1, 1], {"thickness": [0.1]}, [50.0])


def test_a_damaged_member_heals_and_the_run_says_so(site, undisturbed, capsys):
    flip(member_file(site, 2))
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert "3 members done, 0 members failed, 1 members left" in capsys.readouterr().out
    assert cli.main(["ensemble", str(site), "--workers", "1"]) == ExitCode.OK
    assert "member 2: its file does not hold what was written; it is simulated again" in " ".join(capsys.readouterr().err.split())
    assert hazard_map.run(site, stages=STAGES[:-1]).done == ("hazard",)
    assert_same(products(site), undisturbed)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"5",
        b'"text"',
        b"{",
        b"\xff\xfe\x00",
        b"[" * 100_000,
        b'{"hazard": 3, "report": {"key": [], "files": {}}}',
        b'{"hazard": {"key": "k", "files": {"hazard.nc": {"sha256": 3}}}}',
        b'{"hazard": {"key": "k", "files": ["hazard.nc"]}}',
    ],
)
def test_a_damaged_record_of_stages_or_members_is_no_fault(site, finished_site, content, capsys):
    for name in ("stages.json", "checksums.json"):
        (site / "results" / name).write_bytes(content)
    assert cli.main(["status", str(site)]) == ExitCode.OK
    assert "4 members done" in capsys.readouterr().out
    outcome = hazard_map.run(site, stages=("ensemble",), workers=1)
    assert outcome.done == ("ensemble",)
    unchanged = [path.read_bytes() for path in sorted((site / "results" / "members").glob("*.nc"))]
    assert unchanged == [path.read_bytes() for path in sorted((finished_site[0] / "results" / "members").glob("*.nc"))]
    assert {stage.name for stage in hazard_map.PLAN if Study.open(site).why_stale(stage)} == set(STAGES) - {"ensemble"}


def test_a_damaged_member_without_a_record_is_found(site, capsys):
    (site / "results" / "checksums.json").unlink()
    truncate(member_file(site, 1))
    cli.main(["status", str(site)])
    assert "3 members done, 0 members failed, 1 members left" in capsys.readouterr().out


def test_a_report_is_never_made_of_maps_of_other_settings(site, capsys):
    (site / "site.yaml").write_text(OTHER)
    assert cli.main(["report", str(site)]) == ExitCode.FAILURE
    said = " ".join(capsys.readouterr().err.split())
    assert "hazard.nc: inputs, configuration or sources of runout changed; run `runout hazard" in said
    assert hazard_map.run(site, stages=("hazard",)).done == ("hazard",)
    (site / "site.yaml").write_text(SITE)
    assert Study.open(site).why_stale(hazard_map.PLAN[-1])


def test_an_input_that_changes_during_a_stage_is_refused(site, monkeypatch):
    make = hazard_map.MAKERS["terrain"]

    def meanwhile(study):
        write_raster(site / "inputs" / "thickness.tif", 2 * slab())
        return make(study)

    monkeypatch.setitem(hazard_map.MAKERS, "terrain", meanwhile)
    with pytest.raises(InputError, match=r"thickness\.tif: this input was changed during the run"):
        hazard_map.run(site, stages=("terrain",), force=True)
    assert Study.open(site).record.why_stale("terrain", "any") == "it was interrupted"


def test_two_processes_do_not_make_the_same_stage_and_may_make_others(site):
    with exclusive(site / "results", ".locks/terrain"):
        with pytest.raises(StorageError, match="another run is working there"):
            hazard_map.run(site, stages=("terrain",), force=True)
        assert hazard_map.run(site, stages=("release",), force=True).done == ("release",)
