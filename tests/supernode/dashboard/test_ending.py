"""The end of a dashboard: nobody is left waiting, and nothing is said of it but to those who do."""

import asyncio
import threading

import pytest
from live_service import until


@pytest.fixture
def waiting(shown, monkeypatch):
    """A dashboard whose cluster takes hours to answer, and how many wait for that."""
    waiting = []

    async def show(job):
        waiting.append(job)
        await asyncio.sleep(3600)

    monkeypatch.setattr(shown.dashboard, "show", show)
    return waiting


def test_who_still_waits_at_the_end_is_told_so(shown, waiting, capfd):
    told = []
    asks = threading.Thread(target=lambda: told.append(shown.ask("GET", "/api/jobs/a")))
    asks.start()
    until(lambda: waiting)
    shown.close()
    asks.join()
    (status, _, text) = told[0]
    assert (status, text) == (503, "the dashboard ends\n")
    assert capfd.readouterr().err == ""


def test_live_news_end_in_order(shown, capfd):
    told = []
    listens = threading.Thread(target=lambda: told.append(shown.ask("GET", "/events")))
    listens.start()
    until(lambda: shown.streams.count)
    shown.close()
    listens.join()
    (status, _, text) = told[0]
    assert status == 200, "an answer that is cut off raises"
    assert text.startswith("data: ")
    assert text.endswith("\n\n")
    assert capfd.readouterr().err == ""
