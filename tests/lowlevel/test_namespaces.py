"""A process without a network, or with a disk of its own, in a process of its own."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from user_namespaces import needs_namespaces

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import json, os, socket, sys
from pathlib import Path
from lowlevel import namespaces

if sys.argv[1] == "inside":
    namespaces.enter(namespaces.without_network())
found = {"user": os.getuid(), "owner": Path("/").stat().st_uid, "net": os.readlink("/proc/self/ns/net")}
try:
    socket.create_connection(("127.0.0.1", int(sys.argv[2])), 5).close()
except OSError as error:
    found["tcp"] = error.strerror
with socket.socket(socket.AF_UNIX) as unix:
    unix.connect(sys.argv[3])
print(json.dumps(found))
"""


@pytest.fixture
def inside_and_outside(tmp_path):
    """What a script finds there."""
    import json

    with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(tmp_path / "unix.sock"))
        unix.listen()
        given = [str(tcp.getsockname()[1]), str(tmp_path / "unix.sock")]
        return [
            json.loads(subprocess.check_output([sys.executable, "-c", SCRIPT, where, *given], cwd=ROOT))
            for where in ("inside", "outside")
        ]


@needs_namespaces
def test_there_is_no_network_but_unix_sockets_and_the_same_user(inside_and_outside):
    inside, outside = inside_and_outside
    assert inside.pop("tcp") == "Network is unreachable"
    assert inside.pop("net") != outside.pop("net")
    assert inside == outside == {"user": os.getuid(), "owner": Path("/").stat().st_uid}


@needs_namespaces
def test_where_they_are_forbidden_that_is_an_error():
    script = (
        "from pathlib import Path\nfrom lowlevel import namespaces\n"
        "Path('/proc/sys/user/max_net_namespaces').write_text('0')\n"
        "try:\n    namespaces.without_network()\nexcept OSError as error:\n    print(error.strerror)\n"
    )
    command = ["unshare", "--user", "--map-root-user", sys.executable, "-c", script]
    assert subprocess.check_output(command, cwd=ROOT, text=True) == "No space left on device\n"


DISK = """
import sys
from pathlib import Path
from lowlevel.namespaces import own_disk

folder = Path(sys.argv[1])
with own_disk(folder, 1 << 20):
    (folder / "file").write_bytes(bytes(1 << 19))
    print("ready", flush=True)
    sys.stdin.readline()
    try:
        (folder / "other").write_bytes(bytes(1 << 20))
    except OSError as error:
        print(error.strerror)
print(list(folder.iterdir()))
"""


@needs_namespaces
def test_a_disk_of_its_own_is_small_and_seen_by_nobody_else(tmp_path):
    command = [sys.executable, "-c", DISK, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        assert list(tmp_path.iterdir()) == []
        said, _ = process.communicate("\n")
    assert said == "No space left on device\n[]\n"
