"""Stability: the pinned set survives or is refused in advance, and the judge would notice if a run broke."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from docs.pages.stress import page as stability_page
from runout.backends.protocol import get_backend
from runout.errors import RunoutError
from runout.model.erosion_laws import EROSIONS
from runout.studies import stability_stress
from runout.studies.stability_cases.invariants import Watch
from runout.studies.stability_cases.layout import Layout
from runout.studies.stability_cases.matrix import AXES, PINNED, named, one_at_a_time, pinned, sampled
from runout.studies.stability_cases.trial import LARGEST, attempt

REFUSED = {  # pinned trials that must be refused, and words of the reason
    "cfl = 0.61": "unstable above 0.6",
    "friction_angle = 0.0": "no strength",
    "pore_ratio = 0.98": "at most 0.97",
    "bed_depth = 1.0, erosion = ramms, erosion_numbers = (('rate', 0.5),), bed_ratio = 0.98": "at most 0.97",
    "inflow_thickness = 1.0, inflow_speed = 201.0": "at most 200",
}


@pytest.mark.parametrize(("name", "layout"), list(pinned()), ids=[named(choice) for choice in PINNED])
def test_pinned_trial_survives_or_is_refused_with_its_reason(name, layout):
    trial = attempt(name, layout)
    if name in REFUSED:
        assert trial.verdict == "refused"
        assert REFUSED[name] in trial.reason
    else:
        assert (trial.verdict, trial.reason) == ("survived", "")
        assert trial.particles > 0
        assert trial.steps >= layout.steps


OVER_A_BED = {"bed_depth": 1.0, "erosion_numbers": (("rate", 5.0), ("critical_stress", 0.0)), "bed_ratio": 0.9, "pore_ratio": 0.5}


@pytest.mark.parametrize("choice", [{}, {"terrain": "step down in one cell"}, {"keep": 1}, OVER_A_BED], ids=named)
def test_trial_survives_on_the_hash_backend_too(choice):
    trial = attempt("hash", Layout(**choice, steps=40, per_cell=(1, 1, 2)), "hash")
    assert (trial.verdict, trial.reason) == ("survived", "")


def test_mass_that_its_own_weight_would_crush_is_refused_with_the_modulus_it_needs():
    """2 m of 2000 kg/m3 on 10 kPa: a strain of 2.9."""
    soft = attempt("soft", Layout(youngs_modulus=1e4))
    assert soft.verdict == "refused"
    assert "would strain it by 2.91, at most 0.3" in soft.reason
    needed = float(soft.reason.split("take ")[1].split(" Pa")[0])
    assert attempt("enough", Layout(youngs_modulus=needed, steps=1, keep=1), "reference").verdict == "survived"


def watched(steps=4, **choices):
    """A watch over a short run, and its backend."""
    layout = Layout(per_cell=(1, 1, 1), **choices)
    scene, particles, _, _ = layout.built()
    engine = get_backend("reference")
    engine.load(scene, particles)
    watch = Watch(layout, scene, particles, engine.ledger())
    for _ in range(steps):
        dt = engine.stable_step()
        engine.step(dt)
        watch.passed(dt)
    return watch, engine


def disturbed(engine, **changes):
    """The backend with another ledger or other particles."""
    row, p = replace(engine.ledger(), **changes.get("row", {})), engine.particles()
    for name, change in changes.get("particles", {}).items():
        change(getattr(p, name))
    return SimpleNamespace(ledger=lambda: row, particles=lambda: p)


def test_judge_is_content_with_a_sound_run():
    watch, engine = watched()
    assert watch.look(engine)
    watch.finish(engine)
    assert watch.broken == []


@pytest.mark.parametrize(
    ("words", "row", "particles"),
    [
        ("mass", {"escaped_mass": 1.0}, {}),
        ("momentum", {"basal_impulse": np.array([0.0, 0.0, 1e6])}, {}),
        ("speed", {"max_speed": 50.0}, {}),
        ("penetration", {}, {"offset": lambda offset: np.subtract(offset, [0.0, 0.0, 0.9], out=offset)}),
        ("velocity is not finite", {}, {"velocity": lambda v: v.__setitem__((3, 1), np.nan)}),
        ("pore_left is not finite", {}, {"pore_left": lambda left: left.__setitem__(3, np.nan)}),
        ("pore pressure", {}, {"pore_left": lambda left: left.__setitem__(3, 1.01)}),
    ],
)
def test_judge_notices_a_broken_invariant(words, row, particles):
    watch, engine = watched()
    watch.look(disturbed(engine, row=row, particles=particles))
    watch.finish(engine)
    assert any(reason.startswith(words) for reason in watch.broken), watch.broken


def test_judge_notices_a_bed_that_gives_more_than_it_holds():
    layout = Layout(per_cell=(1, 1, 1), bed_depth=0.5)
    scene, particles, bed, _ = layout.built()
    engine = get_backend("reference")
    engine.load(scene, particles)
    watch = Watch(layout, scene, particles, engine.ledger(), bed)
    watch.look(engine)
    assert watch.broken == []
    bed.eroded[:] = bed.depth.on_nodes(bed.first, bed.eroded.shape, scene.spacing) + 0.01
    watch.look(engine)
    assert watch.broken == ["bed 0.01"]
    bed.booked.entrained_mass += 1.0
    watch.look(engine)
    assert watch.broken[0].startswith("mass")


def test_judge_notices_energy_from_nowhere_and_creep():
    watch, engine = watched(rests=True)
    row = engine.ledger()
    hot = replace(row, kinetic_energy=row.kinetic_energy + 0.1 * abs(row.potential_energy))
    for state in (row, hot):
        watch.look(disturbed(engine, row={"kinetic_energy": state.kinetic_energy}))
        watch.close(state)
    watch.finish(engine)
    assert any(reason.startswith("energy") for reason in watch.broken)
    assert any(reason.startswith("rest") for reason in watch.broken)


def test_judge_notices_what_stays_behind_the_edge_of_a_cliff():
    watch, engine = watched(terrain="step down in one cell", passes=True)
    watch.finish(engine)
    assert watch.broken == ["passage 1"]


def test_matrix_covers_every_axis_and_stays_small():
    assert len(list(one_at_a_time())) == sum(len(choices) for choices in AXES.values())
    samples = [layout for _, layout in sampled(200)]
    assert len(samples) == 200
    assert len({layout.terrain for layout in samples}) == 9
    assert 60 < sum(s.bed_depth > 0 for s in samples) < 140 > sum(s.pore_pressure() is not None for s in samples) > 60
    assert {s.erosion for s in samples} == {law.name for law in EROSIONS.known()}
    assert all(64 * np.prod(s.per_cell) * s.thickness / s.flatness <= LARGEST for s in samples)
    assert [s.h for s in samples] == [layout.h for _, layout in sampled(200)]


def test_record_page_and_exit_code_tell_what_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(stability_stress, "pinned", lambda: iter([("bad", Layout(cfl=0.7)), ("good", Layout(keep=1, steps=4))]))
    monkeypatch.setattr(stability_stress, "attempt", lambda name, layout, *_: attempt(name, layout, "reference"))
    assert stability_stress.command(tmp_path, False, "reference") == 0
    made = stability_page(json.loads((tmp_path / "stress.json").read_text()))
    page = made.text
    assert "**1 survived, 1 were refused, 0 failed.**" in page
    assert "| bad | 1 | 0 | 1 | 0 | cfl (1) |" in page
    assert "unstable above 0.6" in made.tables["stress.csv"]
    assert "runout stress --backend reference --out DIR" in page
    assert made.pictures["images/stress.png"].startswith(b"\x89PNG")
    failing = [replace(attempt("x", Layout(cfl=0.7)), verdict="failed", reason="mass 1")]
    monkeypatch.setattr(stability_stress, "stress", lambda *_: failing)
    assert stability_stress.command(None, False, "reference") == 1


@pytest.mark.parametrize(("backend", "device"), [("bogus", "cpu"), ("scan", "cuda:0"), ("hash", "cuda:99")])
def test_a_backend_or_device_that_is_not_there_is_no_refused_trial(backend, device):
    with pytest.raises(RunoutError, match=backend if backend == "bogus" else device):
        stability_stress.command(None, False, backend, device)


def test_judge_notices_mass_and_momentum_that_an_inflow_did_not_bring():
    layout = Layout(per_cell=(1, 1, 1), inflow_thickness=1.0, steps=60, youngs_modulus=1e6)
    assert attempt("inflow", layout, "reference").verdict == "survived"
    scene, particles, bed, entering = layout.built()
    engine = get_backend("reference")
    engine.load(scene, particles)
    entering.begin(scene, len(particles), None, 0.0)
    watch = Watch(layout, scene, particles, engine.ledger(), bed, entering)
    watch.enter(engine, 1.0)
    assert entering.entered.mass > 0.1 * watch.first.mass
    watch.look(engine)
    assert watch.broken == []
    entering.entered.mass += 1.0
    watch.entered_momentum[0] += 100.0
    watch.look(engine)
    assert {reason.split()[0] for reason in watch.broken} >= {"mass", "momentum"}
