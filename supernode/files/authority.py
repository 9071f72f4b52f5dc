"""The authority of a cluster: it makes the members' certificates, and keeps the list of who belongs to the cluster.

All lies in one folder, with a folder for each member in it: see `wire.members`. Only the authority's own key, which
stays in the outer folder, can make further members.
"""

import ipaddress
import json
import os
import secrets
import socket
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from problems.errors import BadInput
from wire.members import AUTHORITY, CERTIFICATE, KEY, MEMBER, MEMBERS, SECRET, Member, is_name
from wire.seal import SECRET_BYTES

_AUTHORITY_KEY = "authority.key"
_AUTHORITY_DAYS = 3650.0
_CLOCKS_DIFFER = timedelta(minutes=5)  # between machines; a new certificate must be valid on all of them
_SHARE_THE_SECRET = ("coordinator", "spy", "node")


class Authority:
    """The authority in a folder.

    Args:
        folder: the folder.

    Raises:
        BadInput: if the folder holds no authority.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            self._certificate = x509.load_pem_x509_certificate((folder / AUTHORITY).read_bytes())
            key = serialization.load_pem_private_key((folder / _AUTHORITY_KEY).read_bytes(), None)
            listed = json.loads((folder / MEMBERS).read_text(encoding="utf-8"))
            self.members = {member.name: member for member in map(Member.of, listed)}
        except OSError as error:
            raise BadInput(
                f"{error.filename}: {error.strerror}; `supernode keys init {folder}` makes an authority"
            ) from None
        except (ValueError, TypeError) as error:
            raise BadInput(f"{folder}: expected an authority of `supernode keys init`: {error}") from None
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise BadInput(f"{folder / _AUTHORITY_KEY}: expected a key of `supernode keys init`, found another kind")
        self._key = key

    @staticmethod
    def make(folder: Path) -> "Authority":
        """Make a new authority in a folder, which must be empty or missing.

        Raises:
            BadInput: if the folder cannot be made, or is not empty.
        """
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise BadInput(f"{folder}: expected an empty folder or none, found files in it")
            folder.chmod(0o700)
        except OSError as error:
            raise BadInput(f"{folder}: cannot make it: {error.strerror}") from None
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"supernode authority {secrets.token_hex(4)}")])
        usage = x509.KeyUsage(
            digital_signature=True,
            key_cert_sign=True,
            crl_sign=True,
            content_commitment=False,
            key_encipherment=False,
            data_encipherment=False,
            key_agreement=False,
            encipher_only=False,
            decipher_only=False,
        )
        certificate = (
            _unsigned(name, name, key, _AUTHORITY_DAYS)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(key, hashes.SHA256())
        )
        _write(folder / _AUTHORITY_KEY, _pem(key))
        _write(folder / AUTHORITY, certificate.public_bytes(serialization.Encoding.PEM))
        _write(folder / SECRET, secrets.token_hex(SECRET_BYTES).encode() + b"\n")
        _write(folder / MEMBERS, b"[]\n")
        return Authority(folder)

    def add(self, name: str, role: str, may: Iterable[str], days: float, addresses: Sequence[str]) -> Member:
        """Make a member's folder with a new key and certificate, and return the member.

        Raises:
            BadInput: if there is a member of that name, or it is no name.
        """
        if not is_name(name):
            raise BadInput(f"the name of a member: expected letters, digits, '_' and '-', found {name!r}")
        if name in self.members:
            raise BadInput(f"{name}: expected a new name, found a member; `supernode keys renew` makes its key anew")
        return self._issue(Member(name, role, tuple(may), addresses=tuple(addresses)), days)

    def renew(self, name: str, days: float | None) -> Member:
        """Make a member's key and certificate anew, and return the member.

        Args:
            name: the member's name.
            days: how long they are valid; None: as long as those before.

        Raises:
            BadInput: if there is no such member.
        """
        member = self._member(name)
        if days is None:
            before = x509.load_pem_x509_certificate((self.folder / name / CERTIFICATE).read_bytes())
            days = (before.not_valid_after_utc - before.not_valid_before_utc - _CLOCKS_DIFFER) / timedelta(days=1)
        return self._issue(member, days)

    def revoke(self, name: str) -> None:
        """Strike a member off the list: the router lets it do nothing any more.

        Raises:
            BadInput: if there is no such member.
        """
        del self.members[self._member(name).name]
        self._write_list()
        for path in (self.folder / name).iterdir():
            path.unlink()
        (self.folder / name).rmdir()

    def _member(self, name: str) -> Member:
        if name not in self.members:
            raise BadInput(f"{name}: expected one of the members {', '.join(self.members)}")
        return self.members[name]

    def _issue(self, member: Member, days: float) -> Member:
        key = ec.generate_private_key(ec.SECP256R1())
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, member.name)])
        both = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
        unsigned = (
            _unsigned(name, self._certificate.subject, key, days)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(both, critical=False)
        )
        if member.addresses:
            names = x509.SubjectAlternativeName([_general_name(each) for each in member.addresses])
            unsigned = unsigned.add_extension(names, critical=False)
        certificate = unsigned.sign(self._key, hashes.SHA256())
        expires = certificate.not_valid_after_utc.isoformat(timespec="seconds")
        member = Member(member.name, member.role, member.may, expires, member.addresses)
        folder = self.folder / member.name
        folder.mkdir(mode=0o700, exist_ok=True)
        _write(folder / AUTHORITY, (self.folder / AUTHORITY).read_bytes())
        _write(folder / KEY, _pem(key))
        _write(folder / CERTIFICATE, certificate.public_bytes(serialization.Encoding.PEM))
        if member.role in _SHARE_THE_SECRET:
            _write(folder / SECRET, (self.folder / SECRET).read_bytes())
        _write(folder / MEMBER, _json(member.to_json()))
        self.members[member.name] = member
        self._write_list()
        return member

    def _write_list(self) -> None:
        text = _json([member.to_json() for member in self.members.values()])
        _write(self.folder / MEMBERS, text)
        for member in self.members.values():
            if member.role == "router":
                _write(self.folder / member.name / MEMBERS, text)  # last, since a router looks at it for changes


def own_names() -> tuple[str, ...]:
    """Return the names and addresses by which this machine, and perhaps others, reach it."""
    found = dict.fromkeys(("localhost", "127.0.0.1", "::1", socket.gethostname()))
    for _, _, _, _, (address, *_) in _addresses_of(socket.gethostname()):
        found[str(address).partition("%")[0]] = None
    return tuple(found)


def _addresses_of(host: str) -> list[tuple[object, object, object, object, tuple[object, ...]]]:
    try:
        return list(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM))
    except OSError:  # a machine that does not know its own name
        return []


def _unsigned(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, days: float
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCKS_DIFFER)
        .not_valid_after(now + timedelta(days=days))
    )


def _general_name(address: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        return x509.DNSName(address)


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _json(value: object) -> bytes:
    return json.dumps(value, indent=2).encode() + b"\n"


def _write(path: Path, data: bytes) -> None:
    """Write a file that only its owner can read; readers find all of the new one, or the one before."""
    draft = path.with_name(f"{path.name}.new")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
