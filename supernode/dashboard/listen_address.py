"""The address that the dashboard listens at, the tokens that it asks for, and its certificate."""

import ipaddress
import re
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from problems.errors import BadInput
from supernode.dashboard.certificate import check_certificate
from supernode.dashboard.tokens import Access, read_tokens

_NEEDED = ("jinja2", "plotly", "prometheus_client", "starlette", "uvicorn")  # libraries
_ADDRESS = re.compile(r"(?:\[(?P<six>[^\]]+)\]|(?P<four>[^:\s]+)):(?P<port>\d{1,5})")
_KEY_BYTES = 32
_WAITING = 128  # connections that the kernel queues
_STALLED_MS = 30_000  # the kernel closes a connection whose other end has taken no data for so long


@dataclass(frozen=True)
class ListenAddress:
    """An address to listen at.

    Attributes:
        host: a name or an IP address.
        port: the port; 0 means any free one.
        tokens: what each token allows of which visitors must have one; none if they need none.
        certificate: the file of the certificate for TLS; None for none.
        key: the file of the certificate's private key.
        session_key: the secret that makes the sessions of browsers.
    """

    host: str
    port: int
    tokens: Mapping[str, Access] = field(default_factory=dict, repr=False)
    certificate: str | None = None
    key: str | None = None
    session_key: str = field(default_factory=lambda: secrets.token_hex(_KEY_BYTES), repr=False, compare=False)

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
        scheme = "http" if self.certificate is None else "https"
        return f"{scheme}://{host}:{sock.getsockname()[1]}/"


def listen_address_of(
    address: str,
    token_file: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
    insecure: bool = False,
) -> ListenAddress:
    """Return the address that the option ``--dashboard`` and those that begin with it ask for.

    Raises:
        BadInput: if the address, the tokens or the certificate are wrong, or tokens or a certificate are needed and
            missing, or a library is not installed.
    """
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise BadInput(f"--dashboard: expected {missing[0]} to be installed: pip install 'supernode[dashboard]'")
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > 65_535:
        raise BadInput(f"--dashboard: expected an address such as 127.0.0.1:8080, found {address}")
    if (certificate is None) != (key is None):
        given, other = ("cert", "key") if key is None else ("key", "cert")
        raise BadInput(f"--dashboard-{given}: expected --dashboard-{other} too")
    if certificate is not None and key is not None:
        # The process that serves may be started in another folder.
        certificate, key = str(Path(certificate).absolute()), str(Path(key).absolute())
        check_certificate(certificate, key)
    tokens = {} if token_file is None else read_tokens(Path(token_file))
    listen_address = ListenAddress(found["six"] or found["four"], int(found["port"]), tokens, certificate, key)
    _check_reach(listen_address, insecure)
    return listen_address


def _check_reach(listen_address: ListenAddress, insecure: bool) -> None:
    """Check that what other machines can reach asks for a token, and speaks TLS unless it is ``insecure``."""
    if insecure and listen_address.certificate is not None:
        raise BadInput("--dashboard-insecure: expected none with --dashboard-cert")
    if listen_address.is_local:
        return
    since = f"since {listen_address.host} is not this machine's loopback address"
    if not listen_address.tokens:
        raise BadInput(f"--dashboard-token-file: needed, {since}")
    if listen_address.certificate is None and not insecure:
        raise BadInput(
            f"--dashboard-cert and --dashboard-key: needed, {since}; or --dashboard-insecure, if a proxy adds TLS"
        )
