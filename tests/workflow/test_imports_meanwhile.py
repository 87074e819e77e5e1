"""The libraries of the products are imported while other processes compute the members, and at no other time."""

import threading
from contextlib import nullcontext

import pytest
from ramp_site import write_site

from runout.ensemble import workers as worker_processes
from runout.processes import imports
from runout.processes.imports import imported_meanwhile
from runout.workflow import hazard_map

ALL = hazard_map.STAGES


def test_what_has_not_begun_at_the_end_of_the_context_is_left_out(monkeypatch):
    imported, begun, go_on = [], threading.Event(), threading.Event()

    def slow_import(name):
        begun.set()
        go_on.wait(10)
        imported.append(name)
        raise ImportError(name)

    monkeypatch.setattr(imports, "import_module", slow_import)
    with imported_meanwhile(("first", "second")):
        assert begun.wait(10)
        threading.Timer(0.1, go_on.set).start()
    assert imported == ["first"]


@pytest.mark.parametrize(
    ("stages", "workers", "times"),
    [(ALL, 2, 1), (ALL, 1, 0), (("ensemble",), 2, 0), (("hazard",), 2, 0)],
)
def test_products_are_imported_if_they_follow_and_this_process_waits(tmp_path, monkeypatch, stages, workers, times):
    contexts = []
    monkeypatch.setattr(worker_processes, "core_count", lambda: 2)
    monkeypatch.setattr(hazard_map, "imported_meanwhile", lambda modules: contexts.append(1) or nullcontext())
    monkeypatch.setattr(hazard_map, "compile_ahead", lambda site: None)
    monkeypatch.setattr(hazard_map, "_make", lambda study, stage: None)
    hazard_map.run(write_site(tmp_path / "ramp"), stages=stages, workers=workers)
    assert len(contexts) == times


@pytest.mark.parametrize(
    ("stages", "workers", "compiles", "number"),
    [(ALL, 2, False, 1), (ALL, 1, False, 0), (ALL, 2, True, 0), (("hazard",), 2, False, 0)],
)
def test_workers_start_ahead_where_they_compute_members_with_compiled_kernels(
    tmp_path, monkeypatch, stages, workers, compiles, number
):
    begun = []
    monkeypatch.setattr(worker_processes, "core_count", lambda: 2)
    monkeypatch.setattr(worker_processes, "Standby", lambda workers, threads: begun.append((workers, threads)) or nullcontext())
    monkeypatch.setattr(hazard_map, "compile_ahead", lambda site: compiles)
    monkeypatch.setattr(hazard_map, "imported_meanwhile", nullcontext)
    monkeypatch.setattr(hazard_map, "_make", lambda study, stage: None)
    hazard_map.run(write_site(tmp_path / "ramp"), stages=stages, workers=workers)
    assert begun == [(2, 1)] * number
