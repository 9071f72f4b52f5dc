"""Nodes are kept for those who came back at once the last time, and no longer than their job took."""

import pytest

from coordinator.jobs import client_limits
from coordinator.jobs.returning_clients import ReturningClients


@pytest.fixture
def returning():
    """Clients of whom one has come back at once, and is to come again from second 10 on: its job took half a second."""
    clients = ReturningClients()
    clients.ended("robot", 16, 0.5, now=5.0)
    clients.came("robot", now=5.4)
    clients.ended("robot", 16, 0.5, now=10.0)
    return clients


def test_nodes_are_kept_for_a_client_that_came_at_once_the_last_time(returning):
    assert (returning.kept(16, 10.4), returning.kept_until(16, 10.4)) == (16, 10.5)


def test_no_nodes_are_kept_from_a_much_larger_job(returning):
    assert (returning.kept(64, 10.4), returning.kept(65, 10.4), returning.kept_until(65, 10.4)) == (16, 0, None)


def test_they_are_kept_for_as_long_as_the_job_took_and_for_a_second_at_most(returning):
    assert (returning.kept(1, 10.5), returning.kept_until(1, 10.5)) == (0, None)
    returning.came("robot", now=10.4)
    returning.ended("robot", 16, 60.0, now=80.0)
    assert (returning.kept_until(1, 80.9), returning.kept_until(1, 81.0)) == (81.0, None)


def test_they_are_kept_long_enough_for_the_way_of_a_job_however_short_jobs_are(returning):
    returning.came("robot", now=10.4)
    returning.ended("robot", 16, 0.001, now=20.0)
    assert (returning.kept_until(1, 20.0), returning.kept(1, 20.15)) == (20.15, 0)


def test_nothing_is_kept_for_a_client_that_is_here_again(returning):
    returning.came("robot", now=10.1)
    assert returning.kept(1, 10.2) == 0


def test_a_client_that_lets_others_wait_in_vain_must_show_again_that_it_comes_at_once(returning):
    returning.came("robot", now=11.0)
    returning.ended("robot", 16, 0.5, now=12.0)
    assert returning.kept(1, 12.1) == 0
    returning.came("robot", now=12.1)
    returning.ended("robot", 16, 0.5, now=13.0)
    assert returning.kept(1, 13.1) == 16


def test_a_client_that_is_new_or_comes_twice_changes_nothing(returning):
    returning.came("stranger", now=10.1)
    returning.came("robot", now=10.1)
    returning.came("robot", now=11.0)
    returning.ended("robot", 4, 0.5, now=12.0)
    returning.ended("stranger", 4, 0.5, now=12.0)
    assert returning.kept(1, 12.1) == 4


def test_too_many_names_are_forgotten(returning, monkeypatch):
    monkeypatch.setattr(client_limits, "_CLIENTS_KEPT", 2)
    for number in range(3):
        returning.ended(f"made up {number}", 1, 1.0, now=10.0)
        returning.came(f"made up {number}", now=10.05)
    assert returning.kept(1, 10.1) == 0
    assert len(returning._clients) == 2
