"""Tables of pointers, by which compiled code finds what an operator needs."""

import gc

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import operators
from genetics.calls_by_address import call_fitness
from genetics.operators import FITNESS, Operator, pointers
from lowlevel import capabilities
from lowlevel.pointers import integers, octets, reals

# These are not kept on disk, as kernels are.


@numba.njit(FITNESS)
def weighted(genomes, fitness, table):
    """Weighted sum of the bytes over a divisor, plus an offset; the table: divisor and offset, then the weights."""
    numbers, weights = integers(table, 0)[0], reals(table, 1)
    for row in range(fitness.size):
        total = 0.0
        for byte in range(genomes.shape[1]):
            total += genomes[row, byte] * weights[byte % weights.shape[0], 0]
        fitness[row] = total / numbers[0] + numbers[1]


@numba.njit("void(int64, uint8[:,::1], float64[::1], int64[:,::1])")
def by_address(address, genomes, fitness, table):
    """Call whatever is there."""
    call_fitness(address, genomes, fitness, table)


@numba.njit("int64(int64[:,::1])")
def sums(table):
    """What is in an array of each type."""
    return int(integers(table, 0).sum() + reals(table, 1).sum() + octets(table, 2).sum())


def operator():
    return Operator.of(weighted, [4, 3], np.array([[0.5], [2.0], [1.0]]))


@pytest.mark.skipif(not capabilities().numba_calls, reason="no kernel is called by its address here")
@given(st.binary(min_size=6, max_size=60))
def test_an_operator_is_the_same_called_by_python_and_by_address(octets_of):
    genomes = np.frombuffer(octets_of[: len(octets_of) // 6 * 6], np.uint8).reshape(-1, 6)
    its = operator()
    expected = (genomes * [0.5, 2.0, 1.0, 0.5, 2.0, 1.0]).sum(axis=1) / 4 + 3
    np.testing.assert_allclose(its.fitness(genomes), expected)
    values = np.full(len(genomes), np.nan)
    by_address(its.address, genomes.copy(), values, its.table)
    np.testing.assert_array_equal(values, its.fitness(genomes))


def test_what_a_table_points_to_is_kept():
    several = [operator() for _ in range(100)]
    gc.collect()
    genomes = np.arange(48, dtype=np.uint8).reshape(8, 6)
    assert {each.fitness(genomes).tobytes() for each in several} == {operator().fitness(genomes).tobytes()}


def test_genomes_may_be_read_only_or_in_pieces():
    genomes = np.arange(48, dtype=np.uint8).reshape(8, 6)
    expected = operator().fitness(genomes)
    read_only = np.frombuffer(genomes.tobytes(), np.uint8).reshape(8, 6)
    np.testing.assert_array_equal(operator().fitness(read_only), expected)
    np.testing.assert_array_equal(operator().fitness(genomes[::2]), expected[::2])
    assert operator().fitness(genomes[:0]).shape == (0,)


@pytest.mark.parametrize(
    ("own", "shape", "kind"),
    [
        (3, (1, 1), np.int64),
        (True, (1, 1), np.int64),
        (0.5, (1, 1), np.float64),
        ([1, 2, 3], (1, 3), np.int64),
        ([True, 2, False], (1, 3), np.int64),
        ([1, 0.5], (1, 2), np.float64),
        (np.zeros((4, 2), np.float32), (4, 2), np.float64),
        (np.ones((2, 3), np.uint8)[:, ::2], (2, 2), np.int64),
        (np.zeros((0, 2), np.int64), (0, 2), np.int64),
    ],
)
def test_what_an_operator_needs_is_kept_as_plain_arrays(own, shape, kind):
    its = Operator.of(weighted, own)
    (kept,) = its.kept
    assert (kept.shape, kept.dtype) == (shape, kind)
    np.testing.assert_array_equal(kept, np.atleast_2d(own))
    assert its.table.tolist() == [[kept.ctypes.data, *shape]]


def test_a_table_remembers_all_but_the_last_dimension_as_rows():
    arrays = np.arange(24).reshape(2, 3, 4), np.full((1, 5), 0.5), np.full((3, 2), 255, np.uint8), np.arange(7)
    table = pointers(*arrays)
    assert table[:, 1:].tolist() == [[6, 4], [1, 5], [3, 2], [1, 7]]
    assert sums(table) == int(276 + 2.5 + 1530)


def test_a_pointer_knows_no_strides():
    with pytest.raises(AssertionError, match="strides"):
        pointers(np.zeros((4, 4))[:, ::2])


def test_all_signatures_end_with_a_table():
    for signature in (operators.FITNESS, operators.VARIATION, operators.MUTATE_ONE_BIT):
        assert signature.args[-1] == operators.types.int64[:, ::1]
