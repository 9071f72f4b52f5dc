"""The run log: a file with one JSON object in each line, for plotting a run afterwards.

Lines of the event `improvement` are a function of the run: they have no time, and are the same byte for byte in the
logs of equal lockstep runs. All other lines say when something was received, and differ from run to run.
"""

import contextlib
import json
import sys
import threading
import time
from collections.abc import Iterable
from io import FileIO
from pathlib import Path
from typing import Any

from problems import BadInput, Run
from spy.improvement_records import ImprovementRecord, worth_telling
from spy.judgement import Judgement
from spy.least_improvement import LEAST
from topologies import Topology
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain

IMPROVEMENT = "improvement"
"""The event of those lines that are a function of the run."""


class RunLog:
    """Appends events to a file, or discards them if there is no path. Thread-safe.

    Args:
        path: the file, which is overwritten; None to discard all events.
        least: the least improvement that is worth a line, as a share of the fitness before.

    Raises:
        BadInput: if the file cannot be written.
    """

    def __init__(self, path: str | Path | None, least: float = LEAST) -> None:
        self._least = least
        self._file: FileIO | None = None
        self._size = 0  # bytes of whole lines
        self._turn = threading.RLock()
        if path is not None:
            try:
                self._file = Path(path).open("wb", buffering=0)  # noqa: SIM115
            except OSError as error:
                raise BadInput(f"--log: expected a file that can be written, found {path}: {error.strerror}") from None

    def write(self, event: str, **values: Any) -> None:
        """Append a line with an event, its values, and the wall-clock time."""
        self._write({"time": round(time.time(), 6), "event": event, **plain(values)})

    def _write(self, line: dict[str, Any]) -> None:
        with self._turn:
            if self._file is None:
                return
            text = f"{json.dumps(line)}\n".encode()
            rest = memoryview(text)
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
                self._size += len(text)
            except OSError as error:  # such as a full disk: the run goes on, since its answer matters more than its log
                sys.stderr.write(f"warning: {self._file.name}: the run log ends here: {error.strerror}\n")
                with contextlib.suppress(OSError):  # it may be a device
                    self._file.truncate(self._size)  # no half line
                self.close()

    def start(self, job: int | str, epoch: int, run: Run) -> None:
        """Log that an epoch of the job begins, with its settings."""
        self.write("start", job=job, epoch=epoch, run=run.model_dump())

    def news(self, topology: Topology, better: Improvement) -> None:
        """Log an improvement that the spy has verified; of several that come at once the spy takes only the last."""
        self.write(
            "news",
            epoch=better.epoch,
            seconds=round(better.seconds, 6),
            generation=better.generation,
            cell=list(topology.place(better.cell)),
            fitness=better.fitness,
            feasible=better.feasible,
        )

    def improvements(self, topology: Topology, records: Iterable[ImprovementRecord]) -> None:
        """Log the improvements that cells noted in an epoch that has ended, as far as they are worth a line."""
        for record in worth_telling(records, self._least):
            self._write({"event": IMPROVEMENT, **record._asdict(), "cell": list(topology.place(record.cell))})

    def statistics(self, statistics: Statistics) -> None:
        """Log the statistics of a running job."""
        values = statistics._asdict()
        self.write("statistics", epoch=values.pop("epoch"), **values)

    def record(self, record: LogRecord) -> None:
        """Log a record that a process has published."""
        self.write("log", **(record._asdict() | {"at": round(record.at, 6)}))

    def end(self, judgement: Judgement, generations: int) -> None:
        """Log the judgement of an epoch, which ended after so many generations."""
        best = judgement.best
        self.write(
            "end",
            status=judgement.status,
            feasible=judgement.feasible,
            message=judgement.message,
            generations=generations,
            fitness=None if best is None else best.fitness,
        )

    def close(self) -> None:
        """Close the file; later events are discarded. Idempotent."""
        with self._turn:
            if self._file is not None:
                with contextlib.suppress(OSError):
                    self._file.close()
                self._file = None
