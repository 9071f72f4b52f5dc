"""Where a running cluster is found: the entry that `supernode up` leaves in its state folder, and the folder's lock."""

import contextlib
import fcntl
import json
import os
import re
import stat
from dataclasses import asdict, dataclass
from pathlib import Path

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.files.key_folder import identity_in
from wire.members import Identity

_ENTRY = "cluster.json"
_LOCK = "up.lock"
_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws|wss|unixsock-stream)/.+", re.DOTALL)


@dataclass(frozen=True)
class ClusterInfo:
    """The entry of a running cluster in its state folder.

    Attributes:
        endpoint: the endpoint of the cluster's router.
        cluster: the cluster's name, a part of its key expressions.
        process: the id of the `supernode up` process, the cluster's lifeline.
        version: the version of supernode that the cluster runs.
    """

    endpoint: str
    cluster: str
    process: int
    version: str


@dataclass(frozen=True)
class Place:
    """Where to look for a cluster: at an endpoint or in a state folder; exactly one of the two is given.

    Attributes:
        endpoint: the endpoint of a router.
        folder: a state folder on this machine.
        cluster: the name of the cluster that is meant, if several answer at the endpoint.
        identity: who the client shows itself to be there; needed at encrypted endpoints.
    """

    endpoint: str | None
    folder: Path | None
    cluster: str | None = None
    identity: Identity | None = None

    @staticmethod
    def of(text: str | Path | None, keys: str | Path | None = None) -> "Place":
        """Return the place that ``text`` names: an endpoint such as ``tcp/127.0.0.1:7447``, or a state folder.

        Args:
            text: the endpoint or the folder; None is the user's default state folder.
            keys: the key folder of a client, for an endpoint.

        Raises:
            BadInput: if there are no such keys.
        """
        if isinstance(text, str) and _ENDPOINT.fullmatch(text):
            return Place(text, None, identity=None if keys is None else identity_in(Path(keys), "client", "keys"))
        return Place.of_folder(text)

    @staticmethod
    def of_folder(folder: str | Path | None) -> "Place":
        """Return the place of a state folder; None is the user's default one."""
        return Place(None, default_folder() if folder is None else Path(folder))

    @staticmethod
    def at(
        endpoint: str, option: str = "--connect", cluster: str | None = None, identity: Identity | None = None
    ) -> "Place":
        """Return the place of the endpoint that a command-line option names.

        Args:
            endpoint: the endpoint.
            option: the option, for the error.
            cluster: the name of the cluster that is meant, if several answer there.
            identity: who the client shows itself to be there.

        Raises:
            BadInput: if ``endpoint`` is not an endpoint.
        """
        if not _ENDPOINT.fullmatch(endpoint):
            raise BadInput(f"{option}: expected an endpoint such as tcp/127.0.0.1:7447, found {endpoint}")
        return Place(endpoint, None, cluster, identity)

    def info(self) -> ClusterInfo | None:
        """Return the entry in the folder; None if this place is an endpoint.

        Raises:
            ClusterFailed: if no cluster is up in the folder.
        """
        return None if self.folder is None else read_info(self.folder)

    def __str__(self) -> str:
        return str(self.endpoint or self.folder)


def default_folder() -> Path:
    """Return the user's state folder: ``$XDG_STATE_HOME/supernode`` or ``~/.local/state/supernode``."""
    home = os.environ.get("XDG_STATE_HOME", "")  # a relative path counts as unset: the XDG specification says so
    return (Path(home) if home.startswith("/") else Path.home() / ".local" / "state") / "supernode"


def read_info(folder: Path) -> ClusterInfo:
    """Return the entry of the cluster that is up in ``folder``.

    Raises:
        ClusterFailed: if none is, or it belongs to another user.
    """
    nobody = ClusterFailed(f"no cluster is up in {folder}; start one with `supernode up`")
    try:
        info = ClusterInfo(**json.loads((folder / _ENTRY).read_text(encoding="utf-8")))
        os.kill(info.process, 0)  # only asks whether the process exists: the entry of a killed cluster stays
    except PermissionError:
        raise ClusterFailed(f"{folder}: the cluster there belongs to another user") from None
    except (OSError, ValueError, TypeError):
        raise nobody from None
    return info


def write_info(folder: Path, info: ClusterInfo) -> None:
    """Write the entry into ``folder``; readers find all of it or nothing."""
    new = folder / f"{_ENTRY}.new"
    new.write_text(json.dumps(asdict(info)) + "\n", encoding="utf-8")
    new.replace(folder / _ENTRY)  # atomic, unlike writing the file in place


def remove_info(folder: Path) -> None:
    """Remove the entry from ``folder``: no cluster is up there any more."""
    with contextlib.suppress(FileNotFoundError):
        (folder / _ENTRY).unlink()


def is_occupied(folder: Path) -> bool:
    """Return whether a cluster holds the lock of ``folder``.

    The entry alone does not tell: it may have been left by a cluster that was killed.
    """
    try:
        os.close(occupy(folder))
    except ClusterFailed:
        return True
    return False


def occupy(folder: Path) -> int:
    """Make ``folder``, private to this user, and lock it; return the descriptor that holds the lock until it is closed.

    The kernel releases the lock when the process ends, however it ends. An existing folder keeps its mode, since it may
    serve other purposes too; the files in it that describe jobs are private by themselves.

    Raises:
        BadInput: if the folder cannot be made, or every user may write into it.
        ClusterFailed: if a cluster is up in it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if folder.stat().st_mode & stat.S_IWOTH:
            raise BadInput(f"--state: expected a folder that not every user may write into, found {folder}")
        # O_CLOEXEC: a child that inherited the descriptor would keep the lock when this process has ended.
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise BadInput(f"--state: expected a folder that can be written, found {folder}: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise ClusterFailed(f"a cluster is up in {folder} already; end it with `supernode down`") from None
    return descriptor
