"""Run a job in this process, without messages: bit-identical to `solve` in lockstep."""

import argparse
import contextlib
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.run_options import add_run_options, chosen_file, settings

if TYPE_CHECKING:
    from node.replay import Epoch
    from node.simulation import StopRequest
    from spy.improvement_records import ImprovementRecord
    from spy.judgement import Judgement
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from supernode.runs.simulation import Listener
    from wire.news import Improvement

EXAMPLE = "supernode simulate examples/arm-ik.toml --torus 8x8 --seed 7"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of a run, and the result to repeat."""
    add_run_options(parser)
    parser.add_argument("--replay", metavar="RESULT.json", help="repeat this run with its settings, in all its epochs")


def run(options: argparse.Namespace) -> int:
    """Simulate, show progress on stderr, and print the result on stdout."""
    import topologies
    from node.replay import epochs_of
    from spy.run_log import RunLog
    from spy.terminal import Terminal
    from supernode.runs.repeating import Recorded
    from supernode.runs.simulation import Simulation
    from supernode.terminal.present import present

    file = chosen_file(options)
    recorded = None if options.replay is None else Recorded.read(options.replay, settings(options))
    epochs = epochs_of(file) if recorded is None else recorded.epochs(file)
    file = epochs[-1].file
    log = RunLog(options.log, options.least_improvement)
    with (
        Terminal(topologies.parse(file.run.topology), options.quiet, least=options.least_improvement) as terminal,
        _interruptible(file.run.seconds if recorded is None else None) as request,
        contextlib.redirect_stdout(sys.stderr),  # a user's module may print
    ):
        stops = None if recorded is None else recorded.stops
        simulation = Simulation(epochs, stops, _shown(terminal, log), request.reason)
        # The deadline's time begins here: making the simulation may have compiled code.
        request.began = time.monotonic()
        result = simulation.run()
        log.close()
    code = present(result, simulation.file, options, request.cancelled)
    if recorded is None or request.cancelled or (complaint := recorded.complaint(result)) is None:
        return code
    print(f"error: {complaint}", file=sys.stderr)
    return exits.NOT_REACHED


@contextlib.contextmanager
def _interruptible(seconds: float | None) -> "Iterator[StopRequest]":
    """Yield a request to stop at the deadline or at Ctrl-C; a second Ctrl-C ends the command at once."""
    from node.simulation import StopRequest

    request = StopRequest(seconds)

    def interrupt(*_: object) -> None:
        if request.cancelled:
            raise KeyboardInterrupt
        request.cancelled = True

    handler = signal.signal(signal.SIGINT, interrupt)
    try:
        yield request
    finally:
        signal.signal(signal.SIGINT, handler)


def _shown(terminal: "Terminal", log: "RunLog") -> "Listener":
    """Return a listener that shows progress on the terminal and writes the run log."""
    from supernode.runs.simulation import Listener

    class Shown(Listener):
        """Passes each event to both."""

        def begins(self, epoch: "Epoch") -> None:
            if epoch.is_fresh:
                terminal.begins_anew(epoch.why)
            log.start(1, epoch.number, epoch.file.run)

        def improvement(self, epoch: "Epoch", better: "Improvement") -> None:
            terminal.improvement(better)
            log.news(epoch.plan.topology, better)

        def lived(self, epoch: "Epoch", records: "Sequence[ImprovementRecord]") -> None:
            log.improvements(epoch.plan.topology, records)

        def ends(self, epoch: "Epoch", judgement: "Judgement", generation: int) -> None:
            log.end(judgement, generation)

    return Shown()
