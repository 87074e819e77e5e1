"""Parallel loops of kernels: the body of ``prange`` becomes a function, which numba compiles once.

    def kernel(arrays):                     def kernel(arrays):
        before                                  before
        for b in prange(n):         ->          in_shares(n, kernel_loop_1, (arrays,))
            body                                after
        after
                                            def kernel_loop_1(first_index, end_index, arrays):
                                                for b in range(first_index, end_index):
                                                    body

``in_shares`` writes the arguments to the stack and gives their address to a small parallel loop, :func:`_divided`, in which each
thread calls the function for its share of the indices. With one thread no thread waits for another.

Numba itself compiles the body of a parallel loop two times and optimises it three times, with one argument for every array of the
groups (docs/decisions/01-packaging-and-compilation.md).

The body writes to arrays, not to variables that the kernel uses outside of the loop; this is checked. It raises no errors: those
would be lost. Indices are unsigned.
"""

import ast
import inspect
from functools import cache
from types import CodeType, FunctionType
from typing import Any

from llvmlite import ir
from numba import njit, prange, types
from numba.core import cgutils
from numba.extending import intrinsic

BYTES, WORD = ir.IntType(8).as_pointer(), ir.IntType(64)
SHARE = ir.FunctionType(ir.VoidType(), [BYTES, WORD, WORD])  # of a loop: address of the arguments, first index, end
ADDRESSES = types.intp, types.uintp, types.uintp  # number of indices, function of this type, and arguments
threads_in_use = types.ExternalFunction("get_num_threads", types.intp())  # that of numba refers to an address, which no cache keeps


@intrinsic
def _call_share(typing: Any, function: Any, arguments: Any, begin: Any, end: Any) -> Any:
    """Call the function at an address for the indices from ``begin`` to ``end``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], SHARE.as_pointer())
        builder.call(pointer, [builder.inttoptr(args[1], BYTES), *args[2:]])
        return context.get_dummy_value()

    return types.void(types.uintp, types.uintp, types.uintp, types.uintp), emit


def _divided(count: Any, function: Any, arguments: Any) -> None:
    """Call a function for all indices below ``count``, in equal shares of the threads; no thread is started for one share."""
    shares = min(count, threads_in_use())
    if shares < 2:
        _call_share(function, arguments, 0, count)  # type: ignore[call-arg]
        return
    for k in prange(shares):
        _call_share(function, arguments, count * k // shares, count * (k + 1) // shares)  # type: ignore[call-arg]


@cache
def _divider() -> Any:
    """The compiled loop; one a process."""
    options: dict[str, Any] = {"parallel": True, "error_model": "numpy", "no_cpython_wrapper": True}
    return njit(types.void(*ADDRESSES), **options)(_divided).overloads[ADDRESSES]


def _share_function(context: Any, builder: Any, body: Any, sig: Any, packer: Any) -> Any:
    """LLVM function that reads the arguments of a loop from a struct and calls its ``body``."""
    compiled = body.dispatcher.overloads[sig.args]
    context.add_linking_libs((compiled.library,))
    function = ir.Function(builder.module, SHARE, f"{compiled.fndesc.mangled_name}.share")
    function.linkage = "internal"
    inside = ir.IRBuilder(function.append_basic_block())
    kinds = packer.argument_types[2:]
    struct = inside.bitcast(function.args[0], ir.LiteralStructType(kinds).as_pointer())
    leaves = [inside.load(cgutils.gep_inbounds(inside, struct, 0, k)) for k in range(len(kinds))]
    values = packer.from_arguments(inside, [*function.args[1:], *leaves])
    context.call_internal_no_propagate(inside, compiled.fndesc, sig, values)
    inside.ret_void()
    return function


@intrinsic
def in_shares(typing: Any, count: Any, body: Any, arguments: Any) -> Any:
    """Call ``body(first_index, end_index, *arguments)`` for all indices below ``count``, which the threads share."""
    own = typing.resolve_function_type(body, (types.uintp, types.uintp, *arguments.types), {})

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        packer, zero = context.get_arg_packer(own.args), ir.Constant(WORD, 0)
        values = [builder.extract_value(args[2], k) for k in range(len(arguments.types))]
        struct = cgutils.alloca_once(builder, ir.LiteralStructType(packer.argument_types[2:]))
        for k, leaf in enumerate(packer.as_arguments(builder, [zero, zero, *values])[2:]):
            builder.store(leaf, cgutils.gep_inbounds(builder, struct, 0, k))
        share = _share_function(context, builder, body, own, packer)
        divider = _divider()
        context.add_linking_libs((divider.library,))
        indices = context.cast(builder, args[0], sig.args[0], types.intp)
        addresses = [indices, builder.ptrtoint(share, WORD), builder.ptrtoint(struct, WORD)]
        context.call_internal_no_propagate(builder, divider.fndesc, types.void(*ADDRESSES), addresses)
        return context.get_dummy_value()

    return types.void(count, body, arguments), emit


def without_parallel_loops(function: FunctionType, key: str) -> tuple[FunctionType, list[FunctionType]]:
    """A kernel that calls functions in place of its parallel loops, and these functions.

    The ``key`` of the compiled code becomes a part of their qualified names, from which numba makes the names of machine code.
    """
    names, code = _taken_apart(function)
    scope = dict(function.__globals__)
    exec(code, scope)
    kernel, *bodies = (scope[name] for name in names)
    kernel.__module__ = function.__module__
    for body in bodies:
        body.__module__, body.__qualname__ = function.__module__, f"{body.__name__}_{key}"
    return kernel, bodies


@cache
def _taken_apart(function: FunctionType) -> tuple[list[str], CodeType]:
    """Names of the kernel and of the functions in place of its loops, and the code that defines them."""
    lines, first = inspect.getsourcelines(function)
    kernel: Any = ast.parse("\n" * (first - 1) + "".join(lines)).body[0]
    loops = _Loops(kernel)
    loops.visit(kernel)
    module = ast.Module([kernel, *loops.bodies], [])
    return [kernel.name, *(body.name for body in loops.bodies)], compile(module, function.__code__.co_filename, "exec")


class _Loops(ast.NodeTransformer):
    """Takes the parallel loops out of the source of a kernel; ``bodies`` are the sources of the functions in their place."""

    def __init__(self, kernel: ast.FunctionDef):
        self.kernel, self.bodies = kernel, list[ast.FunctionDef]()
        inside = {id(n) for loop in ast.walk(kernel) if _is_parallel(loop) for n in ast.walk(loop)}
        outside = [n for n in ast.walk(kernel) if isinstance(n, ast.Name) and id(n) not in inside]
        self.known = {a.arg for a in kernel.args.args} | {n.id for n in outside if isinstance(n.ctx, ast.Store)}
        self.read = {n.id for n in outside if isinstance(n.ctx, ast.Load)}

    def visit_For(self, loop: ast.For) -> Any:
        """The call in place of a parallel loop."""
        if not _is_parallel(loop):
            return self.generic_visit(loop)
        own, index = _names([loop], ast.Store), _names([loop.target], ast.Store)
        if shared := (_read_first(loop.body) - index) & own & self.known | (own & self.read) - self.known:
            raise SyntaxError(f"{self.kernel.name}: a parallel loop sets {', '.join(sorted(shared))}, which is used outside of it")
        name, arguments = (
            f"{self.kernel.name}_loop_{len(self.bodies) + 1}",
            sorted((_names(loop.body, ast.Load) & self.known) - own),
        )
        head = f"def {name}({', '.join(['first_index', 'end_index', *arguments])}):\n"
        body: Any = ast.parse(f"{head}    for _ in range(first_index, end_index):\n        pass").body[0]
        ast.increment_lineno(body, loop.lineno - 1)
        body.body[0].target, body.body[0].body = loop.target, loop.body
        self.bodies.append(body)
        call: Any = ast.parse(f"in_shares(0, {name}, ({''.join(f'{a}, ' for a in arguments)}))").body[0]
        ast.increment_lineno(call, loop.lineno - 1)
        call.value.args[0] = loop.iter.args[0]  # type: ignore[attr-defined]
        return call


def _is_parallel(node: ast.AST) -> bool:
    return isinstance(node, ast.For) and isinstance(node.iter, ast.Call) and getattr(node.iter.func, "id", "") == "prange"


def _names(nodes: "list[Any]", kind: type) -> set[str]:
    """Variables that are read or set, by ``kind``."""
    return {n.id for node in nodes for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, kind)}


def _read_first(body: list[ast.stmt]) -> set[str]:
    """Variables that statements read before they set them, in the order of the source."""
    first: dict[str, bool] = {}
    statements = [n for part in body for n in ast.walk(part) if isinstance(n, ast.stmt)]
    for node in sorted(statements, key=lambda n: (n.lineno, n.col_offset)):
        parts = [part for part in ast.iter_child_nodes(node) if not isinstance(part, ast.stmt)]
        added = _names([node.target], ast.Store) if isinstance(node, ast.AugAssign) else set()
        first = dict.fromkeys(_names(parts, ast.Load) | added, True) | first
        first = dict.fromkeys(_names(parts, ast.Store), False) | first
    return {name for name, is_read in first.items() if is_read}
