"""The database behind the store: SQLite in a file, or PostgreSQL, so opened that what is written is safe, and alone.

Each store is for one coordinator at a time: a second one would give the same numbers to other jobs. So a store is
claimed by a lock that ends with the process, however that ends.
"""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, InterfaceError, OperationalError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as NoConnection

from coordinator.errors import ClusterFailed
from problems.errors import one_line

_CLAIM = 0x5355_5045_524E_4F44  # PostgreSQL's advisory lock: any number that others will hardly think of
_CLAIM_WITHIN = 10.0  # seconds: a database takes a moment to see that a killed coordinator is gone
_SQLITE = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=10000")


class StoreFailed(ClusterFailed):
    """The database cannot be used; ``passing`` if it may work again by itself."""

    def __init__(self, message: str, passing: bool = False) -> None:
        super().__init__(one_line(message))
        self.passing = passing


class Database:
    """A database that is this process's own until `close`.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Raises:
        StoreFailed: if it cannot be opened, or serves another coordinator.
    """

    def __init__(self, url: str) -> None:
        self._url = _checked(url)
        self.name = self._url.render_as_string(hide_password=True)
        self._claims = contextlib.ExitStack()
        self.engine = self._opened()
        try:
            self._claim()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of it. Idempotent."""
        with contextlib.suppress(SQLAlchemyError):
            self._claims.close()
        self.engine.dispose()

    @contextlib.contextmanager
    def failing_clearly(self) -> Iterator[None]:
        """Whatever goes wrong with the database within becomes a `StoreFailed`."""
        try:
            yield
        except SQLAlchemyError as error:
            said = str(error.orig) if isinstance(error, DBAPIError) else str(error)
            passing = isinstance(error, OperationalError | InterfaceError | NoConnection)
            raise StoreFailed(f"store {self.name}: {said}", passing) from error

    @property
    def _path(self) -> Path | None:
        return Path(str(self._url.database)) if self._url.get_backend_name() == "sqlite" else None

    def _opened(self) -> Engine:
        if self._path is None:
            try:
                return create_engine(self._url, pool_pre_ping=True)
            except ModuleNotFoundError as error:
                raise StoreFailed(f"store: {error.name} is missing (pip install 'supernode[postgres]')") from error
        os.close(_open_privately(self._path))
        engine = create_engine(self._url)
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
        return engine

    def _claim(self) -> None:
        until = time.monotonic() + _CLAIM_WITHIN
        with self.failing_clearly():
            while not (self._claim_database() if self._path is None else self._claim_file(self._path)):
                if time.monotonic() > until:
                    raise StoreFailed(f"store {self.name}: another coordinator uses it")
                time.sleep(0.05)

    def _claim_database(self) -> bool:
        connection: Connection = self.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        if not connection.scalar(text("select pg_try_advisory_lock(:claim)"), {"claim": _CLAIM}):
            connection.close()
            return False
        self._claims.callback(connection.close)
        self._claims.callback(connection.detach)  # so that it is closed, and not kept for whoever asks next
        return True

    def _claim_file(self, path: Path) -> bool:
        descriptor = _open_privately(path.with_name(f"{path.name}.lock"))
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        self._claims.callback(os.close, descriptor)
        return True


def url_in(state: Path) -> str:
    """The URL of the database that a state folder has for its jobs."""
    return sqlite_url(state / "jobs.sqlite")


def sqlite_url(path: Path) -> str:
    """The URL of a SQLite database in that file."""
    return URL.create("sqlite", database=str(path.absolute())).render_as_string()


def _checked(url: str) -> URL:
    expected = "store: expected a URL such as sqlite:////folder/jobs.sqlite or postgresql://host/name"
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise StoreFailed(expected) from error
    if parsed.drivername in ("postgresql", "postgres"):
        return parsed.set(drivername="postgresql+psycopg")
    if parsed.get_backend_name() == "sqlite" and parsed.database in (None, "", ":memory:"):
        raise StoreFailed(f"{expected}, found a database in memory, which outlives nothing")
    if parsed.get_backend_name() not in ("sqlite", "postgresql"):
        raise StoreFailed(f"{expected}, found {parsed.get_backend_name()}")
    return parsed


def _open_privately(path: Path) -> int:
    """A descriptor of that file, which nobody else may read if it is new."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise StoreFailed(f"store {path}: {error.strerror}") from error


def _prepare_sqlite(connection: Any, _: object) -> None:
    """A write is on the disk when it is done, and nobody who reads waits for who writes."""
    connection.isolation_level = None  # transactions begin where SQLAlchemy begins them
    for pragma in _SQLITE:
        connection.execute(f"PRAGMA {pragma}")
