"""The sessions of the store's database: one open transaction for all writers, and sessions of their own for readers."""

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from coordinator.store.database import Database, StoreFailed
from coordinator.store.tables import Base, MetaRow

_SCHEMA = 6


class StoreSessions:
    """The sessions of one database. Any thread may use them.

    Writers take turns by a lock, since they share the open transaction; readers have sessions of their own and see only
    what is committed.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Raises:
        StoreFailed: if the database cannot be opened, is of another version, or serves another coordinator.
    """

    def __init__(self, url: str) -> None:
        self._lock = threading.RLock()  # re-entrant: methods write within `transaction`
        self._session: Session | None = None  # the open transaction; only the thread that holds the lock touches it
        self._database = Database(url)
        try:
            with self._database.failing_clearly():
                Base.metadata.create_all(self._database.engine)
            self._check_schema()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the database, so that another coordinator may open it. Idempotent."""
        self._database.close()

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit everything that is written within together, or nothing of it; it is on disk when this ends.

        Raises:
            StoreFailed: if the database fails.
        """
        with self.writing():
            yield

    @contextlib.contextmanager
    def writing(self) -> Iterator[Session]:
        """Return the open transaction, or one of its own that is committed at the end.

        Raises:
            StoreFailed: if the database fails.
        """
        with self._lock:
            if self._session is not None:  # within `transaction`, which commits
                yield self._session
                return
            fresh = self._new_session(expire_on_commit=False)
            with self._database.failing_clearly(), fresh as session, session.begin():
                self._session = session
                try:
                    yield session
                finally:
                    self._session = None

    @contextlib.contextmanager
    def reading(self) -> Iterator[Session]:
        """Return a session that reads what is committed.

        Raises:
            StoreFailed: if the database fails.
        """
        with self._database.failing_clearly(), self._new_session() as session:
            yield session

    def _new_session(self, **options: Any) -> Session:
        return Session(self._database.engine, **options)

    def _check_schema(self) -> None:
        with self.writing() as session:
            found = session.scalar(select(func.max(MetaRow.schema)))
            if found is None:
                session.add(MetaRow(schema=_SCHEMA))
            elif found != _SCHEMA:
                raise StoreFailed(f"store {self._database.name}: expected a store of version {_SCHEMA}, found {found}")
