"""Physics keeps to the subset of Python that numba, warp and plain Python read alike."""

from pathlib import Path

import pytest

import runout.physics
from runout.model.registered_law import violations

MODULES = sorted(Path(runout.physics.__file__).parent.glob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_module_of_physics_keeps_the_shared_subset(path):
    assert [f"{path.name}:{line}: {message}" for line, message in violations(path.read_text())] == []


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("return 0.5 * a", "float literal"),
        ("return real(1.0 / 3.0) * a", "float literal"),
        ("return a % 4", "masks"),
        ("return a // 4", "masks"),
        ("return a ** 2", "multiply"),
        ("return a[0] + 2 * a", "index it"),
        ("return max(a, a, a)", "two arguments"),
        ("return round(a)", "differs"),
        ("return int(a)", "truncates"),
        ("return math.hypot(a, a)", "not in both"),
        ("return g(x=a)", "keyword"),
        ("return a + 4294967296", "31 bits"),
        ("raise ValueError", "Raise"),
        ("import numpy", "imports only"),
    ],
)
def test_lint_finds_what_compilers_read_differently(line, complaint):
    found = [message for _, message in violations(f"def f(a):\n    {line}\n")]
    assert any(complaint in message for message in found)


def test_every_function_of_physics_states_what_it_returns():
    from runout.backends.compile import CONSTRUCTORS, PHYSICS, functions_of

    silent = [f.__qualname__ for m in PHYSICS for f in functions_of(m) if f.__name__ not in CONSTRUCTORS and not f.__doc__]
    assert silent == []
