"""What a trial does: a cluster, its network, the jobs of a client, and the faults."""

import json
from dataclasses import asdict, dataclass
from typing import Any, Literal

import topologies
from problems.run import MOST_GENERATIONS
from supernode.chaos.simulated.network import Weather
from wire.jobs import Cancel, Request, Rewire, Update

_LEAST_LOST = 9.5  # seconds; a host counts as gone a little later
_BACK_WITHIN = 1.0  # seconds from the end of a fault until a process is surely seen again
DRAINED_WITHIN = 25.0
"""Seconds from SIGTERM until a host ends whatever jobs need."""
LATENCIES = (0.2e-3, 1e-3, 4e-3)  # seconds, one for each trial
AFTER = 3.0  # latencies from an event to a fault that waits for it, in the mean
SHORTEST_WORK = 0.1e-3  # seconds of a generation
PROPOSER, NEIGHBOUR = "the proposer", "a neighbour of the proposer"


@dataclass(frozen=True)
class Fault:
    """Something that happens to the cluster.

    Attributes:
        at: seconds since the cluster was ready, or since the event ``upon``.
        do: "kill"; "stop" for a while; "part", which cuts ``whom`` off from ``other`` for a while; "hold", which
            holds back what ``whom`` sends to ``other`` for a while; "disk", whose writes
            fail for a while; "weather", which changes the network for a while; or "leave", which has a host end.
        whom: the name of a process or a host; upon a proposal also `PROPOSER` or `NEIGHBOUR`.
        seconds: for how long; for a host that is killed or leaves, until it is started again.
        other: the name of another process.
        weather: the network's faults meanwhile.
        upon: "question", the ``count``-th one of coordinators; the name of a command, the ``count``-th such question;
            or "proposal": so many cells have proposed to stop.
        count: the number of that event.
    """

    at: float
    do: Literal["kill", "stop", "part", "hold", "disk", "weather", "leave"]
    whom: str = ""
    seconds: float = 0.0
    other: str = ""
    weather: Weather | None = None
    upon: str = ""
    count: int = 0

    def __str__(self) -> str:
        lasting = f" for {self.seconds:.3f} s" if self.seconds else ""
        from_whom = f" from {self.other}" if self.other else ""
        upon = f" after {self.upon} {self.count}" if self.upon else ""
        return f"{self.do} {self.whom or self.weather or ''}{from_whom}".rstrip() + lasting + upon


@dataclass(frozen=True)
class PlannedHost:
    """A host that joins ``at`` seconds after the world began; without an ``endpoint`` the router reaches it."""

    at: float
    name: str
    nodes: int
    endpoint: str


@dataclass(frozen=True)
class PlannedJob:
    """A job that a client submits ``at`` seconds after the cluster is ready, and the settings of its run.

    Without a stall or a target that can be reached it ends after its last generation, or by a fault or a request.
    """

    at: float
    topology: str
    mode: str
    seed: int
    deme: int
    generations: int
    seconds: float | None
    target: float = -1.0
    stall: int = MOST_GENERATIONS - 1
    restarts: int | None = None

    def settings(self) -> dict[str, Any]:
        """Return the settings for `ProblemFile.with_run`."""
        settings = asdict(self)
        del settings["at"]
        return settings


@dataclass(frozen=True)
class PlannedRequest:
    """A request about a job that the client sends ``at`` seconds after the cluster is ready.

    Attributes:
        do: "cancel", "rewire" (as a ring), or "update" (of the function that is to be minimized).
        job: the number of the job among those of the plan.
        function: of an update, the function that is to be minimized from then on.
    """

    at: float
    do: Literal["cancel", "rewire", "update"]
    job: int
    function: Literal["sphere", "rastrigin"] = "sphere"

    def of(self, id: str, job: PlannedJob) -> Request:
        """Return the request, for the job of that id."""
        if self.do == "cancel":
            return Cancel(id)
        if self.do == "rewire":
            return Rewire(id, f"ring {topologies.parse(job.topology).cells}")
        return Update(id, json.dumps({"name": self.function}))


@dataclass(frozen=True)
class Plan:
    """What a trial does, all drawn from its seed.

    Attributes:
        seed: also of everything that is drawn while the trial runs.
        topology: of the cluster.
        hosts: of a cluster that hosts join; empty if one zygote launches all nodes.
        jobs: what clients submit.
        requests: what clients ask for later.
        latency: mean seconds of a message on a link, in fair weather.
        work: mean seconds of a node's generation.
        faults: in the order of their times.
    """

    seed: int
    topology: str
    hosts: tuple[PlannedHost, ...]
    jobs: tuple[PlannedJob, ...]
    requests: tuple[PlannedRequest, ...]
    latency: float
    work: float
    faults: tuple[Fault, ...]

    @property
    def timed(self) -> list[Fault]:
        """The faults that come at a time, not upon an event."""
        return [fault for fault in self.faults if not fault.upon]

    @property
    def loses_hosts(self) -> bool:
        """Whether some host may stay away for so long, by one fault after another, that it counts as gone."""
        return any(self._longest_away(host.name) > _LEAST_LOST for host in self.hosts)

    def _longest_away(self, host: str) -> float:
        """Return for how many seconds a host is out of reach at most, without a break that is sure."""
        timed = self.timed
        at_any_time = [fault for fault in self.faults if fault.upon and fault.whom in (host, "router")]
        back = _BACK_WITHIN * (1 + len(at_any_time)) + sum(fault.seconds for fault in at_any_time)
        back += sum(DRAINED_WITHIN for fault in at_any_time if fault.do == "leave")
        away = [fault for fault in timed if fault.whom in (host, "router") and fault.do != "leave"]
        spans = [(fault.at, fault.at + fault.seconds + back) for fault in away]
        leaves = [fault for fault in timed if fault.whom == host and fault.do == "leave"]
        spans += [(fault.at, fault.at + DRAINED_WITHIN + fault.seconds + back) for fault in leaves]
        longest, until = 0.0, -1.0
        began = 0.0
        for start, end in sorted(spans):
            began, until = (start, end) if start > until else (began, max(until, end))
            longest = max(longest, until - began)
        return longest
