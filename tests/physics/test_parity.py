"""One source, three machines: plain Python, numba and warp on the CPU agree on every function of physics and on every law."""

import numpy as np
import pytest
from callers import integral, plain, through_numba, through_warp
from parity_cases import CASES, law_cases

from runout.backends.compile import CONSTRUCTORS, PHYSICS, functions_of
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS

ALL_CASES = [*CASES, *(case for law in (*LAWS.of_runout(), *FRICTIONS.of_runout()) for case in law_cases(law))]
every_case = pytest.mark.parametrize("case", ALL_CASES, ids=lambda case: case.name)
compilers = pytest.mark.parametrize("compiled", [through_numba, through_warp])


def test_every_function_of_physics_has_a_parity_case():
    defined = {f for module in PHYSICS for f in functions_of(module) if f.__name__ not in CONSTRUCTORS}
    assert defined == {case.function for case in CASES}


@compilers
@every_case
def test_float64_results_are_bitwise_those_of_plain_python(case, compiled):
    arguments = case.sample()
    np.testing.assert_array_equal(compiled(case, arguments, np.float64), plain(case, arguments))


@compilers
@every_case
def test_float32_results_agree_relative_to_their_scale(case, compiled):
    arguments = [a if a.dtype.kind == "i" else a.astype(np.float32).astype(np.float64) for a in case.sample()]
    expected = plain(case, arguments)
    found = compiled(case, arguments, np.float32)
    if integral(case):
        # a comparison or a floor at the very edge may round the other way
        assert np.mean(found != expected) < 0.01
        return
    for column in _parts(case):
        scale = np.abs(expected[:, column]).max() or 1.0
        assert np.abs(found - expected)[:, column].max() / scale < case.single_precision


def _parts(case):
    """Columns of each result: a strain is not measured against an energy."""
    place = 0
    for kind in case.results:
        length = {"v": 3, "y": 6, "t": 9}.get(kind, 1)
        yield slice(place, place + length)
        place += length
