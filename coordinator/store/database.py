"""The database behind the store: SQLite in a file, or PostgreSQL. A committed transaction is safe on disk.

A database serves one coordinator at a time: a second one would give the same numbers to other jobs. So it is claimed by
a lock that ends with the process, however that ends.
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

_CLAIM = 0x5355_5045_524E_4F44  # the number of PostgreSQL's advisory lock ("SUPERNOD"), unlikely in other programs
_CLAIM_WITHIN = 10.0  # seconds; a database needs a moment to notice that a killed coordinator is gone
_SQLITE = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=10000")


class StoreFailed(ClusterFailed):
    """The database cannot be used; ``passing`` says whether it may work again by itself."""

    def __init__(self, message: str, passing: bool = False) -> None:
        super().__init__(one_line(message))
        self.passing = passing


class Database:
    """A database that this process claims until `close`.

    Args:
        url: such as ``sqlite:////home/ada/jobs.sqlite`` or ``postgresql://ada@db.example/supernode``.

    Attributes:
        name: the URL without its password, for messages.
        engine: SQLAlchemy's engine.

    Raises:
        StoreFailed: if the database cannot be opened, or serves another coordinator.
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
        """Release the claim and all connections. Idempotent."""
        with contextlib.suppress(SQLAlchemyError):
            self._claims.close()
        self.engine.dispose()

    @contextlib.contextmanager
    def failing_clearly(self) -> Iterator[None]:
        """Turn every exception of SQLAlchemy within into a `StoreFailed`."""
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
        os.close(_open_privately(self._path))  # a file that SQLite makes itself is usually readable for others
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
        # The lock belongs to the connection. Detached from the pool, the connection is closed and not used again.
        self._claims.callback(connection.detach)
        return True

    def _claim_file(self, path: Path) -> bool:
        # A file beside the database: SQLite locks the database file itself, and would lose its locks if this process
        # closed another descriptor of it (POSIX).
        descriptor = _open_privately(path.with_name(f"{path.name}.lock"))
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return False
        self._claims.callback(os.close, descriptor)
        return True


def url_in(state: Path) -> str:
    """Return the URL of the database in a state folder."""
    return sqlite_url(state / "jobs.sqlite")


def sqlite_url(path: Path) -> str:
    """Return the URL of a SQLite database in a file."""
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
        raise StoreFailed(f"{expected}, found a database in memory, which would be lost with the process")
    if parsed.get_backend_name() not in ("sqlite", "postgresql"):
        raise StoreFailed(f"{expected}, found {parsed.get_backend_name()}")
    return parsed


def _open_privately(path: Path) -> int:
    """Open a file for reading and writing, and return its descriptor; a new one is made private to its user."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise StoreFailed(f"store {path}: {error.strerror}") from error


def _prepare_sqlite(connection: Any, _: object) -> None:
    """Set up a connection so that commits are on disk when they return, and readers do not wait for the writer."""
    connection.isolation_level = None  # transactions begin where SQLAlchemy begins them
    for pragma in _SQLITE:
        connection.execute(f"PRAGMA {pragma}")


def storable(message: str) -> str:
    """Return ``message`` without characters that a database cannot store: NUL (PostgreSQL) and lone surrogates."""
    return message.replace("\0", "\\0").encode("utf-8", "replace").decode("utf-8")
