"""How a job on a running cluster is shown to a person: improvements as they come, then the result in words."""

from dataclasses import replace
from typing import TYPE_CHECKING

import topologies
from problems import BadInput, EvaluationFailed, ProblemFile
from problems.guard import described
from spy.result import Result
from spy.run_log import RunLog
from spy.terminal import Terminal
from supernode.results import topology_of

if TYPE_CHECKING:
    from supernode.client import ClientJob


class Follower:
    """Shows one job, and writes its run log if one is wanted; a context manager.

    Raises:
        BadInput: if the log cannot be written.
    """

    def __init__(self, job: "ClientJob", file: ProblemFile, quiet: bool, log: str | None = None) -> None:
        self._job = job
        self._file = file
        self._quiet = quiet
        self._log = RunLog(log)
        self._log.write("start", job=job.id, run=file.run.model_dump())

    def show(self) -> None:
        """Each improvement until the end."""
        world, topology = 0, topologies.parse(self._file.run.topology)
        terminal = Terminal(topology, self._quiet)
        for better in self._job.improvements():
            if better.world != world:
                world, topology = better.world, topology_of(self._job.show(), better.world)
                terminal = Terminal(topology, self._quiet)
                terminal.say(f"world {world}: {topology.spec}")
            terminal.improvement(better)
            self._log.improvement(topology, better)

    def result(self, timeout: float | None = None) -> Result:
        """What came of the job, with the solution in words; the log is closed.

        Raises:
            TimeoutError: if it has not ended by then.
        """
        result = self._job.result(timeout)
        names = ("status", "feasible", "message", "generations", "fitness")
        self._log.write("end", **{name: getattr(result, name) for name in names})
        self._log.close()
        return replace(result, words=self._words(result))

    def _words(self, result: Result) -> str | None:
        """A user's module may not be here."""
        if result.solution is None:
            return None
        try:
            return described(self._file.problem(), result.solution)
        except (BadInput, EvaluationFailed):
            return None
