"""Hosts in network namespaces: they reach each other, one that is cut off does not, and nothing of them is left."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT, until
from user_namespaces import needs_namespaces

from coordinator.threads import ONE_THREAD

# Each step says which host's datagrams have come to the others; "late" comes by a link that was made before the cut.
SCRIPT = """
import json, socket
from supernode.chaos.network import Network

def bound(address):
    made = socket.socket(type=socket.SOCK_DGRAM)
    made.bind((address, 5000))
    made.settimeout(0.3)
    return made

def heard(ear):
    try:
        return ear.recv(9).decode()
    except TimeoutError:
        return None

with Network(3) as network:
    places = [bound(network.hub)]
    for host, address in enumerate(network.addresses):
        network.within(host, lambda: places.append(bound(address)))
    streams, steps = [], []

    def step(name):
        found = {}
        for speaker, source in enumerate(places):
            for ear in places:
                if ear is not source:
                    source.sendto(b"x", ear.getsockname())
            found[speaker] = [number for number, ear in enumerate(places) if ear is not source and heard(ear)]
        steps.append([name, found])

    listener = socket.create_server((network.hub, 5000))
    network.within(1, lambda: streams.append(socket.create_connection((network.hub, 5000))))
    stream, _ = listener.accept()
    stream.settimeout(20)
    step("together")
    first, second = network.cut(1), network.cut(1)
    step("cut")
    streams[0].sendall(b"late")
    first()
    first()
    step("still cut")
    second()
    step("healed")
    steps.append(["stream", stream.recv(9).decode()])
    print(json.dumps(steps))
"""


@needs_namespaces
def test_a_host_that_is_cut_off_hears_nobody_and_is_heard_by_nobody():
    found = subprocess.check_output([sys.executable, "-c", SCRIPT], cwd=ROOT, text=True)
    everybody = {"0": [1, 2, 3], "1": [0, 2, 3], "2": [0, 1, 3], "3": [0, 1, 2]}
    without_2 = {"0": [1, 3], "1": [0, 3], "2": [], "3": [0, 1]}
    assert json.loads(found) == [
        ["together", everybody],
        ["cut", without_2],
        ["still cut", without_2],
        ["healed", everybody],
        ["stream", "late"],
    ]


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "ones.toml"
    path.write_text('kind = "function"\nname = "onemax"\ndimension = 64\n[run]\ntorus = "2x2"\n')
    return path


def chaos(problem, *options):
    return [sys.executable, "-m", "supernode", "chaos", str(problem), *options]


@needs_namespaces
@pytest.mark.parametrize(
    ("forbidden", "said"),
    [
        ("user", "--hosts: expected the right to make networks within this machine, found 'No space left on device'"),
        ("net", "--hosts: expected the right to make networks within this machine, found 'No space left on device'"),
    ],
)
def test_where_namespaces_are_forbidden_that_is_one_clear_error(problem, forbidden, said):
    script = f'echo 0 > /proc/sys/user/max_{forbidden}_namespaces; exec "$@"'
    command = ["unshare", "--user", "--map-root-user", "sh", "-c", script, "sh", *chaos(problem, "--hosts", "2")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


@needs_namespaces
def test_more_hosts_than_nodes_are_refused(problem):
    done = subprocess.run(chaos(problem, "--hosts", "5"), cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--hosts: expected at most one for each of 4 nodes, found 5" in done.stderr


def below(process):
    """A process and all that it has started."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except OSError:
        return set()
    # A thread of the command has started each of its processes.
    return {process}.union(*(below(int(child)) for child in children))


def network_of(process):
    try:
        return str(Path(f"/proc/{process}/ns/net").readlink())
    except OSError:
        return None


@needs_namespaces
def test_nothing_is_left_when_the_command_is_killed(problem):
    command = subprocess.Popen(
        chaos(problem, "--hosts", "2", "--for", "60", "--at-once", "0.5"),
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_THREAD,
    )
    with command, command.stderr:
        assert any("kill node" in line for line in command.stderr)
        tasks = Path(f"/proc/{command.pid}/task").iterdir()
        started = {int(child) for task in tasks for child in (task / "children").read_text().split()}
        processes = set().union(*(below(each) for each in started))
        networks = {network_of(each) for each in processes}
        assert len(processes) >= 9  # router, coordinator, spy, and two hosts with two nodes each
        assert len(networks - {None}) == 3
        command.kill()
        until(lambda: not any(Path(f"/proc/{each}").exists() for each in processes))
        everywhere = {network_of(each.name) for each in Path("/proc").glob("[0-9]*")}
        assert not everywhere & (networks - {None})
