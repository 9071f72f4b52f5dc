"""Limit how often each address may do something, by token buckets in bounded memory."""

import ipaddress
import time
from collections.abc import Callable

_KEPT = 4096  # addresses; one that is forgotten begins anew
_SUBSCRIBER = 64  # bits of an IPv6 address that one subscriber does not choose


class Limit:
    """Lets each address do something ``burst`` times at once, and ``rate`` times a second in the long run.

    Args:
        rate: times a second.
        burst: times at once.
        clock: returns the time in seconds.
    """

    def __init__(self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._burst = burst
        self._clock = clock
        self._left: dict[str, tuple[float, float]] = {}  # by address: how often, and when that was so; oldest first

    def wait(self, address: str) -> float:
        """Return the seconds until an address may do it again; 0 if it may now."""
        return max(0.0, (1.0 - self._left_now(address)) / self._rate)

    def count(self, address: str) -> None:
        """Count that an address has done it."""
        left = self._left_now(address) - 1.0
        self._left.pop(address, None)  # so that it becomes the newest
        self._left[address] = (max(0.0, left), self._clock())
        if len(self._left) > _KEPT:
            del self._left[next(iter(self._left))]

    def _left_now(self, address: str) -> float:
        left, at = self._left.get(address, (float(self._burst), 0.0))
        return min(float(self._burst), left + self._rate * (self._clock() - at))


def subscriber(host: str) -> str:
    """Return the address that limits count: an IPv4 address, or the network of an IPv6 address."""
    address = ipaddress.ip_address(host.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is not None:  # a visitor by IPv4 of a socket for both
            return str(address.ipv4_mapped)
        return str(ipaddress.ip_network((address, _SUBSCRIBER), strict=False))
    return str(address)
