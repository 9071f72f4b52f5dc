"""Kill and stop processes of a cluster while it solves a problem, and report what was lost.

A quarter of the nodes is killed at once, then one node is killed or stopped every second; spy, router and coordinator
are killed once each. With --full-disk the disk that keeps the jobs is full for a while. The cluster is started for this
on this machine. The exit code is 3 if anything was lost: the job did not end, the answer is worse than one that was
told before, or a replay has another history. With --simulate no process is started: each trial is a whole cluster
within one process, and --draw decides everything but the problem.
"""

import argparse
import contextlib
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import add_force
from supernode.commands.run_options import add_settings, positive, share, whole

if TYPE_CHECKING:
    from pathlib import Path

_TELL_EVERY = 50  # trials
_DISK_BYTES = 64 << 20
EXAMPLE = "supernode chaos examples/rastrigin.toml --torus 4x4 --for 20 --draw 7"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem, the settings of the run, and the faults."""
    add_settings(parser)
    faults = parser.add_argument_group("faults")
    faults.add_argument("--draw", metavar="N", type=whole, default=1, help="the seed of the faults (%(default)s)")
    faults.add_argument("--for", dest="length", metavar="S", type=positive, default=60.0, help="seconds of faults (60)")
    faults.add_argument(
        "--at-once", metavar="R", type=share, default=0.25, help="the share of nodes to kill at once (%(default)s)"
    )
    faults.add_argument(
        "--full-disk", metavar="S", type=positive, help="let the disk that keeps the jobs be full once, for S seconds"
    )
    simulated = parser.add_argument_group("simulation")
    simulated.add_argument(
        "--simulate", action="store_true", help="whole clusters without processes; all is drawn from --draw"
    )
    simulated.add_argument("--trials", metavar="N", type=whole, default=1, help="with the seeds from --draw on (1)")
    simulated.add_argument("--events", action="store_true", help="print what happened in each trial")
    add_force(parser)
    parser.add_argument("--json", action="store_true", help="print the outcome of a trial as one JSON object")
    parser.add_argument("--quiet", action="store_true", help="no line on stderr about what is done")


def run(options: argparse.Namespace) -> int:
    """Show each fault on stderr, and print the outcome on stdout."""
    return _simulate(options) if options.simulate else _try(options)


def _simulate(options: argparse.Namespace) -> int:
    """Simulate clusters under faults, and print what was lost."""
    import importlib.util
    import json
    import sys

    from problems import BadInput, load, registry
    from supernode.launch.supervisor import check_library

    if importlib.util.find_spec("greenlet") is None:
        raise BadInput("chaos --simulate: expected greenlet to be installed: pip install 'supernode[simulate]'")
    check_library("chaos")
    from supernode.chaos.simulated import campaign

    if options.full_disk is not None:
        raise BadInput("--full-disk: expected none with --simulate, whose disks fail by themselves")
    file, broken = load(options.problem), 0
    if registry.is_users_own(file.kind):
        raise BadInput(f"{file.name}: kind: expected a built-in kind with --simulate, found {file.kind!r}")
    for number, outcome in enumerate(campaign.trials(file, options.draw, options.trials), 1):
        broken += bool(outcome.broken)
        if not options.quiet and number % _TELL_EVERY == 0:
            print(f"{number} of {options.trials} trials, something was lost in {broken}", file=sys.stderr)
        if options.json:
            print(json.dumps(campaign.as_json(outcome)))
            continue
        if options.events:
            print("\n".join(outcome.log))
        if outcome.broken or options.trials == 1:
            print(campaign.in_words(outcome))
    if not options.json:
        print(f"{options.trials} trials, something was lost in {broken}")
    return exits.NOT_REACHED if broken else exits.OK


def _try(options: argparse.Namespace) -> int:
    """Try a real cluster."""
    from problems.errors import BadInput

    if options.full_disk is None:
        return _try_on(None, options)
    if options.full_disk >= options.length:
        raise BadInput(f"--full-disk: expected less than --for, {options.length:g}, found {options.full_disk:g}")
    import os
    import sys
    import tempfile
    from pathlib import Path

    from coordinator.threads import ONE_THREAD

    if not os.environ.items() >= ONE_THREAD.items():
        # `own_disk` asks for a process of one thread, and numpy has started others while the arguments were read.
        os.execve(sys.executable, [sys.executable, "-m", "supernode", *sys.argv[1:]], os.environ | ONE_THREAD)

    from lowlevel.namespaces import own_disk

    with contextlib.ExitStack() as stack:
        disk = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="supernode-disk-")))
        try:
            stack.enter_context(own_disk(disk, _DISK_BYTES))
        except OSError as error:
            mend = "run it as root, or where users may make user namespaces"
            raise BadInput(
                f"--full-disk: expected the right to mount a disk in memory, found {error.strerror!r}; {mend}"
            ) from None
        return _try_on(disk, options)


def _try_on(disk: "Path | None", options: argparse.Namespace) -> int:
    """Try a real cluster, whose jobs are kept on a disk that may be full (None: on any)."""
    import json
    import sys

    import topologies
    from problems import load
    from problems.run import MOST_GENERATIONS
    from supernode.chaos import report, schedule, trial
    from supernode.commands.run_options import settings
    from supernode.launch.supervisor import check_library

    check_library("chaos")
    file = load(options.problem).with_run(**settings(options))
    if not any(getattr(file.run, name) is not None for name in ("generations", "evaluations", "stall")):
        # By default the run outlasts the faults, and is cancelled then.
        file = file.with_run(target=-1.0 if file.run.target is None else file.run.target, stall=MOST_GENERATIONS - 1)
    file.refuse_unreachable()
    cells = topologies.parse(file.run.topology).cells
    faults = schedule.faults(cells, options.length, options.at_once, options.draw, options.full_disk or 0.0)

    def say(line: str) -> None:
        if not options.quiet:
            print(line, file=sys.stderr)

    outcome = trial.run(file, faults, options.force, say, disk)
    print(json.dumps(report.as_json(outcome)) if options.json else report.in_words(outcome))
    return exits.NOT_REACHED if outcome.lost else exits.OK
