"""The coordinator's part in one job: prepare all, start all, pass wishes on, gather the reports, have them judged.

A job lives in a row of worlds. An update, another topology and the replacement of a dead node are one and the same: the
next world is prepared and begun everywhere, the one before is stopped, and each node goes on in the next with the deme
that it has.
"""

import contextlib
import json
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import zenoh

import topologies
from coordinator.calls import Calls, GivenUpError, ReplacedError, Reported
from coordinator.errors import ClusterFailed
from coordinator.job import Change, JobEntry, Placing, Replaced, Wish
from problems import BadInput, ProblemFile
from spy.judge import STATUS_OF, Judgement
from spy.result import Clocks, Lived, Result, best_known, result_of, states_of, stop_reasons, stopped_after
from topologies import ROOT
from wire.callbacks import direct
from wire.control import Begin, Done, Drop, Finish, Halt, Judged, Look, Prepare, ProposeStop, Wiring
from wire.keys import Keys
from wire.news import Improvement, Statistics
from wire.report import Reason, Report
from wire.strict import Rejected

_ASK_AGAIN = 0.2  # seconds: a router that has died is there again after about so long
_HALTED_WITHIN = 30.0  # seconds
_LASTING = ("solved", "stalled", "exhausted")  # how a world can end that a job kept alive goes on after


class Dispatch(Protocol):
    """What a conductor needs of whoever runs it; called on the conductor's thread, and by Zenoh's."""

    def wire(self, nodes: tuple[int, ...], topology: str, fresh: bool = False) -> Wiring:
        """The links for a world: those that all its nodes have, or (``fresh``: always) new ones."""

    def changed(self, job: JobEntry, status: str) -> None:
        """The job is in another state."""

    def placed(self, job: JobEntry, placing: Placing) -> None:
        """The job is about to begin in this world."""

    def improved(self, job: JobEntry, better: Improvement) -> None:
        """There is a better answer."""


@dataclass
class _World:
    """What a conductor knows of one world.

    Attributes:
        since: generations of the job before it, as far as is known.
        reports: of the cells that have stopped.
        why: how it followed the one before, for the result.
        rescued: whether, in async mode, all cells have been told to stop.
        halted: whether a node died in it.
    """

    number: int
    file: ProblemFile
    wiring: Wiring
    since: int = 0
    reports: dict[int, Report] = field(default_factory=dict)
    why: Mapping[str, object] = field(default_factory=dict)
    rescued: bool = False
    halted: bool = False

    @property
    def cells(self) -> int:
        return len(self.wiring.nodes)

    @property
    def stopped(self) -> bool:
        return len(self.reports) == self.cells


class Conductor:
    """Conducts one job on ``nodes``; `conduct` is all there is to call.

    Args:
        adopted: where the job is, if it was running when the coordinator before this one died.
    """

    def __init__(
        self,
        job: JobEntry,
        session: zenoh.Session,
        keys: Keys,
        nodes: tuple[int, ...],
        dispatch: Dispatch,
        replaces: bool,
        adopted: Placing | None = None,
    ) -> None:
        self.job = job
        self.number = job.order.number
        self.keys = keys
        self.nodes = nodes
        self.dispatch = dispatch
        self.session = session
        self.calls = Calls(session, job.mail, replaces)
        self.worlds: list[_World] = []
        self.versions: dict[str, str] = {}
        self.best: Improvement | None = None
        self.seconds = 0.0
        self._adopted = adopted
        self._wish: Wish | None = None
        self._changes: deque[Change] = deque()
        self._unheard = False  # whether the cells have still to be told of the wish
        self._asked = -1  # the latest question for reports
        seconds = job.order.file.run.seconds
        self._deadline = None if seconds is None else job.order.submitted + seconds

    @property
    def world(self) -> _World:
        """The latest."""
        return self.worlds[-1]

    def conduct(self, seconds_to_ready: float, cpu_seconds: Callable[[], dict[str, float]]) -> Result:
        """Run the job to its end.

        Raises:
            BadInput: if the problem is wrong.
        """
        used = cpu_seconds()
        with self._listening():
            judgement = self._judgement()
        if judgement.best is not None:
            self._improve(judgement.best)
        spent = sum(after - used[name] for name, after in cpu_seconds().items() if name in used)
        clocks = Clocks(self.seconds, seconds_to_ready, spent)
        lived = [Lived(each.file, list(each.reports.values()), each.why, each.number) for each in self.worlds]
        name = self.job.order.job or str(self.number)
        return result_of(name, lived or [Lived(self.job.order.file)], judgement, self.versions, clocks)

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        subscribers = [
            self.session.declare_subscriber(self.keys.best, direct(self._hear_best)),
            self.session.declare_subscriber(self.keys.spy_stats, direct(self._hear_statistics)),
        ]
        try:
            yield
        finally:
            for subscriber in subscribers:
                with contextlib.suppress(zenoh.ZError):
                    subscriber.undeclare()  # type: ignore[no-untyped-call]

    def _judgement(self) -> Judgement:
        """What came of it, whatever goes wrong."""
        try:
            return self._run()
        except GivenUpError as error:
            return Judgement(STATUS_OF[error.wish.reason], False, "stopped before there was a result", self.best)
        except ClusterFailed as error:
            cancelled = self._wish is not None and self._wish.reason == "cancel" and self.calls.closing
            return Judgement("cancelled" if cancelled else "failed", False, str(error), self.best)
        except BadInput:
            raise
        except Exception as error:  # whatever it is, whoever waits for this job must hear of its end
            return Judgement("failed", False, f"{type(error).__name__}: {error}", self.best)
        finally:
            self._drop()

    def _run(self) -> Judgement:
        if self._adopted is None:
            self._set_out()
        else:
            self._take_over(self._adopted)
        began = time.monotonic()
        try:
            while True:
                judgement = self._live()
                if not (self.world.file.run.keep_alive and judgement.status in _LASTING and self._wish is None):
                    return judgement
                if not self._wait_for_a_change():
                    return self._ended_waiting(judgement)
        finally:
            self.seconds = time.monotonic() - began

    # The beginning of a job -------------------------------------------------------------------------------------------
    def _set_out(self) -> None:
        """Prepare and begin the first world; from the start again if a process dies meanwhile."""
        self.dispatch.changed(self.job, "preparing")
        file, fresh = self.job.order.file, False
        while True:
            first = _World(0, file, self.dispatch.wire(self.nodes, file.run.topology, fresh))
            try:
                # The spy first: it finds a wrong problem before a thousand nodes do.
                self._show_to_the_spy(first)
                self._prepare(first)
                self._let_the_spy_listen(first)
                return self._begin(first)
            except ReplacedError:
                fresh = True

    def _take_over(self, placing: Placing) -> None:
        """Go on with a job that runs already, unless all its nodes have died too."""
        world = _World(placing.world, placing.file, Wiring(placing.wiring, placing.nodes))
        answers = self.calls.ask([(self.keys.every_control, Look(self.number))], expected=0)
        there = {json.loads(answer.note) for answer in answers if isinstance(answer, Done)}
        if not there:
            return self._set_out()
        self.worlds.append(world)
        self._show_to_the_spy(world)
        if len(there) < world.cells:
            return self._go_on_without(set(range(world.cells)) - there)
        self._let_the_spy_listen(world)
        self._ask_for_reports()
        if world.number > 0:  # the coordinator before may not have come to this
            self._stop(world.number - 1, "update")
        return None

    def _prepare(self, world: _World, demes: dict[int, bytes] | None = None) -> None:
        """Every node gets ready; with the ``demes`` of cells that have none of their own, each is told by itself."""
        wiring = world.wiring
        if demes is None:
            questions = [(self.keys.every_control, self._preparation(world))]
        else:
            questions = [
                (self.keys.control(node), self._preparation(world, world.since, demes.get(cell, b"")))
                for cell, node in enumerate(wiring.nodes)
            ]
        answers = self.calls.ask(questions, world.cells, give_up=not self.worlds)
        fingerprints = {answer.note for answer in answers if isinstance(answer, Done)}
        if world.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(f"nodes differ, lockstep would not repeat: {' / '.join(sorted(fingerprints))}")
        self.versions = json.loads(min(fingerprints))

    def _preparation(self, world: _World, since: int | None = None, deme: bytes = b"") -> Prepare:
        log = self.job.order.log
        return Prepare(self.number, world.number, world.file.to_json(), world.wiring, since, deme, log)

    def _show_to_the_spy(self, world: _World) -> None:
        """It forgets the world before."""
        self.calls.ask([(self.keys.spy_control, self._preparation(world))], give_up=not self.worlds)

    def _let_the_spy_listen(self, world: _World) -> None:
        """To the root, whose links are those of this world by now."""
        self.calls.ask([(self.keys.spy_control, Begin(self.number, world.number))], give_up=not self.worlds)

    def _begin(self, world: _World) -> None:
        """Go, as soon as the world before has stopped."""
        self.worlds.append(world)
        placing = Placing(world.number, world.file, self.nodes, world.wiring.number, world.why)
        self.dispatch.placed(self.job, placing)
        self._ask_for_reports()
        self.dispatch.changed(self.job, "running")

    def _ask_for_reports(self) -> None:
        """Of the latest world, which begins by that; a cell answers to who asked last."""
        self._asked = self.calls.ask_for_reports(self.keys.every_control, Begin(self.number, self.world.number))

    # While it runs ----------------------------------------------------------------------------------------------------
    def _live(self) -> Judgement:
        """Until the latest world has stopped, passing on wishes, changes and the deadline; what came of it."""
        while True:
            try:
                error = self._gather()
                return self._finish(error)
            except ReplacedError as replaced:
                self._replace(replaced.node)

    def _gather(self) -> str | None:
        """Wait for the report of every cell. Returns why one failed, if it did; others are not waited for then."""
        again: float | None = None  # when to ask for reports again
        while not self.world.stopped:
            if self._settled:
                self._do_what_was_put_off()
            due = min((each for each in (self._deadline, again) if each is not None), default=None)
            mail = self.calls.next(due)
            if mail is None and again is not None and time.monotonic() >= again:
                self._ask_for_reports()
                again = None
            elif isinstance(mail, Reported):
                if mail.report is None:  # the router has died: a question ends when nobody is left to answer it
                    again = time.monotonic() + _ASK_AGAIN if mail.question == self._asked else again
                elif (error := self._note(mail.world, mail.report)) is not None:
                    return error
            else:
                self._attend_to(mail)
        return None

    def _do_what_was_put_off(self) -> None:
        """While cells were on their way to the latest world none could be told to leave it."""
        if self._wish is not None and self._unheard:
            self._unheard = False
            self._stop(self.world.number, self._wish.reason)
        if self._changes:
            self._change(self._changes.popleft())

    @property
    def _settled(self) -> bool:
        """Whether all cells have come to the latest world; before that there cannot be another one."""
        return len(self.worlds) < 2 or self.worlds[-2].stopped or self.worlds[-2].halted

    def _note(self, number: int, report: Report) -> str | None:
        """A cell has stopped in one of the worlds; returns why, if it failed."""
        for world in self.worlds:
            if world.number == number:
                world.reports[report.cell] = report
                if world.file.run.mode == "async" and report.proposals and not world.rescued:
                    # Without lockstep a lost message could leave a node that never hears of the stop.
                    world.rescued = True
                    command = ProposeStop(self.number, number, report.proposals[0].reason)
                    self.calls.tell(self.keys.every_control, command)
        return report.error if number == self.world.number else None

    def _attend_to(self, mail: object) -> None:
        if mail is None:
            if self._deadline is not None and time.monotonic() >= self._deadline:
                self._deadline = None
                self._give_up(Wish("deadline"))
        elif isinstance(mail, Wish):
            self._give_up(mail)
        elif isinstance(mail, Replaced):
            raise ReplacedError(mail)
        elif isinstance(mail, Change):
            self._changes.append(mail)

    def _give_up(self, wish: Wish) -> None:
        """Let all cells stop; the answer at a deadline is what is known now."""
        self._wish = self._wish or wish
        if wish.reason == "deadline":
            self.dispatch.changed(self.job, "deadline")
        self._unheard = True

    def _stop(self, number: int, reason: Reason) -> None:
        """Propose a stop in that world, to the root unless that has ended: in async mode it may have, before others."""
        world = next((each for each in self.worlds if each.number == number), None)
        root_ended = world is None or ROOT in world.reports
        key = self.keys.every_control if root_ended else self.keys.control(self.nodes[ROOT])
        self.calls.tell(key, ProposeStop(self.number, number, reason))

    def _finish(self, error: str | None) -> Judgement:
        world = self.world
        reports = list(world.reports.values())
        command = Finish(
            self.number,
            world.number,
            best_known(reports, world.file.run.spy),
            stopped_after(reports),
            stop_reasons(reports, world.file.run.mode),
            error,
            tuple(states_of(reports).items()),
            self._since(),
        )
        (answer,) = self.calls.ask([(self.keys.spy_control, command)], give_up=False)
        if not isinstance(answer, Judged):
            raise ClusterFailed("the spy did not judge the run")
        return Judgement.of(answer)

    def _since(self) -> int:
        """Generations of the job before the latest world."""
        return sum(stopped_after(list(each.reports.values())) for each in self.worlds[:-1] if each.reports)

    # From one world to the next ---------------------------------------------------------------------------------------
    def _change(self, change: Change) -> None:
        """Go on in another world, if there can be such a one; else the old one lasts."""
        before = self.world
        try:
            if self._wish is not None:
                raise ClusterFailed(f"job {self.job.order.job} is being stopped")
            file = before.file.changed(change.fields, change.run)
            same_cells = topologies.parse(file.run.topology).cells == before.cells
            if not same_cells:
                raise BadInput(f"topology: expected one of {before.cells} cells, found {file.run.topology!r}")
            wiring = self.dispatch.wire(self.nodes, file.run.topology)
            world = _World(before.number + 1, file, wiring, why=_directive(change))
            self._prepare(world)
        except (BadInput, ClusterFailed) as error:
            change.answer.put(error)
            return
        except ReplacedError:
            self._changes.appendleft(change)
            raise
        self._show_to_the_spy(world)
        self._let_the_spy_listen(world)
        self.best = None
        self._begin(world)
        self._stop(before.number, "update")
        change.answer.put(world.number)

    def _wait_for_a_change(self) -> bool:
        """The world has stopped, and the job is kept alive; whether it goes on in another one."""
        self.dispatch.changed(self.job, "waiting")
        number = self.world.number
        while self.world.number == number:
            mail = self._changes.popleft() if self._changes else self.calls.next(self._deadline)
            if isinstance(mail, Wish) or (mail is None and self._deadline is not None):
                self._wish = mail if isinstance(mail, Wish) else Wish("deadline")
                return False
            if isinstance(mail, Change):
                self._change(mail)
            elif isinstance(mail, Replaced):
                self._replace(mail.node)
        return True

    def _ended_waiting(self, judgement: Judgement) -> Judgement:
        """A job that was kept alive ends as it was told to, with the answer that it had."""
        assert self._wish is not None
        return replace(judgement, status=STATUS_OF[self._wish.reason])

    def _replace(self, node: int | None) -> None:
        """Another process lives in the place of a dead one: go on with it from where the others are."""
        while True:
            try:
                if node is None:
                    self._show_to_the_spy(self.world)
                    return self._let_the_spy_listen(self.world)
                if node in self.nodes:
                    self._go_on_without({self.nodes.index(node)})
                return None
            except ReplacedError as another:
                node = another.node

    def _go_on_without(self, dead: set[int]) -> None:
        """All others halt; in a new world a new node begins with the deme of a neighbour, and they with theirs.

        They are at most as many generations apart as the dead cells were links away from them.
        """
        before = self.world
        for world in self.worlds[-2:]:
            self.calls.ask_for_reports(self.keys.every_control, Halt(self.number, world.number))
        before.halted = True
        others = set(range(before.cells)) - dead
        while not others <= before.reports.keys():
            mail = self.calls.next(time.monotonic() + _HALTED_WITHIN)
            if mail is None:
                raise ClusterFailed("the cells did not halt after a node had died")
            if isinstance(mail, Reported):
                if mail.report is not None and mail.report.cell not in dead:
                    self._note(mail.world, mail.report)
            elif isinstance(mail, Replaced):
                raise ReplacedError(mail)
            else:
                self.calls.put_off(mail)
        before.reports = {cell: report for cell, report in before.reports.items() if cell in others}
        self._begin_with_new_nodes(before, dead)

    def _begin_with_new_nodes(self, before: _World, dead: set[int]) -> None:
        topology = topologies.parse(before.file.run.topology)
        heirs = {cell: _heir(topology.neighbours(cell), before) for cell in sorted(dead)}
        reached = {str(cell): report.generation for cell, report in sorted(before.reports.items())}
        why = {"do": "replace", "demes_of": {str(cell): heir for cell, heir in heirs.items()}, "generations": reached}
        wiring = self.dispatch.wire(self.nodes, topology.spec, fresh=True)
        since = self._since() + max(reached.values())
        world = _World(before.number + 1, before.file, wiring, since, why=why)
        self._prepare(world, {cell: before.reports[heir].deme for cell, heir in heirs.items()})
        self._show_to_the_spy(world)
        self._let_the_spy_listen(world)
        self._begin(world)
        self._unheard = self._wish is not None

    def _drop(self) -> None:
        """Let nodes and spy forget the job, if they still can hear."""
        with contextlib.suppress(zenoh.ZError):
            self.calls.tell(self.keys.every_control, Drop(self.number))
            self.calls.tell(self.keys.spy_control, Drop(self.number))

    # Called by Zenoh, on its thread -----------------------------------------------------------------------------------
    def _hear_best(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            better = Improvement.decode(sample.payload.to_bytes())
            if better.job == self.number:
                self._improve(better)

    def _hear_statistics(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            statistics = Statistics.decode(sample.payload.to_bytes())
            if statistics.job == self.number:
                self.job.tell(statistics)

    def _improve(self, better: Improvement) -> None:
        best = self.best
        if best is None or (better.world, -better.fitness) > (best.world, -best.fitness):
            self.best = better
            self.job.tell(better)
            self.dispatch.improved(self.job, better)


def _heir(slots: tuple[int, ...], world: _World) -> int:
    """The first neighbour that lives; if none does, the first cell that does."""
    return next(cell for cell in (*slots, *sorted(world.reports)) if cell in world.reports)


def _directive(change: Change) -> dict[str, object]:
    """What a result says of it, so that a simulation can do the same."""
    if change.fields:
        return {"do": "update", "fields": change.fields}
    return {"do": "rewire", **change.run}
