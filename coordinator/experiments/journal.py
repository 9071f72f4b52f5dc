"""The folder of an experiment: its description, and a line for each run that has ended.

``experiment.json`` is written once, before the first run. ``runs.jsonl`` gets one line for each event (a run, a launch,
a measurement of memory, a failure) and is forced to disk then. An interrupted experiment continues from this file
alone; all other files are derived from it.
"""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

from coordinator.experiments.experiment import Case
from problems import BadInput

Record = dict[str, Any]

_MUST_AGREE = ("parameters", "problem.sha256", "versions", "machine.cpu", "machine.cores")


class Journal:
    """The open folder of an experiment; a context manager, which holds a lock since only one process may write.

    Attributes:
        folder: the folder.
        experiment: the content of ``experiment.json``.
        records: the records of ``runs.jsonl``, in order.
        runs: the latest record of each run, by its key.

    Raises:
        BadInput: if the folder cannot be used, or holds another experiment.
    """

    def __init__(self, folder: Path, experiment: Record) -> None:
        self.folder = folder
        with _complaints(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self._lines = _locked(folder)
        try:
            with _complaints(folder):
                self.experiment = self._begun(experiment)
                self.records = _read(folder / "runs.jsonl", self._lines)
        except BaseException:
            self.__exit__()
            raise
        self.runs: dict[str, Record] = {record["key"]: record for record in self.of_type("run")}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._lines)

    def append(self, record: Record) -> None:
        """Append a record; it is on disk when this returns."""
        line = json.dumps(record, allow_nan=False) + "\n"
        with _complaints(self.folder):
            _write(self._lines, line.encode())
            os.fsync(self._lines)
        self.records.append(record)
        if record["type"] == "run":
            self.runs[record["key"]] = record

    def of_type(self, kind: str) -> list[Record]:
        """Return the records of one type: "run", "launch", "memory" or "failure"."""
        return [record for record in self.records if record["type"] == kind]

    def lacks(self, case: Case) -> bool:
        """Return whether this run must still be made; a failed run is made again."""
        record = self.runs.get(case.key)
        return record is None or record["status"] == "failed"

    def _begun(self, experiment: Record) -> Record:
        """Return the experiment in the folder; write this one if there is none.

        Raises:
            BadInput: if the folder holds another experiment.
        """
        path = self.folder / "experiment.json"
        if not path.exists():
            if os.fstat(self._lines).st_size:
                raise BadInput(f"{self.folder}: expected an experiment, found runs.jsonl without experiment.json")
            _write_whole(path, json.dumps(experiment, indent=2) + "\n")
            return experiment
        found = _object(path)
        differing = list(_differences(found, experiment))
        if differing:
            raise BadInput(
                f"{self.folder}: expected the experiment that was begun there, found another "
                f"(there / here): {'; '.join(differing)}"
            )
        return found


@contextlib.contextmanager
def _complaints(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BadInput(f"{folder}: expected a folder that can be written, found {error.strerror}") from None


def _locked(folder: Path) -> int:
    """Open and lock ``runs.jsonl``; return its descriptor."""
    descriptor = os.open(folder / "runs.jsonl", os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise BadInput(f"{folder}: expected a folder of one experiment, found one that is still running") from None
    return descriptor


def _write(descriptor: int, data: bytes) -> None:
    while data:  # os.write may write only a part
        data = data[os.write(descriptor, data) :]


def _write_whole(path: Path, text: str) -> None:
    """Write a file so that after a crash it has all of the text or does not exist."""
    beside = path.with_suffix(".new")
    with beside.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def _read(path: Path, descriptor: int) -> list[Record]:
    """Return all records; cut off a last line that a crash left incomplete."""
    data = path.read_bytes()
    records, end = [], 0
    lines = data.splitlines(keepends=True)
    for number, line in enumerate(lines, 1):
        record = _parsed(line)
        if record is None:
            if number < len(lines):
                raise BadInput(f"{path}: expected one JSON object in line {number}, found something else")
            break
        records.append(record)
        end += len(line)
    os.ftruncate(descriptor, end)
    return records


def _parsed(line: bytes) -> Record | None:
    """Return the record in a line; None if the line is incomplete."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        return None
    whole = isinstance(record, dict) and isinstance(record.get("type"), str) and line.endswith(b"\n")
    return record if whole else None


def _object(path: Path) -> Record:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: expected JSON, found {error}") from None
    if not isinstance(value, dict):
        raise BadInput(f"{path}: expected a JSON object, found {type(value).__name__}")
    return value


def _differences(found: Record, wanted: Record) -> Iterator[str]:
    """Yield the names and both values of what must agree and does not."""
    there, here = dict(_flat(found)), dict(_flat(wanted))
    for name in sorted(there.keys() | here.keys()):
        matters = any(name == each or name.startswith(f"{each}.") for each in _MUST_AGREE)
        if matters and there.get(name) != here.get(name):
            yield f"{name.removeprefix('parameters.')} {_shown(there.get(name))} / {_shown(here.get(name))}"


def _flat(value: Record, prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, each in value.items():
        if isinstance(each, dict):
            yield from _flat(each, f"{prefix}{name}.")
        else:
            yield prefix + name, each


def _shown(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, list):
        return ",".join(map(str, value))
    text = str(value)
    return text if len(text) <= 40 else text[:12] + "…"
