"""Stages of a study: done once, done again when what they were made from has changed, and never half."""

import json
from types import SimpleNamespace

import pytest

from runout import cli
from runout.errors import ExitCode, PartialEnsembleError, StorageError
from runout.io.provenance import sha256
from runout.workflow import hazard_map
from runout.workflow.stages import Stage, StageRecord, digest_files, stage_key
from runout.workflow.study import PLAN, STAGES, Study

TERRAIN = Stage("terrain", "read the DEM", ("terrain",))


@pytest.fixture
def record(tmp_path):
    (tmp_path / "terrain.nc").write_text("map")
    record = StageRecord(tmp_path)
    record.finished("terrain", "key 1", [tmp_path / "terrain.nc"])
    return record


def test_stage_is_up_to_date_while_its_key_and_files_stay(record):
    assert record.why_stale("terrain", "key 1") is None
    assert record.why_stale("release", "key 1") == "not done yet"
    assert "changed" in record.why_stale("terrain", "key 2")


def test_stage_is_done_again_when_its_file_was_removed(record):
    (record.results / "terrain.nc").unlink()
    assert record.why_stale("terrain", "key 1") == "terrain.nc is missing"


def test_damaged_record_means_everything_is_done_again(record):
    record.path.write_text(record.path.read_text()[:20])
    assert record.why_stale("terrain", "key 1") == "not done yet"


def test_record_keeps_the_other_stages_and_leaves_no_temporary(record):
    record.finished("release", "key 3", [])
    assert set(json.loads(record.path.read_text())) == {"terrain", "release"}
    assert sorted(path.name for path in record.results.iterdir()) == ["stages.json", "terrain.nc"]


def test_key_depends_on_its_own_sections_inputs_and_state_only():
    site = {"terrain": {"dem": "dem.tif"}, "hazard": {"percentiles": [5]}}
    key = stage_key(TERRAIN, site, "inputs")
    assert stage_key(TERRAIN, {**site, "hazard": {"percentiles": [50]}}, "inputs") == key
    changed = [
        stage_key(TERRAIN, {**site, "terrain": {"dem": "other.tif"}}, "inputs"),
        stage_key(TERRAIN, site, "other inputs"),
        stage_key(TERRAIN, site, "inputs", {0: "done"}),
        stage_key(Stage("release", "", ("terrain",)), site, "inputs"),
    ]
    assert len({key, *changed}) == 5


def test_inputs_are_known_by_their_contents(tmp_path):
    for folder, content in (("a", "1 2 3"), ("b", "1 2 3"), ("c", "1 2 4")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "dem.asc").write_text(content)
    one, copy, other = (digest_files([tmp_path / folder / "dem.asc"]) for folder in "abc")
    assert one == copy != other
    both = [tmp_path / folder / "dem.asc" for folder in "ac"]
    before = digest_files(both)
    contents = [path.read_text() for path in both]
    for path, content in zip(both, reversed(contents), strict=True):
        path.write_text(content)
    assert digest_files(both) != before  # two files of one name that swap their contents


class FakeSite:
    """What a study asks of a site."""

    def __init__(self, folder):
        self.folder, self.name = folder, "fake"
        self.sections = {"terrain": {"dem": "dem.asc"}, "hazard": {"percentiles": [5]}}

    settings = SimpleNamespace(
        ensemble=None, budget=None, simulation=SimpleNamespace(device="cpu"), hazard=SimpleNamespace(formats="all")
    )

    def inputs(self):
        return [self.folder / "dem.asc"]

    def checksums(self, *parts):
        return [] if parts else [sha256(path) for path in self.inputs()]

    @property
    def files(self):
        return SimpleNamespace(paths=lambda *parts: [], checksums=self.checksums)

    def resolved(self):
        return self.sections

    def computed(self):
        return self.resolved()


def standing(study, number, state):
    """State of a fake member of a study."""
    return SimpleNamespace(
        member=SimpleNamespace(number=number, file=lambda results: results / f"{number}.nc"), state=state, reason="because"
    )


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study whose stages leave an empty file and note that they were done."""
    (tmp_path / "dem.asc").write_text("1 2 3")
    study = Study(FakeSite(tmp_path), tmp_path / "results")
    study.did, study.states = [], {0: "left", 1: "left"}

    def make(name):
        def maker(_):
            study.did.append(name)
            if name == "ensemble":
                study.states = dict.fromkeys(study.states, "done")
            file = study.results / f"{name}.out"
            file.write_text("")
            return [file]

        return maker

    monkeypatch.setattr(hazard_map, "MAKERS", {name: make(name) for name in STAGES})
    left = property(lambda _: [member for member, state in study.states.items() if state == "left"])
    monkeypatch.setattr(Study, "standings", property(lambda _: [standing(study, *each) for each in study.states.items()]))
    monkeypatch.setattr(Study, "keep", lambda _: None)
    monkeypatch.setattr(Study, "left", left)
    monkeypatch.setattr(Study, "open", lambda *_, **__: study)
    monkeypatch.setattr(hazard_map, "_require_sound", lambda *_: None)
    monkeypatch.setattr(hazard_map, "_start_ahead", lambda *_: None)
    return study


def again(study):
    """Forget what a new process would not know, and run."""
    study.__dict__.pop("inputs", None)
    study.did.clear()
    return hazard_map.run(study.site.folder)


def test_stages_are_done_in_their_order_and_once(study, capsys):
    assert again(study).done == STAGES == tuple(stage.name for stage in PLAN)
    assert study.did == list(STAGES)
    assert cli.main(["run", str(study.site.folder)]) == ExitCode.OK
    assert study.did == list(STAGES)
    assert "nothing to do" in capsys.readouterr().err


def test_a_change_of_thresholds_leaves_the_members_alone(study):
    again(study)
    study.site.sections = {**study.site.sections, "hazard": {"percentiles": [50]}}
    assert again(study).done == ("hazard", "report")


def test_a_change_of_what_only_the_report_prints_makes_the_report_again(study):
    again(study)
    study.site.sections = {**study.site.sections, "budget": {"hours": 2}}
    assert again(study).done == ("report",)
    study.site.sections = {**study.site.sections, "description": "heads the report, and is the summary of hazard.nc"}
    assert again(study).done == ("hazard", "report")


def test_a_new_member_is_simulated_and_the_maps_are_made_again(study):
    again(study)
    study.states[2] = "left"
    assert again(study).done == ("ensemble", "hazard", "report")


def test_another_dem_starts_from_the_terrain(study):
    again(study)
    (study.site.folder / "dem.asc").write_text("1 2 4")
    assert again(study).done == ("terrain", "release", "hazard", "report")


def test_a_stage_that_ends_early_is_done_again_and_the_finished_ones_are_kept(study, monkeypatch):
    def killed(_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setitem(hazard_map.MAKERS, "hazard", killed)
        assert cli.main(["run", str(study.site.folder)]) == cli.INTERRUPTED
    assert study.did == ["terrain", "release", "ensemble"]
    assert again(study).done == ("hazard", "report")


def test_failed_members_give_the_exit_code_of_a_partial_ensemble(study, capsys):
    again(study)
    study.states[1] = "failed"
    assert cli.main(["run", str(study.site.folder)]) == ExitCode.PARTIAL_ENSEMBLE
    assert "member 1 of 2 failed: because" in capsys.readouterr().err
    assert cli.main(["terrain", str(study.site.folder)]) == ExitCode.OK


def test_one_stage_can_be_asked_for_and_forced(study):
    again(study)
    study.did.clear()
    assert cli.main(["report", str(study.site.folder)]) == ExitCode.OK
    assert study.did == []
    assert cli.main(["report", str(study.site.folder), "--force"]) == ExitCode.OK
    assert study.did == ["report"]


def test_maps_without_a_member_say_what_to_run_first(study):
    with pytest.raises(PartialEnsembleError, match="runout ensemble"):
        _ = study.ensemble_report
    study.states = dict.fromkeys(study.states, "failed")
    with pytest.raises(PartialEnsembleError, match="all 2 members failed; member 0: because"):
        _ = study.ensemble_report
    with pytest.raises(StorageError, match="runout hazard"):
        study.require_maps()


def test_report_of_a_partial_ensemble_names_who_failed(study):
    study.states = {0: "done", 1: "failed", 2: "left"}
    assert study.ensemble_report.valid == (0,)
    assert study.ensemble_report.failed == {1: "because"}
