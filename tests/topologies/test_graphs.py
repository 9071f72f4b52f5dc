"""Every kind of topology: what it says of itself is so."""

import sys
from collections import Counter, deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import topologies
from topologies.parse import EXAMPLES

SPECS = [
    *EXAMPLES,
    "moore 2x3",
    "moore 5x4",
    "grid 1x1",
    "grid 3x7",
    "ring 1",
    "ring 2",
    "ring 3",
    "complete 2",
    "hypercube 1",
    "hypercube 7",
    "random-regular 40 3 seed 9",
    "random-regular 4 3",
    "random-regular 64 60",
    "random-regular 16 8",
    "small-world 30 4 1.0 seed 2",
    "small-world 60 6 0.01",
    "small-world 20 4 1e-05",
]


@pytest.fixture(params=SPECS)
def graph(request):
    return topologies.parse(request.param)


def distances(graph, start):
    """Links from ``start`` to each cell, by breadth-first search."""
    found, queue = {start: 0}, deque([start])
    while queue:
        cell = queue.popleft()
        for other in graph.neighbours(cell):
            if other not in found:
                found[other] = found[cell] + 1
                queue.append(other)
    return found


def test_its_diameter_is_the_farthest_that_any_cell_is_from_any(graph):
    farthest = [distances(graph, start) for start in range(graph.cells)]
    assert all(len(found) == graph.cells for found in farthest), "every cell can be reached"
    assert graph.diameter == max(max(found.values()) for found in farthest)


def test_its_table_says_row_by_row_what_the_cells_say(graph):
    table = graph.table()
    assert (table.dtype, table.flags.c_contiguous) == (np.int64, True)
    assert [tuple(row) for row in table.tolist()] == [graph.neighbours(cell) for cell in range(graph.cells)]


def test_links_go_both_ways(graph):
    links = Counter((cell, other) for cell in range(graph.cells) for other in graph.neighbours(cell))
    assert links == Counter((other, cell) for cell, other in links.elements())


def test_its_text_names_it(graph):
    assert topologies.parse(graph.spec) == graph
    assert topologies.parse(f"  {graph.spec} ") == graph


def test_every_cell_has_a_place_of_its_own(graph):
    assert len({graph.place(cell) for cell in range(graph.cells)}) == graph.cells
    for beyond in (-1, graph.cells):
        with pytest.raises(ValueError, match="expected a cell of"):
            graph.place(beyond)


def test_an_edge_names_the_cell_itself():
    assert topologies.parse("grid 2x3").neighbours(0) == (0, 1, 3, 0)
    assert topologies.parse("grid 2x3").neighbours(4) == (1, 5, 4, 3)


def test_diagonal_neighbours_come_after_the_four():
    assert topologies.parse("moore 3x3").neighbours(4) == (1, 5, 7, 3, 2, 8, 6, 0)


@given(st.integers(0, 2**32 - 1))
def test_the_same_seed_gives_the_same_graph(seed):
    spec = f"random-regular 12 3 seed {seed}"
    topologies.parse.cache_clear()
    first = topologies.parse(spec).table()
    topologies.parse.cache_clear()
    np.testing.assert_array_equal(topologies.parse(spec).table(), first)
    assert (np.sort(first, axis=1) == first).all()


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("ring 0", "at least 1 cell"),
        ("complete 1", "2 to 256 cells, found 1"),
        ("complete 300", "2 to 256 cells, found 300"),
        ("hypercube 0", "1 to 20 dimensions"),
        ("hypercube 21", "1 to 20 dimensions"),
        ("grid 0x4", "at least 1 row"),
        ("random-regular 5 3", "even product"),
        ("random-regular 16 2", "3 or more, found 2"),
        ("random-regular 16 16", "less than the number of cells"),
        ("random-regular 20000 4", "4 to 16384 cells"),
        ("random-regular 16 4 seed 99999999999", "a seed of at most"),
        ("small-world 16 3 0.1", "an even degree of 4 or more"),
        ("small-world 16 4 1.5", "a probability"),
        ("small-world 16 2 0.1", "4 or more"),
        ("small-world 16 4", "a topology such as"),
        ("ring", "a topology such as"),
        ("ring 2000000", "at most 1048576 cells"),
        ("Torus 4x4", "a topology such as"),
    ],
)
def test_what_is_no_topology_is_refused(spec, said):
    with pytest.raises(ValueError, match=said) as error:
        topologies.parse(spec)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("spec", ["random-regular 16000 254 seed 3", "small-world 16000 254 0.1 seed 3"])
def test_a_graph_is_named_and_counted_without_being_built(spec, monkeypatch):
    monkeypatch.setitem(sys.modules, "networkx", None)  # whoever imports it fails
    topologies.parse.cache_clear()
    graph = topologies.parse(spec)
    assert (graph.spec, graph.cells) == (spec, 16000)
    with pytest.raises(ImportError):
        graph.neighbours(0)


def test_no_more_than_a_few_graphs_are_kept():
    for seed in range(1000):
        topologies.parse(f"random-regular 12 3 seed {seed}")
    assert topologies.parse.cache_info().currsize < 20
