"""Hosts on this machine, each a network namespace of its own, with a switch between them that can cut them off.

This process is in a network namespace of its own too, the hub. There is the switch, a bridge of the kernel. A host that
is cut off notices nothing: what it sends, and what is sent to it, is lost. The namespaces go with the last process that
is in them or holds them, however that ends, and all interfaces with them.
"""

import contextlib
import ipaddress
import os
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Self

from pyroute2 import IPRoute, NetlinkError

from lowlevel.namespaces import further_network, go_to_network, own_network

MOST_HOSTS = 1000  # a bridge has 1,024 ports
_FIRST, _PREFIX = ipaddress.IPv4Address("10.77.0.1"), 16
_BRIDGE = "hosts"
_NOWHERE = "nowhere"  # a bridge that stays down: it drops all that its ports receive
END = "eth0"
"""The name of each host's interface."""
_Ends = Callable[[], None]


class Network:
    """The hub and its hosts; a context manager. The process stays in the hub's namespace at the end.

    Args:
        hosts: how many hosts there are, at most `MOST_HOSTS`.

    Raises:
        OSError: if the system does not let this user make namespaces, bridges or cables, or the process has more than
            one thread.

    Attributes:
        hosts: how many hosts there are.
        hub: the address of this process's own namespace.
        addresses: the address of each host.
    """

    def __init__(self, hosts: int) -> None:
        self.hosts = hosts
        self.hub = str(_FIRST)
        self.addresses = [str(_FIRST + 1 + host) for host in range(hosts)]
        self._lock = threading.Lock()
        self._cuts: list[set[object]] = [set() for _ in range(hosts)]
        own_network()
        self._namespaces: list[int] = []
        try:
            self._namespaces += (further_network() for _ in range(hosts))
            with _links() as links:
                _set_up(links, "lo")
                self._switch(links, self._namespaces)
            for host, address in enumerate(self.addresses):
                self.within(host, partial(_connect, address))
        except BaseException:
            self.close()
            raise

    def _switch(self, links: IPRoute, namespaces: Sequence[int]) -> None:
        """Make the switch, and an interface `END` of each host that leads to it."""
        for name in (_BRIDGE, _NOWHERE):
            links.link("add", ifname=name, kind="bridge")
        _set_up(links, _BRIDGE, self.hub)
        for host, namespace in enumerate(namespaces):
            links.link("add", ifname=_port(host), kind="veth", peer={"ifname": END, "net_ns_fd": namespace})
            _set_up(links, _port(host))
            _plug(links, host, on=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def enter(self, host: int) -> None:
        """Put the calling thread, and all that it starts, on a host.

        Raises:
            OSError: if the system refuses.
        """
        go_to_network(self._namespaces[host])

    def within(self, host: int, do: Callable[[], None]) -> None:
        """Call a function on a host, by a thread of its own; return when it has ended.

        Raises:
            OSError: if the system refuses; or whatever the function raises.
        """
        errors: list[BaseException] = []

        def work() -> None:
            try:
                self.enter(host)
                do()
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=work, name=f"on host {host}")
        thread.start()
        thread.join()
        if errors:
            raise errors[0]

    def popen(self, host: int, command: Sequence[str], **options: Any) -> "subprocess.Popen[Any]":
        """Start a process on a host; the options are those of `subprocess.Popen`.

        Raises:
            OSError: if there is no such program.
        """
        started: list[subprocess.Popen[Any]] = []
        self.within(host, lambda: started.append(subprocess.Popen(command, **options)))
        return started[0]

    def cut(self, host: int) -> _Ends:
        """Cut a host off from all others and the hub; return what ends that, which may be called again.

        A host that is cut off twice is joined when both have ended.
        """
        this = object()
        with self._lock:
            self._cuts[host].add(this)
            self._apply(host)
        return partial(self._join, host, this)

    def _join(self, host: int, this: object) -> None:
        with self._lock:
            self._cuts[host].discard(this)
            self._apply(host)

    def _apply(self, host: int) -> None:
        """Have the switch pass on what comes from and goes to a host, or not, by its cuts."""
        with _links() as links:
            _plug(links, host, on=not self._cuts[host])

    def close(self) -> None:
        """Let the hosts go; processes that are still there keep their namespaces."""
        for namespace in self._namespaces:
            os.close(namespace)
        self._namespaces = []


def _port(host: int) -> str:
    return f"host{host}"


def _connect(address: str) -> None:
    with _links() as links:
        _set_up(links, "lo")
        _set_up(links, END, address)


@contextlib.contextmanager
def _links() -> Iterator[IPRoute]:
    """Yield what changes the interfaces of the network namespace of this thread.

    Raises:
        OSError: if the kernel refuses.
    """
    try:
        with IPRoute() as links:
            yield links
    except NetlinkError as error:
        raise OSError(error.code, os.strerror(error.code)) from error


def _plug(links: IPRoute, host: int, *, on: bool) -> None:
    """Plug a host's cable into the switch, or where nobody hears it; the host's end of it stays up.

    A cable that is in no bridge would not do: the hub itself would take what it is sent by it.
    """
    links.link("set", index=_number(links, _port(host)), master=_number(links, _BRIDGE if on else _NOWHERE))


def _number(links: IPRoute, name: str) -> int:
    (found,) = links.link_lookup(ifname=name)
    return int(found)


def _set_up(links: IPRoute, name: str, address: str | None = None) -> None:
    """Let an interface send and receive, by this address if one is given."""
    number = _number(links, name)
    if address is not None:
        links.addr("add", index=number, address=address, prefixlen=_PREFIX)
    links.link("set", index=number, state="up")
