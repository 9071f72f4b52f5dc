"""Run the same job in this process, without messages: bit-identical to `solve` in lockstep."""

import argparse
import contextlib
import signal
import sys
import time
from typing import TYPE_CHECKING

from supernode.commands.run_options import add_run_options, chosen_file

if TYPE_CHECKING:
    from problems import ProblemFile
    from spy.result import Result
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from wire.exchange import Champion
    from wire.report import Reason

EXAMPLE = "supernode simulate examples/arm-ik.toml --torus 8x8 --seed 7"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of a run."""
    add_run_options(parser)


def run(options: argparse.Namespace) -> int:
    """Simulate, follow the run on stderr, and print its result on stdout."""
    import topologies
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from supernode.present import present

    file = chosen_file(options)
    log = RunLog(options.log)
    with (
        Terminal(topologies.parse(file.run.topology), options.quiet) as terminal,
        _Outside(file) as outside,
        contextlib.redirect_stdout(sys.stderr),  # a user's module may print
    ):
        result = _simulate(file, terminal, log, outside)
    return present(result, file, options, outside.interrupted)


class _Outside:
    """The clock and the user, who may want the run to stop."""

    def __init__(self, file: "ProblemFile") -> None:
        self.began = time.monotonic()
        self.interrupted = False
        self._seconds = file.run.seconds

    def __enter__(self) -> "_Outside":
        self._handler = signal.signal(signal.SIGINT, self._interrupt)
        return self

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._handler)

    def _interrupt(self, *_: object) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True

    def wish(self) -> "Reason | None":
        """Why to stop now, if at all."""
        if self.interrupted:
            return "cancel"
        if self._seconds is not None and time.monotonic() - self.began >= self._seconds:
            return "deadline"
        return None


def _simulate(file: "ProblemFile", terminal: "Terminal", log: "RunLog", outside: _Outside) -> "Result":
    import numpy as np

    from node import Plan, simulate
    from node.fingerprint import fingerprint
    from problems import EvaluationFailed
    from spy.collector import Collector
    from spy.judge import judge
    from spy.result import Clocks, Lived, best_known, result_of, states_of, stop_reasons, stopped_after

    plan = Plan.of(file)
    collector = Collector(plan, job=1)
    with contextlib.suppress(EvaluationFailed):  # loads compiled code, off the clock
        plan.evaluate(plan.coding.random(plan.keys(np.arange(1), 0), 1)[0])
    outside.began = time.monotonic()
    log.write("start", job=1, run=file.run.model_dump())

    def hear(champion: "Champion | None") -> None:
        better = collector.hear(champion, time.monotonic() - outside.began)
        if better is not None:
            terminal.improvement(better)
            log.improvement(plan.topology, better)

    reports, error = [], None
    try:
        reports = simulate(plan, watch=lambda _, champion: hear(champion), outside=outside.wish)
    except EvaluationFailed as failure:
        error = str(failure)
    seconds = time.monotonic() - outside.began
    hear(best_known(reports, file.run.spy))
    generation = stopped_after(reports) if reports else 0
    reasons = stop_reasons(reports, file.run.mode)
    judgement = judge(collector, generation, reasons, error, states_of(reports))
    log.end(judgement, generation)
    log.close()
    clocks = Clocks(seconds, 0.0, time.process_time())
    return result_of("1", [Lived(file, reports)], judgement, fingerprint(), clocks)
