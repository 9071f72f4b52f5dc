"""A disk whose writes fail for a while, as the database sees it."""

import contextlib
import sqlite3
from collections.abc import Callable, Iterator
from typing import Any

from sqlalchemy import Engine, event
from sqlalchemy.exc import OperationalError

_WRITES = ("INSERT", "UPDATE", "DELETE", "CREATE")


class Disk:
    """Lets statements that write, and commits, fail while ``fails`` returns True; each commit calls ``spend``."""

    def __init__(self) -> None:
        self.fails: Callable[[], bool] = lambda: False
        self.spend: Callable[[], None] = lambda: None

    @contextlib.contextmanager
    def in_place(self) -> Iterator[None]:
        """Do so in all databases of this process, until the context ends."""
        event.listen(Engine, "before_cursor_execute", self._before_a_statement)
        event.listen(Engine, "commit", self._before_a_commit)
        try:
            yield
        finally:
            event.remove(Engine, "before_cursor_execute", self._before_a_statement)
            event.remove(Engine, "commit", self._before_a_commit)

    def _before_a_statement(self, _: Any, __: Any, statement: str, *___: Any) -> None:
        if statement.lstrip().upper().startswith(_WRITES) and self.fails():
            raise _error(statement)

    def _before_a_commit(self, _: Any) -> None:
        self.spend()
        if self.fails():
            raise _error("COMMIT")


def _error(statement: str) -> OperationalError:
    return OperationalError(statement, None, sqlite3.OperationalError("disk I/O error"))
