"""Loads and stores of vectors, transposition of records, local arrays, prefetch. Positions count numbers, unchecked."""

from collections.abc import Callable
from math import prod
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from runout.backends.lanes.vectors import FLOATS, LANES, Vec, indices

WORD = ir.IntType(64)


def pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any, place_kind: Any) -> Any:
    """Pointer to an element of a C-contiguous array, counted from its first."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [context.cast(builder, place, place_kind, types.intp)])


def _at(builder: Any, pointer: Any, offset: int, element: Any, lanes: int) -> Any:
    """Pointer to a vector ``offset`` elements on."""
    moved = builder.gep(pointer, [ir.Constant(WORD, offset)])
    return builder.bitcast(moved, ir.VectorType(FLOATS[element], lanes).as_pointer())


def _bytes(element: Any) -> int:
    return int(element.bitwidth) // 8


def _loader(lanes: int) -> Any:
    @intrinsic
    def load(typing: Any, array: Any, place: Any) -> Any:
        """Vector of the numbers at ``place`` of a flat array and after it."""

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
            return builder.load(_at(builder, p, 0, array.dtype, lanes), align=_bytes(array.dtype))

        return Vec(array.dtype, lanes)(array, place), emit

    return load


load4, load8, load16 = (_loader(lanes) for lanes in (4, 8, 16))


@intrinsic
def store(typing: Any, array: Any, place: Any, vector: Any) -> Any:
    """Write a vector to ``place`` of a flat array and after it."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
        builder.store(args[2], _at(builder, p, 0, array.dtype, vector.lanes), align=_bytes(array.dtype))
        return context.get_dummy_value()

    return types.void(array, place, vector), emit


@intrinsic
def prefetch(typing: Any, array: Any, place: Any) -> Any:
    """Ask for the cache line at ``place`` of an array; harmless beyond its end."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
        byte, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [builder.bitcast(p, byte), *(ir.Constant(flag, k) for k in (0, 2, 1))])
        return context.get_dummy_value()

    return types.void(array, place), emit


def local_array(shape: tuple[int, ...]) -> Any:
    """Function of an array that returns an uninitialised one of its type on the stack; it must not leave the caller."""

    @intrinsic
    def local(typing: Any, like: Any) -> Any:
        kind = types.Array(like.dtype, len(shape), "C")

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            element = context.get_data_type(kind.dtype)
            size = context.get_abi_sizeof(element)
            room = cgutils.alloca_once(builder, ir.ArrayType(element, prod(shape)))
            room.align = 64
            array = context.make_array(kind)(context, builder)
            steps = [size * prod(shape[k + 1 :]) for k in range(len(shape))]
            populate_array(
                array,
                data=builder.bitcast(room, element.as_pointer()),
                shape=[ir.Constant(WORD, n) for n in shape],
                strides=[ir.Constant(WORD, n) for n in steps],
                itemsize=ir.Constant(WORD, size),
                meminfo=None,
            )
            return array._getvalue()

        return kind(like), emit

    return local


def _exchange(builder: Any, rows: list[Any], distance: int) -> None:
    """One stage of a transposition: swap the off-diagonal squares of ``distance`` rows and lanes."""
    low = indices(j if not j & distance else LANES + j - distance for j in range(LANES))
    high = indices(j + distance if not j & distance else LANES + j for j in range(LANES))
    for i in (i for i in range(len(rows)) if not i & distance):
        a, b = rows[i], rows[i + distance]
        rows[i], rows[i + distance] = builder.shuffle_vector(a, b, low), builder.shuffle_vector(a, b, high)


def _transpose_squares(builder: Any, rows: list[Any]) -> None:
    """Transpose each square of as many lanes as there are rows."""
    distance = len(rows) // 2
    while distance:
        _exchange(builder, rows, distance)
        distance //= 2


def _join(builder: Any, parts: list[Any]) -> Any:
    """Vector of the lanes of one, two or four vectors."""
    while len(parts) > 1:
        lanes = indices(range(2 * LANES // len(parts)))
        parts = [builder.shuffle_vector(a, b, lanes) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


def _tuple(context: Any, builder: Any, kind: Any, values: list[Any]) -> Any:
    result = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for k, value in enumerate(values):
        result = builder.insert_value(result, value, k)
    return result


def record_vectors(width: int) -> tuple[Any, Any]:
    """(load, store) of 16 records of ``width`` numbers, 4, 8 or 16, one behind the other, as ``width`` vectors over the records."""

    @intrinsic
    def load(typing: Any, array: Any, place: Any) -> Any:
        kind = types.UniTuple(Vec(array.dtype, LANES), width)

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
            read = [builder.load(_at(builder, p, width * i, array.dtype, width), align=_bytes(array.dtype)) for i in range(LANES)]
            rows = [_join(builder, read[i::width]) for i in range(width)]
            _transpose_squares(builder, rows)
            return _tuple(context, builder, kind, rows)

        return kind(array, place), emit

    @intrinsic
    def write(typing: Any, array: Any, place: Any, fields: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
            rows = [builder.extract_value(args[2], k) for k in range(width)]
            _transpose_squares(builder, rows)
            for i in range(LANES):
                row = rows[i % width]
                if width < LANES:
                    first = width * (i // width)
                    row = builder.shuffle_vector(row, row, indices(range(first, first + width)))
                builder.store(row, _at(builder, p, width * i, array.dtype, width), align=_bytes(array.dtype))
            return context.get_dummy_value()

        return types.void(array, place, fields), emit

    return load, write


def listed_record_vectors(width: int) -> Any:
    """Load of 16 records of ``width`` numbers by an array of their positions, as ``width`` vectors over the records."""

    @intrinsic
    def load(typing: Any, array: Any, numbers: Any, place: Any) -> Any:
        kind = types.UniTuple(Vec(array.dtype, LANES), width)

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            which = pointer(context, builder, sig.args[1], args[1], args[2], sig.args[2])
            read = []
            for i in range(LANES):
                number = builder.load(builder.gep(which, [ir.Constant(WORD, i)]))
                first = builder.mul(builder.sext(number, WORD), ir.Constant(WORD, width))
                p = _at(builder, builder.gep(data, [first]), 0, array.dtype, width)
                read.append(builder.load(p, align=_bytes(array.dtype)))
            rows = [_join(builder, read[i::width]) for i in range(width)]
            _transpose_squares(builder, rows)
            return _tuple(context, builder, kind, rows)

        return kind(array, numbers, place), emit

    return load


def row_vectors(count: int, stride: int) -> tuple[Any, Any]:
    """(load, store) of ``count`` vectors that lie ``stride`` numbers apart in a flat array."""
    return _row_loader(count, stride), _row_writer(count, stride)


def _row_loader(count: int, stride: int) -> Callable[..., Any]:
    @intrinsic
    def load(typing: Any, array: Any, place: Any) -> Any:
        kind = types.UniTuple(Vec(array.dtype, LANES), count)

        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
            places = [_at(builder, p, stride * k, array.dtype, LANES) for k in range(count)]
            return _tuple(context, builder, kind, [builder.load(q, align=_bytes(array.dtype)) for q in places])

        return kind(array, place), emit

    return load  # type: ignore[no-any-return]


def _row_writer(count: int, stride: int) -> Callable[..., Any]:
    @intrinsic
    def write(typing: Any, array: Any, place: Any, rows: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            p = pointer(context, builder, sig.args[0], args[0], args[1], sig.args[1])
            for k in range(count):
                value = builder.extract_value(args[2], k)
                builder.store(value, _at(builder, p, stride * k, array.dtype, LANES), align=_bytes(array.dtype))
            return context.get_dummy_value()

        return types.void(array, place, rows), emit

    return write  # type: ignore[no-any-return]
