"""How Zenoh is configured: threads, links, limits and leases, in one place.

Measurements led to these choices:

- No shared memory, whose watchdog wakes every process 20 times a second, and long leases: an idle node then costs next
  to nothing.
- A node needs only one runtime thread.
- A router must not receive and send on the same thread, or it can deadlock: while it waits for room in the queue to an
  asker, another thread must empty that queue. Nor may that be the thread (``net``) that tells askers that their time is
  over, since that waits for the same queue: nobody was answered for 10 s. A socket is watched by the threads that have
  accepted it (``acc``), so these send as well.
"""

import ipaddress
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import zenoh

from wire.keys import PREFIX
from wire.members import OTHERS, ROUTERS, Identity

# In the syntax of ZENOH_RUNTIME; a runtime with a "handover" has no threads and runs its tasks on the other's.
NODE_RUNTIME = "(rx:(handover:net),acc:(handover:net),tx:(handover:net),app:(handover:net),net:(worker_threads:1))"
ROUTER_RUNTIME = "(rx:(worker_threads:1),acc:(worker_threads:1),tx:(handover:acc),app:(handover:net))"

UNIX_SOCKET = "unixsock-stream/"
"""How the endpoint of a Unix socket begins; the rest is its path."""
MOST_SESSIONS = 10_000
_SLOW_MS = 60_000  # with hundreds of processes on a core any step of a handshake may take long
_MOST_MESSAGE_BYTES = 64 << 20  # the longest answer to a client
LONG_ANSWER = zenoh.Priority.DATA_LOW
"""The priority of questions with long answers; the answers have the question's. See `_LONG_QUEUE`."""

# A node's one network thread sends, and empties the queues (one for each priority) of what others have sent. If it
# finds a queue full, or another thread that waits for room there, it waits too: for the seconds after which Zenoh gives
# up. So long answers have a queue of their own, with room for the longest, in batches of 64 KB: three states of each
# of four neighbours (`node.engine.state_size`) and some 12 KB of messages. (Large states of more neighbours may
# fill it still.) A thread of its own for sending would cost each exchange a change of threads.
_LONG_QUEUE = 16  # batches; 2 by default
# A client that does not read must not hold up the answers to others, which pass the router one after another. So the
# router drops an answer of over 64 KB that finds no room for 2 s, a shorter one at once, and lets nobody wait so again
# before the client has read something; the client asks again. Without this it waits for room, and closes the link after
# 5 s. Answers have the quality of their question, so they could be dropped on their way to the router too: there the
# coordinator waits as long as for others.
_DROP = "transport/link/tx/queue/congestion_control/drop"
_ANSWERS_ABROAD: dict[str, Any] = {
    "qos/network": [
        {
            "messages": ["query"],
            "key_exprs": [f"{PREFIX}/*/jobs/**"],
            "link_protocols": ["tcp", "tls", "quic"],
            "flows": ["ingress"],
            "overwrite": {"congestion_control": "drop"},
        }
    ],
    f"{_DROP}/max_wait_before_drop_fragments": 2_000_000,  # us
    "transport/link/tx/queue/size/data": 16,  # batches of 64 KB, made when they are needed; 2 by default
}
# On a slow link between hosts, messages that wait in the system's buffer, which grows to megabytes, reach the neighbour
# seconds later, a new champion behind them. So that buffer is small, and what finds no room is dropped at once instead
# of holding up the cell for 1 ms. A neighbour gets fewer messages, but fresh ones. In lockstep few messages are under
# way. All links of a session have the same wait. It is not 0, since parts of long messages would then not wait either.
# QUIC has no such buffer to set.
_SEND_BUFFER = 32768  # bytes; Linux doubles it. On a round trip of 10 ms that is still 4 MB/s
_FRESH: dict[str, Any] = {
    "transport/link/tcp/so_sndbuf": _SEND_BUFFER,
    "transport/link/tls/so_sndbuf": _SEND_BUFFER,
    f"{_DROP}/wait_before_drop": 1,  # us
}
_PATIENT = {f"{_DROP}/{wait}": 5_000_000 for wait in ("wait_before_drop", "max_wait_before_drop_fragments")}  # us
_ALWAYS: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # ms; by default a router waits half a second for replies to scouting, which is off here
    "transport/shared_memory/enabled": False,
    "adminspace/enabled": False,  # any client could read there what is connected and how it is configured
    "transport/link/tx/lease": _SLOW_MS,
    "transport/link/tx/keep_alive": 2,
    "transport/link/rx/max_message_size": _MOST_MESSAGE_BYTES,
    "transport/link/tx/queue/size/data_low": _LONG_QUEUE,
    "transport/unicast/max_sessions": MOST_SESSIONS,
    "transport/unicast/accept_pending": MOST_SESSIONS,
    "transport/unicast/open_timeout": _SLOW_MS,
    "transport/unicast/accept_timeout": _SLOW_MS,
    # Neighbours start in any order, so opening a session does not fail but keeps trying: often at first, then less so.
    "connect/timeout_ms": _SLOW_MS,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 10, "period_max_ms": 200, "period_increase_factor": 1.5},
}


def use_runtime(runtime: str) -> None:
    """Choose the threads of this process. Call it before the first session: Zenoh reads the choice only then."""
    os.environ["ZENOH_RUNTIME"] = runtime


def log_nothing() -> None:
    """Let Zenoh skip its log's spans and events, unless the environment asks for a log (RUST_LOG).

    Without a configured log Zenoh still creates each of them and searches for a receiver: 2 % of an exchange.
    """
    zenoh.init_log_from_env_or("off")


def log_refusals() -> None:
    """Have Zenoh tell on standard output which messages and links are refused, and nothing else.

    See `coordinator.launch.refusals`. Only where access is controlled is there anything to tell.
    """
    zenoh.init_log_from_env_or("off,zenoh::net::routing::interceptor=trace,zenoh_link_tls=warn,zenoh_link_quic=warn")


def unix_socket(folder: Path, name: str) -> str:
    """Return the endpoint of a Unix socket in ``folder``.

    The folder must be private: its permissions are what keeps other users out. It must also be short, since the path of
    a Unix socket has at most 107 bytes.
    """
    return f"{UNIX_SOCKET}{folder}/{name}.sock"


def router(
    listen: Iterable[str], identity: Identity | None = None, access: Mapping[str, Any] | None = None
) -> zenoh.Session:
    """Open the session that makes this process a router.

    Args:
        listen: the endpoints to listen at.
        identity: who this process shows itself to be on encrypted links.
        access: what others may send and receive: see `wire.access`. None: everything.
    """
    return _open("router", list(listen), [], identity, {**_ANSWERS_ABROAD, **_access(access)})


def client(endpoint: str, identity: Identity | None = None) -> zenoh.Session:
    """Open a session through the router at ``endpoint``. A router that is not running yet is no error."""
    return _open("client", [], [endpoint], identity)


def answering(endpoint: str, identity: Identity | None = None) -> zenoh.Session:
    """Open a session as `client` does, for the coordinator: what it sends waits for room on its way to the router."""
    return _open("client", [], [endpoint], identity, _PATIENT)


def visitor(endpoint: str, within: float, identity: Identity | None = None) -> zenoh.Session:
    """Open a session through the router at ``endpoint``, or fail after ``within`` seconds if no router answers.

    Once open, the session reconnects to its router however long that takes, like all sessions.

    Raises:
        zenoh.ZError: if no router answers in time.
    """
    hasty = {"connect/timeout_ms": int(within * 1000), "connect/exit_on_failure": True}
    return _open("client", [], [endpoint], identity, hasty)


def peer(
    listen: Iterable[str],
    links: Iterable[str],
    identity: Identity | None = None,
    access: Mapping[str, Any] | None = None,
) -> zenoh.Session:
    """Open a session with direct links only. Peers never forward messages, so only linked sessions reach each other."""
    listen, links = list(listen), list(links)
    goes_abroad = any(not endpoint.startswith(UNIX_SOCKET) for endpoint in (*listen, *links))
    return _open("peer", listen, links, identity, {**(_FRESH if goes_abroad else {}), **_access(access)})


def is_encrypted(endpoint: str) -> bool:
    """Return whether links at ``endpoint`` are encrypted, and both ends show certificates."""
    return endpoint.partition("/")[0] in ("tls", "quic")


def is_plain_abroad(endpoint: str) -> bool:
    """Return whether links at ``endpoint`` are not encrypted, and may come from other machines."""
    protocol, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0].strip("[]")
    return protocol in ("tcp", "udp", "ws", "wss") and host != "localhost" and not _is_loopback(host)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _access(access: Mapping[str, Any] | None) -> Mapping[str, Any]:
    return {} if access is None else {"access_control": access}


def _open(
    mode: str,
    listen: list[str],
    connect: list[str],
    identity: Identity | None = None,
    other: Mapping[str, Any] | None = None,
) -> zenoh.Session:
    config = zenoh.Config()
    trusted = ROUTERS if mode == "client" else OTHERS
    tls = {} if identity is None else {"transport/link/tls": dict(identity.tls(trusted))}
    for key, value in (_ALWAYS | tls | dict(other or {})).items():
        config.insert_json5(key, json.dumps(value))
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    return zenoh.open(config)
