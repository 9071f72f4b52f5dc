"""The private folders of clusters' Unix sockets: their names, their locks, and the removal of stale ones."""

import fcntl
import os
import secrets
import shutil
import tempfile
import time
from pathlib import Path

_PREFIX = "supernode-"
_IN_MEMORY = Path("/dev/shm")
_YOUNG = 5.0  # seconds in which a new folder may not be locked yet
_LONGEST_HOME = 60  # bytes, so that paths of sockets stay within their limit


def new_folder() -> Path:
    """Return the path of a folder for Unix sockets that does not exist yet; remove stale folders of other clusters."""
    _remove_stale_folders()
    return _home() / f"{_PREFIX}{secrets.token_hex(4)}"


def make_folder(folder: Path) -> int:
    """Make a private folder; return an open descriptor that locks it for as long as any process holds it.

    The zygote does this and not its caller: if the caller made it and was killed then, nobody would remove the folder.
    """
    folder.mkdir(mode=0o700)
    lock = _lock(folder)
    assert lock is not None, "nobody knows it yet"
    return lock


def _home() -> Path:
    """Return the parent of such folders: in memory unless TMPDIR is set, since sockets are made slowly on a disk.

    The path of a Unix socket may have at most 107 bytes, so a long temporary folder is not used.
    """
    usual = Path(tempfile.gettempdir())
    if "TMPDIR" not in os.environ and os.access(_IN_MEMORY, os.W_OK | os.X_OK):
        return _IN_MEMORY
    return usual if len(os.fsencode(usual)) <= _LONGEST_HOME else Path("/tmp")


def _lock(folder: Path) -> int | None:
    """Lock ``folder``; return the descriptor, or None if another process holds the lock.

    The lock (flock) belongs to the open file: children inherit it, and it ends when the last process closes it.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove_stale_folders() -> None:
    """Remove folders of clusters whose processes were all killed at once, so that none could clean up."""
    for folder in _home().glob(f"{_PREFIX}*"):
        try:
            if folder.stat().st_uid != os.getuid() or time.time() - folder.stat().st_mtime < _YOUNG:
                continue  # another user's, or so young that its owner may not have locked it yet
            descriptor = _lock(folder)
        except OSError:
            continue
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)
