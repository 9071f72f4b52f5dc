"""How Zenoh is configured: threads, links, limits and leases, in one place.

What was measured to matter: without shared memory (its watchdog wakes every process 20 times a second) and with long
leases an idle node costs next to nothing; nodes do with a single runtime thread; a router must not share one thread
between receiving and sending, or it can deadlock.
"""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import zenoh

NODE_RUNTIME = "(rx:(handover:net),acc:(handover:net),tx:(handover:net),app:(handover:net),net:(worker_threads:1))"
ROUTER_RUNTIME = "(rx:(worker_threads:1),acc:(handover:net),tx:(handover:net),app:(handover:net))"

MOST_SESSIONS = 10_000
_SLOW_MS = 60_000
_MOST_MESSAGE_BYTES = 64 << 20  # the longest answer to a client
_ALWAYS: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # ms: a router would wait for half a second for what is not looked for
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": _SLOW_MS,
    "transport/link/tx/keep_alive": 2,
    "transport/link/rx/max_message_size": _MOST_MESSAGE_BYTES,
    "transport/unicast/max_sessions": MOST_SESSIONS,
    "transport/unicast/accept_pending": MOST_SESSIONS,
    "transport/unicast/open_timeout": _SLOW_MS,
    "transport/unicast/accept_timeout": _SLOW_MS,
    # Neighbours start in any order: keep trying, at once and patiently.
    "connect/timeout_ms": _SLOW_MS,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 10, "period_max_ms": 200, "period_increase_factor": 1.5},
}


def use_runtime(runtime: str) -> None:
    """Choose the threads of this process; Zenoh reads this once, at the first session."""
    os.environ["ZENOH_RUNTIME"] = runtime


def log_nothing() -> None:
    """Unless the environment asks for a log (RUST_LOG), let Zenoh skip its spans and events.

    As long as nobody has said what becomes of them it makes each one up and looks for another log: 2 % of an exchange.
    """
    zenoh.init_log_from_env_or("off")


def unix_socket(folder: Path, name: str) -> str:
    """The endpoint of a Unix socket in ``folder``, which must be private and short (a path has at most 107 bytes)."""
    return f"unixsock-stream/{folder}/{name}.sock"


def router(listen: Iterable[str]) -> zenoh.Session:
    """Open the session that makes this process a router."""
    return _open("router", list(listen), [])


def client(endpoint: str) -> zenoh.Session:
    """Open a session through the router at ``endpoint``."""
    return _open("client", [], [endpoint])


def visitor(endpoint: str, within: float) -> zenoh.Session:
    """The same for somebody who wants to know ``within`` so many seconds if there is no router.

    Once open, the session looks for its router for as long as it takes, as all do.

    Raises:
        zenoh.ZError: if nobody answers there.
    """
    hasty = {"connect/timeout_ms": int(within * 1000), "connect/exit_on_failure": True}
    return _open("client", [], [endpoint], hasty)


def peer(listen: Iterable[str], links: Iterable[str]) -> zenoh.Session:
    """Open a session with direct links only; peers never forward for each other."""
    return _open("peer", list(listen), list(links))


def _open(mode: str, listen: list[str], connect: list[str], other: Mapping[str, Any] | None = None) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in (_ALWAYS | dict(other or {})).items():
        config.insert_json5(key, json.dumps(value))
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    return zenoh.open(config)
