"""The log as lines on stderr: readable on a terminal, JSON otherwise.

The coordinator writes the messages of all processes; the zygote writes what these cannot publish, such as deaths.
"""

import contextlib
import sys
from collections.abc import MutableMapping
from datetime import UTC, datetime
from typing import Any, TextIO

import structlog

from wire.news import LogRecord
from wire.printable import printable


class LogLines:
    """Writes a line for each log record.

    Args:
        cluster: the name of the cluster, part of each line.
        as_json: whether lines are JSON objects; if None, they are if ``file`` is not a terminal.
        file: where the lines go; stderr if None.
    """

    def __init__(self, cluster: str, as_json: bool | None = None, file: TextIO | None = None) -> None:
        file = sys.stderr if file is None else file
        people = file.isatty() if as_json is None else not as_json
        renderers = _for_people(file.isatty()) if people else [structlog.processors.JSONRenderer(sort_keys=True)]
        # Not `PrintLogger`, which writes the end of a line by itself: another process's line may come between.
        self._logger = structlog.wrap_logger(
            structlog.WriteLogger(file), processors=[structlog.processors.add_log_level, *renderers], cluster=cluster
        )

    def write(self, record: LogRecord, job: str | None = None) -> None:
        """Write one line, without the fields that the record leaves open; ``job`` is the id of the job concerned."""
        about = {name: getattr(record, name) for name in ("node", "cell", "generation")} | {"job": job}
        told = {name: value for name, value in about.items() if value is not None}
        at = datetime.fromtimestamp(record.at, UTC).isoformat(timespec="milliseconds")
        with contextlib.suppress(OSError, ValueError):  # the reader is gone or the disk is full: jobs matter more
            getattr(self._logger, record.level)(record.text, timestamp=at, process=record.process, **told)


def _for_people(colours: bool) -> list[Any]:
    """Return what makes a line for people; JSON escapes by itself what is not printable."""
    return [_made_printable, structlog.dev.ConsoleRenderer(colors=colours)]


def _made_printable(_: Any, __: str, told: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    return {name: printable(value) if isinstance(value, str) else value for name, value in told.items()}
