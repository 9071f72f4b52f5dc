"""What a node is at: an epoch of a job, and the one that comes after it."""

import threading
import time
from collections import deque
from dataclasses import dataclass, field

import zenoh

from node.cell import Action, Cell, Event, Message
from node.cpu_affinity import LONG, core_of
from node.links import Links
from node.plan import Plan

INLINE_SECONDS = 2e-3  # of processor time: what is bred between two exchanges in less may be on the network thread
MANY_UNREAD = 64  # messages in async mode: far more may come before the main thread gets a core
_MOST_EARLY = 1000  # messages: of the next epoch each neighbour sends one or two before this node comes there
_MEASURED_EVERY = 16  # generations: to ask for the time used costs as much as a message
INLINE_BYTES = 1 << 14  # longer messages may have to wait for room to leave; on the network thread nothing may wait


class Assignment:
    """The epoch of a job that this node is at.

    Attributes:
        links: to the neighbours in this epoch.
        news: messages for the cell; the network thread appends, for as long as the cell `hears`, and who has the turn
            takes them.
        awaited: in lockstep, of the neighbours whose messages the next exchange lacks, those of whom nothing at all has
            come since; the network thread removes. With too few in it a step is in vain, with too many one is missed.
        core: which one the node should keep to, for now.
        turns: how long its turns on that core should be, in seconds; 0: as long as the kernel likes.
        hands_on: whether it breeds on that core only while it has the token.
        events: for the cell; any thread may append.
        turn: held by the thread that carries the cell on, or lets it read.
        inline: whether that is the network thread, for now.
        begun: to be answered with the report.
        report: what the cell had to say when it stopped, encoded.
        bred_at: when the latest generations were bred, on the monotonic clock,
        gap: and how long an exchange took then, in seconds.
        most: generations that may be bred at once: as many as take little time.
        told: when counters were told last, on the same clock, and how many messages had been sent and generations been
            bred by then.
    """

    def __init__(self, cell: Cell, links: Links, news: list[Message] | None = None) -> None:
        self.cell = cell
        self.links = links
        self.news: list[Message] = [] if news is None else news
        self.awaited = set(cell.neighbours)
        self.hears = True
        self.core: int | None = None
        self.turns = 0.0
        self.hands_on = False
        self.events: deque[Event] = deque()
        self.turn = threading.Lock()
        self.inline = False
        self.begun: zenoh.Query | None = None
        self.report: bytes | None = None
        self.bred_at = time.monotonic()
        self.gap = 0.0
        self.most = 1
        self.told = (self.bred_at, 0, 0)
        plan = cell.plan
        self._core = core_of(links.wiring, links.cell)
        self._measured_at = -_MEASURED_EVERY  # generation
        self._bred = 0  # generations, at `bred_at`
        self._interval = plan.run.interval
        self.in_lockstep = plan.run.mode == "lockstep"
        self._may_be_inline = self.in_lockstep and plan.problem.any_thread and plan.limits.most_bytes <= INLINE_BYTES

    @property
    def job(self) -> int:
        """Its number."""
        return self.cell.job

    @property
    def epoch(self) -> int:
        """Its number in the job."""
        return self.cell.plan.epoch

    @property
    def busy(self) -> bool:
        """Whether there is something to do for the cell right now."""
        return self.cell.awaits == 0 or bool(self.news or self.events)

    @property
    def is_to_be_measured(self) -> bool:
        """Whether it is time to see how long a generation takes, which a step does."""
        unmeasured = self.cell.rows.generation - self._measured_at
        return unmeasured >= _MEASURED_EVERY or (self._may_be_inline and not self.inline)

    def seconds_since_told(self) -> tuple[float, float]:
        """From one message to the next, and from one generation to the next, on average since this was asked last."""
        before, had_sent, had_bred = self.told
        now, sent, bred = self.told = (time.monotonic(), self.cell.sent, self.cell.rows.generation)
        return (now - before) / max(1, sent - had_sent), (now - before) / max(1, bred - had_bred)

    def step(self) -> list[Action]:
        """Let the cell take what is here now, but not what comes meanwhile; within ``turn`` only."""
        cell = self.cell
        news = self._taken()
        events = [self.events.popleft() for _ in range(len(self.events))] if self.events else ()
        generation, measured = cell.rows.generation, self.is_to_be_measured
        used = time.thread_time() if measured else 0.0
        actions = cell.step(news, events, self.most)
        bred = cell.rows.generation - generation
        if bred:
            self.look_at_the_clock()
            if measured:
                self._measured_at = cell.rows.generation
                each = (time.thread_time() - used) / bred
                self.most = max(1, int(INLINE_SECONDS / max(each, 1e-6)))
                self.inline = self._may_be_inline and each * self._interval < INLINE_SECONDS
                self._settle(each)
        self._end_step()
        return actions

    def went_on(self) -> list[Action]:
        """After the fast path: what it left to be done; within ``turn`` only."""
        actions = self.cell.went_on()
        self.look_at_the_clock()
        self._end_step()
        return actions

    def look_at_the_clock(self) -> None:
        """Note when the latest generations were bred, as far as that is to be seen now."""
        generation = self.cell.rows.generation
        if bred := generation - self._bred:
            now = time.monotonic()
            self.gap, self.bred_at = (now - self.bred_at) / max(1.0, bred / self._interval), now
            self._bred = generation

    def _end_step(self) -> None:
        if self.in_lockstep:
            self.await_messages()
        if self.cell.ended:
            self.hears, self.core, self.turns, self.hands_on = False, None, 0.0, False

    def take_in(self) -> list[Action]:
        """Let the cell read what is here now, and no more; within ``turn`` only."""
        return self.cell.hear(self._taken())

    def _taken(self) -> list[Message]:
        """The news so far, which are none any more."""
        news = self.news[:]
        del self.news[: len(news)]
        return news

    def await_messages(self) -> None:
        """Who has to be heard from before another step is of use; some may have been while the cell was at this one."""
        self.awaited = awaited = self.cell.inbox.missing()
        if self.news:  # only now: whoever appends removes the sender afterwards, from the old set or from this one
            awaited.difference_update(sender for sender, _ in self.news[:])

    def _settle(self, seconds: float) -> None:
        """Where to breed, and for how long at a time, now that it is known how many seconds a generation takes.

        Where nodes wait for each other and generations take long, the kernel knows better who needs a core. Where they
        wait for nobody and are in Python most of the time, the network thread would hardly ever get it on one core.
        """
        goes_on_alone = not self.in_lockstep and self.most == 1 and self.cell.generations is not None
        self.turns = LONG if goes_on_alone else 0.0
        self.core = self._core if self.inline or goes_on_alone else None
        # Whose generations take longer than a turn would keep the others from theirs.
        self.hands_on = goes_on_alone and self.core is not None and seconds < LONG


@dataclass
class Coming:
    """The next epoch of the job, which begins when the one before has stopped.

    Attributes:
        since: generations before it, if that is not for this node to say.
        deme: to begin with, if not with the one that this node has.
        fresh: whether to begin with new individuals.
        news: neighbours may be there already.
        begun: to be answered with the report; None until it may begin.
    """

    job: int
    plan: Plan
    links: Links
    since: int | None
    deme: bytes
    fresh: bool = False
    news: list[Message] = field(default_factory=list)
    begun: zenoh.Query | None = None

    def hear(self, sender: int, payload: bytes) -> None:
        """Of what neighbours say keep the latest: most of it is for the epoch before, however long that lasts."""
        self.news.append((sender, payload))
        if len(self.news) > 2 * _MOST_EARLY:
            del self.news[:-_MOST_EARLY]
