"""The address that a host of nodes tells others, on this machine and in networks made for the test."""

import shutil
import subprocess
import sys

import pytest
from places import ROOT

from problems import BadInput
from supernode.deploy.addresses import own_endpoint

ALONE = ["unshare", "--map-root-user", "--net"]
SCRIPT = """
import sys
from supernode.deploy.addresses import own_endpoint
print(own_endpoint("tcp/0.0.0.0:7450", sys.argv[1]))
"""


def can_unshare():
    return (
        shutil.which("unshare") and shutil.which("ip") and subprocess.run([*ALONE, "true"], check=False).returncode == 0
    )


def told(router, network):
    """What a host in a network of its own tells, whose links ``network`` makes."""
    command = f'{network} && exec "$0" -c "$1" "$2"'
    done = subprocess.run(
        [*ALONE, "sh", "-c", command, sys.executable, SCRIPT, router],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return done.stdout.strip()


@pytest.mark.skipif(not can_unshare(), reason="needs unprivileged network namespaces")
@pytest.mark.parametrize(
    ("router", "network", "address"),
    [
        ("tcp/10.9.8.1:7447", "ip address add 10.9.8.7/24 dev lo && ip address add 10.9.7.7/24 dev lo", "10.9.8.7"),
        ("tcp/10.9.7.1:7447", "ip address add 10.9.8.7/24 dev lo && ip address add 10.9.7.7/24 dev lo", "10.9.7.7"),
        ("tcp/127.0.0.1:7447", "ip address add 198.51.100.7/24 dev lo", "198.51.100.7"),
        ("unixsock-stream//run/router.sock", "ip address add 198.51.100.7/24 dev lo", "198.51.100.7"),
        ("tcp/127.0.0.1:7447", "true", "127.0.0.1"),
        ("tcp/no-such-host.invalid:7447", "true", "127.0.0.1"),
    ],
)
def test_a_host_tells_the_address_from_which_it_speaks_to_the_router(router, network, address):
    assert told(router, f"ip link set lo up && {network}") == f"tcp/{address}:7450"


def test_an_address_that_is_named_is_told_as_it_is():
    assert own_endpoint("tcp/192.168.1.8:7450", "tcp/127.0.0.1:7447") == "tcp/192.168.1.8:7450"
    with pytest.raises(
        BadInput, match=r"--listen: expected tls/ADDRESS:PORT or tcp/ADDRESS:PORT, found tcp/0\.0\.0\.0:0"
    ):
        own_endpoint("tcp/0.0.0.0:0", "tcp/127.0.0.1:7447")
