"""The process of a node: it connects one cell to its neighbours, and its two threads carry out the cell's actions.

`node.driver` decides when the cell steps; `node.commands` and `node.epochs` do what the coordinator commands;
`node.telemetry` sends counters and log records. This module opens the sessions and joins these parts.

Zenoh invokes callbacks on its own network thread. In lockstep that thread also runs the cell: the callback that
receives the last neighbour's message breeds and publishes. A generation then needs no thread switch, which would be
most of an exchange's cost. The main thread does everything that may take long or block: commands, reports, questions to
neighbours, long generations, and in async mode every generation, so that messages still arrive while it breeds.

Who may touch what:
    - The cell (`Assignment.cell`) belongs to the thread that holds `Assignment.lock`, a lock. The network thread only
      tries to get the lock and never waits for it; when it fails, the holder looks at the news again after its step.
      Two exceptions: counters are read without it, beside breeding; and in async mode, where only the main thread
      breeds, `TurnTaking` takes back the number of an unsent message without it.
    - `Assignment.news` and `Assignment.events` may be appended to without the lock. The network thread appends to the
      news; the thread that holds the lock removes from both.
    - `Driver.assignment`, `Driver.coming`, `Epochs.past` and `Epochs.links` are assigned on the main thread only. The
      network thread copies one into a local variable before it uses it twice.
    - `Driver.queue` takes tasks from any thread; only the main thread runs them.
    - The fast path (`node.fast_path`) runs on the network thread, in place of `Driver.hear`; only `FastPath.end_turn`
      is called by the main thread.
"""

import threading
from typing import Any

import zenoh

from lowlevel import thread_state
from node import cpu_affinity
from node.assignment import Assignment
from node.commands import Commands
from node.cpu_affinity import Pinning
from node.driver import Driver, make_fast_path, wake
from node.epochs import Epochs
from node.events import Action, Answer, Answered, AnswerStates, Ask, Complain
from node.node_config import NodeConfig
from node.queries import answer, reply
from node.telemetry import Telemetry
from node.turn_taking import TurnTaking
from wire import control, sessions
from wire.callbacks import direct
from wire.control import Missed
from wire.report import Report
from wire.seal import Seal
from wire.strict import Rejected, of, pack, unpack

# Made when the zygote imports this module, not in each node: making one touches forty pages, which a forked node would
# have to copy. Each node still has its own, because a fork copies what the node writes to.
FAST_PATH = make_fast_path()
_ANSWERED_WITHIN = 1.0  # s in which a neighbour answers; else it is asked again


def live(config: NodeConfig) -> None:
    """Run a node in this process; does not return, since the coordinator or the zygote ends the process."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    thread_state.keep_in_this_process()
    cpu_affinity.take_turns()
    process = NodeProcess(config)
    config.limits.apply()
    process.driver.run()


class NodeProcess:
    """One node: it opens its sessions, joins its parts, and carries out what its cells ask for.

    Attributes:
        control: the session through the router.
        driver: steps the cell and runs the main thread's tasks.
        epochs: prepares and begins the epochs of jobs.
    """

    def __init__(self, config: NodeConfig) -> None:
        self._config = config
        self._seal = Seal(config.secret)
        self._pinning = Pinning()
        self.control = sessions.client(config.router, config.identity)
        counters = self.control.declare_publisher(config.keys.stats(config.node))
        self._telemetry = Telemetry(config.node, counters.put, self._publish_record)
        self.driver = Driver(
            self._carry_out, self._telemetry, TurnTaking(config.core_tokens), FAST_PATH, self._pinning.pin
        )
        self.epochs = Epochs(config, self.control, self.driver, self._telemetry)
        self._commands = Commands(config.node, self._seal, self.driver, self.epochs)
        self._declared = self._register()

    def _register(self) -> list[Any]:
        """Declare what this node answers; the liveliness tokens come last, since they mean "ready"."""
        config, keys = self._config, self._config.keys
        queryable = self.control.declare_queryable(keys.control(config.node), direct(self._take_command))
        liveliness = self.control.liveliness()
        tokens = (keys.life(config.node, config.process), keys.node(config.node))
        return [queryable, *(liveliness.declare_token(key) for key in tokens)]

    def _take_command(self, query: zenoh.Query) -> None:
        """Take a command, on the network thread."""
        self._pinning.network_thread = threading.get_native_id()  # known before there is a cell, so before any pinning
        self._commands.take(query)

    def _publish_record(self, record: bytes) -> None:
        self.control.put(self._config.keys.log, record)

    def _carry_out(self, assignment: Assignment, action: Action) -> None:
        """Carry out an action other than `Publish`, on the main thread; each of these may block."""
        if isinstance(action, Ask):
            self._ask(assignment, action)
        elif isinstance(action, Answer):
            assert isinstance(action.question, zenoh.Query)
            reply(action.question, pack(tuple(action.payloads)))
        elif isinstance(action, AnswerStates):
            assert isinstance(action.question, zenoh.Query)
            answer(action.question, action.kept)
        elif isinstance(action, Complain):
            sender = assignment.links.wiring.nodes[action.sender]
            self._telemetry.log("warning", f"rejects messages of node {sender}: {action.reason}", assignment.cell)
        elif isinstance(action, Report):
            if action.error is not None:
                self._telemetry.log("error", action.error, assignment.cell)
            else:
                # The last counters leave before the report. A cell that failed may have no individuals to count.
                self._telemetry.send_counters(assignment)
            self.epochs.report(assignment, action.encode())

    def _ask(self, assignment: Assignment, action: Ask) -> None:
        """Ask a neighbour, through the router, for a message that has not come by the direct link."""

        def hear(reply: zenoh.Reply) -> None:  # on a thread of Zenoh's
            if reply.ok is not None and (payloads := _messages_in(reply.ok.payload.to_bytes())):
                assignment.events.append(Answered(action.neighbour, action.generation, payloads))
                self.driver.queue.put(wake)

        key = self._config.keys.control(assignment.links.wiring.nodes[action.neighbour])
        missed = control.encode(Missed(assignment.job, assignment.epoch, action.generation))
        sealed, priority = self._seal.close(key, missed), sessions.LONG_ANSWER
        self.control.get(key, direct(hear), payload=sealed, timeout=_ANSWERED_WITHIN, priority=priority)


def _messages_in(payload: bytes) -> list[bytes]:
    """Return the messages in a neighbour's answer; none if it is malformed."""
    try:
        return [of(bytes, message) for message in of(list, unpack(payload))]
    except Rejected:
        return []
