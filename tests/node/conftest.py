"""Every cell of these tests is looked at after each of its steps."""

import pytest
from valid_cells import validate

from node.cell import Cell


@pytest.fixture(autouse=True)
def _validated(monkeypatch):
    for name in ("step", "actions_after_breeding", "hear"):
        monkeypatch.setattr(Cell, name, looked_at(getattr(Cell, name)))


def looked_at(method):
    def then_validated(cell, *arguments, **named):
        actions = method(cell, *arguments, **named)
        validate(cell)
        return actions

    return then_validated
