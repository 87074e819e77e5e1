"""Constant vectors and fixed permutations of lanes; each factory makes one function for use inside numba functions."""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from runout.backends.lanes.memory import pointer
from runout.backends.lanes.vectors import INDEX, LANES, Vec, indices


def constant(lanes: Sequence[float]) -> Any:
    """Function of a vector or array that returns a constant vector of its number type."""
    values = tuple(float(x) for x in lanes)

    @intrinsic
    def like(typing: Any, a: Any) -> Any:
        kind = Vec(a.element if isinstance(a, Vec) else getattr(a, "dtype", a), len(values))

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return ir.Constant(context.get_value_type(kind), list(values))

        return kind(a), emit

    return like


def permutation(lanes: Sequence[int]) -> Any:
    """Function that returns the chosen lanes of a vector of n lanes; a lane of n and more is zero."""
    chosen = tuple(lanes)

    @intrinsic
    def permuted(typing: Any, a: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.shuffle_vector(args[0], ir.Constant(args[0].type, None), indices(chosen))

        return Vec(a.element, len(chosen))(a), emit

    return permuted


def permutation_of_two(lanes: Sequence[int]) -> Any:
    """Function that returns chosen lanes of two vectors of n lanes: 0 to n-1 of the first, n to 2n-1 of the second."""
    chosen = tuple(lanes)

    @intrinsic
    def permuted(typing: Any, a: Any, b: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.shuffle_vector(args[0], args[1], indices(chosen))

        return Vec(a.element, len(chosen))(a, b), emit

    return permuted


def _each(kind: Any, number: int) -> ir.Constant:
    return ir.Constant(kind, [number] * LANES)


@intrinsic
def looked_up(typing: Any, row: Any, cells: Any, place: Any) -> Any:
    """Lanes of a ``row`` of 16 by the columns of 16 ``cells`` of a block, bytes from ``place`` on: their bits 2 to 5."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first = pointer(context, builder, sig.args[1], args[1], args[2], sig.args[2])
        kind = ir.VectorType(INDEX, LANES)
        read = builder.load(builder.bitcast(first, ir.VectorType(ir.IntType(8), LANES).as_pointer()), align=1)
        column = builder.and_(builder.lshr(builder.zext(read, kind), _each(kind, 2)), _each(kind, 15))
        found = ir.Constant(args[0].type, ir.Undefined)
        for k in range(LANES):
            lane = ir.Constant(INDEX, k)
            number = builder.extract_element(args[0], builder.extract_element(column, lane))
            found = builder.insert_element(found, number, lane)
        return found

    known = isinstance(row, Vec) and row.lanes == LANES and cells.dtype == types.uint8
    return (row(row, cells, place), emit) if known else None
