"""The commands that a node takes from the coordinator and from neighbours, each answered at once or at a cell's end."""

import json
from functools import partial

import zenoh

from node.assignment import Assignment
from node.driver import Driver
from node.epochs import Epochs, InAnEpoch, is_meant
from node.events import Asked, AskedForStates, Propose
from node.events import Halt as Halted
from node.fingerprint import fingerprint
from node.queries import answer, drop
from wire import control
from wire.control import (
    Begin,
    Command,
    Done,
    Drop,
    Halt,
    Look,
    Missed,
    Prepare,
    ProposeStop,
    Refused,
    TellStates,
)
from wire.seal import Seal
from wire.strict import Rejected


class Commands:
    """Decodes commands on the network thread, and carries them out on the main thread.

    Args:
        node: the node's number.
        seal: opens sealed commands.
        driver: its queue gets the commands; it holds the present epoch.
        epochs: prepares, begins and leaves epochs.
    """

    def __init__(self, node: int, seal: Seal, driver: Driver, epochs: Epochs) -> None:
        self._node = node
        self._seal = seal
        self._driver = driver
        self._epochs = epochs

    def take(self, query: zenoh.Query) -> None:
        """Decode a command and queue it for the main thread, which carries it out. On the network thread."""
        command: Command | Rejected
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            command = control.decode(self._seal.open(str(query.key_expr), payload))
        except Rejected as error:
            command = error
        else:
            self._epochs.note(command)
            if isinstance(command, Look):  # at once: a cell may be in a long evaluation
                return self._answer_look(command, query)
            if isinstance(command, TellStates) and self._assignment_of(command) is None:
                return drop(query)  # at once: the main thread may be waiting for neighbours, and the coordinator for it
        return self._driver.queue.put(partial(self._carry_out, query, command))

    def _assignment_of(self, command: InAnEpoch) -> Assignment | None:
        """Return the epoch that the command is for, if this node is in it or has just left it; else None."""
        for assignment in (self._driver.assignment, self._epochs.past):
            if assignment is not None and is_meant(command, assignment.job, assignment.epoch, assignment.links):
                return assignment
        return None

    def _carry_out(self, query: zenoh.Query, command: Command | Rejected) -> None:
        """Carry out a command and answer it; a command about a job or epoch unknown here gets no answer."""
        if isinstance(command, Rejected):
            answer(query, Refused(f"node {self._node}: bad command: {command.reason}"))
        elif isinstance(command, Prepare):
            if self._node in command.wiring.nodes:
                answer(query, self._epochs.prepare(command))
            else:
                drop(query)
        elif isinstance(command, Drop):
            self._epochs.forget(command.job)
            answer(query, Done())
        elif isinstance(command, Begin):
            self._epochs.begin(command, query)
        elif not isinstance(command, Look):  # which has its answer already
            assignment = self._assignment_of(command)
            if assignment is not None:
                self._obey(assignment, command, query)
            else:
                drop(query)

    def _answer_look(self, command: Look, query: zenoh.Query) -> None:
        """Answer a coordinator that looks for the nodes of a job. On the network thread."""
        assignment = self._driver.assignment
        if assignment is not None and assignment.job == command.job:
            cell = assignment.cell
            place = {
                "node": self._node,
                "cell": cell.number,
                "epoch": assignment.epoch,
                "begun": cell.state != "prepared",
            }
            answer(query, Done(json.dumps({**place, "wirings": self._epochs.wirings, "versions": fingerprint()})))
        else:  # so that the coordinator can tell this from a router that lets no question through
            answer(query, Done(json.dumps({"node": self._node, "cell": None})))

    def _obey(self, assignment: Assignment, command: Command, query: zenoh.Query) -> None:
        """Carry out a command for an epoch that this node is in or has just left."""
        if isinstance(command, ProposeStop):
            assignment.events.append(Propose(command.reason))
            answer(query, Done())
        elif isinstance(command, Missed | TellStates):
            assignment.events.append(
                Asked(command.generation, query) if isinstance(command, Missed) else AskedForStates(query, command.once)
            )
            if assignment is self._epochs.past:  # `Driver.run` steps the present epoch only
                self._driver.carry_on(assignment)
        elif isinstance(command, Halt):
            assignment.events.append(Halted())
            self._epochs.answer_with_report(assignment, query)
        else:
            answer(query, Refused("that is a command for the spy"))
