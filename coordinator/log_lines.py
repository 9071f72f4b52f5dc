"""The log as lines on stderr: for people on a terminal, as JSON for all other readers.

The coordinator writes what all processes have to say, the zygote what they can say to nobody any more.
"""

import contextlib
import sys
from datetime import UTC, datetime
from typing import Any, TextIO

import structlog

from wire.news import LogRecord


class LogLines:
    """Writes a line for each record.

    Args:
        cluster: its name, which each line tells.
        as_json: whether lines are JSON objects; if None, they are where ``file`` is no terminal.
        file: where they go; stderr if not given.
    """

    def __init__(self, cluster: str, as_json: bool | None = None, file: TextIO | None = None) -> None:
        file = sys.stderr if file is None else file
        people = file.isatty() if as_json is None else not as_json
        renderer: Any = structlog.dev.ConsoleRenderer(colors=file.isatty()) if people else _json()
        self._logger = structlog.wrap_logger(
            structlog.PrintLogger(file), processors=[structlog.processors.add_log_level, renderer], cluster=cluster
        )

    def write(self, record: LogRecord, job: str | None = None) -> None:
        """One line; what the record is not about is left out. ``job`` is the id of the one that it is about."""
        about = {name: getattr(record, name) for name in ("node", "cell", "generation")} | {"job": job}
        told = {name: value for name, value in about.items() if value is not None}
        at = datetime.fromtimestamp(record.at, UTC).isoformat(timespec="milliseconds")
        with contextlib.suppress(OSError, ValueError):  # nobody reads them any more, or the disk is full: life goes on
            getattr(self._logger, record.level)(record.text, timestamp=at, process=record.process, **told)


def _json() -> Any:
    return structlog.processors.JSONRenderer(sort_keys=True)
