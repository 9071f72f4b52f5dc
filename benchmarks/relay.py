"""A switch in user space between hosts in network namespaces: it delays frames, loses some, and can cut a host off.

Usage: python -m benchmarks.relay DELAY LOSS TAP TAP ...  (started by `benchmarks.namespaces`)

It is given the descriptor of a TAP device of each host, and passes frames on until its standard input ends. A line
``cut NUMBER`` there cuts a host off, and ``join NUMBER`` ends that. Linux's netem would do the same in the kernel, but
not every kernel has it.
"""

from __future__ import annotations

import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque

_TUNSETIFF = 0x400454CA  # Linux: ioctl(2) of /dev/net/tun
_TAP, _NO_HEADER = 0x0002, 0x1000
_LONGEST = 65536
_AT_ONCE = 64  # frames read from one host before others are looked at
_MOST_WAITING = 200_000  # frames under way; beyond, new ones are lost, as in any queue


class Relay:
    """Passes frames from TAP to TAP.

    Args:
        taps: the descriptors.
        delay: s by which each frame is late.
        loss: the share of frames that is lost.
    """

    def __init__(self, taps: list[int], delay: float, loss: float) -> None:
        self._delay, self._loss, self._taps = delay, loss, taps
        self._at: dict[bytes, int] = {}  # address to TAP
        self._cut: set[int] = set()
        self._waiting: deque[tuple[float, int, bytes]] = deque()
        self._random = random.Random(1)

    def run(self) -> None:
        """Pass frames on until standard input ends."""
        poll = select.epoll()
        for tap in self._taps:
            poll.register(tap, select.EPOLLIN)
        poll.register(sys.stdin.fileno(), select.EPOLLIN)
        while True:
            left = -1.0 if not self._waiting else max(0.0, self._waiting[0][0] - time.monotonic())
            for found, _ in poll.poll(left):
                if found != sys.stdin.fileno():
                    self._take(found)
                elif not self._obey(sys.stdin.readline()):
                    return
            self._deliver()

    def _obey(self, line: str) -> bool:
        word, _, number = line.strip().partition(" ")
        if word == "cut":
            self._cut.add(self._taps[int(number)])
        elif word == "join":
            self._cut.discard(self._taps[int(number)])
        return bool(line)

    def _take(self, tap: int) -> None:
        for _ in range(_AT_ONCE):
            try:
                frame = os.read(tap, _LONGEST)
            except BlockingIOError:
                return
            self._at[frame[6:12]] = tap
            if len(self._waiting) < _MOST_WAITING and self._random.random() >= self._loss:
                self._waiting.append((time.monotonic() + self._delay, tap, frame))

    def _deliver(self) -> None:
        now = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now:
            _, source, frame = self._waiting.popleft()
            known = self._at.get(frame[:6])
            for tap in self._taps if known is None else [known]:
                if tap != source and not self._cut & {tap, source}:
                    _write(tap, frame)


def _write(tap: int, frame: bytes) -> None:
    try:
        os.write(tap, frame)
    except OSError:  # its host is not up yet, or its queue is full
        return


def tap(name: str) -> int:
    """Return the descriptor of a new TAP device in the calling thread's network namespace."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", name.encode(), _TAP | _NO_HEADER))
    return device


def main() -> None:
    """Pass frames on."""
    delay, loss, *taps = sys.argv[1:]
    Relay([int(each) for each in taps], float(delay), float(loss)).run()


if __name__ == "__main__":
    main()
