"""The types Vec and Mask: arithmetic, comparison, selection, reduction."""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

LANES = 16
FLOATS = {types.float32: ir.FloatType(), types.float64: ir.DoubleType()}
INDEX = ir.IntType(32)


class Vec(types.Type):  # type: ignore[misc]
    """``lanes`` numbers of one type. It has no truth value: code that branches on a lane does not compile."""

    def __init__(self, element: Any, lanes: int):
        self.element, self.lanes = element, lanes
        super().__init__(f"Vec({element} x {lanes})")

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Scalars spread to all lanes."""
        return Conversion.safe if isinstance(other, types.Number) else None


class Mask(types.Type):  # type: ignore[misc]
    """``lanes`` truth values."""

    def __init__(self, lanes: int):
        self.lanes = lanes
        super().__init__(f"Mask(x {lanes})")


@register_model(Vec)
class _VecModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Vec):
        super().__init__(manager, kind, ir.VectorType(FLOATS[kind.element], kind.lanes))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Mask):
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.lanes))


def indices(lanes: Any) -> ir.Constant:
    """Constant that a shuffle takes."""
    lanes = list(lanes)
    return ir.Constant(ir.VectorType(INDEX, len(lanes)), lanes)


def spread(builder: Any, scalar: Any, lanes: int) -> Any:
    """LLVM value with a scalar in every lane."""
    empty = ir.Constant(ir.VectorType(scalar.type, lanes), ir.Undefined)
    first = builder.insert_element(empty, scalar, ir.Constant(INDEX, 0))
    return builder.shuffle_vector(first, first, indices([0] * lanes))


@lower_cast(types.Number, Vec)
def _spread_number(context: Any, builder: Any, source: Any, target: Vec, value: Any) -> Any:
    return spread(builder, context.cast(builder, value, source, target.element), target.lanes)


def _define(operation: Any, emit: Callable[..., Any], result: Callable[[Vec], Any] = lambda v: v) -> None:
    """Give an operator a meaning for two vectors, or a vector and a number."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            vectors = [a for a in args if isinstance(a, Vec)]
            if len(args) == 2 and vectors and all(a == vectors[0] or isinstance(a, types.Number) for a in args):
                return signature(result(vectors[0]), vectors[0], vectors[0])
            return None

    infer_global(operation)(Template)
    lower_builtin(operation, Vec, Vec)(lambda context, builder, sig, args: emit(builder, *args))


_define(operator.add, lambda b, x, y: b.fadd(x, y))
_define(operator.sub, lambda b, x, y: b.fsub(x, y))
_define(operator.mul, lambda b, x, y: b.fmul(x, y))
_define(operator.truediv, lambda b, x, y: b.fdiv(x, y))
_define(operator.iadd, lambda b, x, y: b.fadd(x, y))
_define(operator.isub, lambda b, x, y: b.fsub(x, y))
_define(operator.imul, lambda b, x, y: b.fmul(x, y))
_define(operator.lt, lambda b, x, y: b.fcmp_ordered("<", x, y), lambda v: Mask(v.lanes))
_define(operator.le, lambda b, x, y: b.fcmp_ordered("<=", x, y), lambda v: Mask(v.lanes))
_define(operator.gt, lambda b, x, y: b.fcmp_ordered(">", x, y), lambda v: Mask(v.lanes))
_define(operator.ge, lambda b, x, y: b.fcmp_ordered(">=", x, y), lambda v: Mask(v.lanes))
_define(operator.ne, lambda b, x, y: b.fcmp_unordered("!=", x, y), lambda v: Mask(v.lanes))
_define(min, lambda b, x, y: b.select(b.fcmp_ordered("<", x, y), x, y))


@intrinsic
def select(typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """``a`` in the lanes where ``mask`` holds, else ``b``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return (a(mask, a, a), emit) if isinstance(mask, Mask) and isinstance(a, Vec) and a == b else None


def _maximum(builder: Any, a: Any, b: Any) -> Any:
    bits = 32 if isinstance(a.type.element, ir.FloatType) else 64
    name = f"llvm.maximum.v{a.type.count}f{bits}"
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(a.type, [a.type, a.type]), name)
    return builder.call(function, [a, b])


@intrinsic
def largest(typing: Any, a: Any, b: Any) -> Any:
    """The larger of two vectors lane by lane; not a number if either is."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _maximum(builder, *args)

    return a(a, b), emit


@intrinsic
def whole(typing: Any, number: Any) -> Any:
    """Largest whole number that is not above a scalar, as a real number: math.floor would make an integer of it."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(args[0].type, [args[0].type])
        name = f"llvm.floor.f{sig.args[0].bitwidth}"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), args)

    return (number(number), emit) if isinstance(number, types.Float) else None


@intrinsic
def in_double(typing: Any, a: Any) -> Any:
    """The numbers of a vector in float64."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.VectorType(ir.DoubleType(), sig.args[0].lanes)
        return args[0] if args[0].type == kind else builder.fpext(args[0], kind)

    return (Vec(types.float64, a.lanes)(a), emit) if isinstance(a, Vec) else None


@intrinsic
def lane_bits(typing: Any, mask: Any) -> Any:
    """Integer whose bit k tells whether lane k holds."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(sig.args[0].lanes))
        return builder.zext(bits, ir.IntType(64))

    return types.uint64(mask), emit


@intrinsic
def any_lane(typing: Any, mask: Any) -> Any:
    """Whether any lane holds."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(sig.args[0].lanes))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), emit


@intrinsic
def lowest_bit(typing: Any, bits: Any) -> Any:
    """Position of the lowest bit that is set in a 64-bit integer."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(types.uint64), emit


def _reduced(builder: Any, value: Any, lanes: int, combine: Callable[[Any, Any], Any]) -> Any:
    """Halves combined until one lane is left: an order that no compiler changes."""
    while lanes > 1:
        lanes //= 2
        low = builder.shuffle_vector(value, value, indices(range(lanes)))
        high = builder.shuffle_vector(value, value, indices(range(lanes, 2 * lanes)))
        value = combine(low, high)
    return builder.extract_element(value, ir.Constant(INDEX, 0))


@intrinsic
def lane_sum(typing: Any, a: Any) -> Any:
    """Sum of all lanes, in a fixed order."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _reduced(builder, args[0], sig.args[0].lanes, builder.fadd)

    return a.element(a), emit


@intrinsic
def lane_largest(typing: Any, a: Any) -> Any:
    """Largest of all lanes; not a number if any is."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _reduced(builder, args[0], sig.args[0].lanes, lambda x, y: _maximum(builder, x, y))

    return a.element(a), emit
