"""A node's assignment: the epoch of a job that it is in, and the epoch that comes next.

An assignment is shared by the node's two threads; `node.process` states the rules.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

import zenoh

from node.cell import Cell
from node.cpu_affinity import LONG, core_of
from node.events import Action, Event, Message
from node.links import Links
from node.patience import Patience
from node.plan import Plan
from wire.takeover import Takeover

# Seconds of processor time: if the generations between two exchanges take less, the network thread may breed them.
INLINE_SECONDS = 2e-3
MANY_UNREAD = 64  # messages in async mode, from which on the network thread reads: the main thread may wait for a core
_MOST_EARLY = 1000  # messages kept for the next epoch; each neighbour sends one or two before this node gets there
_MEASURED_EVERY = 16  # generations between two measurements: asking for the time used costs as much as a message
INLINE_BYTES = 1 << 14  # sending a longer message may block until there is room, which the network thread must not do


class Assignment:
    """The epoch of a job that a node is in: its cell, its links, unread messages, and how to run it.

    Attributes:
        cell: the state machine; only the thread that holds ``lock`` may use it.
        links: the links to the neighbours in this epoch.
        news: unread messages for the cell. The network thread appends while ``hears`` is set; the thread that holds
            ``lock`` takes them.
        missing_senders: in lockstep the neighbours whose messages for the next exchange have not come, less those that
            have sent anything since. The network thread removes from it. If it holds too few, a step is made in vain;
            if it holds too many, a step is missed and the cell stands still.
        hears: whether the cell still takes messages; not after its end.
        core: the core that the node should be pinned to, for now; None for none.
        slice_seconds: the time slice that the node should ask for, in seconds; 0 for the kernel's default.
        needs_token: whether the node breeds only while it has the token of its core.
        events: events for the cell. Any thread may append; the thread that holds ``lock`` takes them.
        lock: the lock of the thread that steps the cell, or lets it read messages.
        inline: whether the network thread steps the cell, for now.
        begun: the query to answer with the report.
        report: the cell's report, encoded; None before it has stopped.
        bred_at: when the latest generations were bred, seconds on the monotonic clock, as far as it has been noted.
        gap: how long an exchange took then, in seconds.
        patience: in lockstep, when the cell asks for messages that have not come.
        most: how many generations may be bred in one call: as many as take about `INLINE_SECONDS`.
        last_report: when counters were sent last, on the same clock, and the numbers of messages sent and of
            generations bred until then.
        in_lockstep: whether the job runs in lockstep.
    """

    def __init__(self, cell: Cell, links: Links, news: list[Message] | None = None) -> None:
        self.cell = cell
        self.links = links
        self.news: list[Message] = [] if news is None else news
        self.missing_senders = set(cell.neighbours)
        self.hears = True
        self.core: int | None = None
        self.slice_seconds = 0.0
        self.needs_token = False
        self.events: deque[Event] = deque()
        self.lock = threading.Lock()
        self.inline = False
        self.begun: zenoh.Query | None = None
        self.report: bytes | None = None
        self.bred_at = time.monotonic()
        self.gap = 0.0
        self.patience = Patience()
        self.most = 1
        self.last_report = (self.bred_at, 0, 0)
        plan = cell.plan
        self._core = core_of(links.wiring, links.cell)
        self._measured_at = -_MEASURED_EVERY  # the generation of the latest measurement; the first step measures too
        self._bred = 0  # the generation at `bred_at`
        self._interval = plan.run.interval
        self.in_lockstep = plan.run.mode == "lockstep"
        most_bytes = plan.limits.most_bytes_without_state + plan.state_bytes
        self._may_be_inline = self.in_lockstep and plan.problem.any_thread and most_bytes <= INLINE_BYTES

    @property
    def job(self) -> int:
        """The job's number, unique within the cluster."""
        return self.cell.job

    @property
    def epoch(self) -> int:
        """The epoch's number in the job, from 0."""
        return self.cell.plan.epoch

    @property
    def busy(self) -> bool:
        """Whether a step of the cell would do something now. May be asked without the lock."""
        return self.cell.missing_count == 0 or bool(self.news or self.events)

    @property
    def is_to_be_measured(self) -> bool:
        """Whether the next step measures how long a generation takes.

        A lockstep cell that was too slow for the network thread is measured in each step: a node's first generation may
        be slow only because its code and memory are touched for the first time.
        """
        unmeasured = self.cell.rows.generation - self._measured_at
        return unmeasured >= _MEASURED_EVERY or (self._may_be_inline and not self.inline)

    def seconds_since_report(self) -> tuple[float, float]:
        """Return the mean seconds from message to message, and from generation to generation, since the last call."""
        before, had_sent, had_bred = self.last_report
        now, sent, bred = self.last_report = (time.monotonic(), self.cell.sent, self.cell.rows.generation)
        return (now - before) / max(1, sent - had_sent), (now - before) / max(1, bred - had_bred)

    def step(self) -> list[Action]:
        """Let the cell take the messages and events that are here now, and breed; requires ``lock``.

        What arrives meanwhile is left for the next step.
        """
        cell = self.cell
        news = self._taken()
        events = [self.events.popleft() for _ in range(len(self.events))] if self.events else ()
        generation, measured = cell.rows.generation, self.is_to_be_measured
        used = time.thread_time() if measured else 0.0  # processor time: waiting for a core must not count
        actions = cell.step(news, events, self.most)
        bred = cell.rows.generation - generation
        if bred:
            self.look_at_the_clock()
            if measured:
                self._measured_at = cell.rows.generation
                each = (time.thread_time() - used) / bred
                self.most = max(1, int(INLINE_SECONDS / max(each, 1e-6)))
                self.inline = self._may_be_inline and each * self._interval < INLINE_SECONDS
                self._choose_core(each)
        self._end_step()
        return actions

    def actions_after_breeding(self) -> list[Action]:
        """Return the actions that the fast path has left to Python; requires ``lock``."""
        actions = self.cell.actions_after_breeding()
        self.look_at_the_clock()
        self._end_step()
        return actions

    def look_at_the_clock(self) -> None:
        """Note that generations have been bred since the last look, as if all of them had been bred just now.

        The fast path does not look at the clock, so its generations are noted when Python comes by.
        """
        generation = self.cell.rows.generation
        if bred := generation - self._bred:
            now = time.monotonic()
            self.gap, self.bred_at = (now - self.bred_at) / max(1.0, bred / self._interval), now
            self.patience.note(now, self.gap)
            self.cell.pace_states(self.gap)
            self._bred = generation

    def _end_step(self) -> None:
        """Prepare for the next messages; after the cell's end free the core for others."""
        if self.in_lockstep:
            self.find_missing_senders()
        if self.cell.ended:
            self.hears, self.core, self.slice_seconds, self.needs_token = False, None, 0.0, False

    def take_in(self) -> list[Action]:
        """Let the cell read the messages that are here now, without breeding; requires ``lock``."""
        return self.cell.hear(self._taken())

    def _taken(self) -> list[Message]:
        """Take the messages so far out of the news and return them.

        The network thread may append between the two lines, so only what was copied is deleted.
        """
        news = self.news[:]
        del self.news[: len(news)]
        return news

    def find_missing_senders(self) -> None:
        """Set ``missing_senders`` anew: the neighbours that must send something before another step is of use."""
        self.missing_senders = missing = self.cell.inbox.missing_senders()
        # Look at the news only after the set is in place. The network thread appends a message first and removes its
        # sender afterwards: either from this set, or from the old one, and then the message is in the news by now.
        if self.news:
            missing.difference_update(sender for sender, _ in self.news[:])

    def _choose_core(self, seconds: float) -> None:
        """Choose core and time slice, given the processor time of one generation in ``seconds``.

        Two kinds of nodes are pinned: those that breed on the network thread, and asynchronous ones with long compiled
        generations. In lockstep with long generations the kernel knows better which node needs a core. Asynchronous
        nodes with short generations, or with a fitness in Python, hold the interpreter's lock most of the time; pinned
        to the same core, their network thread would hardly ever get that lock.
        """
        generations = self.cell.generations
        compiled = generations is not None and generations.is_compiled
        goes_on_alone = not self.in_lockstep and self.most == 1 and compiled
        self.slice_seconds = LONG if goes_on_alone else 0.0
        self.core = self._core if self.inline or goes_on_alone else None
        # A node whose generation outlasts its turn would starve the other nodes on its core.
        self.needs_token = goes_on_alone and self.core is not None and seconds < LONG


@dataclass
class Coming:
    """The next epoch of a job, which begins once the previous one has stopped.

    Attributes:
        job: the job's number.
        plan: the plan of the epoch.
        links: the links to the neighbours in the epoch.
        since: generations of the job before the epoch; None if this node is to count them itself.
        deme: the genomes to begin with, one after another; empty to go on with the deme that this node has.
        fresh: whether to begin with new individuals.
        takeover: what to go on from in the place of a process that has died; None for others.
        news: messages that have come so far, since neighbours may be in the epoch already. The network thread appends.
        begun: the query to answer with the report; None until the epoch may begin.
    """

    job: int
    plan: Plan
    links: Links
    since: int | None
    deme: bytes
    fresh: bool = False
    takeover: Takeover | None = None
    news: list[Message] = field(default_factory=list)
    begun: zenoh.Query | None = None

    def hear(self, sender: int, payload: bytes) -> None:
        """Keep the latest messages: most of them are for the epoch before, and that may last long.

        The list is trimmed at twice its bound, so that trimming is rare.
        """
        self.news.append((sender, payload))
        if len(self.news) > 2 * _MOST_EARLY:
            del self.news[:-_MOST_EARLY]
