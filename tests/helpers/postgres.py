"""A PostgreSQL server of one's own: in a temporary folder, on a Unix socket, as a user without rights."""

import contextlib
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

_HOMES = Path("/usr/lib/postgresql")
_IN_MEMORY = Path("/dev/shm")  # quicker than a disk; what is tested is the end of processes, not of power
_UNPRIVILEGED = ("postgres", "nobody")
_DYING_WITH_THE_TEST = ("setpriv", "--pdeathsig", "INT")
_READY_WITHIN = 60.0  # seconds


def binaries():
    """The folder of the newest server's programs, or None."""
    found = [Path(path).parent for path in [shutil.which("initdb")] if path] + [*_HOMES.glob("*/bin")]
    found = [folder for folder in found if (folder / "initdb").exists() and (folder / "postgres").exists()]
    return max(found, key=lambda folder: [int(part) for part in folder.parts if part.isdigit()], default=None)


class Server:
    """A server that runs; ``url`` makes a new, empty database each time it is called."""

    def __init__(self, programs, folder, user):
        self.folder = folder
        self.data = folder / "data"
        self._programs = programs
        self._as = {} if user is None else {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
        self._made = 0
        self._run("initdb", "--auth=trust", "--username=supernode", "--encoding=UTF8", "--locale=C")
        self.start()

    def start(self):
        """Start it again after `stop`. It ends with the test's process, however that ends."""
        options = ("-c", "listen_addresses=", "-k", self.folder, "-c", "shared_buffers=16MB")
        command = [*_DYING_WITH_THE_TEST, self._programs / "postgres", "-D", self.data, *options]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder, **self._as)
        until = time.monotonic() + _READY_WITHIN
        while subprocess.run([self._programs / "pg_isready", "-q", "-h", self.folder], check=False).returncode != 0:
            assert self._process.poll() is None, (self.folder / "log").read_text()
            assert time.monotonic() < until, "PostgreSQL does not come up"
            time.sleep(0.02)

    def stop(self):
        """Stop it at once, as a crash does. Idempotent."""
        self._process.send_signal(signal.SIGQUIT)
        self._process.wait(_READY_WITHIN)

    def url(self):
        self._made += 1
        name = f"test_{self._made}"
        command = [self._programs / "createdb", "-h", self.folder, "-U", "supernode", name]
        subprocess.run(command, check=True, capture_output=True)
        return f"postgresql://supernode@/{name}?host={self.folder}"

    def _run(self, program, *arguments):
        command = [self._programs / program, "-D", self.data, *arguments]
        done = subprocess.run(
            command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=self.folder, **self._as
        )
        assert done.returncode == 0, done.stderr.decode()


@contextlib.contextmanager
def server():
    """A server until the end; where none is installed the test is skipped."""
    programs = binaries()
    if programs is None:
        pytest.skip("PostgreSQL is not installed")
    pytest.importorskip("psycopg")
    user = _user()
    folder = Path(tempfile.mkdtemp(prefix="supernode-pg-", dir=_IN_MEMORY if _IN_MEMORY.is_dir() else "/tmp"))
    try:
        folder.chmod(0o755)
        if user is not None:
            os.chown(folder, user.pw_uid, user.pw_gid)
        running = Server(programs, folder, user)
        try:
            yield running
        finally:
            running.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _user():
    """Whom the server is run as: this user, but never root, as which it refuses to run."""
    if os.getuid() != 0:
        return None
    for name in _UNPRIVILEGED:
        with contextlib.suppress(KeyError):
            return pwd.getpwnam(name)
    pytest.skip("there is no unprivileged user")
