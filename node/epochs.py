"""The epochs of a node: the one before, the present one, and the one that comes; and the links of each."""

import contextlib
import json
import threading
from collections.abc import Callable
from dataclasses import replace

import zenoh

import topologies
from node.assignment import Assignment, Coming
from node.cell import Cell
from node.driver import Driver
from node.events import Start
from node.fingerprint import fingerprint
from node.links import Links
from node.node_config import NodeConfig
from node.plan import Plan
from node.queries import drop, reply
from node.suspects import Suspects
from node.telemetry import Telemetry
from problems import BadInput, registry
from topologies import Topology
from wire.control import (
    Begin,
    Command,
    Done,
    Drop,
    Finish,
    Halt,
    Missed,
    Prepare,
    ProposeStop,
    Refused,
    TellStates,
    Wiring,
)

InAnEpoch = ProposeStop | Halt | Missed | TellStates | Finish
"""The commands for the cell of one epoch."""


class Epochs:
    """Prepares, begins and leaves the epochs of jobs on one node.

    Only the main thread uses it, except for `note` and `wirings`.

    Args:
        config: the node's place in the cluster.
        control: the session through the router.
        driver: steps the cell; it holds the present epoch and the coming one.
        telemetry: told the size of the cluster.

    Attributes:
        past: the epoch before, kept because neighbours may still ask for its messages and the coordinator for its end.
        links: the links of the latest wiring; None if this node has had none yet.
    """

    def __init__(self, config: NodeConfig, control: zenoh.Session, driver: Driver, telemetry: Telemetry) -> None:
        self.past: Assignment | None = None
        self._config = config
        self._control = control
        self._driver = driver
        self._telemetry = telemetry
        self._suspects = Suspects(config.folder, config.node, config.crash, config.limits, self._tell_of_suspects)
        # A context in which the code of the latest prepared problem runs, see `node.suspects.Watch.making`.
        self._making: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext
        # The latest command that makes links prepared for an earlier one useless; the network thread writes it while
        # the main thread may be waiting for neighbours in `Links`.
        self._order: Prepare | Halt | Drop | TellStates | None = None
        self._changed = threading.Condition()  # notified when `_order` changes or a neighbour is linked
        self.links: Links | None = None
        if config.topology:
            topology = topologies.parse(config.topology)
            self._linked(topology, Wiring(0, tuple(range(topology.cells))))

    def note(self, command: Command) -> None:
        """Note a command that has just come, on the network thread.

        The main thread may be waiting in `Links` for a neighbour that has died. It would not take the command from its
        queue before that wait ends, and this ends it.
        """
        is_for_checkpoint = isinstance(command, TellStates) and command.once
        if (isinstance(command, Prepare) and self._config.node in command.wiring.nodes) or (
            isinstance(command, Drop | Halt | TellStates)
            and not is_for_checkpoint
            and self._order is not None
            and command.job == self._order.job
        ):
            with self._changed:
                self._order = command
                self._changed.notify_all()

    @property
    def wirings(self) -> list[int]:
        """The numbers of the wirings whose links are open, in the order in which they were made. Any thread may ask."""
        users = (self.past, self._driver.assignment)
        all_links = [self.links, *(user.links for user in users if user is not None)]
        return sorted({links.wiring.number for links in all_links if links is not None})

    def _linked(self, topology: Topology, wiring: Wiring, order: Prepare | None = None) -> Links:
        """Return links for a wiring: open ones if they fit, else new ones, once every neighbour has been linked.

        The latest ones may be those of an epoch that a coordinator prepared and did not begin. The next coordinator
        may go on with the links of the present epoch.

        Raises:
            GivenUpError: if a newer command than ``order`` arrives while this waits.
            TimeoutError: if a neighbour cannot be linked.
        """
        links = self._open_links(topology, wiring)
        if links.complete:
            return links

        def given_up() -> bool:
            return order is not None and self._order is not order

        hasty = order is not None and order.takeover is not None and order.takeover.others_wait
        try:
            links.wait(given_up, hasty)
        except TimeoutError:
            self.links = None
            raise
        return links

    def _open_links(self, topology: Topology, wiring: Wiring) -> Links:
        """Return links for a wiring, which may still have to wait for neighbours.

        Links for which the wait was given up stay open. While processes die one after the other the coordinator sends
        command after command, and links that began anew with each would not be complete before the next death.
        """
        if self.links is not None and self.links.leads_to(topology, wiring):
            return self.links
        self._close_latest()  # of an epoch that was given up: neighbours must not find them at the new ones' port
        present = None if self._driver.assignment is None else self._driver.assignment.links
        if present is not None and present.leads_to(topology, wiring):
            self.links = present
        else:
            handlers = self._driver.make_handler, self._driver.queue.put
            self.links = Links(self._config, topology, wiring, self._control, *handlers, self._changed)
        return self.links

    def _close_latest(self) -> None:
        """Close the latest links unless the present epoch or the one before still needs them."""
        users = (self._driver.assignment, self.past)
        if self.links is not None and all(user is None or user.links is not self.links for user in users):
            self.links.close()
            self.links = None

    def prepare(self, command: Prepare) -> Done | Refused:
        """Get ready for an epoch: a job's first one becomes the assignment, a later one waits as `coming`."""
        # A node that is given a deme or a state takes the place of one that died: it does not go on with its own deme.
        may_go_on = not command.anew and not command.deme and command.takeover is None
        if may_go_on and not self._catch_up_with(command):
            return Refused(f"node {self._config.node} has not begun epoch {command.epoch - 1} yet: try again")
        goes_on = may_go_on and self._has_lived_before(command)
        if not goes_on and self._driver.assignment is not None:
            self.forget(self._driver.assignment.job)
        self._driver.coming = None
        try:
            file = self._config.modules.read(command.file)
            watch = self._suspects.of(command.job, file)
            self._making = watch.making if registry.is_users_own(file.kind) else contextlib.nullcontext
            with self._making():
                plan = Plan.of(file, command.epoch, command.since or 0, checked=True, protection=watch)
            # The deme must fit the new epoch's genomes. Of a user's own problem the coordinator cannot check that,
            # since it does not import the user's module.
            if goes_on and self._driver.assignment is not None and not command.fresh:
                file.keep_coding(self._driver.assignment.cell.plan.coding, plan.coding)
            links = self._linked(plan.topology, command.wiring, command)
            waits = goes_on or command.deme or command.takeover is not None
            with self._making():
                cell = None if waits else Cell(plan, links.cell, command.job)
        except BadInput as error:
            return Refused(str(error), "input")
        except Exception as error:
            return Refused(f"node {self._config.node}: {type(error).__name__}: {error}")
        self._telemetry.cluster_nodes = command.cluster_nodes
        if cell is None:
            begins_with = command.since, command.deme, command.fresh, command.takeover
            self._driver.expect(Coming(command.job, plan, links, *begins_with))
        else:
            self._enter(Assignment(cell, links))
        return Done(json.dumps(fingerprint()))

    def _catch_up_with(self, command: Prepare) -> bool:
        """Enter the coming epoch if the command prepares a later one; return False if the present one goes on still.

        A coordinator has told all nodes to begin an epoch before it prepares the next one. This node missed that.
        """
        coming = self._driver.coming
        if coming is None or coming.job != command.job or coming.plan.epoch >= command.epoch:
            return True
        if not self._is_free_for_the_next:
            return False
        self._enter_coming(coming)
        return True

    def _enter(self, assignment: Assignment) -> None:
        self._driver.enter(assignment)
        self._log_suspects()

    def _tell_of_suspects(self) -> None:
        """Have the main thread log who is deadly, if it can be said of which cell."""
        self._driver.queue.put(self._log_suspects)

    def _log_suspects(self) -> None:
        if self._driver.assignment is not None:
            for line in self._suspects.news():
                self._telemetry.log("warning", line, self._driver.assignment.cell)

    def _has_lived_before(self, command: Prepare) -> bool:
        """Return whether this node is in an earlier epoch of that job.

        If it is in the same epoch already, because the command came twice, it prepares anew.
        """
        assignment = self._driver.assignment
        return assignment is not None and assignment.job == command.job and assignment.epoch < command.epoch

    def begin(self, command: Begin, query: zenoh.Query) -> None:
        """Begin an epoch. If asked again, as by a coordinator that takes over, report to the latest query only."""
        assignment, coming = self._driver.assignment, self._driver.coming
        if coming is not None and is_meant(command, coming.job, coming.plan.epoch, coming.links):
            coming.begun = query
            self._enter_next_epoch()
        elif assignment is not None and is_meant(command, assignment.job, assignment.epoch, assignment.links):
            if assignment.cell.state == "prepared":
                self._driver.start(assignment, Start())
            self.answer_with_report(assignment, query)
        elif self.past is not None and is_meant(command, self.past.job, self.past.epoch, self.past.links):
            self.answer_with_report(self.past, query)  # the report may have been lost the first time
        else:
            drop(query)

    def answer_with_report(self, assignment: Assignment, query: zenoh.Query) -> None:
        """Answer with the cell's report, now or when the cell stops."""
        if assignment.begun is not None:
            drop(assignment.begun)
        assignment.begun = query
        self._send_report(assignment)

    def report(self, assignment: Assignment, report: bytes) -> None:
        """Answer with the report of a cell that has stopped, and go on to the next epoch if that has been begun."""
        assignment.report = report
        self._send_report(assignment)
        self._enter_next_epoch()

    def _send_report(self, assignment: Assignment) -> None:
        if assignment.report is not None and assignment.begun is not None:
            reply(assignment.begun, assignment.report)
            assignment.begun = None

    @property
    def _is_free_for_the_next(self) -> bool:
        """Whether the cell has stopped in the present epoch, or there is none."""
        return self._driver.assignment is None or self._driver.assignment.cell.ended

    def _enter_next_epoch(self) -> None:
        """Move to the coming epoch if it has been begun and the present one has stopped."""
        coming = self._driver.coming
        if coming is not None and coming.begun is not None and self._is_free_for_the_next:
            self._enter_coming(coming)

    def _enter_coming(self, coming: Coming) -> None:
        """Move to the coming epoch; the deme of the present one moves along."""
        before = self._driver.assignment
        # Only this node knows after which generation its cell stopped, so the coordinator leaves `since` open.
        bred = 0 if before is None else before.cell.plan.since + before.cell.rows.generation
        plan = replace(coming.plan, since=bred if coming.since is None else coming.since)
        genomes = plan.deme_of(coming.deme) if coming.deme else None
        if before is not None and genomes is None and not coming.fresh and coming.takeover is None:
            genomes = before.cell.rows.genomes[0]
        with self._making():
            cell = Cell(plan, coming.links.cell, coming.job)
        assignment = Assignment(cell, coming.links, coming.news)
        self._drop_past()  # kept until now: neighbours and coordinator may have asked how it ended
        self.past = before
        self._enter(assignment)
        assignment.begun = coming.begun
        self._driver.start(assignment, Start(genomes, coming.takeover))

    def _drop_past(self) -> None:
        """Forget the past epoch and close its links, unless a later epoch uses them too."""
        past, self.past = self.past, None
        in_use = (self.links, None if self._driver.assignment is None else self._driver.assignment.links)
        if past is not None and past.links not in in_use:
            past.links.close()

    def forget(self, job: int) -> None:
        """Forget a job. The latest links stay open, since the next job may want the same ones."""
        assignment = self._driver.assignment
        if assignment is not None and assignment.job == job:
            self._driver.leave(assignment)
            self._drop_past()
            if assignment.links is not self.links:
                assignment.links.close()
        if self._driver.coming is not None and self._driver.coming.job == job:
            self._driver.coming = None


def is_meant(command: Begin | InAnEpoch, job: int, epoch: int, links: Links) -> bool:
    """Return whether a command is for a node that is in that epoch of a job, or prepared for it, with these links."""
    wiring = command.wiring if isinstance(command, Begin | Halt | TellStates) else None
    return (job, epoch) == (command.job, command.epoch) and wiring in (None, links.wiring.number)
