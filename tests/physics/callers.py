"""Runs a function of physics on rows of arguments as plain Python, through numba and through warp on the CPU."""

import importlib.util
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import warp as wp
from parity_cases import CASES, LENGTH, Case, home_of, law_cases

from runout.backends.compile import PHYSICS, cache_folder, numba_binding, source_key, warp_binding, warp_record
from runout.io.atomic import write_text
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law

FOLDER = TemporaryDirectory(prefix="runout-parity-")  # of sources that warp reads; removed when the process ends
WARP_TYPES = {"s": "real", "v": "vec", "y": "sym", "t": "tens", "i": "wp.int32", "k": "wp.int64"}


def integral(case: Case) -> bool:
    """Whether the results are integers."""
    return case.results in ("i", "k", "b")


def plain(case: Case, arguments: list[np.ndarray]) -> np.ndarray:
    """Results (n, length) of the function as it stands in its module."""
    return _row_by_row(case, case.function, arguments, SimpleNamespace(**case.material), float)


def _row_by_row(case: Case, function: Any, arguments: list[np.ndarray], record: Any, number: type) -> np.ndarray:
    """Results (n, length) of a function that is called once a row, with real arguments of a type of numbers."""
    columns, rows = [_values(a, kind, number) for a, kind in zip(arguments, kinds_of(case), strict=True)], []
    for values in zip(*columns, strict=True):
        result = function(*with_record(case, values, record))
        parts = result if len(case.results) > 1 else (result,)
        rows.append(np.concatenate([np.atleast_1d(part) for part in parts]))
    return np.array(rows, np.int64 if integral(case) else np.float64)


def _values(a: np.ndarray, kind: str, number: type) -> list:
    """Rows of an argument, numbers or tuples."""
    rows = a.tolist() if a.dtype.kind == "i" else [[number(x) for x in row] for row in a]
    return [row[0] if LENGTH[kind] == 1 else tuple(row) for row in rows]


def kinds_of(case: Case) -> str:
    """Kinds of the arguments besides the record."""
    return case.arguments.replace("m", "")


def with_record(case: Case, values: Any, record: Any) -> list:
    """Arguments with the record in its place."""
    rest = iter(values)
    return [record if kind == "m" else next(rest) for kind in case.arguments]


def through_numba(case: Case, arguments: list[np.ndarray], real: type) -> np.ndarray:
    """Results (n, length) of the function compiled by numba.

    What Python calls takes one row: with a loop over the rows it would take twice as long to compile.
    """
    material = np.array([tuple(case.material.values())], dtype=[(name, real) for name in case.material])
    run = _numba_callers(real, case.law)[case.name]
    return _row_by_row(case, run, arguments, material, np.float32 if real is np.float32 else float)


@cache
def _numba_callers(real: type, law: Law | FrictionLaw | None) -> dict[str, Any]:
    """A compiled function per case of physics, or of a law, by its name; the cache keeps them as it keeps kernels, by content."""
    cases = law_cases(law) if law else CASES
    source = "\n".join(map(_numba_source, cases))
    binding, of_law = numba_binding(real, False), (law.name, law.fingerprint) if law else ()
    scope = {"__name__": __name__} | {f"f_{case.name}": _function(binding, case) for case in cases}  # numba imports it to load
    with cache_folder(source_key(PHYSICS, real.__name__, *of_law, source)) as folder:
        path = folder / f"parity_{home_of(law) if law else 'physics'}.py"
        if not path.exists():
            write_text(source, path)
        exec(compile(source, str(path), "exec"), scope)
        compiled = numba.njit(cache=True, error_model="numpy", _nrt=False, no_cfunc_wrapper=True)
        return {case.name: compiled(scope[case.name]) for case in cases}


def _numba_source(case: Case) -> str:
    names = [f"a{k}" for k in range(len(case.arguments))]
    values = [f"{name}[0]" if kind == "m" else name for name, kind in zip(names, case.arguments, strict=True)]
    return f"def {case.name}({', '.join(names)}):\n    return f_{case.name}({', '.join(values)})\n"


def through_warp(case: Case, arguments: list[np.ndarray], real: type) -> np.ndarray:
    """Results (n, length) of the function compiled by warp, on the CPU."""
    kernels = _warp_kernels(real, case.law)
    scalar = wp.float32 if real is np.float32 else wp.float64
    material = kernels.record()
    for name, value in case.material.items():
        setattr(material, name, value)
    types = {"s": scalar, "i": wp.int32, "k": wp.int64, **{c: getattr(kernels, WARP_TYPES[c]) for c in "vyt"}}
    inputs = [
        wp.array(_typed(a, real) if LENGTH[kind] > 1 else _typed(a, real)[:, 0], dtype=types[kind], device="cpu")
        for a, kind in zip(arguments, kinds_of(case), strict=True)
    ]
    n = len(arguments[0])
    out = wp.array(_results(case, n, real), device="cpu")
    wp.launch(getattr(kernels, case.name), dim=n, inputs=[*inputs, material, out], device="cpu")
    return out.numpy()


def _results(case: Case, n: int, real: type) -> np.ndarray:
    return np.zeros((n, sum(LENGTH[kind] for kind in case.results)), np.int64 if integral(case) else real)


def _typed(a: np.ndarray, real: type) -> np.ndarray:
    return np.ascontiguousarray(a if a.dtype.kind == "i" else a.astype(real))


@cache
def _warp_kernels(real: type, law: Law | FrictionLaw | None) -> ModuleType:
    """A module with one kernel per case of physics, or of a law; warp reads its source from a file."""
    wp.config.quiet = True
    cases = law_cases(law) if law else CASES
    name = home_of(law) if law else "physics"
    path = Path(FOLDER.name) / f"parity_kernels_{name}_{real.__name__}.py"
    path.write_text("import warp as wp\n" + "\n".join(_warp_source(case) for case in cases))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    scalar = wp.float32 if real is np.float32 else wp.float64
    binding = warp_binding(scalar)
    names = {name: binding.names[name] for name in ("vec", "sym", "tens")}
    names |= {"real": scalar, "record": warp_record(f"parity_{name}", tuple(cases[0].material), scalar)}
    names |= {f"f_{case.name}": _function(binding, case) for case in cases}
    module.__dict__.update(names)
    spec.loader.exec_module(module)
    module.__dict__.update(names)
    return module


def _function(binding: Any, case: Case):
    if case.law:
        own = binding.friction(case.law) if isinstance(case.law, FrictionLaw) else binding.law(case.law)
        return own.own[case.function]
    return getattr(getattr(binding, case.function.__module__.rsplit(".", 1)[-1]), case.function.__name__)


def _warp_source(case: Case) -> str:
    names = [f"a{k}" for k in range(len(case.samplers))]
    typed = [f"{name}: wp.array(dtype={WARP_TYPES[kind]})" for name, kind in zip(names, kinds_of(case), strict=True)]
    out = "wp.int64" if integral(case) else "real"
    values = with_record(case, [f"{name}[p]" for name in names], "material")
    parts = [f"r{k}" for k in range(len(case.results))]
    lines = [
        "@wp.kernel(enable_backward=False)",
        f"def {case.name}({', '.join(typed)}, material: record, out: wp.array2d(dtype={out})):",
        "    p = wp.tid()",
        f"    {', '.join(parts)} = f_{case.name}({', '.join(values)})",
    ]
    place = 0
    for part, kind in zip(parts, case.results, strict=True):
        for j in range(LENGTH[kind]):
            lines.append(f"    out[p, {place}] = {_warp_value(case, part, kind, j)}")
            place += 1
    return "\n".join(lines) + "\n"


def _warp_value(case: Case, part: str, kind: str, j: int) -> str:
    if kind == "b":
        return f"wp.where({part}, wp.int64(1), wp.int64(0))"
    if integral(case):
        return f"wp.int64({part})"
    return f"{part}[{j}]" if LENGTH[kind] > 1 else part
