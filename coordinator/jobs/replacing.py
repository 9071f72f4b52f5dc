"""Continue a job whose processes have died, that a dead coordinator has left running, or whose nodes leave."""

import math
import time
from collections.abc import Mapping
from typing import Any

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.calls import ASK_AGAIN, RefusedError, ReplacedError, Reported
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.epochs import Epoch
from coordinator.jobs.job import Placement, Replaced, Returned, StopRequest
from coordinator.jobs.preparing import Preparing
from coordinator.jobs.recovering import Recovering, looks
from coordinator.jobs.resuming import Resuming
from problems import ProblemFile
from spy.past import Past
from topologies import Topology, Torus
from wire.control import Drop, Halt, Look, Wiring

_PRESENT_WITHIN = 150.0  # seconds; by default a host may be out of reach for almost as long
_LONGEST_PAUSE = 1.0  # seconds between questions for nodes that are out of reach
_HALTED_WITHIN = 150.0  # seconds; a host may be out of reach for almost as long
_EXACT_WITHIN = 15.0  # seconds for which exact recovery is begun again while more and more processes die
_MOST_REFUSALS = 2  # such as by a node whose links do not come up; the next time it gets new ones


class Replacing:
    """Brings new processes into a job, in the place of dead ones.

    Args:
        job: the job.
        preparing: prepares the epoch that begins after a death.
        resuming: lets the job go on from its latest checkpoint if all nodes have died.
        eval_timeout: how many seconds an evaluation may go on once the job is stopped.
    """

    def __init__(self, job: ConductedJob, preparing: Preparing, resuming: Resuming, eval_timeout: float) -> None:
        self._job = job
        self._preparing = preparing
        self._resuming = resuming
        self._eval_timeout = eval_timeout
        self._recovering = Recovering(job, preparing)
        self._spy_is_new = False  # the spy was replaced and does not know this job yet

    def take_over(self, placement: Placement) -> None:
        """Continue a job that the previous coordinator left running; begin it again if none of its nodes is left."""
        job = self._job
        # The wiring's number is enough at first: nodes that have its links keep them.
        epoch = Epoch(placement.epoch, placement.file, Wiring(placement.wiring, placement.nodes), why=placement.why)
        job.epochs.take_over(epoch)
        job.lived_before = _lived_before(placement.past)
        job.best = job.answer_for(epoch)
        epoch.dead = set(range(epoch.cells)) - self._present_cells(epoch)
        # Not before: hosts may have been out of reach. New processes need to know where the others are.
        epoch.wiring = job.dispatch.wiring_of(placement.wiring, placement.nodes)
        self._spy_is_new = True  # it may have been replaced while there was no coordinator
        self._replace_the_dead()
        if job.epoch is epoch:  # else a new epoch has begun without the dead, and reports are asked for already
            for each in job.epochs.unsettled:
                job.ask_for_reports(each)
            if epoch.number > 0:  # the previous coordinator may not have got to stop the epoch before
                job.stop_everywhere(epoch.number - 1, "update")

    def _present_cells(self, epoch: Epoch) -> set[int]:
        """Return the cells whose nodes hold this job; wait until each node has answered, or its new process has.

        A node that does not answer may only be cut off, and breed with its neighbours: nobody may take its place then,
        from states that they go on from. One that has answered is there until it is told to have died. A host that is
        given up ends the waiting, and the job; if that takes too long, those without an answer count as dead.
        """
        job, until, pause = self._job, time.monotonic() + _PRESENT_WITHIN, ASK_AGAIN
        cells: dict[int, int | None] = {}  # by node; None for one that does not have the job
        keys = [job.keys.every_control]  # the first time: a cell may be on a node that it has left
        while True:
            try:
                answers = job.calls.ask([(key, Look(job.number)) for key in keys], 0, give_up=False)
                for look in looks(answers):
                    cells[look["node"]] = look["cell"] if _may_live_in(epoch, look) else None
                    if look["cell"] is not None:
                        job.versions = look["versions"]
                        job.dispatch.open_links(look["node"], look["wirings"])
                keys = [job.keys.control(node) for node in epoch.wiring.nodes if node not in cells]
                if not keys or time.monotonic() >= until:
                    return {cell for cell in cells.values() if cell is not None}
                job.calls.wait(pause)
                pause = min(2.0 * pause, _LONGEST_PAUSE)
            except ReplacedError as died:
                if died.node is not None:
                    cells.pop(died.node, None)
                    keys.append(job.keys.control(died.node))

    def replace(self, node: int | None) -> None:
        """Bring a new process (on ``node``; None: the spy) into the job, and others that come meanwhile."""
        self._mark_dead(node)
        self._replace_the_dead()

    def move(self, nodes: tuple[int, ...]) -> None:
        """Let the cells go on, with their demes, on these nodes; more of them are further rows of the torus."""
        job = self._job
        grows = _taller(job.epoch.topology, len(nodes)) is not None  # else it was rewired before it could grow
        job.nodes = nodes if grows else nodes[: job.epoch.cells]
        self._replace_the_dead()

    def go_on_from_a_halt(self) -> None:
        """Begin another epoch, since cells are halted in the latest one; see `HaltedError`."""
        self._replace_the_dead()

    @property
    def _is_moving(self) -> bool:
        return self._job.nodes != self._job.epoch.wiring.nodes

    @property
    def _needs_an_epoch(self) -> bool:
        """Whether the job can only go on in another epoch, also if all its processes live."""
        return self._is_moving or self._job.epoch.has_halted_cells

    def _mark_dead(self, node: int | None, goes_on: bool = False) -> None:
        """Note that a node of this job (None: the spy) was replaced by a new process, which knows nothing of the job.

        Once all cells have reported, a dead node matters only if the job is kept alive, or if it ``goes_on`` and the
        cells were only halted: its deme is needed then.
        """
        job = self._job
        if node is None:
            self._spy_is_new = True
        elif node in job.epoch.wiring.nodes and (goes_on or job.epoch.file.run.keep_alive or not job.epoch.stopped):
            job.epoch.dead.add(job.epoch.wiring.nodes.index(node))

    def _replace_the_dead(self) -> None:
        """Bring the new processes into the job; repeat if another one dies meanwhile, or one refuses."""
        exact_until, refusals = time.monotonic() + _EXACT_WITHIN, 0
        while self._spy_is_new or self._job.epoch.dead or self._needs_an_epoch:
            try:
                if not (self._job.epoch.dead or self._needs_an_epoch):
                    self._preparing.show_to_the_spy(self._job.epoch)
                    self._spy_is_new = False
                elif self._needs_an_epoch or time.monotonic() > exact_until or not self._recovering.recover():
                    self._go_on_without_the_dead()  # this begins a new epoch, which is shown to a new spy too
                    self._spy_is_new = False
            except ReplacedError as another:
                self._mark_dead(another.node, goes_on=bool(self._job.epoch.dead) or self._needs_an_epoch)
            except RefusedError as refused:
                refusals += 1
                if refusals > _MOST_REFUSALS:
                    raise
                self._job.entry.spec.say(f"the dead are replaced once more, since this was refused: {refused}")

    def _go_on_without_the_dead(self) -> None:
        """Halt the other cells and begin an epoch in which each new node starts with the deme of a neighbour.

        In async mode it starts with the latest deme of its own cell that a neighbour keeps, if one does. The others
        continue with their own demes, also those that move to other nodes. In lockstep a cell advances only with its
        neighbours' messages, so the halted cells differ by at most as many generations as there are links between them
        and a dead cell.
        """
        before = self._job.epoch
        others = set(range(before.cells)) - before.dead
        if not others:
            return self._start_over()
        states = self._recovering.latest_of(before.dead) if before.file.run.mode == "async" else {}
        self._wait_until_halted(before, others)
        # A node may have died after its cell had reported. The directive must not list that cell among the others.
        before.reports = {cell: report for cell, report in before.reports.items() if cell in others}
        return self._begin_with_new_nodes(before, states)

    def _wait_until_halted(self, epoch: Epoch, others: set[int]) -> None:
        """Halt the cells and wait for the reports of ``others``; other messages are put back for later.

        Raises:
            ReplacedError: if another process dies meanwhile.
            ClusterFailed: if a cell fails, or they take too long.
            GivenUpError: if the job is stopped, but some evaluation does not end.
        """
        # Cells that only move, or get others beside them, halt after a generation, however long that takes.
        until = time.monotonic() + (_HALTED_WITHIN if epoch.dead else math.inf)
        stop = self._job.stop_request
        stop_until = math.inf if stop is None else time.monotonic() + self._eval_timeout
        again = 0.0  # when to send the command (0.0: now)
        aside = []
        try:
            while not others <= epoch.reports.keys():
                now = time.monotonic()
                if stop is not None and now >= stop_until:
                    self._job.give_up(stop, self._eval_timeout)
                if now >= until:
                    raise ClusterFailed("the cells did not halt after a node had died")
                if now >= again:
                    self._halt()
                    again = now + _HALTED_WITHIN
                message = self._job.calls.next(min(again, stop_until))
                if isinstance(message, Replaced):
                    raise ReplacedError(message)
                if isinstance(message, StopRequest) and stop is None:
                    stop, stop_until = message, time.monotonic() + self._eval_timeout
                if isinstance(message, Returned):  # it may have missed the command
                    again = min(again, time.monotonic() + ASK_AGAIN)
                if not isinstance(message, Reported):
                    aside.append(message)
                elif message.report is None:
                    again = min(again, time.monotonic() + ASK_AGAIN)
                elif (error := self._job.note(message.epoch, message.report)) is not None:
                    raise ClusterFailed(error)
        finally:
            for message in aside:
                self._job.calls.put_off(message)

    def _halt(self) -> None:
        """Halt the cells in whichever epoch they are.

        Each `Halt` follows a `Begin`: a cell that missed the first `Begin` has to begin the latest epoch to halt in it.
        """
        for epoch in self._job.epochs.known:
            self._job.ask_for_reports(epoch)
            command = Halt(self._job.number, epoch.number, epoch.wiring_number)
            self._job.calls.ask_for_reports(self._job.keys.every_control, command)

    def _begin_with_new_nodes(self, before: Epoch, states: Mapping[int, bytes]) -> None:
        """Begin the epoch after a death or a move; its directive says everything that a replay needs to repeat it.

        Args:
            before: the epoch that has been halted.
            states: the states that are kept of dead cells, whose demes go on; such a cell is its own donor.
        """
        job = self._job
        file = self._next_file()
        topology = topologies.parse(file.run.topology)
        donors = {cell: _deme_donor(before.topology.neighbours(cell), before) for cell in sorted(before.dead)}
        donors |= {cell: _deme_donor((cell % before.cells,), before) for cell in range(before.cells, topology.cells)}
        donors |= {cell: cell for cell in states}
        reached = {str(cell): report.generation for cell, report in sorted(before.reports.items())}
        job.entry.spec.say(f"another epoch begins, {self._reason()}")
        why = {
            "do": "replace",
            "demes_of": {str(cell): donor for cell, donor in donors.items()},
            "generations": reached,
            "topology": topology.spec,
        }
        wiring = job.dispatch.wire(job.nodes, topology.spec, fresh=True)
        since = job.generations(before, halted=True)
        nodes = enumerate(zip(job.nodes, before.wiring.nodes, strict=False))
        moved = {cell: cell for cell, (node, old) in nodes if node != old}
        left = set(before.wiring.nodes).difference(job.nodes)
        size = len(next(iter(before.reports.values())).deme)
        demes = {cell: states[cell][-size:] for cell in states}  # a state ends with the deme
        given = {cell: donor for cell, donor in (moved | donors).items() if cell not in states}
        demes |= {cell: before.reports[donor].deme for cell, donor in given.items()}
        epoch = Epoch(before.number + 1, file, wiring, since, why=why, demes=before.last_demes | demes)
        self._preparing.prepare(epoch, demes)
        self._preparing.show_to_the_spy(epoch)
        self._preparing.begin(epoch)
        for node in sorted(left):
            job.calls.tell(job.keys.control(node), Drop(job.number))
        job.unsent_stop = job.stop_request  # a stop in the halted epoch does not hold in this one

    def _reason(self) -> str:
        """Return, for people, why another epoch begins."""
        if dead := ", ".join(map(str, sorted(self._job.epoch.dead))):
            return f"without the processes of cells {dead}"
        return "on other nodes" if self._is_moving else "since cells are halted"

    def _start_over(self) -> None:
        """Go on from the latest checkpoint of this epoch: no node is left that has the demes of the job.

        Without one the job begins again with new individuals, in the latest problem.
        """
        job = self._job
        job.dispatch.changed(job.entry, "queued")
        if job.checkpoint is not None and job.checkpoint.epoch == job.epoch.number:
            self._resuming.go_on_from(job.checkpoint, self._next_file())
        else:
            job.entry.spec.say("begins anew: all its processes have died, and there is no checkpoint of this epoch")
            self._preparing.set_out(job.epoch.number + 1, self._next_file())
        job.unsent_stop = job.stop_request  # what was sent of it is lost with the nodes

    def _next_file(self) -> ProblemFile:
        """Return the problem file of the next epoch: the latest, with as many rows of the torus as there are nodes."""
        epoch = self._job.epoch
        if len(self._job.nodes) == epoch.cells:
            return epoch.file
        return epoch.file.changed({}, {"topology": _taller(epoch.topology, len(self._job.nodes))})


def _may_live_in(epoch: Epoch, look: Mapping[str, Any]) -> bool:
    """Return whether a node lives in an epoch, or will once that begins, as it says in its answer to `Look`.

    A coordinator that died may have prepared new processes to begin the job again, in an epoch that never began.
    """
    return look["cell"] is not None and (look["begun"] or look["epoch"] <= epoch.number)


def _lived_before(past: Past) -> int:
    """Return the generations of a job when it last began with new demes because all its nodes had died."""
    lived = before = 0
    for directive in past.directives:
        lived += directive["generation"]
        before = lived if directive["do"] == "restart" else before
    return before


def _taller(topology: Topology, cells: int) -> str | None:
    """Return the topology of so many cells: this one, or the torus with other rows; None if there is none."""
    if not isinstance(topology, Torus) or cells % topology.columns:
        return topology.spec if topology.cells == cells else None
    return f"{topology.name} {cells // topology.columns}x{topology.columns}"


def _deme_donor(slots: tuple[int, ...], epoch: Epoch) -> int:
    """Return the first of these cells that has reported; if none has, the first cell of all that has."""
    return next(cell for cell in (*slots, *sorted(epoch.reports)) if cell in epoch.reports)
