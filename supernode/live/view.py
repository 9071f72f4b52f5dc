"""The dashboard's model of the cluster: the latest of everything that was received, so that it does not grow."""

import math
import time
from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import topologies
from coordinator.jobs.states import BREEDING, ENDS
from supernode.client.job_feed import improvement_in
from wire.keys import Keys
from wire.news import Counters, Improvement, LogRecord, Statistics, period_of_reports
from wire.plain import plain
from wire.strict import Rejected

SHOWN_FOR = 2.0  # seconds that a death, and then an arrival, is shown at least: a node is often replaced sooner
_LINES = 50  # log records and events that are kept
_FOLLOWED = 64  # jobs whose statistics are kept
_NEEDED = itemgetter("number", "job", "status", "cells", "topology")  # what the list of jobs must hold of each
_MOST_NODES = 1 << 16  # greater numbers of nodes are ignored: the table has a row for each number up to the greatest
_OF_PROCESS = ("host", "memory")  # taken from the answer to `status`; what it says of a job may be out of date
_TICK = 1.0  # seconds between two calls of `news`, about
_SIGNIFICANT = 6  # digits: enough for a heat map


@dataclass
class _Node:
    """One node: its process, and what it reported last.

    Attributes:
        process: the id of its process, None while it has none.
        lost: the id of the process that vanished last, None once another one has come.
        came: when its process came, by the monotonic clock.
        died: when its last process vanished.
        deaths: how many of its processes have died.
        counters: its latest counters.
        status: its part of the latest answer to `status`.
    """

    process: str | None = None
    lost: str | None = None
    came: float = -math.inf
    died: float = -math.inf
    deaths: int = 0
    counters: Counters | None = None
    status: Mapping[str, Any] | None = None

    def counters_of_now(self, ended: Collection[int]) -> Counters | None:
        """Return the latest counters, or None if they are of a job that has ended (one of the numbers ``ended``)."""
        return None if self.counters is None or self.counters.job in ended else self.counters

    def state(self, now: float) -> str:
        if now - self.died < SHOWN_FOR or (self.process is None and self.died > -math.inf):
            return "dead"
        if self.process is None or now - max(self.came, self.died + SHOWN_FOR) < SHOWN_FOR:
            return "joining"
        return "alive"


@dataclass(frozen=True, eq=False)  # compared by identity: an equal one that arrives later is another one
class Heard:
    """An improvement as it was received.

    Attributes:
        improvement: the improvement.
        at: when it was received, Unix time, s.
    """

    improvement: Improvement
    at: float

    def plain(self) -> dict[str, Any]:
        """Return its fields, with ``at``, as plain values."""
        values: dict[str, Any] = plain(vars(self.improvement) | {"at": self.at})
        return values


class View:
    """The cluster as it is known now. Only one asyncio loop may use it.

    Attributes:
        answers: whether the cluster answers.
        trouble: why it does not.
        cluster: its name.
        jobs: the newest jobs, newest last.
        counts: how many jobs are in each state.
        placements: how jobs are spread over hosts, as `status` has it.
        unprotected: endpoints where whoever reaches them can use the cluster.
        statistics: the latest statistics of each job that is followed, by the job's number.
    """

    def __init__(self) -> None:
        self.answers = False
        self.trouble: str | None = None
        self.cluster: str | None = None
        self.jobs: Sequence[Mapping[str, Any]] = ()
        self.counts: Mapping[str, int] = {}
        self.placements: Sequence[Mapping[str, Any]] = []
        self.unprotected: Sequence[str] = []
        self.statistics: dict[int, Statistics] = {}
        self._best: dict[int, Heard] = {}
        self._improved = 0  # improvements received
        self._nodes: dict[int, _Node] = {}
        self._lines: deque[dict[str, Any]] = deque(maxlen=_LINES)
        self._line = 0
        self._began = time.monotonic()
        self._nodes_due = 0.0
        self._stirred = False  # whether a node has appeared or vanished since the nodes were shown
        self._told: tuple[int, int, bool, str | None] | None = None  # what the latest news contained besides the nodes

    def begin(self) -> None:
        """Begin with a new link: all nodes are reported anew, and another cluster's jobs may have the same numbers."""
        self._nodes.clear()
        self._best.clear()
        self._began = time.monotonic()

    # What is received -------------------------------------------------------------------------------------------------
    def hear_counters(self, payload: bytes) -> None:
        """Take a message with the counters of many nodes."""
        for counters in Counters.decode_all(payload):
            if counters.node < _MOST_NODES:
                self._nodes.setdefault(counters.node, _Node()).counters = counters

    def hear_statistics(self, payload: bytes) -> None:
        """Take the spy's statistics of a job."""
        statistics = Statistics.decode(payload)
        _keep(self.statistics, statistics.job, statistics)

    def hear_improvement(self, improvement: Improvement) -> None:
        """Take a verified improvement."""
        self._improved += 1
        _keep(self._best, improvement.job, Heard(improvement, time.time()))

    def hear_log(self, payload: bytes) -> None:
        """Take a log record, a warning or an error, of some process."""
        record = LogRecord.decode(payload)
        self._say(record.level, f"{record.process}: {record.text}")

    def hear_life(self, key: str, is_there: bool) -> None:
        """Take the appearance or the loss of a process's liveliness token, if it is a node's."""
        try:
            number, _ = Keys.life_of(key)
        except Rejected:
            return
        if number is None or number >= _MOST_NODES:
            return
        self._stirred = True
        node, process = self._nodes.setdefault(number, _Node()), key.rpartition("/")[2]
        if is_there:
            self._came(number, node, process)
        elif node.process == process:
            self._gone(number, node)

    def _came(self, number: int, node: _Node, process: str) -> None:
        now = time.monotonic()
        # The tokens of all nodes are lost when the router dies. If the same process's token returns, it has not died.
        if node.lost == process:
            node.died, node.deaths = -math.inf, node.deaths - 1
        elif node.process not in (None, process):  # the successor's token arrived before the old one was lost
            self._gone(number, node)
        if node.deaths and node.process != process:
            self._say("info", f"node {number} is alive again")
        is_new = node.deaths > 0 or now - self._began > SHOWN_FOR
        node.process, node.lost, node.came = process, None, now if is_new else -math.inf

    def _gone(self, number: int, node: _Node) -> None:
        node.process, node.lost, node.counters = None, node.process, None
        node.died, node.deaths = time.monotonic(), node.deaths + 1
        self._say("warning", f"node {number} is dead")

    def hear_status(self, status: Mapping[str, Any]) -> None:
        """Take the answer to `status`: which nodes there are; one that has just come may not be among them yet."""
        self.cluster, self.counts = status["cluster"], status["jobs"]
        self.placements = status.get("placements", [])
        self.unprotected = status.get("unprotected", [])
        listed = {each["node"]: each for each in status["nodes"]}
        for number in self._nodes.keys() - listed.keys():
            if self._nodes[number].process is None:
                del self._nodes[number]
        for number, each in listed.items():
            self._nodes.setdefault(number, _Node()).status = each

    def hear_jobs(self, jobs: Sequence[Mapping[str, Any]], all_of_them: bool = False) -> None:
        """Take the newest jobs, newest last; if they are ``all_of_them``, count their states here, without `status`."""
        for job in jobs:
            _NEEDED(job)  # raises KeyError: a list that cannot be shown must not be kept
        before = {job["number"]: job["status"] for job in self.jobs}
        for job in jobs if before else ():
            if before.get(job["number"]) != job["status"]:
                self._say("info", f"job {job['job']}: {job['status']}")
        self.jobs = jobs
        if all_of_them:
            self.counts = Counter(job["status"] for job in jobs)

    def lost(self, trouble: str) -> None:
        """Note that the cluster does not answer, and why."""
        if self.answers:
            self._say("error", trouble)
        self.answers, self.trouble = False, trouble

    def found(self) -> None:
        """Note that the cluster answers."""
        self.answers, self.trouble = True, None

    # What is shown ----------------------------------------------------------------------------------------------------
    def snapshot(self) -> dict[str, Any]:
        """Return everything that pages show of the cluster as a whole, as plain values."""
        return self._brief() | {"nodes": plain(self._table())}

    def news(self) -> dict[str, Any] | None:
        """Return what has changed, or None if nothing has.

        It is a whole snapshot whenever nodes report (a thousand of them every four seconds), since drawing it costs the
        browser time. A node that has come or gone is shown at once. Log lines, improvements and a change of whether the
        cluster answers are shown at once as well, but without the nodes.
        """
        due, told = self._stirred or time.monotonic() >= self._nodes_due, self._told
        self._told = (self._line, self._improved, self.answers, self.trouble)
        if not due:
            return self._brief() if self._told != told else None
        self._stirred, self._nodes_due = False, time.monotonic() + period_of_reports(self._places()) - _TICK / 2
        return self.snapshot()

    def _brief(self) -> dict[str, Any]:
        rows, columns = self._shape()
        shown = {
            "at": time.time(),
            "answers": self.answers,
            "trouble": self.trouble,
            "cluster": self.cluster,
            "rows": rows,
            "columns": columns,
            "jobs": list(self.jobs),
            "counts": dict(self.counts),
            "placements": list(self.placements),
            "unprotected": list(self.unprotected),
            "statistics": {number: each._asdict() for number, each in self.statistics.items()},
            "lines": list(self._lines),
        }
        return {name: plain(value) for name, value in shown.items()}

    def alive(self) -> int:
        """Return how many nodes are alive."""
        now = time.monotonic()
        return sum(node.state(now) == "alive" for node in self._nodes.values())

    def running(self) -> dict[str, Statistics]:
        """Return the statistics of the jobs that run, by the job's id."""
        running = [job for job in self.jobs if job["status"] in BREEDING and job["number"] in self.statistics]
        return {job["job"]: self.statistics[job["number"]] for job in running}

    def improvements(self) -> dict[int, Heard]:
        """Return the latest improvement of each job that is followed, by the job's number."""
        return dict(self._best)

    def heard_of(self, job: str) -> Any:
        """Return what was last received about a job; it compares equal as long as the cluster need not be asked again.

        A better fitness is no reason to ask: `completed` knows it.
        """
        line = next((each for each in self.jobs if each["job"] == job), None)
        if line is None:
            return None
        statistics, best = self.statistics.get(line["number"]), self._best.get(line["number"])
        epochs = (None if statistics is None else statistics.epoch, None if best is None else best.improvement.epoch)
        return {name: value for name, value in line.items() if name != "fitness"}, epochs

    def completed(self, told: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the cluster's answer about a job, with the latest improvement if that is better than its best.

        Spy and coordinator are separate processes: the coordinator may answer before it has received an improvement
        that is known here.
        """
        best = self._best.get(told["number"])
        # An improvement of another epoch may answer another problem than that of ``told``.
        if best is None or best.improvement.epoch != told["epoch"]:
            return told
        if told["best"] is not None and best.improvement.order <= improvement_in(told["best"]).order:
            return told
        latest = plain(vars(best.improvement))
        return {**told, "best": latest, "fitness": latest["fitness"]}

    def node(self, number: int) -> dict[str, Any] | None:
        """Return everything about one node; None if it is not known."""
        node = self._nodes.get(number)
        if node is None:
            return None
        now = node.counters_of_now(self._ended())
        told = {} if now is None else plain(now._asdict())
        status = {name: value for name, value in (node.status or {}).items() if name in _OF_PROCESS}
        names = {job["number"]: job["job"] for job in self.jobs}
        known = {"node": number, "state": node.state(time.monotonic()), "deaths": node.deaths, "process": node.process}
        return status | told | known | {"job": names.get(told.get("job"))}

    def _table(self) -> dict[str, list[Any]]:
        """Return the nodes by column, which is compact: a thousand are sent each time. Row i is node i."""
        now, ended = time.monotonic(), self._ended()
        nodes = [self._nodes.get(number) for number in range(self._places())]
        told = [None if node is None else node.counters_of_now(ended) for node in nodes]
        states = ["absent" if node is None else node.state(now) for node in nodes]
        table: dict[str, list[Any]] = {"node": list(range(len(nodes))), "state": states}
        for name in ("cell", "job", "generation", "champion", "best", "age", "sent"):
            table[name] = [None if each is None else _short(getattr(each, name)) for each in told]
        return table

    def _places(self) -> int:
        """Return how many rows the table of nodes has: one more than the greatest number of a node."""
        return max(self._nodes, default=-1) + 1

    def _ended(self) -> set[int]:
        return {job["number"] for job in self.jobs if job["status"] in ENDS}

    def _shape(self) -> tuple[int, int]:
        """Return rows and columns: those of the newest job that runs on all nodes, else of the most square torus."""
        count = self._places()
        specs = [job["topology"] for job in self.jobs if job["cells"] == count and job["status"] in BREEDING]
        return shape_of(specs[-1] if specs else topologies.torus_of(max(1, count)))

    def _say(self, level: str, text: str) -> None:
        self._line += 1
        self._lines.append({"number": self._line, "at": time.time(), "level": level, "text": text})


def shape_of(spec: str) -> tuple[int, int]:
    """Return the rows and columns to draw a topology in: its own, or those of the most square torus."""
    topology = topologies.parse(spec)
    if not hasattr(topology, "rows"):
        topology = topologies.parse(topologies.torus_of(topology.cells))
    return getattr(topology, "rows"), getattr(topology, "columns")  # noqa: B009 - only grids have them


def wraps(spec: str) -> bool:
    """Return whether a drawing of the topology may cross its edges; never if it is drawn in another one's shape."""
    return getattr(topologies.parse(spec), "wraps", False)


def _keep(table: dict[int, Any], job: int, value: Any) -> None:
    """Keep the latest value of a job, and drop the job that was updated longest ago if there are too many."""
    table.pop(job, None)
    table[job] = value
    if len(table) > _FOLLOWED:
        del table[next(iter(table))]


def _short(value: float) -> float:
    return value if isinstance(value, int) else float(f"{value:.{_SIGNIFICANT}g}")
