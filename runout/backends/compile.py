"""Binds the plain functions of :mod:`runout.physics` and the kernels of a backend to a compiler.

Each function is copied with its globals extended, so that ``real``, ``i64``, ``vec``, ``sym``, ``tens`` and every physics
function it calls mean the compiled ones; then numba or warp compiles the copy. The sources of physics are read by two
compilers and by plain Python, and are written once.

Numba finds compiled code by the path and the content of the file of a kernel alone. Here the folder of the cache is named by the
content of every source that a binding uses, and the copies that numba compiles state a copy of their source in that folder as their
file. So a change of a law compiles anew, and equal sources compile once on a machine, wherever they are installed.
"""

import ast
import contextlib
import hashlib
import inspect
import platform
import tempfile
import threading
from collections import namedtuple
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType, SimpleNamespace
from typing import Any, TypeVar

from runout.io.atomic import whole_file
from runout.model.erosion_laws import ErosionLaw
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law
from runout.model.registered_law import functions_of_law
from runout.physics import (
    bed,
    blocks,
    bspline,
    contact,
    elastic,
    flow_columns,
    geostatic,
    heightfield,
    inflow,
    moments,
    numerical_scales,
    plastic,
    pore_pressure,
    several_laws,
    structures,
    substeps,
    tensors,
    timestep,
)
from runout.processes.caches import compiled_code

PHYSICS = (
    *(tensors, bspline, moments, heightfield, elastic, plastic),
    *(geostatic, pore_pressure, contact, several_laws, structures, substeps, blocks, timestep, numerical_scales, flow_columns, bed),
    inflow,
)
_SETTING = threading.RLock()  # of the folder in which numba caches
AnyLaw = TypeVar("AnyLaw", Law, FrictionLaw)
CONSTRUCTORS = ("vec", "sym", "tens")  # opaque values: tuples in Python and numba, vectors in warp


def functions_of(module: ModuleType) -> list[FunctionType]:
    """Functions that a module defines, in the order of definition."""
    return [f for f in vars(module).values() if inspect.isfunction(f) and f.__module__ == module.__name__]


def rebound(function: FunctionType, names: Mapping[str, Any], compiled: Mapping[FunctionType, Any]) -> FunctionType:
    """Copy of a function whose globals mean the compiled functions, and ``names`` first of all."""
    scope = {
        name: compiled[value] if inspect.isfunction(value) and value in compiled else value
        for name, value in function.__globals__.items()
    }
    copy = FunctionType(function.__code__, {**scope, **names}, function.__name__, function.__defaults__)
    copy.__annotations__ = dict(function.__annotations__)
    copy.__qualname__ = function.__qualname__
    copy.__module__ = function.__module__
    copy.__doc__ = function.__doc__
    return copy


def names_in(code: CodeType) -> set[str]:
    """Names that code refers to, also in functions inside."""
    return set(code.co_names).union(*(names_in(part) for part in code.co_consts if isinstance(part, CodeType)))


def _copy(function: FunctionType, names: Mapping[str, Any], compiled: Mapping[FunctionType, Any], source: Path) -> FunctionType:
    """The same, whose file is a copy of its source in the cache."""
    copy = rebound(function, names, compiled)
    copy.__code__ = copy.__code__.replace(co_filename=str(source))
    return copy


def _bind(
    modules: tuple[ModuleType, ...], names: Mapping[str, Any], compile_one: Callable[[FunctionType], Any]
) -> tuple[SimpleNamespace, dict[FunctionType, Any]]:
    compiled: dict[FunctionType, Any] = {}
    spaces = SimpleNamespace()
    for module in modules:
        space = SimpleNamespace()
        for function in functions_of(module):
            if function.__name__ in names:
                compiled[function] = names[function.__name__]
            else:
                compiled[function] = compile_one(rebound(function, names, compiled))
            setattr(space, function.__name__, compiled[function])
        setattr(spaces, module.__name__.rsplit(".", 1)[-1], space)
    return spaces, compiled


def _bind_law(
    law: Law, names: Mapping[str, Any], compiled: Mapping[FunctionType, Any], compile_one: Callable[[FunctionType], Any]
) -> SimpleNamespace:
    """``update`` of a law and its steps, by total and by effective stress; a material that never yields has those of elasticity."""
    steps: dict[str, Any] = {"step": law.step, "step_small": law.step_small, "effective_step": law.effective_step}
    steps["effective_step_small"] = law.effective_step_small
    functions: list[Any] = list(dict.fromkeys([*law.own_functions, law.effective_return, *steps.values()]))
    own = _bind_own(law, functions, names, compiled, compile_one)
    return SimpleNamespace(update=own.get(law.update), own=own, **{name: own[step] for name, step in steps.items()})


def _bind_friction(
    law: FrictionLaw, names: Mapping[str, Any], compiled: Mapping[FunctionType, Any], compile_one: Callable[[FunctionType], Any]
) -> SimpleNamespace:
    """``resistance`` of a law of basal friction, as it is and ``at_base``, and what contacts and columns make of it."""
    of_contact = law.limited, law.at_base, law.effective_impulse, law.impulse, law.column_drag, law.free_column_drag
    functions: list[Any] = list(dict.fromkeys([*law.own_functions, *of_contact]))
    own = _bind_own(law, functions, names, compiled, compile_one)
    wanted = "resistance", "at_base", "impulse", "effective_impulse", "column_drag", "free_column_drag"
    return SimpleNamespace(own=own, **{name: own[getattr(law, name)] for name in wanted})


def _with_parts(law: AnyLaw, compiled: Mapping[FunctionType, Any], bound: Callable[[AnyLaw], Any]) -> Mapping[FunctionType, Any]:
    """What is compiled, with the functions of the laws of a mixture: ``bound`` is what a law is bound to."""
    parts = law.laws if len(law.laws) > 1 else ()
    return dict(compiled) | {f: made for part in parts for f, made in bound(part).own.items()}  # type: ignore[arg-type]


def _bind_own(
    law: Law | FrictionLaw | ErosionLaw, functions: list[Any], names: Mapping[str, Any], compiled: Mapping[FunctionType, Any],
    compile_one: Callable[[FunctionType], Any],
) -> dict[Any, Any]:  # fmt: skip
    """What is compiled already and the functions of a law, each after what it calls."""
    own: dict[Any, Any] = dict(compiled)
    for function in functions:
        if function not in own:
            copy = rebound(function, names, own)
            copy.__qualname__ = f"{function.__name__}_{law.name}_{law.fingerprint}"  # part of the key of compiled code
            own[function] = compile_one(copy)
    return own


class NumbaBinding:
    """Physics compiled by numba for one number type: functions for compiled code, which Python must not call.

    Parameters
    ----------
    real : type
        ``numpy.float32`` or ``numpy.float64``.
    contract : bool
        Allow fused multiply-add. Off, float64 results equal plain Python bit by bit.
    """

    def __init__(self, real: type, contract: bool = True):
        import numba

        self.real, self.contract = real, contract
        self.options: dict[str, Any] = {"error_model": "numpy", "boundscheck": False}
        if contract:
            self.options["fastmath"] = {"contract"}
        # only kernels call them, not Python or C: no wrappers, whose code for groups of arrays is long; and they make no array
        alone = {"forceinline": True, "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        self.inlined: dict[str, Any] = {**self.options, **alone}
        names = {"real": real, "i64": numba.int64, "prange": numba.prange}
        inline = numba.njit(**self.inlined)
        for name in CONSTRUCTORS:
            names[name] = inline(getattr(tensors, name))
        spaces, self._compiled = _bind(PHYSICS, names, inline)
        self.names = names
        self._laws: dict[Law | FrictionLaw, SimpleNamespace] = {}
        self._helpers: dict[Any, Any] = {}
        self.__dict__.update(vars(spaces))

    def law(self, law: Law) -> SimpleNamespace:
        """The compiled steps of a law: ``step`` and ``step_small`` of :mod:`runout.physics.plastic`, and its ``update``."""
        if law not in self._laws:
            import numba

            compiled = _with_parts(law, self._compiled, self.law)
            self._laws[law] = _bind_law(law, self.names, compiled, numba.njit(**self.inlined))
        return self._laws[law]

    def friction(self, law: FrictionLaw) -> SimpleNamespace:
        """Compiled functions of a law of basal friction, and ``record``, which makes a record of its numbers."""
        if law not in self._laws:
            import numba

            compiled = _with_parts(law, self._compiled, self.friction)
            self._laws[law] = _bind_friction(law, self.names, compiled, numba.njit(**self.inlined))
            self._laws[law].record = namedtuple("record", law.fields)  # type: ignore[misc]
        return self._laws[law]

    def erosion(self, law: ErosionLaw, friction: FrictionLaw) -> SimpleNamespace:
        """Compiled ``rate`` of a law of erosion, and ``friction_stress`` of a law of basal friction."""
        import numba

        compile_one = numba.njit(**self.inlined)
        rate = _bind_own(law, functions_of_law(law.rate), self.names, self._compiled, compile_one)[law.rate]
        stress = [*friction.own_functions, friction.limited, friction.stress]
        compiled = _with_parts(friction, self._compiled, self.friction)
        bound = _bind_own(friction, stress, self.names, compiled, compile_one)
        return SimpleNamespace(rate=rate, friction_stress=bound[friction.stress])

    def chain(self, link: Any, formulas: Sequence[Any], first: int = 0) -> Any:
        """Copies of the function ``link`` that call each other, each with one of the formulas and its place from ``first`` on."""
        import numba

        *_, found = map(self._inlined, functions_of_law(link.__globals__["others"]))  # what the end of the chain calls comes first
        inline = numba.njit(**self.inlined)
        for place, formula in reversed(list(enumerate(formulas, first))):
            copy = rebound(link, {"PLACE": place, "formula": self._inlined(formula), "others": found}, {})
            copy.__qualname__ = "_".join([link.__name__, *(f.__name__ for f in formulas[place - first :])])
            found = inline(copy)
        return found

    def _inlined(self, function: FunctionType) -> Any:
        """A function in the subset of physics, compiled."""
        import numba

        if function not in self._compiled:
            self._compiled[function] = numba.njit(**self.inlined)(rebound(function, self.names, self._compiled))
        return self._compiled[function]

    def _helper(self, copy: FunctionType) -> Any:
        """An inlined function of kernels, compiled once for all kernels in which its names mean the same."""
        import numba

        used = {name: copy.__globals__[name] for name in names_in(copy.__code__) if name in copy.__globals__}
        values = tuple((name, repr(value) if isinstance(value, int | float) else id(value)) for name, value in sorted(used.items()))
        key = copy.__code__, copy.__qualname__, values
        if key not in self._helpers:
            self._helpers[key] = numba.njit(**self.inlined)(copy)
        return self._helpers[key]

    def kernels(
        self, *modules: ModuleType, sources: tuple[ModuleType, ...] = (), nogil: bool = False, **names: Any
    ) -> SimpleNamespace:
        """Functions of kernel modules, compiled in order.

        Names that start with an underscore are inlined, the others are kernels: parallel if they call ``prange``,
        and cached on disk. ``names`` replace globals of the modules (the law, for one). Later modules see the
        kernels of earlier ones. ``sources`` are further modules whose change makes compiled code stale. With ``nogil``, other
        threads of Python run meanwhile.
        """
        import numba

        from runout.backends.lanes.parallel_loops import in_shares, without_parallel_loops

        labels = (f"contract={self.contract}", *(f"{k}={_label(v)}" for k, v in sorted(names.items())))
        key = source_key((*PHYSICS, *modules, *sources), self.real.__name__, *labels)
        own: dict[str, Any] = {**self.options, "cache": True, "no_cfunc_wrapper": True, "nogil": nogil}  # never called from C
        called: dict[str, Any] = {**self.options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        compiled = dict(self._compiled)
        space = SimpleNamespace()
        with cache_folder(key) as folder:
            for module in modules:
                source = _copied_source(module, folder)
                for function in functions_of(module):
                    if function.__name__.startswith("_"):
                        compiled[function] = self._helper(_copy(function, {**self.names, **names}, compiled, source))
                        continue
                    scope, kernel, options = {**self.names, **names}, function, own
                    if "prange" in function.__code__.co_names:
                        kernel, bodies = without_parallel_loops(function, key)
                        scope["in_shares"], options = in_shares, {**own, "nogil": True}
                        scope |= {body.__name__: numba.njit(**called)(_copy(body, scope, compiled, source)) for body in bodies}
                    compiled[function] = numba.njit(**options)(_copy(kernel, scope, compiled, source))
                    setattr(space, function.__name__, compiled[function])
        return space


@cache
def numba_binding(real: type, contract: bool = True) -> NumbaBinding:
    """The numba binding of a number type, made once a process."""
    return NumbaBinding(real, contract)


@cache
def array_binding() -> SimpleNamespace:
    """Physics for arrays of NumPy in float64, one name space per module: of functions that do not branch."""
    import numpy as np

    names = {"math": np, "min": np.minimum, "max": np.maximum, "abs": np.abs}
    return _bind(PHYSICS, names, lambda function: function)[0]


def warp_binding(real: Any) -> SimpleNamespace:
    """Physics compiled by warp for ``warp.float32`` or ``warp.float64``, one name space per module."""
    import warp as wp

    module = wp.get_module(f"runout.physics.{real.__name__}")
    module.options["max_unroll"] = 1
    module.options["enable_backward"] = False
    names = {
        "real": real,
        "i64": wp.int64,
        "vec": wp.types.vector(length=3, dtype=real),
        "sym": wp.types.vector(length=6, dtype=real),
        "tens": wp.types.vector(length=9, dtype=real),
    }
    compile_one: Callable[[FunctionType], Any] = partial(wp.func, module=module)
    spaces, compiled = _bind(PHYSICS, names, compile_one)
    spaces.names, spaces.compiled = names, compiled
    spaces.law = cache(lambda law: _bind_law(law, names, _with_parts(law, compiled, spaces.law), compile_one))
    spaces.friction = cache(lambda law: _bind_friction(law, names, _with_parts(law, compiled, spaces.friction), compile_one))
    return spaces


def warp_kernels(
    binding: SimpleNamespace, sources: tuple[ModuleType, ...], module_of: Callable[[str], Any],
    packing: Mapping[Any, tuple[Any, Any]], **names: Any,
) -> SimpleNamespace:  # fmt: skip
    """Functions of kernel modules compiled by warp, in order; rules as for :meth:`NumbaBinding.kernels`.

    ``module_of`` is the warp module that takes a kernel by its name, None for one that is left out; warp compiles a module once
    for each number of lanes a block. What ``names`` replaces is not compiled itself: types of arguments and constants, for which
    the sources hold stand-ins. ``packing``: for some types the packed one that a kernel takes, and the function that opens it.
    """
    import warp as wp

    scope = {**binding.names, **names}
    compiled = dict(binding.compiled)
    space = SimpleNamespace()
    for source in sources:
        for function in functions_of(source):
            if function.__name__ in scope:
                continue
            copy = rebound(function, scope, compiled)
            if function.__name__.startswith("_"):
                compiled[function] = wp.func(module=module_of(function.__name__))(copy)
            elif "tid" in function.__code__.co_names and (module := module_of(function.__name__)):
                opening = _Opening(copy, packing)
                options = {"enable_backward": False}
                compiled[function] = wp.Kernel(copy, module=module, options=options, code_transformers=[opening])
                setattr(space, function.__name__, compiled[function])
    return space


class _Opening(ast.NodeTransformer):
    """Lets a kernel take those arguments packed for whose types ``packing`` holds a packed type and a function that opens it."""

    def __init__(self, kernel: FunctionType, packing: Mapping[Any, tuple[Any, Any]]):
        kinds = {name: kernel.__globals__.get(kind, kind) for name, kind in kernel.__annotations__.items()}
        self.packed = {name: packing[kind] for name, kind in kinds.items() if kind in packing}
        kernel.__annotations__ |= {name: packed for name, (packed, _) in self.packed.items()}
        kernel.__globals__.update({f"open_{name}": opens for name, (_, opens) in self.packed.items()})

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        """The kernel, in whose body other names stand for what is opened."""
        for part in (inner for statement in node.body for inner in ast.walk(statement)):
            if isinstance(part, ast.Name) and part.id in self.packed:
                part.id = f"opened_{part.id}"
        opening = ast.parse("\n".join(f"opened_{name} = open_{name}({name})" for name in self.packed))
        for statement in opening.body:
            ast.increment_lineno(statement, node.lineno - statement.lineno)
        node.body = [*opening.body, *node.body]
        return node


def law_record(law: Law | FrictionLaw, real: Any) -> Any:
    """Warp struct of the record of a law."""
    kind = "friction_" if isinstance(law, FrictionLaw) else ""
    return warp_record(kind + law.name, law.fields, real)


@cache
def warp_record(law_name: str, fields: tuple[str, ...], real: Any) -> Any:
    """Warp struct with the parameter fields of a law; one in a process, since warp writes its functions once for each struct."""
    import warp as wp

    record = type(f"{law_name}_{real.__name__}", (), {"__annotations__": dict.fromkeys(fields, real)})
    return wp.struct(record)


def source_key(modules: tuple[ModuleType, ...], *labels: str) -> str:
    """Hash of what compiled code depends on: sources of modules, labels, compiler, interpreter and processor."""
    import numba
    import numpy
    from llvmlite.binding import get_host_cpu_name

    from runout.backends.lanes import parallel_loops

    compiler = numba.__version__, numpy.__version__, platform.python_version(), get_host_cpu_name()
    digest = hashlib.sha256("|".join((*compiler, *labels)).encode())
    for module in (*modules, parallel_loops, inspect.getmodule(source_key)):
        digest.update(Path(inspect.getfile(module)).read_bytes())  # type: ignore[arg-type]
    return digest.hexdigest()[:16]


def _label(value: Any) -> str:
    return getattr(value, "__module__", "") + "." + getattr(value, "__qualname__", repr(value))


def _copied_source(module: ModuleType, folder: Path) -> Path:
    """Copy of the source of a module in a folder of the cache; written whole, since processes share the folder."""
    source = Path(inspect.getfile(module))
    copy = folder / source.name
    if not copy.exists():
        with whole_file(copy) as temporary:
            temporary.write_bytes(source.read_bytes())
    return copy


@contextlib.contextmanager
def cache_folder(key: str) -> Iterator[Path]:
    """Numba caches what is decorated inside in a folder of its own; a temporary one where the cache is unwritable.

    The folder is a setting of numba for the whole process: other threads wait.
    """
    from numba import config as settings

    config: Any = settings
    with _SETTING:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(cache_root() / key)
        try:
            yield Path(config.CACHE_DIR)
        finally:
            config.CACHE_DIR = before


@contextlib.contextmanager
def threads_at_most(count: int) -> Iterator[None]:
    """Scope in which parallel loops of numba take at most ``count`` threads, but one at least."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(before, count)))
    try:
        yield
    finally:
        numba.set_num_threads(before)


@cache
def cache_root() -> Path:
    """Folder of all code that numba has compiled; a temporary one where the user's cache cannot be written or is not safe."""
    cache = compiled_code()
    folder = cache.folder / "numba"
    try:
        if fault := cache.fault():
            raise PermissionError(f"{cache.folder} {fault}")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="runout-")) / "numba"
        folder.mkdir()
    return folder
