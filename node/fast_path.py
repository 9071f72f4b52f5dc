"""The fast path of an exchange: without Python from neighbours' messages to the cell's own.

It takes the ordinary way's place (`node.process`, which opens it and closes it) only where there is nothing else to do
for a while. In lockstep a generation is then one exchange, of messages that are sound, and breeding that takes little
time; it is carried out where the last neighbour's message comes in. In async mode messages are put where they are
taken from before the next generation, and a node with the token breeds on to the end of its turn.

Who may touch a cell's table, and when:

- A thread that holds the assignment's `turn` and has closed the path: nobody else does then.
- In lockstep Zenoh's network thread, without the turn, to write a message into the inbox: only while the path is open,
  and only if it has held the interpreter's lock since it saw that. Whatever may let other threads run (reading a
  payload, an allocation that collects garbage) comes before that look. To breed it takes the turn.
- In async mode the main thread alone, which holds the turn; the network thread only appends to the news.

`go_on`, to which `_carry_on` holds a reference, keeps the assignment, and so the table, alive while a message is
published.
"""

import struct
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from lowlevel.c_api import (
    CALLBACK,
    PAYLOAD_NAME,
    BuiltIn,
    addresses,
    append,
    attribute,
    call,
    call_without,
    content,
    decref,
    forget_exception,
    integer,
    item_of_list,
    length,
    let_others_run,
    message_of,
    new_ref,
    pair,
    payload_of,
    remove_first,
    run_again,
    tuple_item,
)
from lowlevel.clocks import monotonic_nanoseconds
from lowlevel.compiled import c_function, subroutine
from lowlevel.pointers import integers_at
from node.assignment import MANY_UNREAD, Assignment
from node.generation import (
    PLACES,
    breed_on,
    inbox_of,
    lacks,
    may_be_superseded,
    nothing_bred,
    only_a_message,
    take_back,
)
from node.inbox import hear_one

# What the path knows. The first is the address of the cell's table; 0: it is closed. The last are objects.
_TABLE, _OPENINGS, _LEFT, _MOST, _OVER_AT, _SECONDS, _NANOSECONDS = range(7)
_NEWS, _ACQUIRE, _RELEASE, _LINKS, _GO_ON, _PAYLOAD, _PUBLISH, _NONE, _TRUE = range(7, 16)
_PLACES = 16
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
    decref(publish)
    decref(message)
    if done != 0:
        decref(done)
    return done != 0


@subroutine
def _carry_on(path: Any, table: Any) -> Any:
    """Breed and publish, if nobody else is at it (who is looks again afterwards)."""
    acquired = call_without(path[_ACQUIRE])
    decref(acquired)  # True and False are for ever
    if acquired != path[_TRUE]:
        return new_ref(path[_NONE])
    release, go_on = new_ref(path[_RELEASE]), new_ref(path[_GO_ON])  # the path may be another's before they are called
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
    decref(release)
    decref(go_on)
    return result


@subroutine
def _put_among_news(path: Any, message: Any) -> Any:
    """Another thread may be at the inbox; when there are many it is time to see whether it is."""
    append(path[_NEWS], message)
    decref(message)
    if length(path[_NEWS]) < MANY_UNREAD:
        return new_ref(path[_NONE])
    go_on = new_ref(path[_GO_ON])
    result = call_without(go_on)
    decref(go_on)
    return result


@subroutine
def _take_news(path: Any, table: Any) -> Any:
    """Read what has come; False if a message is refused or of another epoch, which is left there."""
    news = path[_NEWS]
    messages = length(news)
    for number in range(messages):
        message = item_of_list(news, number)
        if hear_one(inbox_of(table), content(tuple_item(message, 1)), integer(tuple_item(message, 0))) <= 0:
            remove_first(news, number)
            return False
    remove_first(news, messages)
    return True


@subroutine
def _is_over(path: Any) -> Any:
    """Whether the turn is."""
    return monotonic_nanoseconds(path[_SECONDS : _NANOSECONDS + 1]) >= path[_OVER_AT]


@c_function(CALLBACK)
def _end_turn(own: int, path_at: int) -> Any:
    """Take the news, breed to the end of the turn, and tell nobody before; True if anything was bred."""
    path = integers_at(integer(path_at), 1, _PLACES)[0]
    if path[_TABLE] == 0:  # closed since Python looked
        return new_ref(path[_NONE])
    table = integers_at(path[_TABLE], PLACES, 3)
    nothing_bred(table)
    if not _take_news(path, table):
        return new_ref(path[_NONE])
    while True:
        thread = let_others_run()
        breed_on(table, 1)
        over = _is_over(path)
        run_again(thread)
        if over or not may_be_superseded(table) or not _take_news(path, table):
            return new_ref(path[_TRUE])
        take_back(table)


@c_function(CALLBACK)
def _hear(own: int, sample: int) -> Any:
    """Take a neighbour's message."""
    its = content(tuple_item(own, 0)).view(np.int64)
    path, otherwise = integers_at(its[0], 1, _PLACES)[0], tuple_item(own, 1)
    if path[_TABLE] == 0:
        return call(otherwise, sample)
    openings, is_async = path[_OPENINGS], path[_NEWS] != 0
    payload = payload_of(sample, path[_PAYLOAD])
    if payload == 0:
        return payload
    message = pair(tuple_item(own, 2), payload) if is_async else new_ref(payload)
    decref(payload)
    # To read the payload runs Zenoh's code, and to make a pair may collect garbage: other threads may have run.
    if path[_TABLE] == 0 or path[_OPENINGS] != openings:
        decref(message)
        return call(otherwise, sample)
    if is_async:
        return _put_among_news(path, message)
    table = integers_at(path[_TABLE], PLACES, 3)
    heard = hear_one(inbox_of(table), content(message), its[1]) > 0
    decref(message)
    if not heard:
        return call(otherwise, sample)
    return new_ref(path[_NONE]) if lacks(table) else _carry_on(path, table)


_HEAR = BuiltIn("hear", _hear)
_END_TURN = BuiltIn("end_turn", _end_turn)
_end = _END_TURN.of(None)


class FastPath:
    """One node's; it is open for one assignment at most."""

    def __init__(self) -> None:
        self._path = np.zeros((1, _PLACES), np.int64)
        self._address: int = self._path.ctypes.data
        self._path[0, _PAYLOAD:] = addresses(PAYLOAD_NAME, _PUBLISH_NAME, None, True)
        self._for: Assignment | None = None
        self._objects: tuple[object, ...] = ()  # that the path knows by their addresses

    def make_handler(self, sender: int, ordinary: Callable[[Any], None]) -> Callable[[Any], None]:
        """What to call with a sender's samples; it calls ``ordinary`` as long as the path is closed."""
        # The array must live as long as the function.
        return _HEAR.of((_own.pack(self._address, sender), ordinary, sender, self._path))

    def is_open(self, assignment: Assignment) -> bool:
        """Whether its messages are taken by the fast path."""
        return assignment is self._for and self._path.item(_TABLE) != 0

    def close(self, assignment: Assignment) -> bool:
        """All messages for this assignment go the ordinary way from now on; returns whether they did not before."""
        was_open = self.is_open(assignment)
        if was_open:
            self._path[0, _TABLE] = 0
        return was_open

    def forget(self, assignment: Assignment) -> None:
        """Close it for an assignment, and keep nothing of that."""
        self.close(assignment)
        if assignment is self._for:
            self._for, self._objects = None, ()

    def open(self, assignment: Assignment, go_on: Callable[[Assignment], None]) -> None:
        """Messages are taken by the fast path, if the cell's next generations may be.

        Args:
            assignment: what the node is at. In lockstep it must be idle; whoever opens looks afterwards whether it is,
                and closes if not: messages that come the ordinary way are put among the news first, and then close.
            go_on: does what is not for the fast path. In lockstep it is called with the turn, which it must end; in
                async mode when there are many unread messages.
        """
        generations = assignment.cell.generations
        if generations is None or (assignment.in_lockstep and not assignment.inline) or self.is_open(assignment):
            return
        if assignment is not self._for:
            turn = assignment.turn
            objects = (partial(turn.acquire, False), turn.release, assignment.links, partial(go_on, assignment))
            self._path[0, _NEWS] = 0 if assignment.in_lockstep else id(assignment.news)
            self._path[0, _ACQUIRE:_PAYLOAD] = addresses(*objects)
            self._for, self._objects = assignment, objects
        # Until the history is to be digested: then Python looks at the clock too.
        self._path[0, _LEFT], self._path[0, _MOST] = assignment.cell.room - 1, assignment.most
        self._path[0, _OPENINGS] += 1
        self._path[0, _TABLE] = generations.table.ctypes.data

    def end_turn(self, over_at: float) -> bool:
        """In async mode, while this path is open, take the news and breed, until then on the monotonic clock.

        Nobody is told before the end; what the last of these generations has to say is for the assignment to ask.
        Nothing is bred, and False returned, if some of the news is not for this path.
        """
        self._path[0, _OVER_AT] = int(over_at * 1e9)
        return bool(_end(self._address))
