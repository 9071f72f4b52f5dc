"""Where a running cluster is: what `supernode up` leaves in its state folder for those who come to talk to it."""

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

_CARD = "cluster.json"
_LOCK = "up.lock"
_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws|wss|unixsock-stream)/.+", re.DOTALL)


@dataclass(frozen=True)
class ClusterInfo:
    """A running cluster's calling entry.

    Attributes:
        endpoint: of its router.
        cluster: its name, a part of its key expressions.
        process: the id of the process that `supernode up` left running.
        version: of supernode.
    """

    endpoint: str
    cluster: str
    process: int
    version: str


@dataclass(frozen=True)
class Place:
    """Where to look for a cluster: at an endpoint, or in a state folder.

    Attributes:
        cluster: the name of the one that is meant if several answer at the endpoint.
    """

    endpoint: str | None
    folder: Path | None
    cluster: str | None = None

    @staticmethod
    def of(text: str | Path | None) -> "Place":
        """An endpoint such as ``tcp/127.0.0.1:7447``, or a folder; None is the default folder."""
        if isinstance(text, str) and _ENDPOINT.fullmatch(text):
            return Place(text, None)
        return Place.of_folder(text)

    @staticmethod
    def of_folder(folder: str | Path | None) -> "Place":
        """A state folder; None is the default one."""
        return Place(None, default_folder() if folder is None else Path(folder))

    @staticmethod
    def at(endpoint: str, option: str = "--connect", cluster: str | None = None) -> "Place":
        """The endpoint that an option names, and ``cluster`` of those there.

        Raises:
            BadInput: if it is none.
        """
        if not _ENDPOINT.fullmatch(endpoint):
            raise BadInput(f"{option}: expected an endpoint such as tcp/127.0.0.1:7447, found {endpoint}")
        return Place(endpoint, None, cluster)

    def info(self) -> ClusterInfo | None:
        """The entry in the folder; None for a bare endpoint.

        Raises:
            ClusterFailed: if no cluster is up in the folder.
        """
        return None if self.folder is None else read_info(self.folder)

    def __str__(self) -> str:
        return str(self.endpoint or self.folder)


def default_folder() -> Path:
    """The state folder of whoever names none."""
    home = os.environ.get("XDG_STATE_HOME", "")
    return (Path(home) if home.startswith("/") else Path.home() / ".local" / "state") / "supernode"


def read_info(folder: Path) -> ClusterInfo:
    """Who is up in ``folder``.

    Raises:
        ClusterFailed: if nobody is.
    """
    nobody = ClusterFailed(f"no cluster is up in {folder}; start one with `supernode up`")
    try:
        info = ClusterInfo(**json.loads((folder / _CARD).read_text(encoding="utf-8")))
        os.kill(info.process, 0)
    except PermissionError:
        raise ClusterFailed(f"{folder}: it is another user's") from None
    except (OSError, ValueError, TypeError):
        raise nobody from None
    return info


def write_info(folder: Path, info: ClusterInfo) -> None:
    """Say who is up in ``folder``; whoever reads finds all of it or nothing."""
    new = folder / f"{_CARD}.new"
    new.write_text(json.dumps(asdict(info)) + "\n", encoding="utf-8")
    new.replace(folder / _CARD)


def remove_card(folder: Path) -> None:
    """Nobody is up here any more."""
    with contextlib.suppress(FileNotFoundError):
        (folder / _CARD).unlink()


def is_occupied(folder: Path) -> bool:
    """Whether a cluster holds the lock of that folder; a entry alone may be that of one that was killed long ago."""
    try:
        os.close(occupy(folder))
    except ClusterFailed:
        return True
    return False


def occupy(folder: Path) -> int:
    """Make ``folder``, private, and lock it for as long as the descriptor that is returned is open.

    One that is there keeps its mode: it may be for other things too, and whatever tells of jobs is private by itself.

    Raises:
        BadInput: if there can be no such folder.
        ClusterFailed: if a cluster is up in it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if folder.stat().st_mode & stat.S_IWOTH:
            raise BadInput(f"--state: expected a folder into which not everybody may write, found {folder}")
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        raise BadInput(f"--state: expected a folder of one's own, found {folder}: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise ClusterFailed(f"a cluster is up in {folder} already; end it with `supernode down`") from None
    return descriptor
