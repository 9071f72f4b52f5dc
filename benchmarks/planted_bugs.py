"""Plant bugs in nodes, spy, hosts and coordinator, one at a time, and count the simulated trials until each is found.

Usage: python -m benchmarks.planted_bugs [--most 2000] [--only NAME]

A simulation that finds nothing shows little unless it finds what is there. Each bug changes a few words of the source
as it is imported; no file is changed. The run fails if the source does not have these words any more. A trial in which
something is broken without the bug too does not count.
"""

from __future__ import annotations

import argparse
import importlib.abc
import importlib.machinery
import importlib.util
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

_ROOT = Path(__file__).resolve().parent.parent
_PROBLEM = _ROOT / "examples" / "rastrigin.toml"
_LONGEST = 3000.0  # seconds for one bug


class Bug(NamedTuple):
    """A change of the source of a module: ``old`` becomes ``new``."""

    name: str
    module: str
    old: str
    new: str


BUGS = (
    Bug(
        "a node forgets that the links of its present epoch are open",
        "node.epochs",
        "if present is not None and present.leads_to(topology, wiring):",
        "if False:",
    ),
    Bug(
        "a new process is not told of a stop that others know",
        "coordinator.jobs.recovering",
        "            stop_at = least_stop(kept)\n",
        "            stop_at = None\n",
    ),
    Bug(
        "a new process knows of a stop before it has bred so far",
        "node.cell",
        "            self.generations.tell_stop(start.takeover.stop_at)\n",
        "            rows.stop_at[0] = min(rows.stop_at[0], start.takeover.stop_at or rows.limit)\n",
    ),
    Bug(
        "a new process stops before others may have got to that generation",
        "node.cell",
        "if self._put_off and self.rows.generation >= self._reached:",
        "if self._put_off:",
    ),
    Bug(
        "answers of neighbours are filed one exchange late",
        "node.cell",
        "event.generation // self.plan.run.interval, event.payloads",
        "event.generation // self.plan.run.interval + 1, event.payloads",
    ),
    Bug(
        "a cell claims to have all its messages since the beginning",
        "node.cell",
        "oldest = now if oldest is None else oldest",
        "oldest = 0",
    ),
    Bug(
        "a cell that goes on from a state expects its first messages again",
        "node.cell",
        "            self.inbox.go_on_from(rows.generation, plan.run.interval)\n",
        "",
    ),
    Bug(
        "a cell that waits never asks for a missing message",
        "node.patience",
        "return waited >= patience",
        "return False",
    ),
    Bug(
        "a report that was lost is not told again",
        "node.epochs",
        "            self.answer_with_report(assignment, query)\n        elif self.past",
        "            drop(query) if assignment.report is not None else self.answer_with_report(assignment, query)\n"
        "        elif self.past",
    ),
    Bug(
        "a node ignores the order to halt",
        "node.commands",
        "            assignment.events.append(Halted())\n",
        "",
    ),
    Bug(
        "a node told to take a dead one's place begins with random individuals",
        "node.epochs",
        "self._driver.start(assignment, Start(genomes, coming.takeover))",
        "self._driver.start(assignment, Start(genomes, None))",
    ),
    Bug(
        "an answer to the problem before a change counts for the one after it",
        "spy.process",
        "if before is not None and before.problem == problem and before.collector",
        "if before is not None and before.collector",
    ),
    Bug(
        "the spy does not tell its last answer to a coordinator that begins a job again",
        "spy.process",
        "return None if best is None else best.encode().hex()",
        "return None if best is None else None",
    ),
    Bug(
        "the spy forgets what the reports say of the best",
        "spy.process",
        "        self._hear(assignment, command.champion)\n",
        "",
    ),
    Bug(
        "a question that too few have answered is not asked again",
        "coordinator.jobs.calls",
        "until = time.monotonic() + (_REPLACED_WITHIN if self._replaces else 0.0)",
        "until = time.monotonic()",
    ),
    Bug(
        "all states look fit to go on from",
        "coordinator.jobs.recovering",
        "return beside.oldest <= generation <= max(beside.generation, dict(beside.heard).get(cell, 0))",
        "return True",
    ),
    Bug(
        "a new process may have got no further than its state",
        "coordinator.jobs.recovering",
        "+ epoch.topology.diameter * epoch.file.run.interval",
        "- epoch.topology.diameter * epoch.file.run.interval",
    ),
    Bug(
        "a coordinator that takes over takes all nodes for alive",
        "coordinator.jobs.replacing",
        "epoch.dead = set(range(epoch.cells)) - self._present_cells(epoch)",
        "self._present_cells(epoch)",
    ),
    Bug(
        "a coordinator that takes over takes the spy for the old one",
        "coordinator.jobs.replacing",
        "self._spy_is_new = True  # it may have been replaced while there was no coordinator",
        "self._spy_is_new = False",
    ),
    Bug(
        "reports that a dead router has lost are not asked for again",
        "coordinator.jobs.running",
        '                job.stop_everywhere(epoch.number, "update")\n            job.ask_for_reports(epoch)\n',
        '                job.stop_everywhere(epoch.number, "update")\n',
    ),
    Bug(
        "nodes are not freed at the end of a job",
        "coordinator.jobs.dispatcher",
        "            self._scheduler.free(number)\n            self.jobs.pop",
        "            self.jobs.pop",
    ),
    Bug(
        "a failing disk loses what was to be written",
        "coordinator.store.recorder",
        "                if not error.passing:\n",
        "                if error.passing:\n",
    ),
    Bug(
        "the death of a node is not told to its job",
        "coordinator.jobs.dispatcher",
        "if nodes is not None and (node is None or node in nodes):",
        "if nodes is not None and node is None:",
    ),
    Bug(
        "a host that comes back gets other numbers",
        "coordinator.service.host_book",
        "host for host in known_ones if host.name == asking.name",
        "host for host in known_ones if host.id == asking.id",
    ),
    Bug(
        "a host may leave although jobs still need it",
        "coordinator.service.joined",
        "            return sorted(needed.intersection(nodes))",
        "            return []",
    ),
    Bug(
        "a host takes no numbers for an answer, though the disk may be full",
        "coordinator.launch.host",
        "if numbers := _read(reply.ok.payload.to_bytes()):",
        "if (numbers := _read(reply.ok.payload.to_bytes())) or True:",
    ),
    Bug(
        "a host's agent that has died asks for numbers once more",
        "coordinator.launch.host",
        "    if not host.nodes:\n        here[0]",
        "    if True:\n        here[0]",
    ),
    Bug(
        "a cancel that was answered dies with its coordinator",
        "coordinator.service.request_handler",
        "            if job.is_cancelled:\n",
        "            if job.is_cancelled and not job.nodes:\n",
    ),
    # What simulation had found in this project, and was mended.
    Bug(
        "a host may end although a second move of a job begins at its nodes",
        "coordinator.service.joined",
        "if nodes == (self._scheduler.nodes_of(number) or ())[: len(nodes)]:",
        "if nodes:",
    ),
    Bug(
        "a coordinator does not recall the hosts of the one before",
        "coordinator.service.host_book",
        "        self._recall()\n",
        "        self._kept = []\n",
    ),
    Bug(
        "a coordinator does not tell a job that a node is back which it had not seen before",
        "coordinator.service.launched",
        "arrived=self.returned, returned=self.returned,",
        "returned=self.returned,",
    ),
    Bug(
        "a job is not taken over while one of its hosts is out of reach",
        "coordinator.service.joined",
        "            away = known.difference(self._scheduler.here)\n",
        "            away = known.difference(known)\n",
    ),
    Bug(
        "nodes that were cut off at the end of a job breed on",
        "coordinator.service.service_dispatcher",
        "            elif now > self._strays.setdefault(stray, now) + _STRAY_AFTER:",
        "            elif now < self._strays.setdefault(stray, now):",
    ),
    Bug(
        "the cells of a job that has begun again elsewhere breed on where it was",
        "coordinator.service.service_dispatcher",
        "return self._is_restored and not here and",
        "return self._is_restored and self._scheduler.nodes_of(job) is None and",
    ),
    Bug(
        "cells of a job that has begun again elsewhere report as it is halted",
        "coordinator.jobs.replacing",
        "Halt(self._job.number, epoch.number, epoch.wiring_number)",
        "Halt(self._job.number, epoch.number)",
    ),
    Bug(
        "a node that is back is not asked for its report if others were asked for something else",
        "coordinator.jobs.calls",
        "self._put_off.append(news)  # a node that is back may have missed an earlier question as well",
        "self._put_off.extend([] if isinstance(news, Returned) else [news])",
    ),
    Bug(
        "a cell that died before it had sent anything begins a later epoch with random individuals",
        "coordinator.jobs.preparing",
        'deme = b"" if takeover.state else demes.get(cell, b"")',
        'deme = b"" if takeover.state or demes else b""',
    ),
    Bug(
        "an epoch is not prepared again for nodes that are back",
        "coordinator.jobs.calls",
        "if isinstance(news, Returned) and for_nodes_back:",
        "if isinstance(news, Returned) and for_nodes_back and not self._replaces:",
    ),
    Bug(
        "the death of a node is not told to a job that moves away from it",
        "coordinator.service.joined",
        "            self._tell_movers([node], crash)\n",
        "            pass\n",
    ),
    Bug(
        "the loss of a host while a change is prepared counts for the change only",
        "coordinator.jobs.changing",
        "            change.answer.put(error)\n            raise\n",
        "            change.answer.put(error)\n            return\n",
    ),
    Bug(
        "a coordinator that takes over does not ask which links are open",
        "coordinator.jobs.replacing",
        '                    job.dispatch.open_links(look["node"], look["wirings"])\n',
        "                    pass\n",
    ),
    Bug(
        "a node that was thought dead keeps its deme as the job begins anew",
        "node.epochs",
        "may_go_on = not command.anew and not command.deme",
        "may_go_on = not command.deme",
    ),
    Bug(
        "a cell that a dead coordinator has halted counts as one that has ended",
        "coordinator.jobs.running",
        "elif message.report.halted and message.epoch == job.epoch.number:",
        "elif False:",
    ),
    Bug(
        "a stop that was proposed by a process that died is recorded nowhere",
        "coordinator.jobs.ending",
        "            reports[ROOT] = replace(root, proposals=(*root.proposals, lost))\n",
        "            assert root and lost\n",
    ),
    Bug(
        "a node begins an epoch for which a dead coordinator has prepared it",
        "node.epochs",
        " and wiring in (None, links.wiring.number)",
        "",
    ),
    Bug(
        "a cell that died as it moved, and whose state is kept, gets the deme that it did not report",
        "coordinator.jobs.replacing",
        "for cell, donor in (moved | donors).items() if cell not in states}",
        "for cell, donor in donors.items() if cell not in states} | moved",
    ),
    Bug(
        "links of an epoch that was given up stay open",
        "node.epochs",
        "        self._close_latest()  # of",
        "        # of",
    ),
    Bug(
        "nodes that are still to come are not drained",
        "coordinator.jobs.scheduler",
        "        self._leaving.update(nodes)  # also",
        "        self._leaving.update(self._here.intersection(nodes))  # also",
    ),
    Bug(
        "a node listens where its old links are open",
        "coordinator.jobs.node_hosts",
        "        number = min(ahead, key=lambda number: (taken[number % PORTS], latest.get(number % PORTS, -1)))",
        "        number = max(ahead, key=lambda number: taken[number % PORTS])",
    ),
    Bug(
        "a node that dies while halted cells move is not marked as dead",
        "coordinator.jobs.replacing",
        "self._mark_dead(another.node, goes_on=bool(self._job.epoch.dead) or self._needs_an_epoch)",
        "self._mark_dead(another.node)",
    ),
    Bug(
        "a node that does not answer a first question at a takeover counts as dead",
        "coordinator.jobs.replacing",
        "                if not keys or time.monotonic() >= until:",
        "                if cells:",
    ),
)


class _Loader(importlib.machinery.SourceFileLoader):
    """Loads a module from its file with one bug in it."""

    def __init__(self, name: str, path: str, bug: Bug) -> None:
        super().__init__(name, path)
        self._bug = bug

    def get_code(self, fullname: str) -> CodeType:
        """Compile the changed source; what is cached is the unchanged one."""
        source = Path(self.path).read_text(encoding="utf-8")
        if source.count(self._bug.old) != 1:
            raise SystemExit(
                f"{self.path}: expected once, found {source.count(self._bug.old)} times: {self._bug.old!r}"
            )
        return compile(source.replace(self._bug.old, self._bug.new), self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, bug: Bug) -> None:
        self._bug = bug

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._bug.module:
            return None
        file = _ROOT.joinpath(*fullname.split(".")).with_suffix(".py")
        return importlib.util.spec_from_file_location(fullname, file, loader=_Loader(fullname, str(file), self._bug))


def _find(bug: Bug | None, first: int, most: int) -> None:
    """Run trials with the bug, if any, until something is broken; print the seed, and what is broken."""
    if bug is not None:
        sys.meta_path.insert(0, _Finder(bug))
    from problems import load
    from supernode.chaos.simulated.drawing import drawn
    from supernode.chaos.simulated.trial import run

    file = load(str(_PROBLEM))
    for seed in range(first, most + 1):
        outcome = run(drawn(seed), file)
        if outcome.broken:
            print(f"{seed}\t{outcome.broken[0]}")
            return
    print(f"-\tnot found in {most} trials")


def _trials(number: int | None, first: int, most: int) -> tuple[str, str]:
    """Return the first seed at which something is broken with a bug (None: without any), and what; or "-", and why.

    Raises:
        subprocess.TimeoutExpired: if that takes too long.
    """
    command = [sys.executable, "-m", "benchmarks.planted_bugs", "--first", str(first), "--most", str(most)]
    planted = "none" if number is None else str(number)
    done = subprocess.run(
        [*command, "--plant", planted], capture_output=True, text=True, timeout=_LONGEST, check=False, cwd=_ROOT
    )
    if done.returncode:
        return "?", done.stderr.strip().rpartition("\n")[2]
    seed, _, what = done.stdout.strip().partition("\t")
    return seed, what


def _search(number: int, most: int) -> tuple[str, str]:
    """Return the first seed that finds a bug, and what it says; or "-", and why none does."""
    first = 1
    try:
        while True:
            seed, what = _trials(number, first, most)
            if not seed.isdigit():
                return seed, what
            without, why = _trials(None, int(seed), int(seed))
            if not without.isdigit():  # so the bug broke it, unless the check itself has failed
                return (without, why) if without == "?" else (seed, what)
            first = int(seed) + 1
    except subprocess.TimeoutExpired:
        return "-", f"not found within {_LONGEST:.0f} s"


def main() -> None:
    """Plant each bug in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=2000, help="trials for each bug (%(default)s)")
    parser.add_argument("--only", help="the bug whose name begins so")
    parser.add_argument("--first", type=int, default=1, help=argparse.SUPPRESS)
    parser.add_argument("--plant", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.plant is not None:
        bug = BUGS[int(options.plant)] if options.plant.isdigit() else None
        return _find(bug, options.first, options.most)
    found = asked = 0
    for number, bug in enumerate(BUGS):
        if options.only and not bug.name.startswith(options.only):
            continue
        began, asked = time.monotonic(), asked + 1
        seed, what = _search(number, options.most)
        found += seed.isdigit()
        print(
            f"{seed:>5}  {time.monotonic() - began:6.1f} s  {bug.module}: {bug.name}\n{'':16}{what[:150]}", flush=True
        )
    print(f"{found} of {asked} bugs found")
    return None


if __name__ == "__main__":
    main()
