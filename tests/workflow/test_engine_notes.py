"""What is known of the kernels is kept for a day, and for some minutes if other work disturbed the measurement."""

import json
import os
from types import SimpleNamespace

import pytest
from ramp_site import write_site

from runout.config.site import read_site
from runout.forecast import engine_notes, step_cost
from runout.forecast.engine_notes import StepCost
from runout.forecast.step_cost import StepTimer
from runout.workflow import plan
from runout.workflow.compilation import compile_ahead, kernels_noted


@pytest.fixture
def arguments(tmp_path):
    return {**read_site(write_site(tmp_path / "ramp")).member_arguments(), "threads": 1}


@pytest.fixture
def measured(monkeypatch):
    """Answers of the measurement: cost of a step, and whether it was undisturbed."""
    answers = []
    monkeypatch.setattr(step_cost, "measured_step_cost", lambda arguments: answers.pop(0))
    return answers


def test_a_step_is_measured_once_a_day(arguments, measured, notes):
    measured += [(StepCost(1e-3, 1e-6), True), (StepCost(2e-3, 2e-6), True)]
    assert step_cost.step_cost(arguments) == step_cost.step_cost(arguments) == StepCost(1e-3, 1e-6)
    (file,) = notes.glob("layer-*.json")
    noted = json.loads(file.read_text())
    file.write_text(json.dumps({**noted, "time": noted["time"] - 1.01 * engine_notes.DAY}))
    assert step_cost.step_cost(arguments) == StepCost(2e-3, 2e-6)


def test_a_forecast_that_compiles_nothing_takes_the_cost_of_the_last_month_or_a_typical_one(arguments, measured, notes):
    quick = step_cost.quick_step_cost
    assert quick(arguments, lambda: False) is step_cost.TYPICAL
    measured += [(StepCost(1e-3, 1e-6), True), (StepCost(2e-3, 2e-6), True)]
    assert quick(arguments, lambda: True) == StepCost(1e-3, 1e-6)
    (file,) = notes.glob("layer-*.json")
    noted = json.loads(file.read_text())
    for days, compiled, cost in ((29, True, (1e-3, 1e-6)), (31, False, step_cost.TYPICAL), (31, True, (2e-3, 2e-6))):
        file.write_text(json.dumps({**noted, "time": noted["time"] - days * engine_notes.DAY}))
        assert quick(arguments, lambda known=compiled: known) == cost


def test_a_disturbed_measurement_counts_for_some_minutes(arguments, measured, notes):
    measured += [(StepCost(3e-3, 1e-6), False), (StepCost(1e-3, 1e-6), True)]
    assert step_cost.step_cost(arguments) == step_cost.step_cost(arguments) == StepCost(3e-3, 1e-6)
    (file,) = notes.glob("layer-*.json")
    noted = json.loads(file.read_text())
    file.write_text(json.dumps({**noted, "time": noted["time"] - 1.01 * engine_notes.SHORT}))
    assert step_cost.step_cost(arguments) == StepCost(1e-3, 1e-6)


def test_notes_of_earlier_days_are_removed(arguments, notes):
    engine_notes.note_layer(arguments, StepCost(1e-3, 1e-6))
    (old,) = notes.glob("*.json")
    os.utime(old, (0, 0))
    engine_notes.note_layer(arguments | {"precision": "float64"}, StepCost(1e-3, 1e-6))
    assert old not in set(notes.glob("*.json"))


@pytest.mark.parametrize("text", ["{", "[]", '{"value": [1, 2]}'])
def test_a_damaged_note_counts_as_absent(arguments, measured, notes, text):
    measured += [(StepCost(1e-3, 1e-6), True), (StepCost(2e-3, 1e-6), True)]
    step_cost.step_cost(arguments)
    next(notes.glob("layer-*.json")).write_text(text)
    assert step_cost.step_cost(arguments) == StepCost(2e-3, 1e-6)


@pytest.mark.parametrize("change", [{"precision": "float64"}, {"substeps": 1}])
def test_other_kernels_have_notes_of_their_own(arguments, measured, change):
    measured += [(StepCost(1e-3, 1e-6), True), (StepCost(2e-3, 2e-6), True)]
    assert step_cost.step_cost(arguments) != step_cost.step_cost(arguments | change)


def member(arguments, seconds, monkeypatch, *, first=0.0, mass=(1.0, 1.0)):
    """Tell a timer of a member of 100 steps and 1000 particles that took so much processor time [s]."""
    clock = iter([5.0, 5.0, 5.0 + seconds])
    monkeypatch.setattr("runout.forecast.step_cost.time", SimpleNamespace(process_time=lambda: next(clock)))
    timer = StepTimer()
    timer(first)
    timer(1.0)
    timer.note(arguments, SimpleNamespace(series={"mass": mass}, steps=100, n_particles=1000))


def test_the_fastest_member_of_a_scene_counts_more_than_the_layer(arguments, monkeypatch):
    engine_notes.note_layer(arguments, StepCost(1e-3, 1e-6))
    member(arguments, 0.4, monkeypatch)
    assert step_cost.step_cost(arguments) == pytest.approx(StepCost(2e-3, 2e-6))
    member(arguments, 0.8, monkeypatch)
    assert step_cost.step_cost(arguments) == pytest.approx(StepCost(2e-3, 2e-6))
    member(arguments, 0.1, monkeypatch)
    assert step_cost.step_cost(arguments) == pytest.approx(StepCost(0.5e-3, 0.5e-6))
    assert step_cost.step_cost(arguments | {"cell_size": 5.0}) == StepCost(1e-3, 1e-6)


def test_a_member_that_says_little_of_a_step_is_not_noted(arguments, monkeypatch):
    engine_notes.note_layer(arguments, StepCost(1e-3, 1e-6))
    member(arguments, 0.1, monkeypatch, first=0.5)  # from a checkpoint: its time is not that of all its steps
    member(arguments, 0.1, monkeypatch, mass=(1.0, 0.5))  # half of its particles left
    member(arguments | {"threads": 2}, 0.1, monkeypatch)
    assert step_cost.step_cost(arguments) == StepCost(1e-3, 1e-6)


def test_memory_of_the_kernels_is_asked_for_once(monkeypatch):
    asked = []
    monkeypatch.setattr(plan, "bytes_on_host", lambda *of: asked.append(of) or 1234)
    sizes = [plan._noted_bytes(n, 10, 20, 40, "float32", "mls", False) for n in (1000, 1000, 2000)]
    assert sizes == [1234] * 3
    assert [of[0] for of in asked] == [1000, 2000]


def test_known_kernels_start_no_compilation_until_they_are_removed(tmp_path, monkeypatch):
    started, mark = [], tmp_path / "kernels.done"
    monkeypatch.setattr("runout.backends.protocol.start_compilation", lambda *of, marked, **how: started.append(marked))
    site = read_site(write_site(tmp_path / "ramp"))
    compile_ahead(site)
    mark.touch()
    started[0](mark)
    assert compile_ahead(site) is None
    assert len(started) == 1
    assert kernels_noted(site)
    mark.unlink()
    assert not kernels_noted(site)
    compile_ahead(site)
    assert len(started) == 2
