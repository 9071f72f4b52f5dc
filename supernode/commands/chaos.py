"""Kill and stop processes of a cluster while it solves a problem, and report what was lost.

A quarter of the nodes is killed at once, then one node is killed or stopped every second; spy, router and coordinator
are killed once each. With --hosts the nodes are on several hosts, which are cut off now and then, and one is killed.
With --full-disk the disk that keeps the jobs is full for a while. The cluster is started for this on this machine. The
exit code is 3 if anything was lost: the job did not end, the answer is worse than one that was told before, or a replay
has another history. With --simulate no process is started: each trial is a whole cluster within one process, and --draw
decides everything but the problem.
"""

import argparse
import contextlib
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import add_force
from supernode.commands.run_options import add_settings, positive, share, whole

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from supernode.chaos.network import Network

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
    faults.add_argument(
        "--hosts",
        metavar="N",
        type=whole,
        help="put the nodes on N hosts, each in a network namespace of its own; cut hosts off, and kill one",
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
    if options.hosts is not None:
        raise BadInput("--hosts: expected none with --simulate, which draws how many hosts there are")
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

    if options.full_disk is None and options.hosts is None:
        return _try_on(options)
    if options.full_disk is not None and options.full_disk >= options.length:
        raise BadInput(f"--full-disk: expected less than --for, {options.length:g}, found {options.full_disk:g}")
    if options.hosts is not None:
        _check_hosts(options.hosts)
    from coordinator.threads import begin_again_with_one_thread

    begin_again_with_one_thread()  # since numpy was read with the arguments
    with contextlib.ExitStack() as stack:
        network = None if options.hosts is None else stack.enter_context(_network(options.hosts))
        disk = None if options.full_disk is None else stack.enter_context(_disk())
        return _try_on(options, disk, network)


def _check_hosts(hosts: int) -> None:
    """Raise `BadInput` unless there can be so many hosts for the nodes, and what makes their network is installed."""
    import importlib.util

    from problems.errors import BadInput

    if importlib.util.find_spec("pyroute2") is None:
        raise BadInput("chaos --hosts: expected pyroute2 to be installed: pip install 'supernode[chaos]'")
    from supernode.chaos.network import MOST_HOSTS

    if not 1 <= hosts <= MOST_HOSTS:
        raise BadInput(f"--hosts: expected 1 to {MOST_HOSTS}, found {hosts}")


def _network(hosts: int) -> "Network":
    """Return so many hosts for the nodes.

    Raises:
        BadInput: if this system or this user can have none.
    """
    from problems.errors import BadInput
    from supernode.chaos.network import Network

    try:
        return Network(hosts)
    except OSError as error:
        mend = "let users make user namespaces (sysctl user.max_user_namespaces, a container's profile), and the kernel"
        mend += " load its modules bridge and veth"
        raise BadInput(
            f"--hosts: expected the right to make networks within this machine, found {error.strerror!r}; {mend}"
        ) from None


@contextlib.contextmanager
def _disk() -> "Iterator[Path]":
    """Yield the folder of a disk of this process's own.

    Raises:
        BadInput: if this user can have none.
    """
    import tempfile
    from pathlib import Path

    from lowlevel.namespaces import own_disk
    from problems.errors import BadInput

    with contextlib.ExitStack() as stack:
        disk = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="supernode-disk-")))
        try:
            stack.enter_context(own_disk(disk, _DISK_BYTES))
        except OSError as error:
            mend = "run it as root, or where users may make user namespaces"
            raise BadInput(
                f"--full-disk: expected the right to mount a disk in memory, found {error.strerror!r}; {mend}"
            ) from None
        yield disk


def _try_on(options: argparse.Namespace, disk: "Path | None" = None, network: "Network | None" = None) -> int:
    """Try a real cluster: on a disk that may be full (None: on any), and on several hosts (None: on this one)."""
    import json
    import sys

    import topologies
    from problems import BadInput, load
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
    hosts = options.hosts or 0
    if hosts > cells:
        raise BadInput(f"--hosts: expected at most one for each of {cells} nodes, found {hosts}")
    faults = schedule.faults(cells, options.length, options.at_once, options.draw, options.full_disk or 0.0, hosts)

    def say(line: str) -> None:
        if not options.quiet:
            print(line, file=sys.stderr)

    outcome = trial.run(file, faults, options.force, say, disk, network)
    print(json.dumps(report.as_json(outcome)) if options.json else report.in_words(outcome))
    return exits.NOT_REACHED if outcome.lost else exits.OK
