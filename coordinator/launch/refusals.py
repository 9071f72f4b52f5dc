"""Tell what a router has refused, from the log of Zenoh, which tells it nowhere else.

A refused message is told by two lines of one thread: that a session is unauthorized, and that the message was
intercepted. The first line may lack the member's name; an earlier line about the session has it. Of a session that no
rule knows, there is the second line alone. At a session's first use of a key Zenoh also says what it may do with it: a
line for each kind of message and direction, which are no refusals. A refused certificate is told by a warning of the
link.
"""

import re
from collections import Counter
from collections.abc import Callable

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_THREAD = re.compile(r"(ThreadId\(\d+\))")
_NAME = re.compile(r"CertCommonName\(([^)]*)\)")
_SESSION = re.compile(r"access_control: (?:Using cached result: )?([0-9a-f]+) ")
_VERDICT = re.compile(r" is (un)?authorized to (.+?) \((?:in|e)gress\) on (\S+)")
_IN_ADVANCE = "caching permissions for"
_CACHED = "Using cached result"
_KINDS_IN_ADVANCE = 9  # lines after such a line
_CERTIFICATE = re.compile(r"zenoh_link_(?:tls|quic)\S*: (.*?certificate.*?)\. Hint")
_INTERCEPTED = "Msg intercepted!"
_SAY_AGAIN = 60.0  # seconds from one line about the same refusal to the next
_MOST_KINDS = 1000
_MOST_SESSIONS = 10_000
_NOBODY = "somebody who is no member"
_NUMBERS = re.compile(r"\d+")


class Refusals:
    """Counts refusals, and says the first of each kind at once, further ones once a minute with their number.

    Args:
        say: called with a line for people.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        # By thread, the latest message of which somebody was not authorized: the kind, and where to.
        self._claims: dict[str, tuple[str, str]] = {}
        self._in_advance: Counter[str] = Counter()  # by thread, how many verdicts are still to come that refuse nothing
        self._names: dict[str, str] = {}  # of the members, by session
        self._since: Counter[str] = Counter()  # refusals of a kind since the last line about it
        self._said: dict[str, float] = {}

    def read(self, line: str, now: float) -> None:
        """Read a line of the log at the time ``now``, in seconds."""
        line = _COLOURS.sub("", line)
        found = _THREAD.search(line)
        thread = found[1] if found else ""
        if (verdict := _VERDICT.search(line)) is not None:
            # A key may hold line breaks, and then look like further lines of this log: who is refused may blame others.
            self._hear_verdict(thread, line, *verdict.groups())
        elif _IN_ADVANCE in line:
            self._claims.pop(thread, None)
            self._in_advance[thread] = _KINDS_IN_ADVANCE
        elif _INTERCEPTED in line:
            self._in_advance[thread] = 0
            self._count(*self._claims.pop(thread, (f"{_NOBODY}: a message", "")), now)
        elif (certificate := _CERTIFICATE.search(line)) is not None:
            self._count(f"a link: {_NUMBERS.sub('…', certificate[1])}", "", now)

    def _hear_verdict(self, thread: str, line: str, refused: str | None, what: str, key: str) -> None:
        """Note what a session may not do, as long as that is not said in advance."""
        name = self._name(line)
        if _CACHED not in line and self._in_advance[thread] > 0:
            self._in_advance[thread] -= 1
        elif refused:
            self._claims[thread] = f"{name}: {what}", f" on {key}"
        else:
            self._claims.pop(thread, None)

    def _name(self, line: str) -> str:
        """Return the name of the member whose session a line is about."""
        session, named = _SESSION.search(line), _NAME.search(line)
        if session is None or named is None:
            return _NOBODY if session is None else self._names.get(session[1], _NOBODY)
        self._names.pop(session[1], None)  # so that it becomes the newest
        self._names[session[1]] = named[1]
        if len(self._names) > _MOST_SESSIONS:
            del self._names[next(iter(self._names))]
        return named[1]

    def _count(self, kind: str, where: str, now: float) -> None:
        """Count a refusal of a kind: of a member and what it tried, wherever that was to go."""
        if kind not in self._said and len(self._said) >= _MOST_KINDS:
            self._said = {each: at for each, at in self._said.items() if now < at + _SAY_AGAIN}
            kind = kind if len(self._said) < _MOST_KINDS else "others"
        self._since[kind] += 1
        if now >= self._said.get(kind, -_SAY_AGAIN) + _SAY_AGAIN:
            times = self._since.pop(kind)
            self._said[kind] = now
            self._say(f"refused {kind}{where}" + (f" ({times} times)" if times > 1 else ""))
