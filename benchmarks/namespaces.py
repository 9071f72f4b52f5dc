"""Network namespaces as hosts for benchmarks: each has an address on a bridge, which is in one more. Linux, as root."""

from __future__ import annotations

import contextlib
import os
import subprocess
from types import TracebackType
from typing import Self


class Namespaces:
    """Hosts that see each other and nobody else; they are removed at the end, with whatever failed.

    Args:
        hosts: how many.
        delay: ms by which each host's packets are late.
        loss: the share of each host's packets that is lost, per cent.

    Attributes:
        addresses: the address of each host.
    """

    def __init__(self, hosts: int, delay: float = 0.0, loss: float = 0.0) -> None:
        prefix = f"sn{os.getpid()}"
        self._hub, self._names = f"{prefix}-hub", [f"{prefix}-{number}" for number in range(hosts)]
        self._delay, self._loss = delay, loss
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

    def _make(self) -> None:
        _ip("netns", "add", self._hub)
        _ip("-n", self._hub, "link", "add", "bridge", "type", "bridge")
        _ip("-n", self._hub, "link", "set", "bridge", "up")
        for number, (name, address) in enumerate(zip(self._names, self.addresses, strict=True)):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
            port = f"port{number}"
            _ip("-n", self._hub, "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", name)
            _ip("-n", self._hub, "link", "set", port, "master", "bridge", "up")
            _ip("-n", name, "address", "add", f"{address}/24", "dev", "eth0")
            _ip("-n", name, "link", "set", "eth0", "up")
            if self._delay or self._loss:
                netem = ["delay", f"{self._delay}ms", "loss", f"{self._loss}%", "limit", "100000"]
                self._tc(name, "qdisc", "add", "dev", "eth0", "root", "netem", *netem)

    @staticmethod
    def _tc(name: str, *arguments: str) -> None:
        _run(["tc", "-n", name, *arguments])

    def _remove(self) -> None:
        for name in (*self._names, self._hub):
            with contextlib.suppress(SystemExit):
                _ip("netns", "del", name)


def _ip(*arguments: str) -> None:
    _run(["ip", *arguments])


def _run(command: list[str]) -> None:
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if ran.returncode:
        raise SystemExit(f"{' '.join(command)}: {ran.stderr.strip()}")
