"""The mutation tool: which faults it makes, that a seed repeats them, and that tests kill those that they see."""

import ast
import json

import run
from calls import callers
from mutants import mutants, sample

SOURCE = b'''"""A text of 3 words."""
from typing import Any


def part(a: Any, b: Any = 2):
    """Of 4 words, \xc3\xa4 too."""
    log("x")
    if a < b and not b:
        raise ValueError(f"{a + 1} is wrong")
    return -a * min(a, 0.5)
'''
TEST = "from toy.sums import larger\n\n\ndef test_larger():\n    assert (larger(1, 2), larger(2, 1)) == (2, 2)\n"


def test_every_mutant_is_one_change_of_the_code_that_python_reads():
    found = mutants("toy.py", SOURCE)
    changes = {(m.line, m.operator, m.text) for m in found}
    assert {
        (7, "removed call", "pass"),
        (8, "boundary", "(a <= b)"),
        (8, "comparison", "(a >= b)"),
        (9, "removed raise", "pass"),
    } < changes
    assert {(8, "boolean", "((a < b) or (not b))"), (8, "boolean", "b"), (10, "return value", "return None")} < changes
    assert {
        (10, "arithmetic", "((-a) / min(a, 0.5))"),
        (10, "sign", "a"),
        (10, "call", "max(a, 0.5)"),
        (10, "constant", "1.0"),
    } < changes
    assert {(5, "constant", "(1)"), (5, "constant", "(3)")} < changes
    assert len(found) == 13
    for mutant in found:
        assert ast.dump(ast.parse(mutant.apply(SOURCE))) != ast.dump(ast.parse(SOURCE))


def test_a_seed_repeats_its_sample(tmp_path):
    (tmp_path / "toy.py").write_bytes(SOURCE)
    first, again, other = (sample(tmp_path, ["toy.py"], 6, seed) for seed in (1, 1, 2))
    assert first == again != other
    assert len(set(first)) == 6


def test_tests_of_a_line_are_those_that_call_its_function():
    called = {"test_a.py": ["toy.py:5"], "test_b.py": []}
    assert callers(called, "toy.py", SOURCE, 8) == {"test_a.py"}
    assert callers(called, "toy.py", SOURCE, 2) == callers(called, "toy.py", SOURCE, 5) == {"test_a.py", "test_b.py"}
    inner = b"@cache\ndef f():\n    def g():\n        return 1\n    return g\n"
    called = {"test_a.py": ["toy.py:1"], "test_b.py": ["toy.py:1", "toy.py:3"]}
    assert callers(called, "toy.py", inner, 4) == {"test_b.py"}
    assert callers(called, "toy.py", inner, 5) == {"test_a.py", "test_b.py"}


def test_tests_kill_what_they_see_and_survivors_are_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # what the runs below do not need
    (tmp_path / "toy").mkdir()
    (tmp_path / "checks").mkdir()
    source = "def larger(a, b):\n    return a if a > b else b\n"
    (tmp_path / "toy" / "sums.py").write_text(source)
    (tmp_path / "checks" / "test_sums.py").write_text(TEST)
    monkeypatch.setattr(run, "ROOT", tmp_path)
    monkeypatch.setattr(run, "COPIED", ("toy", "checks"))
    monkeypatch.setattr(run, "TESTS", {"toy": ["checks"]})
    (tmp_path / "checks" / "test_other.py").write_text("def test_nothing():\n    pass\n")
    share = run.main(["--package", "toy", "--workers", "1", "--json", str(tmp_path / "found.json")])
    found = json.loads((tmp_path / "found.json").read_text())["mutants"]
    assert {m["operator"]: m["state"] for m in found} == {
        "boundary": "survived",  # equal numbers: both are the larger one
        "comparison": "killed",
        "return value": "killed",
    }
    assert share == 2 / 3
    printed = capsys.readouterr().out
    assert "survived: toy/sums.py:2 (boundary)\n    -    return a if a > b else b\n    +    return a if (a >= b) else b" in printed
    assert "seed 0: 2 of 3 mutants killed (67 %)" in printed
    assert (tmp_path / "toy" / "sums.py").read_text() == source
