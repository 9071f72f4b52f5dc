"""The authority of a cluster: it makes the members' certificates, and keeps the list of who belongs to the cluster.

All lies in one folder, with a folder for each member in it: see `wire.members`. Only the authority's own keys, which
stay in the outer folder, can make further members. One key signs the certificates of routers, one all others.
"""

import contextlib
import fcntl
import ipaddress
import json
import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from problems.errors import BadInput
from wire.members import CERTIFICATE, KEY, MEMBER, MEMBERS, OTHERS, ROUTERS, SECRET, Member, is_name
from wire.seal import SECRET_BYTES

_REVOKED = "revoked.json"
_AUTHORITY_DAYS = 3650.0
_MOST_DAYS = 36500.0
_CLOCKS_DIFFER = timedelta(minutes=5)  # between machines; a new certificate must be valid on all of them
_SHARE_THE_SECRET = ("coordinator", "spy", "node")
_ADDRESS = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")


class _Signer(NamedTuple):
    """A key that signs certificates, and the certificate by which others know it."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate


class Authority:
    """The authority in a folder. Use it while the folder is `locked`.

    Args:
        folder: the folder.

    Raises:
        BadInput: if the folder holds no authority.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            self._signers = {name: _read_signer(folder, name) for name in (ROUTERS, OTHERS)}
            listed = json.loads((folder / MEMBERS).read_text(encoding="utf-8"))
            self.members = {member.name: member for member in map(Member.of, listed)}
            self._revoked = {str(each) for each in json.loads((folder / _REVOKED).read_text(encoding="utf-8"))}
        except OSError as error:
            mend = f"`supernode keys init {folder}` makes an authority"
            raise BadInput(f"{error.filename}: {error.strerror}; {mend}") from None
        except (ValueError, TypeError) as error:
            raise BadInput(f"{folder}: expected an authority of `supernode keys init`: {error}") from None

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
        for name in (ROUTERS, OTHERS):
            _make_signer(folder, name)
        _write(folder / SECRET, secrets.token_hex(SECRET_BYTES).encode() + b"\n")
        _write(folder / _REVOKED, b"[]\n")
        _write(folder / MEMBERS, b"[]\n")
        return Authority(folder)

    def add(self, name: str, role: str, may: Iterable[str], days: float, addresses: Sequence[str]) -> Member:
        """Make a member's folder with a new key and certificate, and return the member.

        Raises:
            BadInput: if there is or was a member of that name, or a name, an address or the time cannot be.
        """
        if not is_name(name):
            raise BadInput(f"the name of a member: expected letters, digits, '_' and '-', found {name!r}")
        if name in self.members:
            raise BadInput(f"{name}: expected a new name, found a member; `supernode keys renew` makes its key anew")
        if name in self._revoked:  # access control knows names only: the old key would work again
            raise BadInput(f"{name}: expected a new name, found one that was revoked, whose old key would work again")
        for address in addresses:
            if not _is_address(address):
                raise BadInput(f"--address: expected a host's name or address, such as 10.0.0.2, found {address!r}")
        return self._issue(Member(name, role, tuple(may), addresses=tuple(addresses)), days)

    def renew(self, name: str, days: float | None) -> Member:
        """Make a member's key and certificate anew, and return the member. The old key is valid until it expires.

        Args:
            name: the member's name.
            days: how long they are valid; None: as long as those before.

        Raises:
            BadInput: if there is no such member.
        """
        member = self._member(name)
        return self._issue(member, member.days if days is None else days)

    def revoke(self, name: str) -> None:
        """Strike a member off the list: the router lets it do nothing any more.

        Raises:
            BadInput: if there is no such member, or it is the only router.
        """
        member = self._member(name)
        if member.role == "router" and self._routers == [member]:
            raise BadInput(
                f"{name}: expected another router to be left, found none; `keys renew {name}` makes its key anew"
            )
        del self.members[name]
        self._revoked.add(name)
        _write(self.folder / _REVOKED, _json(sorted(self._revoked)))
        self._write_list()
        shutil.rmtree(self.folder / name, ignore_errors=True)  # it may have been moved to where it is used

    @property
    def _routers(self) -> list[Member]:
        return [member for member in self.members.values() if member.role == "router"]

    def _member(self, name: str) -> Member:
        if name not in self.members:
            raise BadInput(f"{name}: expected one of the members {', '.join(self.members)}")
        return self.members[name]

    def _issue(self, member: Member, days: float) -> Member:
        if not 0.0 < days <= _MOST_DAYS:
            raise BadInput(f"--days: expected at most {_MOST_DAYS:g}, found {days:g}")
        key = ec.generate_private_key(ec.SECP256R1())
        certificate = self._certificate_of(member, key, days)
        expires = certificate.not_valid_after_utc.isoformat(timespec="seconds")
        member = replace(member, expires=expires, days=days)
        folder = self.folder / member.name
        folder.mkdir(mode=0o700, exist_ok=True)
        for name, signer in self._signers.items():
            _write(folder / name, signer.certificate.public_bytes(serialization.Encoding.PEM))
        _write(folder / KEY, _pem(key))
        _write(folder / CERTIFICATE, certificate.public_bytes(serialization.Encoding.PEM))
        if member.role in _SHARE_THE_SECRET:
            _write(folder / SECRET, (self.folder / SECRET).read_bytes())
        _write(folder / MEMBER, _json(member.to_json()))
        self.members[member.name] = member
        self._write_list()
        return member

    def _certificate_of(self, member: Member, key: ec.EllipticCurvePrivateKey, days: float) -> x509.Certificate:
        signer = self._signers[ROUTERS if member.role == "router" else OTHERS]
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, member.name)])
        usages = [] if member.role == "router" else [ExtendedKeyUsageOID.CLIENT_AUTH]
        if member.role in ("router", "node"):  # which others connect to
            usages.append(ExtendedKeyUsageOID.SERVER_AUTH)
        unsigned = (
            _unsigned(name, signer.certificate.subject, key, days)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        )
        if member.addresses:
            names = x509.SubjectAlternativeName([_general_name(each) for each in member.addresses])
            unsigned = unsigned.add_extension(names, critical=False)
        return unsigned.sign(signer.key, hashes.SHA256())

    def _write_list(self) -> None:
        text = _json([member.to_json() for member in self.members.values()])
        _write(self.folder / MEMBERS, text)
        for member in self._routers:
            if (self.folder / member.name).is_dir():  # else it was moved to where it is used
                _write(self.folder / member.name / MEMBERS, text)  # last, since a router looks at it for changes


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let no other process change the authority in a folder, which need not exist, until the context ends."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        yield
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


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


def _is_address(text: str) -> bool:
    with contextlib.suppress(ValueError):
        ipaddress.ip_address(text)
        return True
    return _ADDRESS.fullmatch(text) is not None


def _key_file(name: str) -> str:
    """Return the name of the file with the key of an authority whose certificate is in a file ``name``."""
    return Path(name).with_suffix(".key").name


def _make_signer(folder: Path, name: str) -> None:
    """Make the key that signs some of the certificates, and its own certificate, which is in a file ``name``."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"supernode {name} {secrets.token_hex(4)}")])
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
        _unsigned(subject, subject, key, _AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    _write(folder / _key_file(name), _pem(key))
    _write(folder / name, certificate.public_bytes(serialization.Encoding.PEM))


def _read_signer(folder: Path, name: str) -> _Signer:
    key = serialization.load_pem_private_key((folder / _key_file(name)).read_bytes(), None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ValueError(f"{_key_file(name)} is a key of another kind")
    return _Signer(key, x509.load_pem_x509_certificate((folder / name).read_bytes()))


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
