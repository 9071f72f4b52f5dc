"""The run log: one JSON object a line, for people who plot runs afterwards."""

import contextlib
import json
import sys
import threading
import time
from pathlib import Path
from typing import Any, TextIO

from problems import BadInput
from spy.judge import Judgement
from topologies import Topology
from wire.news import Improvement, LogRecord, Statistics
from wire.plain import plain


class RunLog:
    """Appends events to a file, or nowhere if there is no path; any thread may.

    Raises:
        BadInput: if the file cannot be written.
    """

    def __init__(self, path: str | Path | None) -> None:
        self._file: TextIO | None = None
        self._turn = threading.RLock()
        if path is not None:
            try:
                self._file = Path(path).open("w", encoding="utf-8", buffering=1)  # noqa: SIM115
            except OSError as error:
                raise BadInput(f"--log: expected a file that can be written, found {path}: {error.strerror}") from error

    def write(self, event: str, **values: Any) -> None:
        """One line, with the wall-clock time."""
        with self._turn:
            if self._file is None:
                return
            line = {"time": round(time.time(), 6), "event": event, **plain(values)}
            try:
                self._file.write(json.dumps(line) + "\n")
            except OSError as error:  # an answer matters more than its log
                sys.stderr.write(f"warning: the run log ends here: {error.strerror}\n")
                self.close()

    def improvement(self, topology: Topology, better: Improvement) -> None:
        """A verified champion."""
        self.write(
            "improvement",
            seconds=round(better.seconds, 6),
            generation=better.generation,
            cell=list(topology.place(better.cell)),
            fitness=better.fitness,
            feasible=better.feasible,
        )

    def statistics(self, statistics: Statistics) -> None:
        """How the job is."""
        self.write("statistics", **statistics._asdict())

    def record(self, record: LogRecord) -> None:
        """What a process has to say."""
        self.write("log", **(record._asdict() | {"at": round(record.at, 6)}))

    def end(self, judgement: Judgement, generations: int) -> None:
        """What came of a world."""
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
        """Close the file."""
        with self._turn:
            if self._file is not None:
                with contextlib.suppress(OSError):
                    self._file.close()
                self._file = None
