"""Every run executes the code of the cache: a process that has compiled a kernel would round differently from one that loads it."""

import os
import subprocess
from types import SimpleNamespace

import pytest
from scenes import SAND, box, plane, scene

from runout.backends.compile import cache_root
from runout.backends.scan import precompile
from runout.backends.scan.backend import ScanBackend
from runout.backends.scan.kernels import kernels_for
from runout.model.particles import Particles


@pytest.mark.parametrize(
    ("precision", "index", "transfer"),
    [
        *((precision, index, {}) for precision in ("float32", "float64") for index in ("sparse", "dense")),
        ("float64", "sparse", {"transfer": "aflip", "f_bar": True}),
        ("float64", "sparse", {"f_bar": True}),
    ],
)
def test_no_kernel_is_compiled_in_the_process_that_runs_it(precision, index, transfer):
    ground = plane(slope_x=-0.5, height=30.0)
    particles = box((6.0, 6.0, 0.0), (8.0, 8.0, 3.0), (1.0, 1.0, 1.0), SAND.density, surface=ground)
    particles.velocity[:] = (3.0, -6.0, -1.5)  # over the southern edge before long
    materials = (SAND, SAND) if transfer else (SAND,)  # the kernels of test_other_transfers
    a_scene = scene(ground, materials=materials, friction=(0.5,) * len(materials), precision=precision, **transfer)
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
    assert ("take_gradients" in loaded) == bool(transfer)


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
    empty.pass_second_half(a_scene.stable_step(1.0))
    assert {name: set(kernels[name].signatures) for name in of_the_run} == of_the_run


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
    assert precompile._warm_up_elsewhere(scene(materials=(SAND,), precision="float32"), "plain")


def test_sources_that_were_installed_anew_are_compiled_anew(monkeypatch, tmp_path):
    """Numba does not take what it has cached for a file of another place or time."""
    started = []
    monkeypatch.setattr(precompile, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(precompile, "_warm_up_elsewhere", lambda *job: not started.append(job))
    source = tmp_path / "kernels.py"
    source.write_text("")
    module = SimpleNamespace(__file__=str(source))
    monkeypatch.setattr(precompile.inspect, "getfile", lambda m: getattr(m, "__file__", __file__))
    a_scene = scene(materials=(SAND,))
    for seconds, processes in ((100, 1), (100, 1), (200, 2)):
        os.utime(source, (seconds, seconds))
        precompile.ensure_compiled(a_scene, (module,))
        assert len(started) == processes


def test_without_a_process_to_compile_in_kernels_are_compiled_where_they_run(monkeypatch, tmp_path):
    monkeypatch.setattr(precompile, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(precompile.sys, "executable", str(tmp_path / "none"))
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
