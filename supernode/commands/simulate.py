"""Run the same job in this process, without messages: bit-identical to `solve` in lockstep."""

import argparse
import contextlib
import itertools
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.run_options import add_run_options, chosen_file, settings

if TYPE_CHECKING:
    from node.replay import World
    from spy.result import Result
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from wire.exchange import Champion
    from wire.report import Proposal, Reason, Report

EXAMPLE = "supernode simulate examples/arm-ik.toml --torus 8x8 --seed 7"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of a run, or what is to be repeated."""
    add_run_options(parser)
    parser.add_argument("--replay", metavar="RESULT.json", help="repeat this run: its settings, and all its worlds")


def run(options: argparse.Namespace) -> int:
    """Simulate, follow the run on stderr, and print its result on stdout."""
    import topologies
    from node.replay import worlds_of
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from supernode.present import present
    from supernode.repeating import Recorded

    file = chosen_file(options)
    recorded = None if options.replay is None else Recorded.read(options.replay, settings(options))
    worlds = worlds_of(file) if recorded is None else recorded.worlds(file)
    file = worlds[-1].file
    log = RunLog(options.log)
    with (
        Terminal(topologies.parse(file.run.topology), options.quiet) as terminal,
        _Outside(file.run.seconds if recorded is None else None) as outside,
        contextlib.redirect_stdout(sys.stderr),  # a user's module may print
    ):
        result = _simulate(worlds, () if recorded is None else recorded.stops, terminal, log, outside)
    code = present(result, file, options, outside.interrupted)
    if recorded is None or outside.interrupted or (complaint := recorded.complaint(result)) is None:
        return code
    print(f"error: {complaint}", file=sys.stderr)
    return exits.NOT_REACHED


class _Outside:
    """The clock and the user, who may want the run to stop."""

    def __init__(self, seconds: float | None) -> None:
        self.began = time.monotonic()
        self.interrupted = False
        self._seconds = seconds

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


def _simulate(
    worlds: Sequence["World"], stops: Sequence["Proposal"], terminal: "Terminal", log: "RunLog", outside: _Outside
) -> "Result":
    """Live through all worlds, of which the last was stopped as ``stops`` say; it alone is judged."""
    import numpy as np

    from node.fingerprint import fingerprint
    from node.replay import live
    from problems import EvaluationFailed
    from spy.collector import Collector
    from spy.judge import judge
    from spy.past import Lived, Past, stopped_after
    from spy.result import Clocks, result_of, states_of, stop_reasons

    last = worlds[-1]
    plan, run = last.plan, last.file.run
    collector = Collector(plan, job=1)
    with contextlib.suppress(EvaluationFailed):  # loads compiled code, off the clock
        plan.evaluate(plan.coding.random(plan.keys(np.arange(1), 0), 1)[0])
    outside.began = time.monotonic()
    log.write("start", job=1, world=last.number, run=run.model_dump())

    def hear(champion: "Champion | None") -> None:
        better = collector.hear(champion, time.monotonic() - outside.began)
        if better is not None:
            terminal.improvement(better)
            log.improvement(plan.topology, better)

    past, reports, error = Past(), list["Report"](), None
    try:
        lived = live(worlds, lambda _, champion: hear(champion), outside.wish)
        for each, then in itertools.pairwise(lived):
            past = past.and_then(Lived(each.file, each.reports, each.plan.world), then.why)
        reports = _with_stops(lived[-1].reports, stops)
    except EvaluationFailed as failure:
        error = str(failure)
    seconds = time.monotonic() - outside.began
    world = Lived(last.file, reports, last.number)
    hear(past.or_better(world))
    generation = stopped_after(reports) if reports else 0
    reasons = stop_reasons(reports, run.mode)
    judgement = judge(collector, generation, reasons, error, states_of(reports), last.since)
    log.end(judgement, generation)
    log.close()
    clocks = Clocks(seconds, 0.0, time.process_time())
    return result_of("1", worlds[0].file.run, past, world, judgement, fingerprint(), clocks)


def _with_stops(reports: Sequence["Report"], stops: Sequence["Proposal"]) -> list["Report"]:
    """As if the root had proposed the stops that came from outside."""
    return [
        replace(report, proposals=(*report.proposals, *(each for each in stops if each.cell == report.cell)))
        for report in reports
    ]
