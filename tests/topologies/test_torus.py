"""The torus, and the text that names one."""

from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

import topologies
from topologies import Torus
from topologies.parse import MOST_CELLS

NORTH, EAST, SOUTH, WEST = range(4)

shapes = st.builds(Torus, st.integers(1, 12), st.integers(1, 12))


def farthest(torus, start):
    """The greatest distance from ``start``, by breadth-first search."""
    distance = {start: 0}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        for other in torus.neighbours(cell):
            if other not in distance:
                distance[other] = distance[cell] + 1
                queue.append(other)
    assert len(distance) == torus.cells, "every cell can be reached"
    return max(distance.values())


def test_neighbours_are_north_east_south_west():
    torus = Torus(3, 4)
    #  0  1  2  3
    #  4  5  6  7
    #  8  9 10 11
    assert torus.neighbours(5) == (1, 6, 9, 4)
    assert torus.neighbours(0) == (8, 1, 4, 3)
    assert torus.neighbours(11) == (7, 8, 3, 10)


@given(shapes)
def test_every_link_goes_both_ways_by_opposite_slots(torus):
    for cell in range(torus.cells):
        north, east, south, west = torus.neighbours(cell)
        assert torus.neighbours(north)[SOUTH] == cell
        assert torus.neighbours(east)[WEST] == cell
        assert torus.neighbours(south)[NORTH] == cell
        assert torus.neighbours(west)[EAST] == cell


@given(shapes)
def test_every_cell_is_named_as_often_as_it_has_slots(torus):
    named = sorted(other for cell in range(torus.cells) for other in torus.neighbours(cell))
    assert named == sorted(list(range(torus.cells)) * 4)


def test_on_one_by_one_all_slots_are_the_cell_itself():
    assert Torus(1, 1).neighbours(0) == (0, 0, 0, 0)
    assert Torus(1, 1).diameter == 0


@pytest.mark.parametrize("columns", [2, 3, 5])
def test_on_a_single_row_north_and_south_are_the_cell_itself(columns):
    torus = Torus(1, columns)
    for cell in range(columns):
        assert torus.neighbours(cell) == (cell, (cell + 1) % columns, cell, (cell - 1) % columns)


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_on_a_single_column_east_and_west_are_the_cell_itself(rows):
    torus = Torus(rows, 1)
    for cell in range(rows):
        assert torus.neighbours(cell) == ((cell - 1) % rows, cell, (cell + 1) % rows, cell)


def test_on_two_by_two_opposite_slots_name_the_same_cell():
    torus = Torus(2, 2)
    assert [torus.neighbours(cell) for cell in range(4)] == [(2, 1, 2, 1), (3, 0, 3, 0), (0, 3, 0, 3), (1, 2, 1, 2)]


@given(shapes)
def test_the_diameter_is_that_of_a_breadth_first_search(torus):
    assert torus.diameter == farthest(torus, 0)


def test_the_diameter_is_the_same_from_every_cell():
    torus = Torus(4, 7)
    assert {farthest(torus, cell) for cell in range(torus.cells)} == {torus.diameter} == {5}


@given(shapes)
def test_place_numbers_cells_row_by_row(torus):
    places = [torus.place(cell) for cell in range(torus.cells)]
    assert places == [(row, column) for row in range(torus.rows) for column in range(torus.columns)]


@pytest.mark.parametrize("cell", [-1, 6, 1 << 40])
def test_there_is_no_place_and_there_are_no_neighbours_beyond_the_cells(cell):
    expected = rf"expected a cell of torus 2x3, 0 to 5, found {cell}"
    with pytest.raises(ValueError, match=expected):
        Torus(2, 3).place(cell)
    with pytest.raises(ValueError, match=expected):
        Torus(2, 3).neighbours(cell)


@given(st.integers(1, 1024), st.integers(1, 1024))
def test_the_spec_of_a_torus_names_it(rows, columns):
    torus = Torus(rows, columns)
    assert torus.spec == f"torus {rows}x{columns}"
    assert topologies.parse(torus.spec) == torus
    assert torus.cells == rows * columns


@pytest.mark.parametrize("spec", ["torus 4x8", "  torus   4 x 8 ", "torus 4×8", "torus 04x08"])
def test_a_spec_may_be_written_in_several_ways(spec):
    assert topologies.parse(spec) == Torus(4, 8)


@pytest.mark.parametrize("spec", ["torus 1024x1024", "torus 1x1048576"])
def test_the_largest_torus_may_be_asked_for(spec):
    assert topologies.parse(spec).cells == MOST_CELLS


@pytest.mark.parametrize(
    ("spec", "found"),
    [
        ("torus 0x4", "0 x 4"),
        ("torus 4x0", "4 x 0"),
        ("torus -1x4", "'torus -1x4'"),
        ("torus 4x-1", "'torus 4x-1'"),
        ("torus 1024x1025", "1049600"),
        ("torus 9999999x9999999", "99999980000001"),
        ("torus 10000000x1", "'torus 10000000x1'"),
        ("torus 4", "'torus 4'"),
        ("torus 4x4x4", "'torus 4x4x4'"),
        ("torus 4.0x4", "'torus 4.0x4'"),
        ("torus axb", "'torus axb'"),
        ("torus4x4", "'torus4x4'"),
        ("TORUS 4x4", "'TORUS 4x4'"),
        ("4x4", "'4x4'"),
        ("torus 4x4; rm", "'torus 4x4; rm'"),
        ("", "''"),
        ("\x00", r"'\x00'"),
    ],
)
def test_a_wrong_spec_says_what_was_expected_and_what_was_found(spec, found):
    with pytest.raises(ValueError, match=r"expected .*, found ") as caught:
        topologies.parse(spec)
    message = str(caught.value)
    assert message.endswith(f", found {found}")
    assert "\n" not in message


@given(st.text(max_size=30))
def test_no_text_raises_anything_but_a_value_error(text):
    try:
        torus = topologies.parse(text)
    except ValueError as error:
        assert "expected" in str(error)  # noqa: PT017 - most texts are wrong, a few may be right
    else:
        assert topologies.parse(torus.spec) == torus


@pytest.mark.parametrize(("rows", "columns"), [(0, 1), (1, 0), (-3, 3)])
def test_a_torus_has_a_row_and_a_column(rows, columns):
    with pytest.raises(ValueError, match=rf"expected .*, found {rows} x {columns}"):
        Torus(rows, columns)
