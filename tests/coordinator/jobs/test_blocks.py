"""Which host gets which cells: each its share, in blocks, with few edges between hosts and racks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import topologies
from coordinator.jobs.blocks import edges_between, fewest_hosts, host_of_cells


def crossing(spec, shares, labels=None):
    """The edges that cross, each counted once."""
    topology = topologies.parse(spec)
    of_cells = host_of_cells(topology, shares, labels or [f"host{number}" for number in range(len(shares))])
    return edges_between(topology, of_cells)[0] // 2


@pytest.mark.parametrize(
    ("spec", "shares", "best"),
    [
        ("torus 8x8", [16, 16, 16, 16], 32),  # four blocks of 4 x 4
        ("torus 8x8", [24, 24, 16], 24),  # three bands around the torus
        ("torus 8x8", [32, 32], 16),
        ("torus 16x16", [32] * 8, 96),  # blocks of 4 x 8
        ("torus 32x32", [256] * 4, 128),
        ("torus 64x64", [64] * 64, 1024),  # blocks of 8 x 8
        ("grid 8x8", [16, 16, 16, 16], 16),
        ("ring 60", [20, 20, 20], 3),
        ("torus 4x4", [16, 0, 0], 0),
    ],
)
def test_blocks_have_the_fewest_edges_between_them(spec, shares, best):
    assert crossing(spec, shares) == best


def test_uneven_shares_are_near_the_best_bands():
    assert crossing("torus 8x8", [22, 21, 21]) <= 1.2 * 24


def test_hosts_of_one_rack_are_beside_each_other():
    topology, labels = topologies.parse("torus 16x16"), [f"rack{number % 4}/host{number}" for number in range(16)]
    of_cells = host_of_cells(topology, [16] * 16, labels)
    between_racks, _ = edges_between(topology, [labels[host].split("/")[0] for host in of_cells])
    assert between_racks // 2 <= 1.1 * 64  # four racks of 8 x 8


SPECS = ["torus 6x4", "grid 3x8", "ring 24", "complete 24", "small-world 24 4 0.2 seed 1", "moore 4x6"]


@settings(deadline=None)
@given(st.sampled_from(SPECS), st.lists(st.integers(0, 24), min_size=1, max_size=8), st.data())
def test_every_host_gets_its_share(spec, free, data):
    free[data.draw(st.integers(0, len(free) - 1))] += 24
    shares = fewest_hosts(free, 24)
    assert sum(shares) == 24
    assert all(share <= most for share, most in zip(shares, free, strict=True))
    used = sorted((each for each in free if each), reverse=True)[: sum(share > 0 for share in shares)]
    assert sum(used[:-1]) < 24  # with one host fewer it would not fit
    labels = [f"rack{number // 2}/host{number}" for number in range(len(free))]
    of_cells = host_of_cells(topologies.parse(spec), shares, labels)
    assert np.bincount(of_cells, minlength=len(free)).tolist() == shares
