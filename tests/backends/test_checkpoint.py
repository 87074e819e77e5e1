"""A run that was broken off goes on from its checkpoint bit by bit as if it had not been."""

import logging
import os
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scenes import SAND, box, engine_of, loaded, plane, scene

import runout
from runout.backends.protocol import ResumableBackend
from runout.backends.reference.backend import ReferenceBackend
from runout.errors import ConfigError, StorageError
from runout.io.source_code import Checksums
from runout.simulation.checkpoint import Checkpoint, stored_time
from runout.simulation.single import simulate

RAMP = Path(__file__).parent / "resumed_ramp.py"
STEPS = 40


def same_bits(one, other):
    """Whether two objects hold arrays and numbers of the same bytes under the same names."""
    if not hasattr(one, "__dict__"):
        return np.asarray(one).tobytes() == np.asarray(other).tobytes()
    return all(same_bits(getattr(one, name), getattr(other, name)) for name in vars(one).keys() | vars(other).keys())


def sliding(precision="float64"):
    ground = plane(slope_x=-0.5, height=30.0)
    particles = box((6.0, 6.0, 0.0), (8.0, 8.0, 3.0), (1.0, 1.0, 1.0), SAND.density, surface=ground)
    particles.velocity[:] = (3.0, -6.0, -1.5)  # over the southern edge before long
    return scene(ground, materials=(SAND,), precision=precision), particles


def advance(engine, steps=STEPS):
    for _ in range(steps):
        engine.step(engine.stable_step())
    return engine


def resumable(engine):
    if not isinstance(engine, ResumableBackend):
        pytest.skip(f"{type(engine).__name__} keeps no checkpoints")
    return engine


@pytest.mark.parametrize(
    ("name", "precision"), [("reference", "float64"), *product(("scan", "hash"), ("float32", "float64"))]
)  # the reference has no other precision
def test_a_restored_backend_takes_the_steps_of_the_one_that_went_on(name, precision):
    a_scene, particles = sliding(precision)
    backend, other = resumable(engine_of(name)), engine_of(name)
    advance(loaded(backend, a_scene, particles))
    state = {name: values.copy() for name, values in backend.checkpoint().items()}
    other.restore(a_scene, state)
    assert same_bits(other.particles(), backend.particles())
    assert other.counters.steps == STEPS
    advance(backend, 3 * STEPS), advance(other, 3 * STEPS)
    assert backend.ledger().escaped_mass > 0
    assert backend.ledger().contact_particles > 0
    assert same_bits(other.particles(), backend.particles())
    assert same_bits(other.ledger(), backend.ledger())
    assert same_bits(other.columns(), backend.columns())
    assert other.counters.rebuilds == backend.counters.rebuilds


def test_the_state_of_a_backend_holds_plain_arrays_and_no_more_than_its_particles_need(backend):
    a_scene, particles = sliding("float32")
    resumable(backend)
    state = advance(loaded(backend, a_scene, particles), 5).checkpoint()
    assert all(isinstance(values, np.ndarray) and values.dtype != object for values in state.values())
    held = sum(values.nbytes for name, values in state.items() if len(values.shape) and len(values) >= len(particles))
    assert held <= 300 * len(particles)


def ramp_run(**choices):
    import resumed_ramp

    return simulate(**{**resumed_ramp.ARGUMENTS, **choices})


def assert_same_run(one, other):
    for name, values in one.fields.items():
        assert values.tobytes() == other.fields[name].tobytes(), name
    for name in one.series.keys() - {"memory"}:  # arrays that are restored hold no spare room
        values = one.series[name]
        assert values.tobytes() == other.series[name].tobytes(), name
    assert same_bits(one.state, other.state)
    assert (one.steps, one.n_particles, one.stop_reason) == (other.steps, other.n_particles, other.stop_reason)
    assert [t for t, _, _ in one.snapshots] == [t for t, _, _ in other.snapshots]
    for (_, h, v), (_, g, w) in zip(one.snapshots, other.snapshots, strict=True):
        assert (h.tobytes(), v.tobytes()) == (g.tobytes(), w.tobytes())
    assert len(one.particle_frames) == len(one.snapshots)
    for frame, same in zip(one.particle_frames, other.particle_frames, strict=True):
        assert frame.tobytes() == same.tobytes()


class Broken(Exception):
    pass


def broken_off_at(fraction, path, **choices):
    """A run that ends with an error after ``fraction`` of its time."""

    def progress(done):
        if done >= fraction:
            raise Broken

    with pytest.raises(Broken):
        ramp_run(checkpoint=path, checkpoint_every=0.0, progress=progress, **choices)
    assert path.exists()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_run_broken_off_twice_gives_maps_ledger_and_particles_of_one_that_was_not(tmp_path, precision):
    whole = ramp_run(precision=precision, threads=2)
    path = tmp_path / "run.npz"
    broken_off_at(0.3, path, precision=precision, threads=2)
    broken_off_at(0.6, path, precision=precision, threads=1)
    early = stored_time(path)
    assert early > 0.3 * whole.series["time"][-1]
    seen = []
    resumed = ramp_run(precision=precision, threads=2, checkpoint=path, progress=seen.append)
    assert seen[0] > 0.5  # it did not start anew
    assert_same_run(resumed, whole)
    assert not path.exists()


@pytest.mark.parametrize("name", ["reference", "hash"])
def test_the_other_backends_resume_too(tmp_path, name):
    coarse = {"backend": name, "device": "cpu", "cell_size": 5.0, "end_time": 0.6}
    broken_off_at(0.5, tmp_path / "run.npz", **coarse)
    assert_same_run(ramp_run(checkpoint=tmp_path / "run.npz", **coarse), ramp_run(**coarse))


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_killed_process_loses_nothing_but_the_time_since_its_checkpoint(tmp_path):
    path = tmp_path / "run.npz"
    path_of_modules = [str(RAMP.parent), str(Path(runout.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path_of_modules)}
    process = subprocess.Popen([sys.executable, str(RAMP), str(path)], env=environment)
    ends = time.monotonic() + 300  # kernels may have to be compiled
    while (stored_time(path) or 0.0) < 0.5:
        assert time.monotonic() < ends
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert stored_time(path) >= 0.5
    seen = []
    resumed = ramp_run(checkpoint=path, threads=1, progress=seen.append)
    assert seen[0] > 0.1
    assert_same_run(resumed, ramp_run(threads=2))


@pytest.mark.parametrize("change", ["cell_size", "seed", "version", "half a file"])
def test_a_checkpoint_of_another_run_or_a_damaged_one_is_not_used_and_says_so(tmp_path, monkeypatch, caplog, change):
    path = tmp_path / "run.npz"
    coarse = {"cell_size": 5.0, "end_time": 0.5}
    broken_off_at(0.5, path, **coarse)
    choices = dict(coarse)
    if change == "half a file":
        path.write_bytes(path.read_bytes()[:5000])
    elif change == "version":
        monkeypatch.setattr("runout.io.source_code.checksums", lambda: Checksums("of other sources", "of other sources"))
    else:
        choices[change] = {"cell_size": 4.0, "seed": 1}[change]
    seen = []
    with caplog.at_level(logging.WARNING):
        result = ramp_run(checkpoint=path, progress=seen.append, **choices)
    assert seen[0] == 0.0
    assert "checkpoint not used" in caplog.text
    assert "cannot be read" in caplog.text if change == "half a file" else "other inputs or other sources of runout" in caplog.text
    assert_same_run(result, ramp_run(**choices))


def test_checkpoints_are_written_at_their_cadence_and_their_time_is_booked(tmp_path, monkeypatch):
    often = ramp_run(cell_size=5.0, end_time=0.5, checkpoint=tmp_path / "run.npz", checkpoint_every=0.0)
    assert 0 < often.timing["checkpoints"] < often.timing["total"]
    monkeypatch.setattr(Checkpoint, "write", lambda self, state: pytest.fail("none is due"))
    assert ramp_run(cell_size=5.0, end_time=0.5, checkpoint=tmp_path / "run.npz").timing["checkpoints"] == 0.0


def test_bad_places_and_cadences_are_refused(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match="choose another folder"):
        ramp_run(checkpoint=tmp_path / "file" / "run.npz", checkpoint_every=0.0)
    with pytest.raises(ConfigError, match="checkpoint_every is -1 s"):
        ramp_run(checkpoint=tmp_path / "run.npz", checkpoint_every=-1.0)


class WithoutCheckpoints(ReferenceBackend):
    checkpoint = None


def test_a_backend_without_checkpoints_says_so_and_runs(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr("runout.simulation.single.get_backend", lambda *_, **__: WithoutCheckpoints())
    with caplog.at_level(logging.WARNING):
        result = ramp_run(cell_size=5.0, end_time=0.1, checkpoint=tmp_path / "run.npz", checkpoint_every=0.0)
    assert result.stop_reason == "end time"
    assert "WithoutCheckpoints writes no checkpoints" in caplog.text
