"""Who belongs to a cluster with keys: each member's name, which its certificate shows, its role and its rights.

`supernode keys` makes the members' folders; this module reads them. Each holds the member's private key and
certificate, the certificates of the authorities that it trusts, and who the member is. The router's holds the list of
all members too.
"""

import json
import re
import ssl
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from wire.jobs import RIGHTS
from wire.keys import ANYONE

ROLES = ("coordinator", "router", "spy", "node", "client", "dashboard")
MEMBER, MEMBERS = "member.json", "members.json"
CERTIFICATE, KEY, SECRET = "member.crt", "member.key", "secret"
"""Files of a member's folder. Coordinator, spy and nodes share a secret: see `wire.seal`."""
ROUTERS, OTHERS = "routers.crt", "members.crt"
"""The authorities that signed the certificates of routers, and of all other members.

There are two, so that no other member can pose as a router: who connects to one trusts ``ROUTERS`` only.
"""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}")


class BadMemberError(ValueError):
    """A file says of a member what cannot be."""


@dataclass(frozen=True)
class Member:
    """A member of a cluster.

    Attributes:
        name: its name, the common name of its certificate.
        role: one of `ROLES`.
        may: the rights of a client or a dashboard, some of `wire.jobs.RIGHTS`.
        expires: the date until which its certificate is valid, in ISO 8601.
        addresses: the names and addresses at which others reach it; its certificate is valid for these alone.
        days: for how many days its certificate was made.
    """

    name: str
    role: str
    may: tuple[str, ...] = ()
    expires: str = ""
    addresses: tuple[str, ...] = ()
    days: float = 0.0

    @staticmethod
    def of(fields: Any) -> "Member":
        """Return the member that the fields of a file describe.

        Raises:
            BadMemberError: if they describe none.
        """
        try:
            member = Member(**{**fields, "may": tuple(fields["may"]), "addresses": tuple(fields["addresses"])})
        except (TypeError, KeyError):
            raise BadMemberError("expected name, role, may, expires, addresses and days of a member") from None
        if not isinstance(member.name, str) or not is_name(member.name):
            raise BadMemberError(f"name: expected letters, digits, '_' and '-', found {member.name!r}")
        if member.role not in ROLES:
            raise BadMemberError(f"role: expected one of {', '.join(ROLES)}, found {member.role!r}")
        if not set(member.may) <= set(RIGHTS):
            raise BadMemberError(f"may: expected some of {', '.join(RIGHTS)}, found {member.may!r}")
        if not isinstance(member.days, int | float) or not all(isinstance(each, str) for each in member.addresses):
            raise BadMemberError("expected a number of days, and addresses as text")
        try:
            datetime.fromisoformat(member.expires)
        except (TypeError, ValueError):
            raise BadMemberError(f"expires: expected a date, found {member.expires!r}") from None
        return member

    def to_json(self) -> dict[str, Any]:
        """Return the fields, for a file."""
        return asdict(self)


def is_name(text: str) -> bool:
    """Return whether a member can have that name, which is a part of key expressions and the name of a folder."""
    return _NAME.fullmatch(text) is not None and text not in (ANYONE, SECRET)


@dataclass(frozen=True)
class Identity:
    """Who a process shows itself to be on its links.

    Attributes:
        member: the member.
        folder: the folder with its key and certificates.
    """

    member: Member
    folder: Path

    @staticmethod
    def read(folder: Path) -> "Identity":
        """Return the identity in a member's folder.

        Raises:
            OSError: if its file cannot be read.
            BadMemberError: if the file describes no member.
        """
        return Identity(Member.of(_json(folder / MEMBER)), folder.absolute())

    def members(self) -> tuple[Member, ...]:
        """Return all members of the cluster, of which the router has a list.

        Raises:
            OSError: if the list cannot be read.
            BadMemberError: if it is none.
        """
        found = _json(self.folder / MEMBERS)
        if not isinstance(found, list):
            raise BadMemberError("expected a list of members")
        return tuple(Member.of(each) for each in found)

    def stamp(self) -> tuple[tuple[int, int], ...]:
        """Return what changes when one of the files does that can change."""
        found = []
        for name in (MEMBERS, KEY, CERTIFICATE):
            try:
                status = (self.folder / name).stat()
            except OSError:
                found.append((0, 0))
            else:
                found.append((status.st_ino, status.st_mtime_ns))
        return tuple(found)

    def check(self) -> None:
        """Check that key and certificate can be read and belong together.

        Raises:
            OSError: if not.
        """
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.folder / CERTIFICATE, self.folder / KEY)
        context.load_verify_locations(self.folder / OTHERS)

    def tls(self, trusted: str) -> Mapping[str, object]:
        """Return Zenoh's settings for links by TLS and QUIC: both ends show certificates, and the names are checked.

        Args:
            trusted: ``ROUTERS`` or ``OTHERS``: whose certificates are accepted.
        """
        certificate, key = str(self.folder / CERTIFICATE), str(self.folder / KEY)
        return {
            "root_ca_certificate": str(self.folder / trusted),
            "listen_certificate": certificate,
            "listen_private_key": key,
            "connect_certificate": certificate,
            "connect_private_key": key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }

    def host_id(self, start: str) -> str:
        """Return an id for this start of the member's host, from which `member_of_host` tells the member."""
        return f"{start}.{self.member.name}"


def member_of_host(host: str) -> str:
    """Return the name of the member that a host's id ends with; "" if it names none."""
    return host.partition(".")[2]


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BadMemberError(f"expected JSON: {error}") from None
