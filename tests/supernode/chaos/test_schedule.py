"""The faults of a trial: the same seed draws the same ones, and everything that is to die dies."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from supernode.chaos.schedule import DISK, SPECIAL, faults


@given(nodes=st.integers(1, 200), seconds=st.floats(1.0, 90.0), at_once=st.floats(0.0, 0.9), seed=st.integers(0, 9999))
def test_a_seed_draws_the_faults(nodes, seconds, at_once, seed):
    drawn = faults(nodes, seconds, at_once, seed)
    assert drawn == faults(nodes, seconds, at_once, seed)
    assert drawn == sorted(drawn, key=lambda fault: fault.at)
    assert all(1.0 <= fault.at <= max(1.0, seconds) for fault in drawn)
    assert all(0.0 < fault.seconds < 15.0 if fault.do == "stop" else fault.seconds == 0.0 for fault in drawn)
    assert [fault.target for fault in sorted(drawn, key=lambda fault: fault.target) if fault.target in SPECIAL] == (
        sorted(SPECIAL)
    )
    at_first = [fault.target for fault in drawn if fault.at == 1.0 and fault.target not in SPECIAL]
    assert len(set(at_first)) == len(at_first) == round(at_once * nodes)
    assert {fault.target for fault in drawn} <= {*SPECIAL, *(f"node {node}" for node in range(nodes))}


@given(seconds=st.floats(1.0, 90.0), seed=st.integers(0, 9999), full=st.floats(0.1, 30.0))
def test_the_disk_is_full_once_and_the_other_faults_stay_the_same(seconds, seed, full):
    drawn = faults(9, seconds, 0.25, seed, full)
    (disk,) = [fault for fault in drawn if fault.target == DISK]
    assert (disk.do, disk.seconds) == ("fill", full)
    assert [fault for fault in drawn if fault is not disk] == faults(9, seconds, 0.25, seed)


@given(seconds=st.floats(1.0, 90.0), seed=st.integers(0, 9999), hosts=st.integers(1, 5))
def test_hosts_are_cut_off_now_and_then_and_one_dies_and_the_other_faults_stay_the_same(seconds, seed, hosts):
    drawn = faults(9, seconds, 0.25, seed, hosts=hosts)
    assert drawn == faults(9, seconds, 0.25, seed, hosts=hosts) == sorted(drawn, key=lambda fault: fault.at)
    on_hosts = [fault for fault in drawn if fault.kind == "host"]
    assert [fault for fault in drawn if fault not in on_hosts] == faults(9, seconds, 0.25, seed)
    assert {fault.number for fault in on_hosts} <= set(range(hosts))
    assert all(1.0 <= fault.at <= max(1.0, seconds) for fault in on_hosts)
    counts = Counter(fault.do for fault in on_hosts)
    assert counts.keys() == {"kill", "part"}
    assert counts["kill"] == 1
    assert seconds / 8.0 - 0.5 <= counts["part"] <= max(1.0, seconds / 8.0 + 0.5)
    assert all(1.0 <= fault.seconds <= 20.0 for fault in on_hosts if fault.do == "part")


def test_most_cuts_are_short_but_some_are_long():
    lengths = [
        fault.seconds for seed in range(50) for fault in faults(9, 60.0, 0.0, seed, hosts=3) if fault.do == "part"
    ]
    assert 0.7 < sum(length <= 6.0 for length in lengths) / len(lengths) < 0.9
    assert max(lengths) > 15.0
