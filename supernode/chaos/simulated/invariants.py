"""What must hold in a simulated cluster at every look, and at the end."""

import json
import math
from collections import defaultdict
from collections.abc import Collection, Iterator
from functools import cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary, ref

from node.assignment import Assignment
from node.process import NodeProcess
from problems import BadInput, ProblemFile
from spy.judgement import STATUS_OF, Status
from supernode.chaos.repeating import Repetition, repeated
from supernode.chaos.simulated.client import Asked, SimulatedClient
from supernode.chaos.simulated.cluster import Cluster
from supernode.chaos.simulated.plans import Plan
from supernode.chaos.simulated.world import World

_SPY_IS_TOLD_WITHIN = 10.0  # seconds from when the spy or the faults end until it knows the jobs
_STANDS_STILL = 10.0  # seconds; lost messages are asked for after a second
_WAITS = 20.0  # seconds; in 2,000 trials no job waited for more than 10.2
_DROPPED_WITHIN = 7.0  # seconds from when a host is back until its nodes have forgotten jobs that run elsewhere
_BY_ITSELF = ("solved", "stalled", "exhausted")  # how a job ends that nobody stops
_OF_DEATHS = {"replace", "resume"}  # directives of epochs that began because cells could not go on exactly


class Invariants:
    """Looks at the cluster and notes what is broken.

    Args:
        world: the world.
        cluster: the cluster.
        client: the client.
        broken: takes a sentence for each thing that is broken.
        plan: what happens to the cluster, so what jobs may suffer from it.

    Attributes:
        faults_end: when the last fault is over.
    """

    def __init__(self, world: World, cluster: Cluster, client: SimulatedClient, broken: list[str], plan: Plan) -> None:
        self._may_lose_hosts = plan.loses_hosts
        self._may_lose_cells = any(fault.do == "kill" for fault in plan.faults)
        self._may_lose_histories = any(fault.whom == "coordinator" for fault in plan.faults)
        self._world = world
        self._cluster = cluster
        self._client = client
        self._broken = broken
        self.faults_end = math.inf
        self._seen: set[str] = set()
        # What should not last, and with whom it is so, since when: as of the look before, and of this one.
        self._lasted: dict[tuple[str, object], float] = {}
        self._lasting: dict[tuple[str, object], float] = {}
        self._reached: dict[int, tuple[int, int]] = {}  # by job, how far its cells are
        self._begun: WeakKeyDictionary[NodeProcess, _Begun] = WeakKeyDictionary()

    def look(self, every: float) -> None:
        """Look now, and then again and again. On the hub."""
        self._cells()
        self._world.at(self._world.now + every, lambda: self.look(every))

    def all_ended(self, jobs: int) -> bool:
        """Return whether the client knows the end of all its jobs."""
        asked = self._client.jobs
        return len(asked) == jobs and all(each.has_ended for each in asked)

    def expect_faults_until(self, end: float) -> None:
        """Note when another fault will be over."""
        self.faults_end = max(self.faults_end, end)

    def strays(self) -> list[int]:
        """Return the nodes that still run a cell."""
        return [node for node, assignment in self._running()]

    def leaking(self) -> list[int]:
        """Return the nodes that have open links of which they do not know any more."""
        nodes = self._cluster.nodes.items()
        return [node for node, process in nodes if self._cluster.open_links(node) > len(process.epochs.wirings)]

    def taken(self, process: str, address: str) -> None:
        """Nobody listens where an old link may be open: the coordinator knows which addresses are in use."""
        self._complain(f"{process} finds {address} in use")

    def at_the_end(self) -> None:
        """Look at what the client was told, and whether all nodes have stopped and closed their links."""
        if strays := self.strays():
            self._complain(f"all jobs have ended, but nodes {strays} still run cells")
        if leaking := self.leaking():
            self._complain(f"all jobs have ended, but nodes {leaking} have open links that they do not know any more")
        for asked in self._client.jobs:
            self._ended(asked)
            if asked.result is not None and not self._has_lost_a_host(asked):
                self._told(asked, asked.result)
                self._changed(asked, asked.result)
                self._is_whole(asked, asked.result)
                self._repeats(asked, asked.result)

    def _complain(self, text: str) -> None:
        if text not in self._seen:
            self._seen.add(text)
            self._broken.append(text)
            self._world.say(f"BROKEN: {text}")

    def _cells(self) -> None:
        """No two processes on a cell, and at most two epochs of a job at a time.

        A coordinator that takes over while all hosts of a job are cut off lets it begin again elsewhere. Nobody can end
        its cells on those hosts until they are back; until then the two do not meet.
        """
        self._lasted, self._lasting = self._lasting, {}
        self._numbers()
        self._begin_once()
        on: dict[tuple[int, int, int], list[int]] = defaultdict(list)
        epochs: dict[int, set[int]] = defaultdict(set)
        for node, assignment in self._running():
            cut_off_until = self._cluster.cut_off_until(node) if self._may_lose_histories else 0.0
            if cut_off_until and self._world.now < cut_off_until + _DROPPED_WITHIN:
                continue
            on[assignment.job, assignment.epoch, assignment.cell.number].append(node)
            epochs[assignment.job].add(assignment.epoch)
        for (job, epoch, cell), nodes in on.items():
            if len(nodes) > 1:
                self._complain(f"job {job}, epoch {epoch}: cell {cell} runs on nodes {nodes}")
        for job, there in epochs.items():
            if max(there) - min(there) > 1:
                self._complain(f"job {job}: epochs {sorted(there)} run at the same time")
            self._goes_on(job)
            self._is_watched(job, there)
        self._wait_for_nothing(epochs.keys())

    def _lasts(self, what: str, whom: object, is_so: bool, limit: float) -> bool:
        """Return whether this has been so for longer than the limit, at each look since the faults were over."""
        now, key = self._world.now, (what, whom)
        if is_so:
            self._lasting[key] = self._lasted.get(key, now)
        return is_so and now - max(self._lasting[key], self.faults_end) > limit

    def _goes_on(self, job: int) -> None:
        """Once the faults are over, the cells of a job never stand still for long."""
        running = [each for _, each in self._running() if each.job == job]
        far = max(each.epoch for each in running), sum(each.cell.rows.generation for each in running)
        before = self._reached.get(job)
        self._reached[job] = far
        if self._lasts("stands still", job, far == before, _STANDS_STILL):
            self._complain(f"job {job} stands still")

    def _wait_for_nothing(self, running: Collection[int]) -> None:
        """Once the faults are over, a job without running cells goes on or ends soon, unless another has its nodes.

        One that is given up at its deadline may keep nodes for longer if a coordinator takes it over just then.
        """
        for asked in self._client.jobs:
            may_wait = asked.number in running or (asked.status == "queued" and running) or asked.status == "deadline"
            waits = asked.accepted and not asked.has_ended and not may_wait
            if self._lasts("waits", asked.id, waits, _WAITS):
                self._complain(f"{asked.id} is {asked.status}, waits and has no running cells")

    def _is_watched(self, job: int, epochs: set[int]) -> None:
        """Once the faults are over, the spy knows a job and its epoch, so that clients are told better answers."""
        spy = self._cluster.spy
        watched = None if spy is None else spy.assignments.get(job)
        is_watched = watched is not None and watched.plan.epoch in epochs and watched.began is not None
        if self._lasts("is not watched", job, not is_watched, _SPY_IS_TOLD_WITHIN):
            self._complain(f"job {job}: the spy does not watch it")

    def _running(self) -> Iterator[tuple[int, Assignment]]:
        """Yield the nodes that run a cell, and what they are assigned to."""
        for node, process in self._cluster.nodes.items():
            assignment = process.driver.assignment
            if assignment is not None and assignment.cell.state == "running":
                yield node, assignment

    def _begin_once(self) -> None:
        """A process begins its cell once in an epoch: as long as it lives, nobody takes it for dead.

        A job that begins again elsewhere has the same epochs, but another wiring.
        """
        for node, process in self._cluster.nodes.items():
            now, before = process.driver.assignment, self._begun.get(process)
            if now is None or now.cell.state == "prepared" or (before is not None and before.assignment() is now):
                continue
            place = now.job, now.epoch, now.links.wiring.number, now.cell.number
            if before is not None and place == before.place:
                self._complain(f"job {now.job}, epoch {now.epoch}: cell {now.cell.number} begins again on node {node}")
            self._begun[process] = _Begun(place, ref(now))

    def _numbers(self) -> None:
        """No two hosts have a node of the same number."""
        has: dict[int, str] = {}
        for name, nodes in self._cluster.nodes_of_hosts().items():
            for node in nodes:
                if has.setdefault(node, name) != name:
                    self._complain(f"hosts {has[node]} and {name} both have node {node}")

    def _ended(self, asked: Asked) -> None:
        """An accepted job is known to its end, with a result, and fails only if a host was away for too long."""
        if asked.refused is not None:
            self._complain(f"{asked.id} is {'lost' if asked.accepted else 'refused'}: {asked.refused}")
        elif asked.status == "failed":
            if not self._has_lost_a_host(asked):
                self._complain(f"{asked.id} failed: {asked.message}")
        elif asked.result is None and asked.status not in ("deadline", "cancelled"):
            self._complain(f"{asked.id} is {asked.status}, but has no result")

    def _has_lost_a_host(self, asked: Asked) -> bool:
        return self._may_lose_hosts and "has been away for" in (asked.message or "")

    def _told(self, asked: Asked, result: dict[str, Any]) -> None:
        """The result is not worse than the best that the client was told in the last epoch, of the problem as it is."""
        changed = max((each["epoch"] for each in result["directives"] if each["do"] == "update"), default=0)
        told = [each for _, each in asked.told if each.job == asked.number and each.epoch >= changed]
        best = min((each.fitness for each in told if each.epoch == max(one.epoch for one in told)), default=None)
        if best is not None and (result["fitness"] is None or result["fitness"] > best):
            self._complain(f"{asked.id}: its fitness is {result['fitness']}, but the client was told {best}")

    def _changed(self, asked: Asked, result: dict[str, Any]) -> None:
        """Changes that were answered are among the directives."""
        done = {each["do"] for each in result["directives"]}
        if asked.changed - done:
            self._complain(f"{asked.id}: {sorted(asked.changed)} were answered, but its directives are {sorted(done)}")

    def _is_whole(self, asked: Asked, result: dict[str, Any]) -> None:
        """A job that is exhausted has bred all its generations.

        In async mode each cell leaves an epoch after another generation, so nobody knows that of a later epoch.
        """
        done, run = {each["do"] for each in result["directives"]}, asked.file.run
        is_known = "restart" not in done if run.mode == "lockstep" else not done
        if asked.status == "exhausted" and is_known and result["generations"] < run.generations:
            self._complain(f"{asked.id} has ended after {result['generations']} generations, for no reason")

    def _repeats(self, asked: Asked, result: dict[str, Any]) -> None:
        """A result in lockstep is that of a replay, so all cells have stopped after the same generation.

        A part of its history may be unknown if cells have died as an epoch began, or before a coordinator took over.
        Its best answer may be one that the client was told by a cell that has died since and did not go on exactly: a
        replay does not know of that.
        """
        done = {each["do"] for each in result["directives"]}
        if asked.file.run.mode != "lockstep" or "restart" in done or not result["generations"]:
            return
        if result["history_sha256"] is None:
            if not (done & _OF_DEATHS or self._may_lose_histories):
                self._complain(f"{asked.id}: its history is not known")
            return  # a replay may not end, without the stop that some cells have not told
        expected = _expected(_Key(asked.file), json.dumps(result["directives"], sort_keys=True))
        if isinstance(expected, str):
            self._complain(f"{asked.id}: it cannot be repeated: {expected}")
            return
        history, fitness, reasons = expected
        if history != result["history_sha256"]:
            self._complain(f"{asked.id}: its history is {result['history_sha256']}, a replay's is {history}")
        best = result["fitness"]
        may_be_better = "retry" in done or self._was_told(asked, best)  # a replay tells the last attempt's fitness
        if fitness is not None and best != fitness:
            if not (may_be_better and best < fitness):
                self._complain(f"{asked.id}: its fitness is {best}, a replay's is {fitness}")
        elif asked.status in _BY_ITSELF and asked.status != (status := _status(asked.file, result, expected)):
            self._complain(f"{asked.id} is {asked.status}, but a replay is {status}, by {reasons}")

    def _was_told(self, asked: Asked, best: float | None) -> bool:
        """Return whether the client was told this fitness, if cells may have died, and the problem was not changed."""
        told = any(each.job == asked.number and each.fitness == best for _, each in asked.told)
        return told and self._may_lose_cells and "update" not in asked.changed


class _Begun(NamedTuple):
    """The cell that a process has begun, the latest if several.

    Attributes:
        place: job, epoch, number of the wiring, and cell.
        assignment: weak, since an assignment may hold a query that ends when nobody knows it any more.
    """

    place: tuple[int, int, int, int]
    assignment: ref[Assignment]


class _Key:
    """A problem file as a key of a cache."""

    def __init__(self, file: ProblemFile) -> None:
        self.file = file
        self._text = file.to_json()

    def __hash__(self) -> int:
        return hash(self._text)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other._text == self._text


@cache
def _expected(key: _Key, directives: str) -> Repetition | str:
    """Return what comes of a run with these directives, or why they cannot be repeated."""
    try:
        return repeated(key.file, json.loads(directives))
    except BadInput as error:
        return str(error)


def _status(file: ProblemFile, result: dict[str, Any], expected: Repetition) -> Status:
    """Return how a run ends, as the spy judges it: what came of its answer counts before the reasons of the stop."""
    target, last = file.run.target, file.run.generations
    if target is not None and expected.fitness is not None and expected.fitness <= target:
        return "solved"
    if not expected.reasons or result["generations"] == last:
        return "exhausted"
    return STATUS_OF[expected.reasons[0]]
