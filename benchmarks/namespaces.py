"""Network namespaces as hosts for benchmarks: each has an address on a switch between them. Linux, as root."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self


class Namespaces:
    """Hosts that see each other and nobody else; they are removed at the end, with whatever failed.

    The switch is a bridge of the kernel in a namespace of its own, or, with ``relay``, `benchmarks.relay`, which can
    delay and lose what passes.

    Args:
        hosts: how many.
        relay: seconds by which packets are late, and the share of them that is lost; None for the bridge.

    Attributes:
        addresses: the address of each host.
    """

    def __init__(self, hosts: int, relay: tuple[float, float] | None = None) -> None:
        prefix = f"sn{os.getpid()}"
        self._hub, self._names = f"{prefix}-hub", [f"{prefix}-{number}" for number in range(hosts)]
        self._wanted = relay
        self._relay: subprocess.Popen[str] | None = None
        self.addresses = [f"10.77.0.{number + 1}" for number in range(hosts)]

    def __enter__(self) -> Self:
        try:
            self._make()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._remove()

    def command(self, host: int, command: list[str]) -> list[str]:
        """Return a command that runs another one on a host."""
        return ["ip", "netns", "exec", self._names[host], *command]

    def relay_cpu_seconds(self) -> float:
        """Return the processor time that the relay has used so far; 0 without one."""
        if self._relay is None:
            return 0.0
        stat = Path(f"/proc/{self._relay.pid}/stat").read_text(encoding="ascii")
        user, system = stat.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def cut(self, host: int | None) -> None:
        """Cut a host off from the others; None joins all again. Only with a relay."""
        assert self._relay is not None
        assert self._relay.stdin is not None
        self._relay.stdin.write("heal\n" if host is None else f"cut {host}\n")
        self._relay.stdin.flush()

    def _make(self) -> None:
        for name in self._names:
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        ports = self._bridged() if self._wanted is None else self._relayed(*self._wanted)
        for name, port, address in zip(self._names, ports, self.addresses, strict=True):
            _ip("-n", name, "address", "add", f"{address}/24", "dev", port)
            _ip("-n", name, "link", "set", port, "up")

    def _bridged(self) -> list[str]:
        """Make the bridge; return the name of each host's end of its cable."""
        _ip("netns", "add", self._hub)
        _ip("-n", self._hub, "link", "add", "bridge", "type", "bridge")
        _ip("-n", self._hub, "link", "set", "bridge", "up")
        for number, name in enumerate(self._names):
            port = f"port{number}"
            _ip("-n", self._hub, "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", name)
            _ip("-n", self._hub, "link", "set", port, "master", "bridge", "up")
        return ["eth0"] * len(self._names)

    def _relayed(self, delay: float, loss: float) -> list[str]:
        """Start the relay; return the name of each host's TAP."""
        command = [sys.executable, "-m", "benchmarks.relay", str(len(self._names)), str(delay), str(loss)]
        self._relay = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._relay.stdout is not None
        taps = self._relay.stdout.readline().split()
        for tap, name in zip(taps, self._names, strict=True):
            _ip("link", "set", tap, "netns", name)  # the relay keeps its end
        return taps

    def _remove(self) -> None:
        if self._relay is not None:
            assert self._relay.stdin is not None
            self._relay.stdin.close()
            self._relay.wait()
        for name in (*self._names, self._hub):
            with contextlib.suppress(SystemExit):
                _ip("netns", "del", name)


def _ip(*arguments: str) -> None:
    ran = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if ran.returncode:
        raise SystemExit(f"ip {' '.join(arguments)}: {ran.stderr.strip()}")
