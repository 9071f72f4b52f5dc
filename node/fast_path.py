"""The fast path of an exchange: compiled code from the neighbours' messages to the cell's own, with no Python between.

`node.driver` opens it while a cell needs nothing but sound messages and breeding, and closes it for everything else,
which then takes the ordinary path in Python. What the fast path does depends on the mode:

    - In lockstep the callback of a message reads it into the inbox. The last neighbour's message also breeds and
      publishes, on the network thread.
    - In async mode the callback only appends the message to the assignment's news. A node that has its core's token
      breeds to the end of its turn in one call on the main thread, and reads the news before each generation.

Python and compiled code share a row of integers, the path. Both use it under the interpreter's lock only: compiled code
holds that lock except while Zenoh sends (`_publish`) and while it breeds and looks at the clock in async mode
(`_end_turn`). Objects in the path are bare addresses; `FastPath` holds references to them as long as they are there.

Invariant: who may touch a cell's table, and when.

    - A thread that holds the assignment's lock and has closed the path: nobody else does then.
    - In lockstep the network thread, without the assignment's lock, to write a message into the inbox: only while the
      path is open, and only if it has held the interpreter's lock since it saw that. Whatever may let others run
      (reading a payload, an allocation that collects garbage) comes before that look. To breed it takes the
      assignment's lock.
    - In async mode the main thread alone, which holds the assignment's lock; the network thread only appends to the
      news.

`_carry_on` holds a reference to `go_on`, which keeps the assignment, and so the table, alive while Zenoh sends.
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
from node.cell import GENERATIONS_AT_ONCE
from node.engine import cell_table
from node.engine.compiled_generation import (
    breed_on,
    inbox_of,
    next_message_replaces_it,
    nothing_bred,
    only_a_message,
    take_back,
)
from node.engine.inbox import take_in_one
from node.engine.layout import RowLayout
from node.engine.rule import is_missing_any

_PATH = RowLayout()
_TABLE = _PATH.column("table")  # the address of the cell's table of pointers; 0: the path is closed
_OPENINGS = _PATH.column("openings")  # how often the path has been opened
_LEFT = _PATH.column("left")  # generations left before Python must take a step
_MOST = _PATH.column("most")  # generations to breed at once
_OVER_AT = _PATH.column("over_at")  # the end of the turn, in ns
_SECONDS = _PATH.column("seconds")  # with the next one a struct timespec
_NANOSECONDS = _PATH.column("nanoseconds")
# Addresses of objects of the assignment.
_NEWS = _PATH.column("news")  # the list; 0 in lockstep
_ACQUIRE = _PATH.column("acquire")  # acquires the assignment's lock, if that is free
_RELEASE = _PATH.column("release")
_LINKS = _PATH.column("links")
_GO_ON = _PATH.column("go_on")  # does the rest of the work
# Addresses of constants.
_PAYLOAD = _PATH.column("payload")
_PUBLISH = _PATH.column("publish")
_NONE = _PATH.column("none")
_TRUE = _PATH.column("true")
_PLACES = len(_PATH)
_CELL_PLACES = len(cell_table.TABLE)
_PUBLISH_NAME = sys.intern("publish")
_own = struct.Struct("<2q")  # what belongs to one callback: the path's address and the sender's cell


@subroutine
def _publish(path: Any, octets: Any) -> Any:
    """Send a message to all neighbours; return whether that succeeded. Zenoh releases the interpreter's lock meanwhile.

    The function is looked up each time: `Links.publish` changes when a neighbour must be reached through the router.
    """
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
    """In lockstep breed and publish, and leave what else there is to do to Python.

    If another thread holds the assignment's lock, this returns: that thread looks for messages again after its step.
    What is called last, `release` or `go_on`, releases the lock.
    """
    acquired = call_without(path[_ACQUIRE])
    decref(acquired)  # True and False are immortal, so the address may be compared afterwards
    if acquired != path[_TRUE]:
        return new_ref(path[_NONE])
    # While the message is sent, the main thread may open the path for another assignment: keep this one's functions.
    release, go_on = new_ref(path[_RELEASE]), new_ref(path[_GO_ON])
    if path[_LEFT] > 0:
        path[_LEFT] -= breed_on(table, min(path[_LEFT], path[_MOST]))
    else:
        nothing_bred(table)
    message = only_a_message(table)
    if message.size == 0 or not _publish(path, message):
        forget_exception()  # the ordinary path sends the message again, and reports what is wrong
        result = call_without(go_on)
    elif is_missing_any(table):  # the usual case: wait for the next messages
        result = call_without(release)
    else:  # the neighbours are one exchange ahead; nothing may be published twice, so Python sees nothing bred
        nothing_bred(table)
        result = call_without(go_on)
    decref(release)
    decref(go_on)
    return result


@subroutine
def _put_among_news(path: Any, message: Any) -> Any:
    """In async mode append a message to the news: the main thread may be using the inbox.

    Once many are unread, let Python read them if the main thread is not at it.
    """
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
    """Read the news into the inbox; return False at a message that is refused or of another epoch, and leave it there.

    The ordinary path then reads that one: it knows how to complain, and what to do with another epoch's.
    """
    news = path[_NEWS]
    messages = length(news)  # the network thread may append more, which the next call reads
    for number in range(messages):
        message = item_of_list(news, number)
        if take_in_one(inbox_of(table), content(tuple_item(message, 1)), integer(tuple_item(message, 0))) <= 0:
            remove_first(news, number)
            return False
    remove_first(news, messages)
    return True


@subroutine
def _is_over(path: Any) -> Any:
    """Return whether the turn's end has come."""
    return monotonic_nanoseconds(path[_SECONDS : _NANOSECONDS + 1]) >= path[_OVER_AT]


@c_function(CALLBACK)
def _end_turn(own: int, path_at: int) -> Any:
    """Take the news and breed to the end of the turn, sending nothing; return True, or None if nothing was bred."""
    path = integers_at(integer(path_at), 1, _PLACES)[0]
    if path[_TABLE] == 0:  # closed since Python looked
        return new_ref(path[_NONE])
    table = integers_at(path[_TABLE], _CELL_PLACES, 3)
    nothing_bred(table)
    if not _take_news(path, table):
        return new_ref(path[_NONE])
    while True:
        # Between these two calls the network thread may append to the news, so no Python object is touched here.
        thread = let_others_run()
        breed_on(table, 1)
        over = _is_over(path)
        run_again(thread)
        if over or not next_message_replaces_it(table) or not _take_news(path, table):
            return new_ref(path[_TRUE])
        take_back(table)  # the next generation's message supersedes this one, and must leave no gap in the numbers


@c_function(CALLBACK)
def _hear(own: int, sample: int) -> Any:
    """Take a neighbour's message: what Zenoh calls, on the network thread.

    ``own`` is the tuple that `FastPath.make_handler` gives to the callback.
    """
    packed = content(tuple_item(own, 0)).view(np.int64)  # by `FastPath.make_handler`: an address and the sender
    path, otherwise = integers_at(packed[0], 1, _PLACES)[0], tuple_item(own, 1)
    if path[_TABLE] == 0:  # closed: the ordinary path takes the message
        return call(otherwise, sample)
    openings, is_async = path[_OPENINGS], path[_NEWS] != 0
    payload = payload_of(sample, path[_PAYLOAD])
    if payload == 0:  # an exception is set
        return payload
    message = pair(tuple_item(own, 2), payload) if is_async else new_ref(payload)
    decref(payload)
    # Reading the payload runs Zenoh's code, and making a pair may collect garbage: other threads may have run, closed
    # the path, and even opened it again for another cell.
    if path[_TABLE] == 0 or path[_OPENINGS] != openings:
        decref(message)
        return call(otherwise, sample)
    if is_async:
        return _put_among_news(path, message)
    table = integers_at(path[_TABLE], _CELL_PLACES, 3)
    # This needs no lock: in lockstep Python steps the cell only while the path is closed.
    heard = take_in_one(inbox_of(table), content(message), packed[1]) > 0
    decref(message)
    if not heard:  # refused, or of another epoch
        return call(otherwise, sample)
    return new_ref(path[_NONE]) if is_missing_any(table) else _carry_on(path, table)


_HEAR = BuiltIn("hear", _hear)
_END_TURN = BuiltIn("end_turn", _end_turn)
_end = _END_TURN.of(None)


class FastPath:
    """One node's fast path, which is open for one assignment at most."""

    def __init__(self) -> None:
        self._path = np.zeros((1, _PLACES), np.int64)
        self._address: int = self._path.ctypes.data
        self._point(payload=PAYLOAD_NAME, publish=_PUBLISH_NAME, none=None, true=True)
        self._for: Assignment | None = None
        self._objects: dict[str, object] = {}  # keeps alive what the path holds addresses of

    def _point(self, **objects: object) -> None:
        """Write the addresses of objects into their columns."""
        self._path[0, [_PATH.names.index(name) for name in objects]] = addresses(*objects.values())

    def make_handler(self, sender: int, ordinary: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback for a sender's samples; it calls ``ordinary`` with those that the path does not take.

        The callback serves every assignment whose links have it, so it must not refer to one.
        """
        # `self._path` is there because the array must live as long as the function, which knows only its address.
        return _HEAR.of((_own.pack(self._address, sender), ordinary, sender, self._path))

    def is_open(self, assignment: Assignment) -> bool:
        """Return whether the fast path takes the assignment's messages."""
        return assignment is self._for and self._path.item(_TABLE) != 0

    def close(self, assignment: Assignment) -> bool:
        """Send the assignment's messages by the ordinary path from now on; return whether the fast path took them."""
        was_open = self.is_open(assignment)
        if was_open:
            self._path[0, _TABLE] = 0
        return was_open

    def forget(self, assignment: Assignment) -> None:
        """Close the path for an assignment and drop the references to it; requires the assignment's lock."""
        self.close(assignment)
        if assignment is self._for:
            self._for, self._objects = None, {}

    def open(self, assignment: Assignment, go_on: Callable[[Assignment], None]) -> None:
        """Let the fast path take the assignment's messages, if its generations are compiled and (in lockstep) short.

        Requires the assignment's lock.

        Args:
            assignment: the node's present epoch. In lockstep it must be idle, because this path never looks at its news
                and events. The caller checks that after opening, and closes the path if a message came in between:
                the ordinary path appends to the news first and closes the path second, so one of both threads notices.
            go_on: does what the fast path leaves to Python. In lockstep it is called with the assignment's lock held,
                and must release it; in async mode it is called without, when many messages are unread.
        """
        generations = assignment.cell.generations
        if generations is None or not generations.is_compiled or self.is_open(assignment):
            return
        if assignment.in_lockstep and not assignment.inline:
            return
        if assignment is not self._for:
            lock = assignment.lock
            objects = {
                "acquire": partial(lock.acquire, False),
                "release": lock.release,
                "links": assignment.links,
                "go_on": partial(go_on, assignment),
            }
            self._path[0, _NEWS] = 0 if assignment.in_lockstep else id(assignment.news)
            self._point(**objects)
            self._for, self._objects = assignment, objects
        # The ordinary path breeds the last one, and looks at the clock.
        self._path[0, _LEFT], self._path[0, _MOST] = GENERATIONS_AT_ONCE - 1, assignment.most
        self._path[0, _OPENINGS] += 1
        self._path[0, _TABLE] = generations.table.ctypes.data  # last, since it opens the path

    def end_turn(self, over_at: float) -> bool:
        """In async mode take the news and breed until ``over_at``, seconds on the monotonic clock.

        Call it on the main thread with the assignment's lock held. Nothing is sent; `Assignment.actions_after_breeding`
        returns what the last of these generations has to say.

        Returns:
            Whether anything was bred: not if the path is closed, or if a message must take the ordinary path.
        """
        self._path[0, _OVER_AT] = int(over_at * 1e9)
        return bool(_end(self._address))
