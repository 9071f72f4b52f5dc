"""The memory that Python and compiled code share: declared once, filled by name, and read as what it is."""

import ast
from pathlib import Path

import numpy as np
import pytest

from lowlevel import capabilities
from node.engine import cell_table, inbox
from node.engine.layout import RowLayout, TableLayout

ROOT = Path(__file__).resolve().parents[3]
READ_BY = {"integers": np.int64, "reals": np.float64, "octets": np.uint8, "blocks": np.uint8}
DECLARE = {"integers", "reals", "octets", "column"}
MODULES = {"node/engine/cell_table.py": cell_table, "node/engine/inbox.py": inbox}
if capabilities().c_api:
    from node import fast_path

    MODULES["node/fast_path.py"] = fast_path


@pytest.fixture
def layout():
    layout = TableLayout()
    assert [layout.integers("counts"), layout.reals("fitness"), layout.octets("genomes")] == [0, 1, 2]
    return layout


COUNTS, FITNESS, GENOMES = np.zeros((2, 3), np.int64), np.zeros(4), np.zeros((2, 3, 5), np.uint8)


def test_a_table_points_to_each_array_at_its_place_whatever_their_order(layout):
    table = layout.build(genomes=GENOMES, counts=COUNTS, fitness=FITNESS)
    assert table.tolist() == [[COUNTS.ctypes.data, 2, 3], [FITNESS.ctypes.data, 1, 4], [GENOMES.ctypes.data, 6, 5]]


def test_a_table_takes_exactly_the_arrays_that_are_declared(layout):
    with pytest.raises(AssertionError, match="not as declared: fitness"):
        layout.build(genomes=GENOMES, counts=COUNTS)
    with pytest.raises(AssertionError, match="not as declared: more"):
        layout.build(genomes=GENOMES, counts=COUNTS, fitness=FITNESS, more=COUNTS)
    with pytest.raises(AssertionError, match="declared twice"):
        layout.reals("counts")


def test_arrays_that_are_exchanged_are_noticed_by_their_types(layout):
    with pytest.raises(AssertionError, match="counts is of float64, not int64"):
        layout.build(genomes=GENOMES, counts=FITNESS, fitness=COUNTS)


def test_a_row_has_each_value_in_its_column():
    row = RowLayout()
    assert [row.column("one"), row.column("other")] == [0, 1]
    assert row.build(other=True, one=np.int64(7)).tolist() == [7, 1]
    assert row.zeros().tolist() == [0, 0]
    with pytest.raises(AssertionError, match="not as declared: one"):
        row.build(other=1)
    with pytest.raises(AssertionError, match="declared twice"):
        row.column("one")


def declarations(name):
    """The constants of a module that name a place or a column: the layout's name, the method, and the string."""
    for node in ast.parse((ROOT / name).read_text()).body:
        match node:
            case ast.Assign(
                targets=[ast.Name(id=constant)],
                value=ast.Call(
                    func=ast.Attribute(value=ast.Name(id=layout), attr=method), args=[ast.Constant(value=str(field))]
                ),
            ) if method in DECLARE:
                yield constant, layout, method, field


@pytest.mark.parametrize("name", MODULES)
def test_every_constant_has_the_name_of_its_place_and_its_number(name):
    module, found = MODULES[name], {}
    for constant, layout, _, field in declarations(name):
        assert constant.lstrip("_") == field.upper()
        declared = getattr(module, layout)
        names = list(declared.kinds if isinstance(declared, TableLayout) else declared.names)
        assert names.index(field) == getattr(module, constant)
        assert type(getattr(module, constant)) is int
        found.setdefault(layout, []).append(field)
    layouts = {key for key, value in vars(module).items() if isinstance(value, TableLayout | RowLayout)}
    assert found.keys() == layouts
    assert all(len(fields) == len(getattr(module, layout)) for layout, fields in found.items())


def reads(tree):
    """Each use of a place in compiled code: the function that reads it, and the constant."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=reader), args=[_, place, *_]) if reader in READ_BY:
                match place:
                    case ast.Name(id=constant):
                        yield reader, constant
                    case ast.Attribute(value=ast.Name(id="at"), attr=constant):
                        yield reader, constant


@pytest.mark.parametrize(
    ("user", "declared_in"),
    [
        ("node/engine/inbox.py", "node/engine/inbox.py"),
        ("node/engine/rule.py", "node/engine/cell_table.py"),
        ("node/engine/generation.py", "node/engine/cell_table.py"),
        ("node/engine/compiled_generation.py", "node/engine/cell_table.py"),
    ],
)
def test_compiled_code_reads_every_place_as_the_type_that_it_has(user, declared_in):
    kinds = {
        constant: getattr(MODULES[declared_in], layout).kinds[field]
        for constant, layout, _, field in declarations(declared_in)
        if isinstance(getattr(MODULES[declared_in], layout), TableLayout)
    }
    used = list(reads(ast.parse((ROOT / user).read_text())))
    assert used
    assert [(reader, constant) for reader, constant in used if READ_BY[reader] != kinds[constant]] == []


def test_no_place_is_declared_in_vain():
    text = "".join(path.read_text() for path in (ROOT / "node" / "engine").glob("*.py"))
    assert [name for name, *_ in declarations("node/engine/cell_table.py") if f"at.{name}" not in text] == []
