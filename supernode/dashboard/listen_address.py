"""The address that the dashboard listens at, and the token that it asks for."""

import ipaddress
import re
import secrets
import socket
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from problems.errors import BadInput
from supernode.files.private_file import read_private

_NEEDED = ("jinja2", "plotly", "prometheus_client", "starlette", "uvicorn")  # libraries
_ADDRESS = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<four>[^:\s]+)):(?P<port>\d{1,5})")
_SHORTEST_TOKEN = 16  # characters
_WAITING = 128  # connections that the kernel queues
_STALLED_MS = 30_000  # the kernel closes a connection whose other end has taken no data for so long


@dataclass(frozen=True)
class ListenAddress:
    """An address to listen at.

    Attributes:
        host: a name or an IP address.
        port: the port; 0 means any free one.
        token: the token that visitors must have; None if they need none.
    """

    host: str
    port: int
    token: str | None = None

    @property
    def is_local(self) -> bool:
        """Whether only this machine can connect."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def listen(self) -> socket.socket:
        """Return a socket that listens at this address.

        Raises:
            BadInput: if it cannot listen there.
        """
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        sock = socket.socket(family, socket.SOCK_STREAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _STALLED_MS)
            sock.bind((self.host, self.port))
            sock.listen(_WAITING)
        except OSError as error:
            sock.close()
            raise BadInput(f"--dashboard: cannot listen at {self.host}:{self.port}: {error.strerror}") from None
        return sock

    def address(self, sock: socket.socket) -> str:
        """Return the URL for people, with the port that ``sock`` was given."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{sock.getsockname()[1]}/"


def listen_address_of(address: str, token_file: str | None) -> ListenAddress:
    """Return the address that the options ``--dashboard`` and ``--dashboard-token-file`` ask for.

    Raises:
        BadInput: if the address or the token is wrong, a token is needed and missing, or a library is not installed.
    """
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise BadInput(f"--dashboard: expected {missing[0]} to be installed: pip install 'supernode[dashboard]'")
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > 65_535:
        raise BadInput(f"--dashboard: expected an address such as 127.0.0.1:8080, found {address}")
    token = None if token_file is None else _token(Path(token_file))
    listen_address = ListenAddress(found["six"] or found["four"], int(found["port"]), token)
    if token is None and not listen_address.is_local:
        raise BadInput(
            f"--dashboard-token-file: needed, since {listen_address.host} is not this machine's loopback address"
        )
    return listen_address


def _token(path: Path) -> str:
    token = read_private(path, "--dashboard-token-file", "a token")
    if not re.fullmatch(rf"[A-Za-z0-9._~-]{{{_SHORTEST_TOKEN},}}", token):
        expected = f"at least {_SHORTEST_TOKEN} letters, digits, '.', '_', '~' or '-', such as {secrets.token_hex(4)}…"
        raise BadInput(f"--dashboard-token-file: {path}: expected {expected}, found something else")
    return token
