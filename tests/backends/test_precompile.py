"""Every run executes the code of the cache: a process that has compiled a kernel would round differently from one that loads it."""

import logging
import os
import subprocess
import sys
import threading
import time
from types import ModuleType, SimpleNamespace

import pytest
from kernel_compiler import KernelCompiler
from scenes import ROCK, SAND, box, plane, scene

from runout.backends.compile import cache_root
from runout.backends.scan import ahead, precompile
from runout.backends.scan.backend import OF_SUBSTEPS, PARTS, ScanBackend
from runout.backends.scan.kernels import kernels_for
from runout.backends.scan.warm_up import TOGETHER
from runout.model.particles import Particles
from runout.processes.lifetime import LOOK_SECONDS

IN_OWN_PROCESS = precompile._warm_up_elsewhere  # workers of pytest compile all variants in one process


@pytest.mark.parametrize(
    ("precision", "index"), [(precision, index) for precision in ("float32", "float64") for index in ("sparse", "dense")]
)
def test_no_kernel_is_compiled_in_the_process_that_runs_it(precision, index):
    ground = plane(slope_x=-0.5, height=30.0)
    particles = box((6.0, 6.0, 0.0), (8.0, 8.0, 3.0), (1.0, 1.0, 1.0), SAND.density, surface=ground)
    particles.velocity[:] = (3.0, -6.0, -1.5)  # over the southern edge before long
    a_scene = scene(ground, materials=(SAND,), friction=(0.5,), precision=precision)
    engine = ScanBackend(index=index)
    engine.load(a_scene, particles)
    for _ in range(150):
        engine.step(engine.stable_step())
    assert engine.ledger().escaped_mass > 0
    engine.columns(), engine.flow_columns(), engine.particles()
    ScanBackend().restore(a_scene, engine.checkpoint())
    kernels = vars(kernels_for(a_scene))
    compiled_here = [name for name, kernel in kernels.items() if sum(kernel.stats.cache_misses.values())]
    loaded = [name for name, kernel in kernels.items() if sum(kernel.stats.cache_hits.values())]
    assert compiled_here == []
    assert {"grid_to_particles", "particles_to_nodes_over_ground", "solve_contacts"} <= set(loaded)


def test_kernels_compiled_ahead_have_the_types_of_a_run():
    """They are called without particles; a run with particles must find them in the cache."""
    ground = plane(slope_x=-0.5, height=30.0)
    a_scene = scene(ground, materials=(SAND,), precision="float32")
    engine = ScanBackend()
    engine.load(a_scene, box((6.0, 6.0, 0.0), (8.0, 8.0, 3.0), (1.0, 1.0, 1.0), SAND.density, surface=ground))
    for _ in range(40):
        engine.step(engine.stable_step())
    engine.ledger(), engine.particles()
    kernels = vars(kernels_for(a_scene))
    of_the_run = {name: set(kernel.signatures) for name, kernel in kernels.items() if kernel.signatures}
    assert {"grid_to_particles", "settle", "make_way", "sum_blocks", "unpack", "change_step"} <= set(of_the_run)
    empty = ScanBackend()
    empty.load(a_scene, Particles.zeros(0))
    for part in reversed(PARTS):
        empty.pass_part(part, a_scene.stable_step(1.0))
    assert {name: set(kernels[name].signatures) for name in of_the_run} == of_the_run


def test_each_part_of_a_transfer_is_compiled_by_one_process():
    """Two processes that compile kernels with the same inlined functions compile these twice."""
    assert sorted(name for names in TOGETHER for name in names) == sorted((*PARTS, *OF_SUBSTEPS))


def test_what_is_cached_is_not_compiled_again(monkeypatch):
    ScanBackend().load(scene(materials=(SAND,)), box((6.0, 6.0, 0.0), (2.0, 2.0, 2.0), (1.0, 1.0, 1.0)))
    assert list(cache_root().glob("*.done"))
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("a process was started"))
    from runout.backends.scan.kernels import SOURCES

    precompile.ensure_compiled(scene(materials=(SAND,)), SOURCES)


def test_what_is_compiled_is_not_another_tree_in_the_working_folder(monkeypatch, tmp_path):
    """A user may work in the checkout of a version that is not the one installed."""
    (tmp_path / "runout").mkdir()
    (tmp_path / "runout" / "__init__.py").write_text("raise SystemExit(3)")
    monkeypatch.chdir(tmp_path)
    assert IN_OWN_PROCESS(scene(materials=(SAND,), precision="float32"), "plain")


def test_kernels_are_compiled_anew_for_other_sources_and_not_for_another_place_or_time(monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr(precompile, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(precompile, "_warm_up_elsewhere", lambda *job: not started.append(job))
    for place, seconds, text, processes in (("a", 100, "", 1), ("a", 200, "", 1), ("b", 100, "", 1), ("b", 100, "x = 1", 2)):
        source = tmp_path / place / "kernels.py"
        source.parent.mkdir(exist_ok=True)
        source.write_text(text)
        os.utime(source, (seconds, seconds))
        module = ModuleType("kernels")
        module.__file__ = str(source)
        precompile.ensure_compiled(scene(materials=(SAND,)), (module,))
        assert len(started) == processes


def test_without_a_process_to_compile_in_kernels_are_compiled_where_they_run(monkeypatch, tmp_path):
    monkeypatch.setattr(precompile, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(precompile, "python_command", lambda code: [str(tmp_path / "none"), code])
    precompile.ensure_compiled(scene(materials=(SAND,)), (precompile,))
    assert not list(tmp_path.glob("*.done"))


def test_only_the_process_that_rehearses_starts_no_other(monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr(precompile, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(precompile, "_warm_up_elsewhere", lambda *job: started.append(job))
    monkeypatch.setitem(os.environ, precompile.WARM_UP, "a job")
    precompile.ensure_compiled(scene(materials=(SAND,)), (precompile,))
    assert not started
    monkeypatch.delenv(precompile.WARM_UP)
    precompile.ensure_compiled(scene(materials=(SAND,)), (precompile,))
    assert len(started) == 1


def sums_of_a_slide(material):
    """The kernels of a short run with a material, and the types of their arguments."""
    ground = plane(slope_x=-0.5, height=30.0)
    a_scene = scene(ground, materials=(material,))
    engine = ScanBackend()
    particles = box((6.0, 6.0, 0.0), (8.0, 8.0, 3.0), (1.0, 1.0, 1.0), material.density, surface=ground)
    particles.velocity[:] = (3.0, -6.0, -1.5)  # over the southern edge before long
    engine.load(a_scene, particles)
    for k in range(150):
        engine.step(engine.stable_step(), 1 + k % 2)
    assert engine.ledger().escaped_mass > 0
    engine.particles()
    return vars(kernels_for(a_scene))


def test_a_second_law_compiles_the_kernels_that_hold_it():
    """A kernel with the types of another law, or bound anew for it, would be compiled again."""
    first, second = sums_of_a_slide(SAND), sums_of_a_slide(ROCK)
    called = {name for name, kernel in first.items() if kernel.signatures}
    assert len(called - {"substep"}) <= ahead.KERNELS
    anew = {
        name for name in called if second[name].stats.cache_path != first[name].stats.cache_path or len(second[name].signatures) > 1
    }
    assert anew == {"grid_to_particles", "substep"}


@pytest.mark.parametrize(("broken", "said"), [("warm_up", "compiling in a process of its own failed"), ("warm_up_ahead", "one of")])
def test_a_process_that_fails_to_compile_is_said_with_its_reason(monkeypatch, caplog, broken, said):
    scripts = dict.fromkeys(("warm_up", "warm_up_ahead"), "import time; time.sleep(1.0)")
    scripts[broken] = "raise RuntimeError('no room for code')"
    start = subprocess.Popen

    def scripted(command, **options):
        return start([sys.executable, "-c", scripts[command[-1].split()[-1].rstrip("()")]], **options)

    monkeypatch.setattr(precompile.os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(precompile.subprocess, "Popen", scripted)
    with caplog.at_level(logging.WARNING):
        worked = IN_OWN_PROCESS(scene(materials=(SAND,), precision="float32"), "plain")
    assert worked == (broken == "warm_up_ahead")
    assert said in caplog.text
    assert "no room for code" in caplog.text


def test_compilation_goes_on_beside_the_process_that_needs_it(monkeypatch):
    begun, go_on, fractions = threading.Event(), threading.Event(), []

    def compiled(a_scene, sources):
        assert a_scene.precision == "float32"
        assert a_scene.substeps == 4
        begun.set()
        assert go_on.wait(10.0)

    monkeypatch.setattr(ahead, "ensure_compiled", compiled)
    friction = scene(materials=(SAND,)).basal.law.example
    found = ahead.CompilingAhead((SAND,), (friction,), {"precision": "float32", "substeps": 4}, zones=False)
    assert begun.wait(10.0)
    assert found.is_running

    def note(fraction):
        fractions.append(fraction)
        go_on.set()

    found.wait(note)
    assert not found.is_running
    assert fractions[-1] == 1.0


def test_the_process_that_compiles_for_all_tests_leaves_what_it_cannot_do_to_others(monkeypatch, tmp_path):
    """A job that fails, a job for another cache, and one whose process has ended."""
    jobs, a_scene = [], scene(materials=(SAND,))
    compiler = KernelCompiler(lambda a_scene, kind: jobs.append(kind) is None, tmp_path)
    monkeypatch.setattr(precompile, "job_of", lambda *job: "no job")
    try:
        assert compiler(a_scene, "first")
        (process,) = compiler.started
        assert process.poll() is None
        with monkeypatch.context() as patch:
            patch.setattr(precompile, "cache_root", lambda: tmp_path)
            assert compiler(a_scene, "second")
        process.kill()
        process.wait()
        assert compiler(a_scene, "third")
        assert len(compiler.started) == 2
    finally:
        compiler.end()
    assert jobs == ["first", "second", "third"]


def test_workers_share_the_process_that_compiles_for_all_tests(monkeypatch, tmp_path):
    """The second compiles in that of the first, which does not end with the process that a job names as its parent."""
    a_scene = scene(plane(), materials=(SAND,))
    kind = precompile.variant(a_scene)
    first, second = (KernelCompiler(lambda a_scene, kind: pytest.fail("another process was asked"), tmp_path) for _ in range(2))
    monkeypatch.setattr(precompile, "os", SimpleNamespace(**{**vars(os), "getpid": lambda: 1}))
    try:
        assert first(a_scene, kind)
        assert second(a_scene, kind)
        time.sleep(2 * LOOK_SECONDS)
        assert first(a_scene, kind)
        assert (len(first.started), second.started) == (1, [])
    finally:
        first.end()
