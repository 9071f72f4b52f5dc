"""Tell what a router has refused, from the log of Zenoh, which tells it nowhere else.

A refused message is told by two lines of one thread: that somebody is unauthorized, and that the message was
intercepted. The first alone may be a look into the future: Zenoh works out the permissions for a key in advance. A
refused certificate is told by a warning of the link.
"""

import re
from collections import Counter
from collections.abc import Callable

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_THREAD = re.compile(r"(ThreadId\(\d+\))")
_NAME = re.compile(r"CertCommonName\(([^)]*)\)")
_UNAUTHORIZED = re.compile(r" is unauthorized to (.+?) \((?:in|e)gress\) on (\S+)")
_CERTIFICATE = re.compile(r"zenoh_link_(?:tls|quic)\S*: (.*?certificate.*?)\. Hint")
_INTERCEPTED = "Msg intercepted!"
_SAY_AGAIN = 60.0  # seconds from one line about the same refusal to the next
_MOST_KINDS = 1000
_NOBODY = "somebody without a certificate"
_UNNAMED = "a message"  # of which Zenoh does not say whose it was
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
        self._since: Counter[str] = Counter()  # refusals of a kind since the last line about it
        self._said: dict[str, float] = {}

    def read(self, line: str, now: float) -> None:
        """Read a line of the log at the time ``now``, in seconds."""
        line = _COLOURS.sub("", line)
        found = _THREAD.search(line)
        thread = found[1] if found else ""
        if (unauthorized := _UNAUTHORIZED.search(line)) is not None:
            name = _NAME.search(line)
            what, key = unauthorized.groups()
            # A key may hold line breaks, and then look like further lines of this log: who is refused may blame others.
            self._claims[thread] = f"{_NOBODY if name is None else name[1]}: {what}", f" on {key}"
        elif _INTERCEPTED in line:
            self._count(*self._claims.pop(thread, (_UNNAMED, "")), now)
        elif (certificate := _CERTIFICATE.search(line)) is not None:
            self._count(f"a link: {_NUMBERS.sub('…', certificate[1])}", "", now)

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
