"""A launcher that is killed while it starts a cluster leaves nothing, whenever that is; the benchmark tries more."""

import pytest

from benchmarks.launcher_killed import killed_after, seconds_of_a_start

TOPOLOGY = "torus 8x16"
PATIENCE = 30.0  # seconds: on a machine that is busy otherwise; the benchmark allows 5


@pytest.fixture(scope="module")
def whole_start() -> float:
    return seconds_of_a_start(TOPOLOGY)


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_nothing_is_left_of_a_cluster_whose_launcher_is_killed(whole_start: float, share: float) -> None:
    left = killed_after(TOPOLOGY, share * whole_start, PATIENCE)
    assert (left.processes, left.files) == ([], [])
