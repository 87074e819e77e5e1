"""Constant vectors and fixed permutations of lanes; each factory makes one function for use inside numba functions."""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

from runout.backends.lanes.vectors import Vec, indices


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
