"""Show a job of a running cluster to a person: improvements as they come, then the result in words."""

import contextlib
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING

import topologies
from problems import BadInput, EvaluationFailed, ProblemFile
from problems.guard import described
from spy.improvement_records import ImprovementRecord
from spy.least_improvement import LEAST
from spy.result import Result
from spy.run_log import RunLog
from spy.terminal import Terminal
from supernode.client.job_feed import SEARCHING, WAITING
from supernode.reports.records import pages
from supernode.runs.results import topology_of
from wire.news import Improvement, LogRecord, Statistics
from wire.strict import Rejected

if TYPE_CHECKING:
    from rich.console import RenderableType

    from supernode.client.client import Client, ClientJob

_STATE_NOTES = {
    WAITING: "it is kept alive for an update (`supernode cancel {job}` ends it, Ctrl-C ends the watching)",
    SEARCHING: "it stalled without an answer, and begins anew until it has one (`supernode cancel {job}` ends it)",
}


class Follower:
    """Shows one job on the terminal, and writes its run log if one is wanted.

    Args:
        client: a client of the job's cluster.
        job: the job.
        file: the job's problem as it was submitted.
        quiet: show nothing.
        log: the file of the run log; None for none.
        below: what a terminal shows live under the improvements.
        least: the least improvement worth a line, as a share of the fitness before.

    Raises:
        BadInput: if the log cannot be written.
    """

    def __init__(
        self,
        client: "Client",
        job: "ClientJob",
        file: ProblemFile,
        quiet: bool,
        log: str | None = None,
        below: "RenderableType" = "",
        least: float = LEAST,
    ) -> None:
        self._client = client
        self._job = job
        self._file = file
        self._quiet = quiet
        self._below = below
        self._least = least
        self._log = RunLog(log, least)
        self._log.start(job.id, 0, file.run)
        self._is_logged = log is not None
        if self._is_logged:
            self._number = job.show()["number"]
            # The log's handlers run on the client's thread, `show` and `result` on the caller's.
            client.listen(client.keys.spy_stats, self._hear_statistics)
            client.listen(client.keys.log, self._hear_record)

    def show(self) -> None:
        """Show each improvement until the job ends, and how to end a job that is kept alive."""
        epoch, topology = 0, topologies.parse(self._file.run.topology)
        with Terminal(topology, self._quiet, below=self._below, least=self._least) as terminal:
            for event in self._job.events():
                if isinstance(event, str):
                    if event in _STATE_NOTES:
                        terminal.say(f"{event}: {_STATE_NOTES[event].format(job=self._job.id)}")
                    continue
                if event.epoch != epoch:
                    epoch = self._describe_epoch(terminal, event, epoch)
                terminal.improvement(event)
                self._log.news(terminal.topology, event)

    def _describe_epoch(self, terminal: Terminal, better: Improvement, epoch: int) -> int:
        """Say how the epoch of ``better`` began, and return the number of the last epoch described.

        That number stays as it is if the coordinator does not know the new epoch yet; the next improvement tries again.
        """
        view = self._job.show()
        if view["epoch"] < better.epoch:  # the spy's improvement was quicker than the coordinator's record
            return epoch
        terminal.topology = topology_of(view, better.epoch)
        retries = [each for each in view["epochs"] if each["epoch"] == better.epoch and each.get("do") == "retry"]
        for why in retries:
            terminal.begins_anew(why)
        if not retries:
            terminal.say(f"epoch {better.epoch}: {terminal.topology.spec}")
        return better.epoch

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the result, close the log, and return the result with the solution in words.

        Raises:
            TimeoutError: if the job has not ended after ``timeout`` seconds.
        """
        result = self._job.result(timeout)
        if self._is_logged:
            self._log_history()
        names = ("status", "feasible", "message", "generations", "fitness")
        self._log.write("end", **{name: getattr(result, name) for name in names})
        self._log.close()
        return replace(result, words=self._words(result))

    def _log_history(self) -> None:
        """Write the improvements that the cells recorded, epoch by epoch."""
        view = self._job.show()
        rows = [row for page in pages(self._client, "history", self._job.id) for row in page.rows]
        records = [ImprovementRecord(*row) for row in rows]
        for epoch, of_epoch in groupby(records, key=lambda record: record.epoch):
            self._log.improvements(topology_of(view, epoch), list(of_epoch))

    def _hear_statistics(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            statistics = Statistics.decode(payload)
            if statistics.job == self._number:
                self._log.statistics(statistics)

    def _hear_record(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            record = LogRecord.decode(payload)
            if record.job in (None, self._number):
                self._log.record(record)

    def _words(self, result: Result) -> str | None:
        """Return the solution in words; None if there is none, or the module of a user's problem is not found here."""
        if result.found is None:
            return None
        try:
            return described(self._file.problem(), result.found)
        except (BadInput, EvaluationFailed):
            return None
