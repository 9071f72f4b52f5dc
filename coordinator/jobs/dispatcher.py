"""Run jobs on the nodes of one cluster: as many at once as there are free nodes for, each conducted on its own thread.

The dispatcher reports everything that happens to `Hooks`, which store or publish it; a `LocalCluster` needs none.

Any thread may call it. One re-entrant lock guards the scheduler, the wirings and the table of jobs. While it is held,
no hook that waits for the disk is called, and no conductor is joined.
"""

import itertools
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import zenoh

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.alarms import NO_JOB, Alarms
from coordinator.jobs.calls import tell
from coordinator.jobs.client_limits import NO_LIMITS, ClientLimits
from coordinator.jobs.conductor import Conductor
from coordinator.jobs.forgetting import Forgetting
from coordinator.jobs.growing import Growing
from coordinator.jobs.hooks import Hooks, NoHooks
from coordinator.jobs.job import Failure, JobEntry, JobSpec, Placement, Returned, StopRequest
from coordinator.jobs.listener import Listener
from coordinator.jobs.node_hosts import NodeHosts
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.jobs.scheduler import Placed, Scheduler
from spy.improvement_records import ImprovementRecord
from spy.result import Result
from wire.control import Drop, Wiring
from wire.keys import Keys
from wire.news import Improvement
from wire.seal import Seal

_BEGUN_WITHIN = 5.0  # seconds: a thread that was created has begun by then
_LOOK_AGAIN = 0.01  # seconds


class Dispatcher:
    """Runs the jobs of one cluster.

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        seal: signs commands; the cluster's processes obey only sealed ones.
        topology: the topology of the nodes.
        wired: whether the nodes have the links of that topology; if not, their links are unknown.
        hooks: called with everything that happens; if None, the jobs' own event queues are filled instead.
        cpu_seconds: returns the CPU time that each process has used so far, by name.
        seconds_to_ready: how long the cluster took to start, for results.
        replaces: whether dead processes are replaced.
        checked: whether problems are checked before they are submitted.
        eval_timeout: how many seconds an evaluation may go on once its job is stopped.
        limits: what each client may take.
        first_wiring: a wiring number that these nodes have not had yet.
        expected: for a cluster whose nodes `join`, the least number of nodes expected; ``topology`` is unused then.

    Attributes:
        jobs: the jobs that have not ended, by number.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        seal: Seal,
        topology: str,
        *,
        wired: bool = True,
        hooks: Hooks | None = None,
        cpu_seconds: Callable[[], dict[str, float]] = dict,
        seconds_to_ready: float = 0.0,
        replaces: bool = False,
        checked: bool = False,
        eval_timeout: float = EVAL_TIMEOUT,
        limits: ClientLimits = NO_LIMITS,
        first_wiring: int = 1,
        expected: int | None = None,
    ) -> None:
        self.session, self.keys, self._seal = session, keys, seal
        self.hooks: Hooks = hooks or NoHooks()
        self._told = hooks is None  # else nobody would empty the jobs' event queues
        self.cpu_seconds = cpu_seconds
        self.seconds_to_ready = seconds_to_ready
        self._make_conductor = partial(Conductor, replaces=replaces, checked=checked, eval_timeout=eval_timeout)
        self.topology = topology
        self.jobs: dict[int, JobEntry] = {}
        self._lock = threading.RLock()
        self._failure: str | None = None  # why no job can run any more
        self._node_hosts = NodeHosts()
        # These only read: each node's host is one entry, so they need no lock.
        self.hosts_of, self.wiring_of = self._node_hosts.hosts_of, self._node_hosts.wiring
        self._wirings: dict[int, tuple[str, Wiring]] = {}  # by node, its latest links; none of a replaced node
        nodes = () if expected is not None else tuple(range(topologies.parse(topology).cells))
        joining, place_of = expected is not None, self._node_hosts.place_of
        self._scheduler = Scheduler(
            expected or len(nodes), limits, joining=joining, place_of=place_of, clock=time.monotonic
        )
        if wired and nodes:
            self._scheduler.wired(nodes, topology)
            self._wirings = dict.fromkeys(nodes, (topology, Wiring(0, nodes)))
        self._numbers = itertools.count(first_wiring)
        self._threads: dict[int, threading.Thread] = {}
        self._conductors: dict[int, Conductor] = {}
        self._forgetting = Forgetting(session, keys, seal)
        self._deadlines = Alarms(self._end_at_deadline)
        self._look_again = Alarms(lambda _: self._start())
        self._growing = Growing(self._lock, self._scheduler, self.jobs)
        self._listener = Listener(session, keys, self.jobs, self._conductors, self.hooks)

    # Orders -----------------------------------------------------------------------------------------------------------
    def submit(self, spec: JobSpec, *, accepted_before: bool = False) -> JobEntry:
        """Put a job into the queue; it runs when there are enough free nodes.

        A job ``accepted_before``, by a coordinator that died, starts over; it is queued even if the queue is full.

        Raises:
            TooLarge: if the cluster has too few nodes, or one client may have too few.
            QueueFull: if too many jobs wait.
            ClusterFailed: if the cluster has failed, or is closed.
            BadInput: if the job's log cannot be written.
        """
        job = JobEntry(spec, self._told, self.cancel)
        topology = topologies.parse(spec.file.run.topology)
        if accepted_before:  # some nodes may still hold the job; those that do must forget it before it starts over
            tell(self.session, self._seal, self.keys.every_control, Drop(spec.number))
        with self._lock:
            if self._failure is not None:
                raise ClusterFailed(self._failure)
            wants = topology.cells, topology.spec, spec.priority, spec.client
            self._scheduler.add(spec.number, *wants, accepted_before=accepted_before)
            self.jobs[spec.number] = job
        self.hooks.changed(spec.number, "queued", ())  # before `_start`: its conductor reports the next state
        self._set_deadline(spec)
        self._start()
        return job

    def adopt(self, spec: JobSpec, placement: Placement) -> JobEntry:
        """Take over a job that runs already, from a dead coordinator. Raise ValueError if its nodes are not free."""
        job = JobEntry(spec, self._told)
        with self._lock:
            topology = placement.file.run.topology
            wiring = self._node_hosts.taken_over(placement.wiring, placement.nodes)  # first: its links may be open
            self._scheduler.occupy(spec.number, placement.nodes, topology, spec.client)
            self._wirings |= dict.fromkeys(wiring.nodes, (topology, wiring))
            self.jobs[spec.number] = job
        self._set_deadline(spec)
        self._conduct(job, placement.nodes, placement)
        return job

    def _set_deadline(self, spec: JobSpec) -> None:
        if (seconds := spec.file.run.seconds) is not None:
            self._deadlines.set(spec.number, spec.submitted + seconds)

    def _end_at_deadline(self, number: int) -> None:
        """End a job at its deadline: clients get the best answer now, its nodes stop when they can. Alarms' thread."""
        with self._lock:
            job = self.jobs.get(number)
            if job is None:
                return
            waiting = self._scheduler.remove(number)
            self.hooks.changed(number, "deadline", self._scheduler.nodes_of(number) or ())
        job.queue.put(StopRequest("deadline"))
        if waiting:
            self._conduct(job, ())  # without nodes: only to make its result

    def cancel(self, number: int) -> None:
        """Stop a job; one that still waits ends at once. Harmless if the job has ended."""
        with self._lock:
            job = self.jobs.get(number)
            waiting = self._scheduler.remove(number)
        if job is not None:
            job.queue.put(StopRequest("cancel"))
            if waiting:
                self._conduct(job, ())  # without nodes: only to make its result

    def update(self, number: int, fields: dict[str, Any]) -> int:
        """Replace fields of a job's problem; return the number of the new epoch once all nodes are prepared for it.

        Raises:
            BadInput: if the changed problem is not valid.
            ClusterFailed: if the job has ended.
        """
        return self._running(number).update(**fields)

    def rewire(self, number: int, topology: str) -> int:
        """Change a job's topology, which begins another epoch; return the number of that epoch. See `update`."""
        return self._running(number).rewire(topology)

    def _running(self, number: int) -> JobEntry:
        with self._lock:
            if number not in self.jobs:
                raise ClusterFailed(f"job {number} has ended")
            return self.jobs[number]

    def place_of(self, node: int) -> tuple[JobEntry | None, int | None]:
        """Return the job that a node belongs to, and its cell there; None twice if it is free."""
        with self._lock:
            for number, job in self.jobs.items():
                if node in (nodes := self._scheduler.nodes_of(number) or ()):
                    return job, nodes.index(node)
        return None, None

    def fail(self, message: str, closing: bool = False) -> None:
        """Fail every job, also later ones: a process died that is not replaced, or the cluster is ``closing``."""
        with self._lock:
            self._failure = self._failure or message
            for job in self.jobs.values():
                job.queue.put(Failure(self._failure, closing))
            waiting = [job for job in self.jobs.values() if self._scheduler.remove(job.spec.number)]
        for job in waiting:
            self._conduct(job, ())

    def replaced(self, node: int | None, crash: str = "") -> None:
        """Tell jobs that a process has replaced that of a node (None: of the spy); see `JobEntry.replaced`."""
        with self._lock:
            if node is not None:  # the new process has no links
                self._scheduler.replaced(node)
                self._wirings.pop(node, None)
            for job in self.jobs.values():
                nodes = self._scheduler.nodes_of(job.spec.number)
                if nodes is not None and (node is None or node in nodes):
                    job.replaced(node, crash)

    def returned(self, node: int) -> None:
        """Tell the job of a node that the node was cut off and is back."""
        if (job := self.place_of(node)[0]) is not None:
            job.queue.put(Returned(node))

    def joined(self, node: int) -> None:
        """Add a node to the cluster. Harmless if it is there already."""
        with self._lock:
            self._scheduler.join([node])
        self.returned(node)  # to a job that was taken over while its host was out of reach
        self._start()

    def left(self, nodes: Iterable[int], why: str) -> None:
        """Remove nodes that are gone for good; the jobs that have one of them fail with the message ``why``."""
        with self._lock:
            self._node_hosts.leave(nodes)
            for node in nodes:
                self._wirings.pop(node, None)
            for number in self._scheduler.leave(nodes):
                self.jobs[number].queue.put(Failure(why))

    def wait(self) -> None:
        """Wait until every job has ended."""
        while self._threads:
            for number, thread in list(self._threads.items()):
                if not _joined(thread):
                    self._threads.pop(number, None)

    # For conductors, on their threads ---------------------------------------------------------------------------------
    @property
    def cluster_nodes(self) -> int:
        """The number of nodes in the cluster, busy or free."""
        with self._lock:
            return len(self._scheduler.here)

    def wire(self, nodes: tuple[int, ...], topology: str, fresh: bool = False) -> Wiring:
        """Return the links for an epoch: the existing ones if all its nodes share them, else (or if ``fresh``) new."""
        with self._lock:
            known = {self._wirings.get(node) for node in nodes}
            for spec, wiring in [each for each in known if each is not None]:
                if len(known) == 1 and not fresh and spec == topology and wiring.nodes == nodes:  # in this order too
                    return wiring
            wiring = self._node_hosts.wiring(self._node_hosts.number(self._numbers, nodes), nodes)
            self._wirings |= dict.fromkeys(wiring.nodes, (topology, wiring))
            return wiring

    def open_links(self, node: int, wirings: Sequence[int]) -> None:
        """Note the wirings whose links a node has, which a coordinator before this one has made."""
        with self._lock:
            self._node_hosts.open_links(node, wirings)

    def end_silent(self, nodes: Sequence[int], seconds: float) -> None:
        """Do nothing: whoever runs this cluster ends it when its job has ended."""

    def changed(self, job: JobEntry, status: str) -> None:
        """Pass on that the job has entered another state."""
        self.hooks.changed(job.spec.number, status, self._scheduler.nodes_of(job.spec.number) or ())

    def placed(self, job: JobEntry, placement: Placement) -> None:
        """Pass on that the job is about to begin an epoch, and note how its nodes are linked from now on."""
        with self._lock:
            self._node_hosts.begun(placement.wiring, placement.nodes)
            if placement.epoch > 0:
                self._scheduler.rewired(job.spec.number, placement.file.run.topology)
        self.hooks.placed(job.spec.number, placement)

    def improved(self, job: JobEntry, better: Improvement) -> None:
        """Pass on a better answer."""
        self.hooks.improved(job.spec.number, better)

    def lived(self, job: JobEntry, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """Pass on the improvements of an epoch that has ended."""
        self.hooks.lived(job.spec.number, epoch, records)

    # Conductors and their threads -------------------------------------------------------------------------------------
    def _start(self) -> None:
        """Start the queued jobs for which there are nodes now. Called whenever a job comes or nodes become free."""
        with self._lock:
            placed: list[Placed] = self._scheduler.start()
            if (again_at := self._scheduler.look_again_at) is not None:
                self._look_again.set(NO_JOB, again_at)
        for number, nodes in placed:
            self._conduct(self.jobs[number], nodes)
        self._growing.look_soon()

    def _conduct(self, job: JobEntry, nodes: tuple[int, ...], adopted: Placement | None = None) -> None:
        """Conduct a job on a thread of its own; one without nodes ends at once, as the message in its queue says."""
        thread = threading.Thread(target=self._run, args=(job, nodes, adopted), daemon=True)
        thread.name = f"conductor {job.spec.number}"
        with self._lock:
            self._threads[job.spec.number] = thread
            thread.start()

    def _run(self, job: JobEntry, nodes: tuple[int, ...], adopted: Placement | None) -> None:
        """Conduct a job to its end, on the conductor's thread; this returns normally whatever happens."""
        outcome: Result | Exception
        try:
            conductor = self._make_conductor(job, self.session, self._seal, self.keys, nodes, self, adopted=adopted)
            self._conductors[job.spec.number] = conductor
            outcome = conductor.conduct(self.seconds_to_ready, self.cpu_seconds)
        except Exception as error:  # a mistake in the problem or here; clients that wait must get it as the outcome
            outcome = error
        number = job.spec.number
        self._deadlines.forget(number)
        forget = self._forgetting.after(number, outcome) if nodes else lambda: None
        with self._lock:
            self._scheduler.free(number)
            self.jobs.pop(number, None)
            self._conductors.pop(number, None)
        self.hooks.ended(number, outcome, forget)
        job.end(outcome)
        self._start()  # before this thread counts as ended: `wait` must see the threads of jobs that start now
        with self._lock:
            self._threads.pop(number, None)


def _joined(thread: threading.Thread) -> bool:
    """Join a thread; return whether it ever ran.

    Ctrl-C may have interrupted `Thread.start`. `Thread.join` raises for a thread that has not begun yet, and also for
    one whose system thread was never created. CPython does not tell the two apart, so this tries again for a while.
    """
    until = time.monotonic() + _BEGUN_WITHIN
    while True:
        try:
            thread.join()
        except RuntimeError:
            if time.monotonic() >= until:
                return False
            time.sleep(_LOOK_AGAIN)
        else:
            return True
