"""Network namespaces as hosts for benchmarks: those of `supernode chaos --hosts`, or with a slow switch. Linux only."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pyroute2 import IPRoute

from benchmarks.relay import tap
from coordinator.threads import begin_again_with_one_thread
from lowlevel.namespaces import own_network
from supernode.chaos.network import END, Network


class Namespaces(Network):
    """Hosts that see each other and nobody else.

    The switch is that of `supernode.chaos.network`, or, with ``relay``, `benchmarks.relay`, which can delay and lose
    what passes. A program calls `prepare` before it makes any.

    Args:
        hosts: how many.
        relay: seconds by which packets are late, and the share of them that is lost; None for the bridge.

    """

    def __init__(self, hosts: int, relay: tuple[float, float] | None = None) -> None:
        self._wanted = relay
        self._relay: subprocess.Popen[str] | None = None
        super().__init__(hosts)

    def run(self, host: int, command: Sequence[str]) -> bytes:
        """Return what a command on a host prints."""
        with self.popen(host, command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            printed, _ = process.communicate()
            return bytes(printed)

    def relay_cpu_seconds(self) -> float:
        """Return the processor time that the relay has used so far; 0 without one."""
        if self._relay is None:
            return 0.0
        stat = Path(f"/proc/{self._relay.pid}/stat").read_text(encoding="ascii")
        user, system = stat.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def _switch(self, links: IPRoute, namespaces: Sequence[int]) -> None:
        if self._wanted is None:
            super()._switch(links, namespaces)
            return
        taps: list[int] = []
        for host in range(self.hosts):
            self.within(host, lambda: taps.append(tap(END)))
        command = [sys.executable, "-m", "benchmarks.relay", *map(str, self._wanted), *map(str, taps)]
        self._relay = subprocess.Popen(command, stdin=subprocess.PIPE, text=True, pass_fds=taps)
        for each in taps:
            os.close(each)

    def _apply(self, host: int) -> None:
        if self._relay is None:
            super()._apply(host)
            return
        assert self._relay.stdin is not None
        self._relay.stdin.write(f"{'cut' if self._cuts[host] else 'join'} {host}\n")
        self._relay.stdin.flush()

    def close(self) -> None:
        """Let the hosts go, and end the relay."""
        if self._relay is not None:
            assert self._relay.stdin is not None
            self._relay.stdin.close()
            self._relay.wait()
        super().close()


def prepare() -> None:
    """Put this process where it may make network namespaces, before it starts any thread.

    Raises:
        SystemExit: if this user may not.
    """
    begin_again_with_one_thread()
    try:
        own_network()
    except OSError as error:
        raise SystemExit(f"network namespaces: {error}; run it as root, or where users may make them") from None
