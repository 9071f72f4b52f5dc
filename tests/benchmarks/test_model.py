"""The arithmetic of the model of how fast a torus goes; nothing here is timed."""

import pytest

from benchmarks.model import Measured, Model, beyond, crossing_share, error


def torus(nodes, cpu, cores=2.0):
    return Measured(nodes, nodes / cores * cpu, cpu)


MODEL = Model((torus(16, 60e-6), torus(64, 140e-6), torus(1024, 220e-6)), wait=80e-6)


def test_it_is_what_was_measured():
    sizes = [torus(1024, 220e-6, 1.4), torus(16, 60e-6, 2.0), torus(64, 140e-6, 1.9)]
    model = Model.of(sizes, Measured(2, 20e-6 + 80e-6, 20e-6))
    assert model.wait == pytest.approx(80e-6)
    for size in sizes:
        assert model.cores_of(size.nodes) == pytest.approx(size.cores)
        assert model.cpu_of(size.nodes) == pytest.approx(size.cpu)
        assert model.seconds(size.nodes) == pytest.approx(size.seconds)


def test_the_cores_kept_busy_change_with_the_logarithm_of_the_nodes():
    losing = Model((torus(16, 60e-6, 2.0), torus(1024, 220e-6, 1.4)), wait=80e-6)
    assert losing.cores_of(4) == losing.cores_of(16) == 2.0
    assert losing.cores_of(128) == pytest.approx(1.7)
    assert losing.cores_of(4096) == 1.4
    assert losing.seconds(1024) > MODEL.seconds(1024)


def test_cpu_time_is_a_power_of_the_processes_of_a_core_between_what_was_measured():
    assert MODEL.cpu_of(32, 2.0) == pytest.approx((60e-6 * 140e-6) ** 0.5)
    assert MODEL.cpu_of(256, 2.0) == pytest.approx((140e-6 * 220e-6) ** 0.5)
    assert MODEL.cpu_of(1 << 40, 2.0) == pytest.approx(220e-6)
    assert MODEL.cpu_of(64, 8.0) == pytest.approx(60e-6)
    assert MODEL.cpu_of(2, 2.0) == pytest.approx(60e-6)


def test_a_generation_is_the_work_of_a_core_or_a_wait():
    assert MODEL.seconds(16) == pytest.approx(8 * 60e-6)
    assert MODEL.seconds(16, extra=100e-6) == pytest.approx(8 * 160e-6)
    assert MODEL.seconds(4) == pytest.approx(60e-6 + 80e-6)
    assert MODEL.seconds(2, extra=100e-6) == pytest.approx(160e-6 + 80e-6)
    assert MODEL.seconds(16, cores=16.0, network=50e-6) == pytest.approx(60e-6 + 80e-6 + 50e-6)
    assert MODEL.seconds(16, cores=1000.0) == pytest.approx(60e-6 + 80e-6)
    assert MODEL.seconds(64, network=1.0, waits=False) == pytest.approx(32 * (60e-6 + 80e-6))


def test_busy_cores_are_cpu_time_by_time():
    assert Measured(16, 500e-6, 60e-6).cores == pytest.approx(1.92)


def test_errors_are_in_percent_of_what_is_measured():
    assert error(75.0, 100.0) == pytest.approx(-25.0)
    assert error(120.0, 100.0) == pytest.approx(20.0)


@pytest.mark.parametrize(("cells", "share"), [(1, 1.0), (4, 0.5), (100, 0.1), (50, 0.15)])
def test_links_that_leave_a_block(cells, share):
    assert crossing_share(cells) == pytest.approx(share)


def test_the_large_computer_has_a_line_for_each_case():
    lines = beyond(MODEL, 100, 100, 30.0)
    assert "10,000 cores (torus 100x100)" in lines[0]
    assert "| network 30 µs, evaluation 0 µs | 170 | 5,882 | 235,294,118 | 17.0 ms |" in lines
