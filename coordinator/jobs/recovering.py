"""Let new processes go on exactly where their dead predecessors were, in lockstep: no bit of the result changes.

Neighbours keep a cell's latest states, and every cell its own messages since (`node.engine.state`). The new process
gets a state, asks its neighbours for the messages, and breeds the same generations once more: random draws have keys.
The epoch goes on; the other cells only wait.
"""

import json
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from coordinator.jobs.calls import ASK_AGAIN, Given, RefusedError
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.preparing import Preparing
from topologies import ROOT, Topology
from wire.control import Command, Done, Look, TellStates
from wire.takeover import KeptStates, Takeover

_ANSWERS_WITHIN = 3.0  # seconds in which all living cells should tell what they keep; a stopped one does not
_MOST_ANSWER_WITHIN = 12.0  # seconds in which most do, also if the router has died and is back
_BEGINS_WITHIN = 1.0  # seconds in which a cell that is told to begin an epoch does so

States = dict[int, tuple[int, bytes]]
"""By cell, a generation and the state of the cell in it."""


class Recovering:
    """Brings new processes into the epoch that a job is in.

    Args:
        job: the job.
        preparing: prepares the new processes.
    """

    def __init__(self, job: ConductedJob, preparing: Preparing) -> None:
        self._job = job
        self._preparing = preparing

    def recover(self) -> bool:
        """Let the new processes of the dead cells go on; return whether that was possible, else nothing has changed.

        Raises:
            ReplacedError: if another process dies meanwhile.
        """
        job, epoch = self._job, self._job.epoch
        if epoch.file.run.mode != "lockstep" or not job.epochs.settled:
            return False
        # A process on another host could not use the links of this epoch.
        if job.dispatch.hosts_of(job.nodes) != epoch.wiring.hosts:
            return False
        kept = self.kept_states()
        demes = job.epochs.first_demes()
        begin = range(epoch.cells) if epoch.has_random_demes else demes
        chosen = choose_states(epoch.topology, kept, begin)
        if not kept or not epoch.dead <= chosen.keys():
            self._tell_why_not(epoch.dead - chosen.keys() or epoch.dead, "no state to go on from is kept")
            return False
        # In lockstep no cell is further ahead of another than there are exchanges on the way between them.
        reached = max(each.generation for each in kept.values()) + epoch.topology.diameter * epoch.file.run.interval
        try:
            stop_at = least_stop(kept)
            takeovers = {cell: Takeover(reached, chosen[cell][1], stop_at=stop_at) for cell in epoch.dead}
            self._preparing.prepare_again(epoch, takeovers, demes)
        except RefusedError as error:  # such as a link that does not come up again
            self._tell_why_not(epoch.dead, str(error))
            return False
        if ROOT in epoch.dead:
            self._preparing.show_to_the_spy(epoch)
            job.unsent_stop = job.stop_request  # what was sent of it is lost with the root
        for cell in epoch.dead:
            epoch.reports.pop(cell, None)
        generations = {str(cell): chosen[cell][0] for cell in sorted(epoch.dead)}
        job.entry.log.write("recovered", epoch=epoch.number, generations=generations)
        cells = ", ".join(generations)
        job.entry.spec.say(f"new processes go on where the dead ones were: cells {cells}")
        epoch.dead.clear()
        job.ask_for_reports(epoch)
        return True

    def _tell_why_not(self, cells: set[int], why: str) -> None:
        job = self._job
        job.entry.log.write("not recovered", epoch=job.epoch.number, cells=sorted(cells), why=why)
        job.entry.spec.say(f"cells {sorted(cells)} cannot go on exactly: {why}")

    def latest_of(self, dead: set[int]) -> dict[int, bytes]:
        """Return the latest state that is kept of each of these cells, where there is one.

        Raises:
            ReplacedError: if another process dies meanwhile.
        """
        states = states_by_cell(self.kept_states())
        return {cell: states[cell][max(states[cell])] for cell in dead & states.keys()}

    def kept_states(self) -> dict[int, KeptStates]:
        """Return what the living cells of the latest epoch keep, by cell.

        Raises:
            ReplacedError: if another process dies meanwhile.
        """
        job, key = self._job, self._job.keys.every_control
        questions: list[tuple[str, Command]] = [
            (key, TellStates(job.number, job.epoch.number, wiring=job.epoch.wiring_number)),
            (key, Look(job.number)),
        ]
        kept: dict[int, KeptStates] = {}
        living = set(range(job.epoch.topology.cells)) - job.epoch.dead
        began = may_begin_at = time.monotonic()
        while True:
            answers = job.calls.ask(questions, 0, give_up=False)
            kept |= {answer.cell: answer for answer in answers if isinstance(answer, KeptStates)}
            there = [look for look in looks(answers) if look["cell"] is not None and look["epoch"] <= job.epoch.number]
            looking = {look["cell"] for look in there if look["begun"] and look["epoch"] == job.epoch.number}
            if len(looking) < len(there) and time.monotonic() >= may_begin_at:
                job.ask_for_reports(job.epoch)  # some were cut off as the epoch began, or it has never begun
                may_begin_at = time.monotonic() + _BEGINS_WITHIN
            # A node in a long evaluation looks, but does not tell yet. One that is stopped does neither.
            is_most = 2 * len(living & kept.keys()) > len(living)
            is_late = time.monotonic() > began + (_ANSWERS_WITHIN if is_most else _MOST_ANSWER_WITHIN)
            if looking <= kept.keys() and (living <= kept.keys() or is_late):
                return kept
            job.calls.wait(ASK_AGAIN)


def looks(answers: Sequence[Given]) -> list[dict[str, Any]]:
    """Return what nodes say in their answers to `Look`; the cell is None if they have none of the job."""
    return [json.loads(answer.note) for answer in answers if isinstance(answer, Done)]


def least_stop(kept: Mapping[int, KeptStates]) -> int | None:
    """Return the earliest generation after which living cells will stop; None if they know of no stop.

    If the dead ones alone had told it, new processes would hear of it too late, or never.
    """
    return min((each.stop_at for each in kept.values() if each.stop_at is not None), default=None)


class _Choice(NamedTuple):
    """From which generation dead cells that are linked with each other can go on.

    Attributes:
        offered: by cell, what is kept of it: states by generation.
        shared: the generations of which the states of all living neighbours are kept too.
        best: the generation to choose where only these cells count.
    """

    offered: Mapping[int, Mapping[int, bytes]]
    shared: set[int]
    best: int


def choose_states(topology: Topology, kept: Mapping[int, KeptStates], begin: Collection[int]) -> States:
    """Return the latest state from which each dead cell can go on; cells that cannot are left out.

    Dead cells that are neighbours need each other's messages, so they go on from the same generation. A living
    neighbour must still have its messages since then, and must not wait for a message of the dead cell from before:
    one that is itself catching up is behind, but has the messages that the dead cell had sent until then.

    The new process will have its own messages since that generation only, and for a while it will have heard no later
    ones. A living neighbour that dies then can go on from that generation, hardly from another one. So, if possible,
    one is chosen of which its state is kept too, the same for all dead cells, since one may be beside several of them;
    or at least none that is later than the latest state kept of it.

    Args:
        topology: the neighbours of each cell.
        kept: what each living cell keeps.
        begin: cells that can also begin the epoch once more, from an empty state of generation 0.
    """
    states = states_by_cell(kept)
    first = {cell: {0: b""} for cell in begin}
    dead = set(range(topology.cells)) - kept.keys()
    choices: list[_Choice] = []
    while dead:
        group = _connected(topology, dead)
        dead -= group
        offered = {cell: first.get(cell, {}) | states.get(cell, {}) for cell in group}
        links = [(cell, kept[other]) for cell in group for other in topology.neighbours(cell) if other in kept]
        common = set.intersection(*(set(its) for its in offered.values()))
        fit = {each for each in common if all(_may_go_on(cell, each, beside) for cell, beside in links)}
        if fit:
            known = [states.get(beside.cell, {}).keys() for _, beside in links]
            shared = fit.intersection(*known)
            earlier = {each for each in fit if all(each <= max(its, default=0) for its in known)}
            choices.append(_Choice(offered, shared, max(shared or earlier or fit)))
    for_all = set.intersection(*(choice.shared for choice in choices)) if choices else set()
    chosen: States = {}
    for choice in choices:
        best = max(for_all, default=choice.best)
        chosen |= {cell: (best, its[best]) for cell, its in choice.offered.items()}
    return chosen


def _may_go_on(cell: int, generation: int, beside: KeptStates) -> bool:
    """Return whether the cell may go on from a generation beside a living neighbour. Messages come in their order."""
    return beside.oldest <= generation <= max(beside.generation, dict(beside.heard).get(cell, 0))


def states_by_cell(kept: Mapping[int, KeptStates]) -> dict[int, dict[int, bytes]]:
    """Return the states that are kept of each cell, by generation; cells of which there is none are left out."""
    found: dict[int, dict[int, bytes]] = {}
    for each in kept.values():
        for cell, generation, state in each.states:
            found.setdefault(cell, {})[generation] = state
    return found


def _connected(topology: Topology, cells: set[int]) -> set[int]:
    """Return some of these cells: one, and all that are linked with it through others of them."""
    found: set[int] = set()
    ahead = {min(cells)}
    while ahead:
        found |= ahead
        ahead = {other for cell in ahead for other in topology.neighbours(cell)} & cells - found
    return found
