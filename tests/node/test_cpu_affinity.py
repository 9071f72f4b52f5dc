"""Who keeps to which core, and how long a turn is."""

import os
import platform
import subprocess
import sys
from collections import Counter

import pytest

from lowlevel import capabilities
from node.cpu_affinity import core_of
from wire.control import Wiring


@pytest.fixture
def cores(monkeypatch):
    """Have these cores, whatever the machine has."""

    def have(*cores):
        monkeypatch.setattr("node.cpu_affinity.CORES", list(cores))

    return have


def cores_of(wiring):
    return [core_of(wiring, cell) for cell in range(len(wiring.nodes))]


def test_blocks_of_the_torus_share_a_core(cores):
    cores(3, 5)
    assert cores_of(Wiring(0, tuple(range(16)))) == [3] * 8 + [5] * 8


def test_which_nodes_live_there_does_not_matter(cores):
    cores(0, 1, 2)
    nodes = tuple(reversed(range(40, 64)))
    assert cores_of(Wiring(7, nodes)) == [0] * 8 + [1] * 8 + [2] * 8


def test_a_few_nodes_go_wherever_the_kernel_likes(cores):
    cores(0, 1)
    assert cores_of(Wiring(0, tuple(range(15)))) == [None] * 15


def test_each_host_deals_out_its_own_cells(cores):
    cores(0, 1)
    hosts = ("a", "b") * 16 + ("c",) * 4
    dealt = cores_of(Wiring(0, tuple(range(36)), hosts))
    assert dealt[0:32:2] == dealt[1:32:2] == [0] * 8 + [1] * 8
    assert dealt[32:] == [None] * 4


@pytest.mark.parametrize("nodes", [64, 100, 1023])
def test_all_cores_have_as_many(cores, nodes):
    cores(*range(7))
    shares = Counter(cores_of(Wiring(0, tuple(range(nodes)))))
    assert len(shares) == 7
    assert max(shares.values()) - min(shares.values()) <= 1


# How a process of its own sees its turns: milliseconds, by sched_getattr(2); 0 before Linux 6.12, which tells nothing.
LOOK = """
import ctypes, struct
from lowlevel.linux import ask_for_turns
from node.cpu_affinity import LONG, take_turns

def look():
    attributes = ctypes.create_string_buffer(48)
    assert ctypes.CDLL(None).syscall(315, 0, attributes, 48, 0) == 0
    _, policy, _, _, _, turn, *_ = struct.unpack("=IIQiIQQQ", attributes)
    print(policy, turn / 1e6)

look()
take_turns()
ask_for_turns(LONG)
look()
ask_for_turns(0.0)
look()
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="asks the kernel by number")
@pytest.mark.skipif(not capabilities().linux, reason="the ordinary path leaves turns as they are")
def test_turns_are_long_for_as_long_as_they_should_be():
    said = subprocess.run([sys.executable, "-c", LOOK], check=True, capture_output=True, text=True).stdout
    before, during, after = ((int(policy), float(turn)) for policy, turn in map(str.split, said.splitlines()))
    known = before[1] > 0
    assert before == (os.sched_getscheduler(0), before[1])
    assert during == (os.SCHED_BATCH, 20.0 if known else 0.0)
    assert after == (os.SCHED_BATCH, before[1])
    assert before[1] < 20
