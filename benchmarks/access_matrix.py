"""Try what each role can send, receive and answer on each kind of link, with real keys.

    python -m benchmarks.access_matrix [--link tls]

A router serves Unix sockets, TLS and QUIC. For each link and role a session tries every kind of message of a cluster,
its own and forged ones. A trusted session on the router's Unix socket sees what passes. Then the same for direct links
between nodes of two hosts. The table has ``+`` where a message passes and ``.`` where it is refused, and ends with what
differs from `ALLOWED`, if anything does. Each kind of refusal on a link with certificates must also be in the log of
the router.
"""

import argparse
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import zenoh

from coordinator.launch.refusals import Refusals
from supernode.deploy.addresses import free_port
from supernode.files.authority import Authority
from wire import access, sessions
from wire.jobs import RIGHTS
from wire.keys import Keys
from wire.members import ROUTERS, Identity

KEYS = Keys("c1")
LINKS = ("unix", "tls", "quic")
ROLES = ("coordinator", "spy", "node", "client", "watcher", "dashboard", "router", "revoked", "foreign", "expired")
_MAY = {"client": RIGHTS, "watcher": ("watch",), "dashboard": ("watch", "submit")}
_LOGGED_AS = {
    "publish": "Put",
    "hear": "Declare Subscriber",
    "ask": "Query",
    "answer": "Declare Queryable",
    "live": "Liveliness Token",
    "watch": "Declare Liveliness Subscriber",
}
"""The name of each kind of message in Zenoh's log."""
_WITHIN, _NOT_WITHIN, _PAUSE = 5.0, 0.5, 0.02  # seconds
_COORDINATOR, _SPY, _NODE = {"coordinator"}, {"spy"}, {"node"}
_CLIENTS = {"client", "watcher", "dashboard"}

ALLOWED: Mapping[str, set[str]] = {
    "publish node/3/out": _NODE,
    "publish node/3/stats": _NODE,
    "publish best": _SPY,
    "publish spy/stats": _SPY,
    "publish spy/counters": _SPY,
    "publish state": _COORDINATOR,
    "publish log": _COORDINATOR | _SPY | _NODE,
    "publish coordinator": set(),
    "hear node/3/out": _SPY | _NODE,
    "hear node/3/stats": _SPY,
    "hear best": _COORDINATOR | _CLIENTS,
    "hear spy/stats": _COORDINATOR | _CLIENTS,
    "hear spy/counters": _COORDINATOR | _CLIENTS,
    "hear state": _CLIENTS,
    "hear log": _COORDINATOR | _CLIENTS,
    "ask jobs/OWN/watch": _CLIENTS,
    "ask jobs/OWN/submit": {"client", "dashboard"},
    "ask jobs/OWN/change": {"client"},
    "ask jobs/OWN/down": {"client"},
    "ask jobs/other/watch": set(),
    "ask jobs/*/submit": set(),
    "ask nodes": _NODE,
    "ask node/3/control": _COORDINATOR | _NODE,
    "ask node/*/control": _COORDINATOR | _NODE,
    "ask spy/control": _COORDINATOR,
    "ask host/1.node": _COORDINATOR,
    "answer jobs/client/submit": _COORDINATOR,
    "answer nodes": _COORDINATOR,
    "answer node/3/control": _NODE,
    "answer spy/control": _SPY,
    "answer host/1.OWN": _NODE,
    "answer host/1.other": set(),
    "live coordinator": _COORDINATOR,
    "live spy/life/1": _SPY,
    "live node/3": _NODE,
    "live node/3/routed": _NODE,
    "live node/3/life/1-1.OWN": _NODE,
    "live node/3/life/1-1.other": set(),
    "live host/1.OWN": _NODE,
    "live host/1.other": set(),
    "watch coordinator": _NODE | _CLIENTS,
    "watch node/3/life/1": _COORDINATOR | _CLIENTS,
    "watch node/3": _SPY | _NODE,
    "watch spy/life/1": _COORDINATOR,
    "watch host/1.x": _COORDINATOR,
}
"""Each kind of message, with the roles that may send or receive it over links with certificates."""

DIRECT = {
    "publish node/3/out": _NODE,
    "publish node/4/out": set(),  # another host's node
    "publish node/3/stats": set(),
    "publish best": set(),
    "hear node/0/out": _NODE,
    "ask node/0/control": set(),
    "live node/3": _NODE,
    "live node/4": set(),
}
"""The same for a direct link to a node, from the host of node 3."""

Table = dict[tuple[str, str, str], bool]
"""Whether a message passes, by link, message and role."""


class _Meeting:
    """Two sessions whose messages come in order: the one that tries, and the one that sees what passes.

    Args:
        trying: the session of the role.
        trusted: the session that sees.
        own: the name of the role's member.
        in_order: whether a question through the router comes back after what was sent before it. Not so over QUIC,
            which has streams, and not without a router. Then what is to pass is given some seconds, all else half a
            second.
    """

    def __init__(self, trying: zenoh.Session, trusted: zenoh.Session, own: str, in_order: bool) -> None:
        self._in_order = in_order
        self._trying = trying
        self._trusted = trusted
        self._own = own

    def passes(self, message: str, is_expected: bool) -> bool:
        """Try a message; return whether it passes. Without order, try longer if that is expected."""
        kind, _, key = message.partition(" ")
        until = time.monotonic() + (_WITHIN if is_expected else _NOT_WITHIN)
        while True:
            if getattr(self, f"_{kind}")(f"supernode/c1/{key.replace('OWN', self._own)}"):
                return True
            if self._in_order or time.monotonic() > until:
                return False

    def _publish(self, key: str) -> list[object]:
        return self._heard(self._trying, self._trusted, key)

    def _hear(self, key: str) -> list[object]:
        return self._heard(self._trusted, self._trying, key)

    def _heard(self, sender: zenoh.Session, hearer: zenoh.Session, key: str) -> list[object]:
        heard: list[object] = []
        subscriber = hearer.declare_subscriber(key, zenoh.handlers.Callback(heard.append, indirect=False))
        self._settle()
        sender.put(key, b"x")
        self._settle()
        subscriber.undeclare()  # type: ignore[no-untyped-call]
        return heard

    def _ask(self, key: str) -> list[object]:
        return self._asked(self._trying, self._trusted, key)

    def _answer(self, key: str) -> list[object]:
        return self._asked(self._trusted, self._trying, key)

    def _asked(self, asker: zenoh.Session, answerer: zenoh.Session, key: str) -> list[object]:
        concrete = key.replace("*", "3")

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(concrete, b"x")

        queryable = answerer.declare_queryable(concrete, zenoh.handlers.Callback(answer, indirect=False))
        self._settle()
        replies = [reply for reply in asker.get(key, timeout=_WITHIN) if reply.ok is not None]
        queryable.undeclare()  # type: ignore[no-untyped-call]
        return list(replies)

    def _live(self, key: str) -> list[object]:
        return self._seen(self._trying, self._trusted, key)

    def _watch(self, key: str) -> list[object]:
        return self._seen(self._trusted, self._trying, key)

    def _seen(self, living: zenoh.Session, watching: zenoh.Session, key: str) -> list[object]:
        seen: list[object] = []
        token = living.liveliness().declare_token(key)
        self._settle()
        see = zenoh.handlers.Callback(seen.append, indirect=False)
        watcher = watching.liveliness().declare_subscriber(key, see, history=True)
        self._settle()
        watcher.undeclare()  # type: ignore[no-untyped-call]
        token.undeclare()  # type: ignore[no-untyped-call]
        return seen

    def _settle(self) -> None:
        """Let all that was sent arrive: a question without an answerer comes back after what was sent before it."""
        if not self._in_order:
            time.sleep(_PAUSE)
        for session in (self._trying, self._trusted, self._trying, self._trusted):
            for _ in session.get("supernode/nobody", timeout=_WITHIN):
                pass


@contextmanager
def authority() -> Iterator[Path]:
    """Yield the folder of an authority with a member of each role; "revoked" has keys, but is struck off the list."""
    with tempfile.TemporaryDirectory() as folder:
        made = Authority.make(Path(folder) / "keys")
        for role in ("router", "coordinator", "spy", "node"):
            made.add(role, role, (), 1.0, ("127.0.0.1",))
        for name, may in _MAY.items():
            made.add(name, "dashboard" if name == "dashboard" else "client", may, 1.0, ())
        made.add("revoked", "client", RIGHTS, 1.0, ())
        kept = (made.folder / "revoked").rename(made.folder / "kept")
        made.revoke("revoked")
        kept.rename(made.folder / "revoked")
        made.add("expired", "client", RIGHTS, 1e-9, ())
        foreign = Authority.make(Path(folder) / "foreign")
        foreign.add("client", "client", RIGHTS, 1.0, ())
        shutil.copytree(foreign.folder / "client", made.folder / "foreign")
        shutil.copy(made.folder / ROUTERS, made.folder / "foreign")  # it trusts the cluster, which does not trust it
        yield made.folder


def through_the_router(
    folder: Path, link: str, roles: Iterable[str] = ROLES, messages: Collection[str] = ALLOWED.keys()
) -> Table:
    """Return what passes through a router over a kind of link."""
    router = Identity.read(folder / "router")
    local = sessions.unix_socket(folder, "router")
    endpoint = local if link == "unix" else f"{link}/127.0.0.1:{free_port()}"
    table: Table = {}
    with ExitStack() as stack:
        listen = {local, endpoint}
        stack.enter_context(closing(sessions.router(listen, router, access.of_the_router(router.members()))))
        trusted = stack.enter_context(closing(sessions.client(local)))
        for role in roles:
            try:
                trying = sessions.visitor(endpoint, _WITHIN, Identity.read(folder / role))
            except zenoh.ZError:  # its certificate is none of a client
                table |= dict.fromkeys(((link, message, role) for message in messages), False)
                continue
            with closing(trying):
                meeting = _Meeting(trying, trusted, role, in_order=link != "quic")
                for message in messages:
                    table[link, message, role] = meeting.passes(message, role in ALLOWED[message])
    return table


def directly(folder: Path, link: str, roles: Iterable[str] = ROLES) -> Table:
    """Return what passes over a direct link to node 0, which expects node 3 of the host ``node`` there."""
    here = Identity.read(folder / "node")
    local = sessions.unix_socket(folder, "n0")
    table: Table = {}
    first = free_port()
    for number, role in enumerate(roles):
        endpoint = f"{link}/127.0.0.1:{first + number}"  # another one each time: QUIC frees a port late
        listening = sessions.peer([local, endpoint], [], here, access.of_links("c1", {"node": [3]}))
        with closing(listening), closing(sessions.peer([], [endpoint], Identity.read(folder / role))) as trying:
            _until_linked(trying)
            meeting = _Meeting(trying, listening, role, in_order=False)
            for message, allowed in DIRECT.items():
                table[f"direct {link}", message, role] = meeting.passes(message, role in allowed)
    return table


def _until_linked(session: zenoh.Session) -> None:
    """Wait until there is a link, or for as long as a refused one is tried."""
    until = time.monotonic() + _WITHIN
    while not session.info.peers_zid() and time.monotonic() < until:
        time.sleep(_PAUSE)


def differences(table: Table) -> list[str]:
    """Return what passes but should not, and what should but does not."""
    found = []
    for (link, message, role), passes in table.items():
        expected = True if link == "unix" else role in (DIRECT if link.startswith("direct") else ALLOWED)[message]
        if passes != expected:
            found.append(f"{link}: {message} by {role}: expected {_word(expected)}, found {_word(passes)}")
    return found


class RouterLog:
    """Zenoh's log of refusals in this process, which has it on standard output; what is printed goes on as before.

    Attributes:
        lines: the first of each kind.
    """

    def __init__(self) -> None:
        self.lines: set[str] = set()
        reading, writing = os.pipe()
        sys.stdout = os.fdopen(os.dup(1), "w")
        os.dup2(writing, 1)
        sessions.log_refusals()
        threading.Thread(target=self._read, args=(reading,), daemon=True).start()

    def _read(self, log: int) -> None:
        refusals = Refusals(self.lines.add)
        with os.fdopen(log, errors="replace") as lines:
            for line in lines:
                refusals.read(line, 0.0)

    def lacks(self, table: Table) -> list[str]:
        """Return which refusals of a table are not in the log."""
        expected = {
            "refused somebody who is no member: a message"
            if role == "revoked"
            else f"refused {role}: {_LOGGED_AS[message.partition(' ')[0]]} "
            for (link, message, role), passes in table.items()
            if not passes and link in ("tls", "quic") and role not in ("foreign", "expired", "router")
        }
        lines = self.lines.copy()
        missing = {each for each in expected if not any(line.startswith(each) for line in lines)}
        links = [line for line in lines if line.startswith("refused a link: ")]
        missing |= {why for why in ("UnknownIssuer", "expired") if not any(why in line for line in links)}
        return [f"the router's log lacks {each!r}" for each in sorted(missing)]


def _word(passes: bool) -> str:
    return "that it passes" if passes else "that it is refused"


def main() -> None:
    """Try all, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--link", choices=LINKS, help="through the router over this kind of link only")
    only = parser.parse_args().link
    log = RouterLog()
    tries: list[tuple[Callable[[Path, str], Any], str]] = [
        *((through_the_router, link) for link in LINKS),
        *((directly, link) for link in LINKS if link != "unix"),
    ]
    if only:
        tries = [(through_the_router, only)]
    found: Table = {}
    with authority() as folder:
        for function, link in tries:
            found |= function(folder, link)
    for link in dict.fromkeys(link for link, _, _ in found):
        print(f"\n| {link} | {' | '.join(ROLES)} |\n|---|{'---|' * len(ROLES)}")
        for message in dict.fromkeys(message for at, message, _ in found if at == link):
            marks = " | ".join("+" if found[link, message, role] else "." for role in ROLES)
            print(f"| {message} | {marks} |")
    wrong = differences(found) + ([] if only == "unix" else log.lacks(found))
    print("\n" + "\n".join(wrong or [f"{len(found)} tries, all as they should be"]))
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
