"""The fast path of a lockstep exchange: from the last neighbour's message to the cell's own without Python in between.

It takes the ordinary way's place only where a generation is nothing but an exchange, of messages that are sound, and
breeding in compiled code that takes little time. Whatever else there is to do, and now and then anything, is left to
the ordinary way (`node.process`), which opens this one and closes it.
"""

import struct
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from genetics.compiled import c_function, subroutine
from genetics.operators import integers_at
from node.assignment import Assignment
from node.generation import PLACES, breed_on, inbox_of, lacks, nothing_bred, only_a_message
from node.inbox import hear_one
from wire.compiled_callbacks import (
    CALLBACK,
    PAYLOAD_NAME,
    BuiltIn,
    addresses,
    attribute,
    call,
    call_without,
    content,
    drop,
    forget_exception,
    item,
    message_of,
    payload_of,
    same,
)

# What the path knows. The first is the address of the cell's table; 0: it is closed. The last are objects.
_TABLE, _LEFT, _MOST, _ACQUIRE, _RELEASE, _LINKS, _GO_ON, _PAYLOAD, _PUBLISH, _NONE, _TRUE = range(11)
_PUBLISH_NAME = sys.intern("publish")
_own = struct.Struct("<2q")  # of each function: the path's address and the sender's cell


@subroutine
def _publish(path: Any, octets: Any) -> Any:
    """Whether a message could be sent; the interpreter's lock is let go of meanwhile."""
    publish = attribute(path[_LINKS], path[_PUBLISH])
    if publish == 0:
        return False
    message = message_of(octets)
    done = call(publish, message)
    drop(publish)
    drop(message)
    if done != 0:
        drop(done)
    return done != 0


@subroutine
def _carry_on(path: Any, table: Any) -> Any:
    """Breed and publish, if nobody else is at it (who is looks again afterwards)."""
    acquired = call_without(path[_ACQUIRE])
    drop(acquired)  # True and False are for ever
    if acquired != path[_TRUE]:
        return same(path[_NONE])
    release, go_on = same(path[_RELEASE]), same(path[_GO_ON])  # the path may be another's before they are called
    if path[_LEFT] > 0:
        path[_LEFT] -= breed_on(table, min(path[_LEFT], path[_MOST]))
    else:
        nothing_bred(table)
    message = only_a_message(table)
    if message.size == 0 or not _publish(path, message):
        forget_exception()  # the ordinary way publishes it again, and says what is wrong
        result = call_without(go_on)
    elif lacks(table):
        result = call_without(release)
    else:
        nothing_bred(table)
        result = call_without(go_on)
    drop(release)
    drop(go_on)
    return result


@c_function(CALLBACK)
def _hear(own: int, sample: int) -> Any:
    """Take a neighbour's message."""
    its = content(item(own, 0)).view(np.int64)
    path, otherwise = integers_at(its[0], 1, 11)[0], item(own, 1)
    if path[_TABLE] == 0:
        return call(otherwise, sample)
    table = integers_at(path[_TABLE], PLACES, 3)
    payload = payload_of(sample, path[_PAYLOAD])
    if payload == 0:
        return payload
    heard = hear_one(inbox_of(table), content(payload), its[1])
    drop(payload)
    if not heard:
        return call(otherwise, sample)
    if lacks(table):
        return same(path[_NONE])
    return _carry_on(path, table)


_HEAR = BuiltIn("hear", _hear)


class FastPath:
    """One node's; it is open for one assignment at most."""

    def __init__(self) -> None:
        self._path = np.zeros((1, 11), np.int64)
        self._path[0, _PAYLOAD:] = addresses(PAYLOAD_NAME, _PUBLISH_NAME, None, True)
        self._for: Assignment | None = None
        self._objects: tuple[object, ...] = ()  # that the path knows by their addresses

    def ear(self, sender: int, ordinary: Callable[[Any], None]) -> Callable[[Any], None]:
        """What to call with a sender's samples; it calls ``ordinary`` as long as the path is closed."""
        # The array must live as long as the function.
        return _HEAR.of((_own.pack(self._path.ctypes.data, sender), ordinary, self._path))

    def close(self, assignment: Assignment) -> bool:
        """All messages for this assignment go the ordinary way from now on; returns whether they did not before."""
        if assignment is not self._for or self._path[0, _TABLE] == 0:
            return False
        self._path[0, _TABLE] = 0
        return True

    def open(self, assignment: Assignment, go_on: Callable[[Assignment], None]) -> None:
        """Messages are taken by the fast path, if the cell's next generations may be.

        Args:
            assignment: what the node is at; it must be idle, and have nothing unread.
            go_on: does what is not for the fast path; it is called with the turn, and must end it.
        """
        generations = assignment.cell.generations
        if not assignment.brisk or generations is None or assignment.cell.ended:
            return
        if assignment is not self._for:
            turn = assignment.turn
            self._for = assignment
            self._objects = (partial(turn.acquire, False), turn.release, assignment.links, partial(go_on, assignment))
            self._path[0, _ACQUIRE:_PAYLOAD] = addresses(*self._objects)
        # Until the history is to be digested: then Python looks at the clock too.
        self._path[0, _LEFT], self._path[0, _MOST] = assignment.cell.room - 1, assignment.most
        self._path[0, _TABLE] = generations.table.ctypes.data
