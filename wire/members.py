"""Who belongs to a cluster with keys: each member's name, which its certificate shows, its role and its rights.

`supernode keys` makes the members' folders; this module reads them. Each holds the member's private key and
certificate, the certificate of the authority that signed it, and who the member is. The router's holds the list of all
members too.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wire.jobs import RIGHTS
from wire.keys import ANYONE

ROLES = ("coordinator", "router", "spy", "node", "client", "dashboard")
MEMBER, MEMBERS = "member.json", "members.json"
AUTHORITY, CERTIFICATE, KEY, SECRET = "authority.crt", "member.crt", "member.key", "secret"
"""Files of a member's folder. Coordinator, spy and nodes share a secret: see `wire.seal`."""

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
    """

    name: str
    role: str
    may: tuple[str, ...] = ()
    expires: str = ""
    addresses: tuple[str, ...] = ()

    @staticmethod
    def of(fields: Any) -> "Member":
        """Return the member that the fields of a file describe.

        Raises:
            BadMemberError: if they describe none.
        """
        try:
            member = Member(**{**fields, "may": tuple(fields["may"]), "addresses": tuple(fields["addresses"])})
        except (TypeError, KeyError):
            raise BadMemberError("expected name, role, may, expires and addresses of a member") from None
        if not isinstance(member.name, str) or not is_name(member.name):
            raise BadMemberError(f"name: expected letters, digits, '_' and '-', found {member.name!r}")
        if member.role not in ROLES:
            raise BadMemberError(f"role: expected one of {', '.join(ROLES)}, found {member.role!r}")
        if not set(member.may) <= set(RIGHTS):
            raise BadMemberError(f"may: expected some of {', '.join(RIGHTS)}, found {member.may!r}")
        return member

    def to_json(self) -> dict[str, Any]:
        """Return the fields, for a file."""
        return asdict(self)


def is_name(text: str) -> bool:
    """Return whether a member can have that name, which is a part of key expressions and the name of a folder."""
    return _NAME.fullmatch(text) is not None and text != ANYONE


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

    @property
    def tls(self) -> Mapping[str, object]:
        """Zenoh's settings for links by TLS and QUIC: both ends show a certificate, and the names are checked."""
        certificate, key = str(self.folder / CERTIFICATE), str(self.folder / KEY)
        return {
            "root_ca_certificate": str(self.folder / AUTHORITY),
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
