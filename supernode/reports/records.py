"""Fetch the records of a job from a cluster page by page, and write them as a table in a file."""

import csv
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from problems import BadInput
from supernode.files.outputs import unwritable
from wire.printable import printable

if TYPE_CHECKING:
    import pyarrow

    from supernode.client.client import Client

_UNITS = {"at": "Unix s", "seconds": "s", "messages_per_second": "1/s", "age": "generations", "exchange_seconds": "s"}
_FLOATS = (
    "at",
    "seconds",
    "exchange_seconds",
    "messages_per_second",
    "diversity",
    "fitness",
    "best",
    "median",
    "worst",
)
_TEXTS = ("level", "process", "text", "job", "event", "about")
_EVENTS = ["at", "event", "epoch", "generation", "about"]


@dataclass(frozen=True)
class Page:
    """Some of the records of a job; a row for each record."""

    columns: list[str]
    rows: list[list[Any]]


def pages(client: "Client", kind: str, job: str) -> Iterator[Page]:
    """Yield all records of a job, oldest first, a page at a time; the first page may be empty.

    Args:
        client: a client of the job's cluster.
        kind: "log"; "events" (the job's states and epochs); or a kind that `AsyncClient.records` knows. Records of
            "history" come without their ids: the ids differ between equal runs.
        job: the job's id.

    Raises:
        BadInput: if there is no such job or kind.
    """
    if kind == "events":
        yield Page(_EVENTS, _events(client.job(job).show()))
        return
    after, more = 0, True
    while more:
        told = client.logs(job, after=after) if kind == "log" else client.records(kind, job, after)
        # The first column of a page is the record's id.
        unnamed = 1 if kind == "history" else 0
        yield Page(told["columns"][unnamed:], [row[unnamed:] for row in told["rows"]])
        more = told["more"]
        if more:
            after = told["rows"][-1][0]


def _events(view: dict[str, Any]) -> list[list[Any]]:
    """Return a row for each state of the job and for each epoch after its first, in the order of time.

    Whatever else is known of an epoch, such as the fields that an update changed, is JSON in the column "about".
    """
    rows: list[list[Any]] = [[at, state, None, None, None] for state, at in view["states"]]
    for epoch in view["epochs"]:
        about = {name: value for name, value in epoch.items() if name not in ("at", "do", "epoch", "generation")}
        rows.append([epoch["at"], epoch["do"], epoch["epoch"], epoch["generation"], json.dumps(about)])
    return sorted(rows, key=lambda row: float(row[0]))


def write_csv(found: Iterator[Page], name: str | None) -> None:
    """Write a line for each record, under column names with units; to stdout if ``name`` is None.

    A terminal gets printable text; a file or a pipe gets the text as it is.

    Raises:
        BadInput: if the file cannot be written.
    """
    first = next(found)  # fetched before the file is opened: an unknown job leaves no empty file behind
    if name is None:
        shown = _printable if sys.stdout.isatty() else _as_it_is
        _write_lines(first, found, sys.stdout, shown)
        return
    try:
        with Path(name).open("w", encoding="utf-8", newline="") as file:
            _write_lines(first, found, file, _as_it_is)
    except OSError as error:
        raise unwritable(name, error) from None


def write_parquet(found: Iterator[Page], name: str) -> None:
    """Write the same table as Parquet.

    Raises:
        BadInput: if the file cannot be written, or pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise BadInput("--format: parquet needs pyarrow: pip install 'supernode[scale]'") from error
    first = next(found)
    schema = pyarrow.schema([(_titled(column), _type_of(column)) for column in first.columns])
    try:
        with parquet.ParquetWriter(name, schema) as file:
            for page in chain((first,), found):
                rows = [dict(zip(schema.names, row, strict=True)) for row in page.rows]
                file.write_table(pyarrow.Table.from_pylist(rows, schema))
    except OSError as error:
        raise unwritable(name, error) from None


def _as_it_is(value: Any) -> Any:
    return value


def _printable(value: Any) -> Any:
    return printable(value) if isinstance(value, str) else value


def _write_lines(first: Page, others: Iterator[Page], file: TextIO, shown: Callable[[Any], Any]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([shown(_titled(column)) for column in first.columns])
    for page in chain((first,), others):
        writer.writerows([[shown(value) for value in row] for row in page.rows])


def _titled(column: str) -> str:
    return f"{column} [{_UNITS[column]}]" if column in _UNITS else column


def _type_of(column: str) -> "pyarrow.DataType":
    import pyarrow

    if column in _FLOATS:
        return pyarrow.float64()
    if column in _TEXTS:
        return pyarrow.string()
    return pyarrow.bool_() if column == "feasible" else pyarrow.int64()
