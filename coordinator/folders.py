"""The private folders of clusters' Unix sockets: their names, their locks, and the removal of those that were left."""

import fcntl
import os
import secrets
import shutil
import tempfile
import time
from pathlib import Path

_PREFIX = "supernode-"
_IN_MEMORY = Path("/dev/shm")
_YOUNG = 5.0  # seconds
_LONGEST_HOME = 60  # bytes


def new_folder() -> Path:
    """Return the name of a folder for Unix sockets that is not there yet; those that nobody needs are removed."""
    _remove_stale_folders()
    return _home() / f"{_PREFIX}{secrets.token_hex(4)}"


def make_folder(folder: Path) -> int:
    """Make a private folder; return an open descriptor that locks it for as long as any process has it.

    The zygote does this, not its caller: one that was killed in between could leave a folder that nobody removes.
    """
    folder.mkdir(mode=0o700)
    lock = _lock(folder)
    assert lock is not None, "nobody knows it yet"
    return lock


def _home() -> Path:
    """Where folders of sockets lie: in memory if TMPDIR does not choose, since a disk's file system makes them slowly.

    The path of a Unix socket has at most 107 bytes.
    """
    usual = Path(tempfile.gettempdir())
    if "TMPDIR" not in os.environ and os.access(_IN_MEMORY, os.W_OK | os.X_OK):
        return _IN_MEMORY
    return usual if len(os.fsencode(usual)) <= _LONGEST_HOME else Path("/tmp")


def _lock(folder: Path) -> int | None:
    """An open descriptor that locks ``folder`` for as long as any process holds it; None if another one does."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove_stale_folders() -> None:
    """Folders of clusters whose processes were all killed at once, so that nobody could clean up."""
    for folder in _home().glob(f"{_PREFIX}*"):
        try:
            if folder.stat().st_uid != os.getuid() or time.time() - folder.stat().st_mtime < _YOUNG:
                continue  # another's, or so young that its owner may not have locked it yet
            descriptor = _lock(folder)
        except OSError:
            continue
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)
