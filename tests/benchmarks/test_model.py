"""The arithmetic of the model of how fast a torus goes; nothing here is timed."""

from dataclasses import astuple, replace

import pytest

from benchmarks.model import Measured, Model, beyond, crossing_share, error

MODEL = Model(cpu=60e-6, cold=160e-6, wait=80e-6, least=16, cores=2.0, lost=0.0)
LOSING = replace(MODEL, lost=0.02)


def measured(model, nodes):
    return Measured(nodes, model.seconds(nodes), model.cpu_of(nodes))


@pytest.mark.parametrize("model", [MODEL, LOSING])
def test_it_finds_the_numbers_that_made_the_measurements(model):
    alone = Measured(2, 20e-6 + 80e-6, 20e-6)
    found = Model.fitted(measured(model, 16), measured(model, 1024), alone)
    assert astuple(found) == pytest.approx(astuple(model))


def test_the_kernel_takes_more_of_the_cores_the_more_processes_there_are():
    assert LOSING.cores_of(4) == LOSING.cores_of(16) == 2.0
    assert LOSING.cores_of(64) == pytest.approx(2.0 - 0.08)
    assert LOSING.cores_of(1024) == pytest.approx(2.0 - 0.56)
    assert LOSING.seconds(1024) > MODEL.seconds(1024)


def test_cpu_time_grows_with_the_processes_of_a_core_up_to_that_of_cold_caches():
    assert MODEL.cpu_of(16, 2.0) == pytest.approx(60e-6)
    assert MODEL.cpu_of(64, 2.0) == pytest.approx(60e-6 + 80e-6)
    assert MODEL.cpu_of(1 << 40, 2.0) == pytest.approx(60e-6 + 160e-6, rel=1e-4)
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
