"""The libraries of the products are imported while other processes compute the members, and at no other time."""

import gc
import threading
from contextlib import nullcontext

import pytest
from ramp_site import write_site

from runout.ensemble import machine
from runout.workflow import ahead, hazard_map
from runout.workflow.ahead import imported_meanwhile


def test_what_has_not_begun_at_the_end_of_the_context_is_left_out(monkeypatch):
    imported, begun, go_on = [], threading.Event(), threading.Event()

    def slow_import(name):
        begun.set()
        go_on.wait(10)
        imported.append(name)
        raise ImportError(name)

    monkeypatch.setattr(ahead, "import_module", slow_import)
    with imported_meanwhile(("first", "second")):
        assert begun.wait(10)
        threading.Timer(0.1, go_on.set).start()
    assert imported == ["first"]


@pytest.mark.parametrize(
    ("stages", "workers", "times"),
    [(hazard_map.STAGES, 2, 1), (hazard_map.STAGES, 1, 0), (("ensemble",), 2, 0), (("hazard",), 2, 0)],
)
def test_products_are_imported_if_they_follow_and_this_process_waits(tmp_path, monkeypatch, stages, workers, times):
    contexts = []
    monkeypatch.setattr(machine, "core_count", lambda: 2)
    monkeypatch.setattr(hazard_map, "imported_meanwhile", lambda: contexts.append(1) or nullcontext())
    monkeypatch.setattr(hazard_map, "compile_ahead", lambda site: None)
    monkeypatch.setattr(hazard_map, "_make", lambda study, stage: None)
    hazard_map.run(write_site(tmp_path / "ramp"), stages=stages, workers=workers)
    assert len(contexts) == times


def test_garbage_is_collected_as_soon_as_a_stage_is_made(tmp_path):
    gc.disable()
    try:
        hazard_map.run(write_site(tmp_path / "ramp"), stages=("terrain",))
        assert gc.isenabled()
    finally:
        gc.enable()
