"""The lane library against NumPy, for both number types."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from runout.backends.lanes import (
    any_lane,
    constant,
    in_double,
    lane_bits,
    lane_largest,
    lane_sum,
    largest,
    listed_record_vectors,
    load4,
    load8,
    load16,
    local_array,
    looked_up,
    lowest_bit,
    permutation,
    permutation_of_two,
    prefetch,
    record_vectors,
    row_vectors,
    select,
    store,
    whole,
)

both = pytest.mark.parametrize("real", [np.float32, np.float64])
ramp = constant(range(16))
reversed_lanes = permutation(range(15, -1, -1))
first_half_then_nothing = permutation([*range(8), *[16] * 8])
interleaved = permutation_of_two([k for i in range(8) for k in (i, 16 + i)])
load_wide, store_wide = record_vectors(16)
load_short, store_short = record_vectors(4)
load_narrow, store_narrow = record_vectors(8)
load_chosen = listed_record_vectors(16)
load_rows, store_rows = row_vectors(3, 20)
local_square = local_array((2, 16))


def lanes(real, n=1, seed=0):
    return np.random.default_rng(seed).normal(size=16 * n).astype(real)


def ran(function, *arguments):
    return numba.njit(function)(*arguments)


@both
def test_a_row_is_looked_up_by_the_columns_of_cells(real):
    """Marks of cells, which are above their 64 numbers, do not count."""

    def look(row, cells, out):
        store(out, 0, looked_up(load16(row, 0), cells, 3))

    row, cells, out = lanes(real), np.random.default_rng(2).integers(0, 256, 24).astype(np.uint8), np.zeros(16, real)
    ran(look, row, cells, out)
    np.testing.assert_array_equal(out, row[(cells[3:19] & 63) >> 2])


@both
def test_arithmetic_is_that_of_numpy_lane_by_lane(real):
    def combine(a, b, out):
        x, y = load16(a, 0), load16(b, 0)
        store(out, 0, (x + y) * x - y / x + 2.0 * y)

    a, b, out = lanes(real), lanes(real, seed=1), np.zeros(16, real)
    ran(combine, a, b, out)
    np.testing.assert_allclose(out, (a + b) * a - b / a + 2 * b, rtol=20 * np.finfo(real).eps, atol=1e-6)


@both
def test_numbers_in_double_are_the_same_numbers(real):
    def widen(a, out):
        store(out, 0, in_double(load4(a, 3)))

    a, out = lanes(real), np.zeros(4)
    ran(widen, a, out)
    np.testing.assert_array_equal(out, a[3:7].astype(np.float64))


@both
def test_selection_takes_the_lanes_that_hold(real):
    def choose(a, b, out):
        x, y = load16(a, 0), load16(b, 0)
        store(out, 0, select(x > y, x, ramp(x)))
        mask = lane_bits(x > y)
        return mask, any_lane(x > x), any_lane(x >= x), lowest_bit(mask)

    a, b, out = lanes(real), lanes(real, seed=1), np.zeros(16, real)
    mask, none, every, lowest = ran(choose, a, b, out)
    np.testing.assert_array_equal(out, np.where(a > b, a, np.arange(16)))
    assert [mask >> k & 1 for k in range(16)] == list(a > b)
    assert (none, every, lowest) == (False, True, np.argmax(a > b))


@both
def test_reductions_take_all_lanes_and_show_what_is_not_a_number(real):
    def reduce(a, b):
        x, y = load16(a, 0), load16(b, 0)
        return lane_sum(x), lane_largest(x), lane_largest(largest(x, y))

    a, b = lanes(real), lanes(real, seed=1)
    b[5] = np.nan
    total, most, spoiled = ran(reduce, a, b)
    assert total == pytest.approx(a.sum(dtype=np.float64), rel=1e-5, abs=1e-5)
    assert most == a.max()
    assert np.isnan(spoiled)


@both
def test_comparison_with_what_is_not_a_number_never_holds_but_unequal_does(real):
    def compare(a):
        x = load16(a, 0)
        return lane_bits(x > x), lane_bits(x <= x), lane_bits(x != x)

    greater, not_greater, unequal = ran(compare, np.full(16, np.nan, real))
    assert (greater, not_greater, unequal) == (0, 0, 0xFFFF)


@both
def test_permutations_move_lanes_and_fill_with_zero(real):
    def move(a, b, out):
        x, y = load16(a, 0), load16(b, 0)
        store(out, 0, reversed_lanes(x))
        store(out, 16, first_half_then_nothing(x))
        store(out, 32, interleaved(x, y))

    a, b, out = lanes(real), lanes(real, seed=1), np.zeros(48, real)
    ran(move, a, b, out)
    np.testing.assert_array_equal(out[:16], a[::-1])
    np.testing.assert_array_equal(out[16:32], [*a[:8], *[0] * 8])
    np.testing.assert_array_equal(out[32:], np.stack([a[:8], b[:8]], axis=1).ravel())


@both
@pytest.mark.parametrize("width", [8, 16])
def test_records_turn_into_vectors_and_back(real, width):
    load, save = (load_narrow, store_narrow) if width == 8 else (load_wide, store_wide)
    fields = row_vectors(width, 16)[1]

    def turn(records, columns, back):
        vectors = load(records, width)  # the first record is skipped
        fields(columns, 0, vectors)
        save(back, width, vectors)

    records = lanes(real, 20).reshape(-1, width)
    columns, back = np.zeros((width, 16), real), np.zeros_like(records)
    ran(turn, records, columns, back)
    np.testing.assert_array_equal(columns, records[1:17].T)
    np.testing.assert_array_equal(back[1:17], records[1:17])
    assert not back[17:].any()
    assert not back[0].any()


@both
def test_records_of_four_become_columns_and_go_back(real):
    (load, save), (read, write) = row_vectors(4, 16), (load_short, store_short)

    def turn(records, columns, back):
        save(columns, 0, read(records, 4))
        write(back, 4, load(columns, 0))

    records, columns, back = lanes(real, 5).reshape(20, 4), np.zeros((4, 16), real), np.full((20, 4), 7.0, real)
    ran(turn, records, columns, back)
    np.testing.assert_array_equal(columns, records[1:17].T)
    np.testing.assert_array_equal(back[1:17], records[1:17])
    assert (back[[0, 17, 18, 19]] == 7.0).all()


@both
def test_listed_records_are_loaded_from_where_the_list_says(real):
    fields = row_vectors(16, 16)[1]

    def turn(records, numbers, columns):
        fields(columns, 0, load_chosen(records, numbers, 2))

    records = lanes(real, 30).reshape(30, 16)
    numbers, columns = np.random.default_rng(2).integers(0, 30, 18).astype(np.int32), np.zeros((16, 16), real)
    ran(turn, records, numbers, columns)
    np.testing.assert_array_equal(columns, records[numbers[2:]].T)


@both
def test_rows_lie_a_stride_apart(real):
    def shift(a, out):
        store_rows(out, 1, load_rows(a, 0))
        prefetch(a, 0)
        store(out, 60, load4(a, 3))
        store(out, 64, load8(a, 5))

    a, out = lanes(real, 5), np.zeros(80, real)
    ran(shift, a, out)
    for k in range(3):
        np.testing.assert_array_equal(out[20 * k + 1 : 20 * k + 17], a[20 * k : 20 * k + 16])
    np.testing.assert_array_equal(out[60:72], [*a[3:7], *a[5:13]])


@both
def test_local_arrays_are_separate_and_of_the_type_of_their_model(real):
    def fill(a, out):
        x, y = local_square(a), local_square(a)
        for i in range(2):
            for j in range(16):
                x[i, j] = a[j] + i
                y[i, j] = -a[j]
        for j in range(16):
            out[j] = x[1, j] + y[0, j]

    out = np.zeros(16, real)
    ran(fill, lanes(real), out)
    np.testing.assert_allclose(out, 1.0, rtol=1e-5)


@both
def test_whole_floors_and_keeps_the_number_type(real):
    def floor(a, out):
        for k in range(np.uint64(16)):
            out[k] = whole(a[k])

    a, out = lanes(real) * real(3), np.zeros(16, real)
    ran(floor, a, out)
    np.testing.assert_array_equal(out, np.floor(a))


@pytest.mark.parametrize("processor", ["x86-64", "haswell"])
def test_narrower_processors_run_the_same_source(processor):
    """In a process of its own, for a processor without AVX and one with AVX2 only."""
    features = {"x86-64": "+sse2", "haswell": "+avx2,+fma"}[processor]
    program = (
        "import numba, numpy as np; from runout.backends.lanes import *; load, save = record_vectors(16)\n"
        "f = numba.njit(lambda a, out: save(out, 0, load(a, 0)) or store(out, 0, load16(a, 0) * 2.0 + load16(a, 16)))\n"
        "a = np.arange(256, dtype=np.float32); out = np.zeros_like(a); f(a, out)\n"
        "assert (out[16:] == a[16:]).all() and (out[:16] == 2 * a[:16] + a[16:32]).all()\n"
        "assert 'zmm' not in ''.join(f.inspect_asm().values())"
    )
    settings = {**os.environ, "NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": features}
    done = subprocess.run([sys.executable, "-c", program], env=settings, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
