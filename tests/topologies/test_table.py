"""The neighbours of all cells at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from topologies import Torus


@given(st.builds(Torus, st.integers(1, 12), st.integers(1, 12)))
def test_the_table_says_row_by_row_what_the_cells_say(torus):
    table = torus.table()
    assert table.dtype == np.int64
    assert table.flags.c_contiguous
    assert [tuple(row) for row in table.tolist()] == [torus.neighbours(cell) for cell in range(torus.cells)]


@pytest.mark.parametrize("shape", [(1024, 1024), (1, 1 << 20)])
def test_the_largest_tori_have_a_table_of_the_same(shape):
    torus = Torus(*shape)
    table = torus.table()
    assert table.shape == (1 << 20, 4)
    for cell in (0, 1, 1023, 1024, 524_289, (1 << 20) - 1):
        assert tuple(table[cell].tolist()) == torus.neighbours(cell)
