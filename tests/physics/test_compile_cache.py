"""The key of compiled code follows the sources: a changed law is never served from a stale cache."""

import importlib.util
import threading

import numpy as np
import pytest
from numba import config as settings

from runout.backends import compile as binding
from runout.physics import elastic


@pytest.fixture
def law_file(tmp_path):
    path = tmp_path / "some_law.py"
    path.write_text("def twice(a):\n    return a + a\n")
    return path


def load(path):
    spec = importlib.util.spec_from_file_location("some_law", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_key_changes_with_the_source_of_a_law(law_file):
    before = binding.source_key((load(law_file),), "float32")
    assert binding.source_key((load(law_file),), "float32") == before
    law_file.write_text("def twice(a):\n    return a + a + a\n")
    assert binding.source_key((load(law_file),), "float32") != before


def test_key_differs_between_number_types(law_file):
    module = load(law_file)
    assert binding.source_key((module,), "float32") != binding.source_key((module,), "float64")


def test_changed_kernel_is_compiled_anew_not_taken_from_the_cache(law_file, tmp_path, monkeypatch):
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    binding.cache_root.cache_clear()
    try:
        numbers = binding.numba_binding(np.float64, False)
        assert numbers.kernels(load(law_file)).twice(2.0) == 4.0
        law_file.write_text("def twice(a):\n    return a + a + a\n")
        assert numbers.kernels(load(law_file)).twice(2.0) == 6.0
        assert any((tmp_path / "cache").rglob("*.nbi"))
    finally:
        binding.cache_root.cache_clear()


def test_equal_kernels_of_another_place_are_loaded_from_the_cache(law_file, tmp_path, monkeypatch):
    """A fresh clone, or another virtual environment, has the sources in another folder."""
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    binding.cache_root.cache_clear()
    other = tmp_path / "other" / law_file.name
    other.parent.mkdir()
    other.write_text(law_file.read_text())
    try:
        numbers = binding.numba_binding(np.float64, False)
        first, second = (numbers.kernels(load(path)).twice for path in (law_file, other))
        assert first(2.0) == second(2.0) == 4.0
        assert sum(first.stats.cache_misses.values()) == 1
        assert sum(second.stats.cache_hits.values()) == 1
        assert not second.stats.cache_misses
    finally:
        binding.cache_root.cache_clear()


def test_unwritable_cache_folder_falls_back_to_a_temporary_one(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("RUNOUT_CACHE", str(blocked))
    binding.cache_root.cache_clear()
    try:
        folder = binding.cache_root()
        assert folder.is_dir()
        assert blocked not in folder.parents
    finally:
        binding.cache_root.cache_clear()


def test_a_thread_waits_for_the_folder_of_another_one():
    """Members of a GPU make their particles in threads; a folder set meanwhile would take or lose the kernels of another."""
    before, seen, entered = settings.CACHE_DIR, {}, threading.Event()

    def other():
        entered.set()
        with binding.cache_folder("second"):
            seen["second"] = settings.CACHE_DIR

    thread = threading.Thread(target=other)
    with binding.cache_folder("first"):
        thread.start()
        assert entered.wait(10)
        thread.join(0.2)
        assert thread.is_alive()
        assert settings.CACHE_DIR.endswith("first")
    thread.join(10)
    assert seen["second"].endswith("second")
    assert before == settings.CACHE_DIR


def test_rebinding_leaves_the_plain_function_as_it_was():
    before = elastic.step.__globals__["real"]
    binding.numba_binding(np.float32)
    assert elastic.step.__globals__["real"] is before is float
