"""Live news: many who listen, and one who does not."""

import contextlib
import itertools
import json
import math
import socket
import time
from dataclasses import replace

import pytest
from live_service import until

from supernode.dashboard import listen_address, streams
from wire.news import Improvement

ASK = b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n"


def listen(shown, room=None, ask=ASK):
    sock = socket.socket()
    if room is not None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room)
    sock.settimeout(20)
    sock.connect(("127.0.0.1", shown.port))
    sock.sendall(ask)
    return sock


def named_events(sock):
    """Each event's name, and what it holds."""
    name = "message"
    with sock.makefile("rb") as lines:
        for line in lines:
            if line.startswith(b"event: "):
                name = line[7:].strip().decode()
            elif line.startswith(b"data: "):
                yield name, json.loads(line[6:])
                name = "message"


def first_event(sock):
    return next(event for name, event in named_events(sock) if name == "message")


def test_fifty_browsers_hear_the_same(shown, service):
    with contextlib.ExitStack() as stack:
        socks = [stack.enter_context(listen(shown)) for _ in range(50)]
        events = [first_event(sock) for sock in socks]
        assert {event["rows"] for event in events} == {1}
        assert shown.streams.count == 50
    until(lambda: shown.streams.count == 0)


def test_pages_that_show_no_nodes_are_told_of_none(shown):
    with listen(shown) as whole, listen(shown, ask=ASK.replace(b"/events", b"/events?nodes=0")) as brief:
        assert first_event(whole).keys() - first_event(brief).keys() == {"nodes"}


BETTER = Improvement(1, 0, math.inf, 3, 2, 0.5, True, {"x": [1.5, math.inf]})


def test_an_improvement_is_told_with_fitness_and_solution_whatever_no_number_can_say(shown, service):
    until(lambda: shown.dashboard.view.answers)
    before = time.time()
    with listen(shown) as sock:
        until(lambda: service.publish(service.keys.best, BETTER.encode()) or shown.dashboard.view.improvements())
        told = next(event for name, event in named_events(sock) if name == "improvement")
    assert before <= told.pop("at") <= time.time()
    place = {"job": 1, "epoch": 0, "seconds": None, "generation": 3, "cell": 2}
    assert told == place | {"fitness": 0.5, "feasible": True, "solution": {"x": [1.5, None]}}


def hear(shown, improvement):
    """The dashboard receives an improvement."""
    shown.streams._latest.get_loop().call_soon_threadsafe(shown.dashboard.view.hear_improvement, improvement)
    until(lambda: any(each.improvement is improvement for each in shown.dashboard.view.improvements().values()))


def told_until(news, generation):
    """The generations of the improvements that a browser is told of, up to that one."""
    told = (event["generation"] for name, event in news if name == "improvement")
    return [*itertools.takewhile(lambda each: each != generation, told), generation]


def test_each_browser_is_told_of_an_improvement_once_though_it_comes_late(shown):
    until(lambda: shown.dashboard.view.answers)
    hear(shown, replace(BETTER, generation=4))
    with listen(shown) as one, listen(shown) as other:
        all_news = named_events(one), named_events(other)
        for news in all_news:
            assert told_until(news, 4) == [4]
        hear(shown, replace(BETTER, job=2, generation=5))
        for news in all_news:
            assert told_until(news, 5) == [5]
    with listen(shown) as late:
        assert told_until(named_events(late), 5) == [4, 5]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # it is raised where it serves
def test_a_dashboard_whose_news_break_ends(show, monkeypatch):
    shown = show()
    with listen(shown) as sock:
        first_event(sock)
        monkeypatch.setattr(shown.streams, "_news", lambda: {"best": math.inf})
        until(lambda: shown.ended)


@pytest.mark.parametrize(
    ("most", "refusal"),
    [("MOST", (503, "there are 2 streams already\n")), ("MOST_OF_ONE", (429, "this address has 2 streams already\n"))],
)
def test_there_is_a_most_of_all_and_of_one_address(shown, monkeypatch, most, refusal):
    monkeypatch.setattr(streams, most, 2)
    with listen(shown) as one, listen(shown) as two:
        first_event(one), first_event(two)
        status, _, text = shown.ask("GET", "/events")
        assert (status, text) == refusal
    until(lambda: shown.streams.count == 0)
    assert shown.streams._of == {}
    with listen(shown) as again:
        first_event(again)


def test_news_end_with_the_session(show, monkeypatch):
    monkeypatch.setattr(streams, "PERIOD", 0.01)
    shown = show({"s3cret-s3cret-s3cret": "read"})
    cookie = shown.log_in("s3cret-s3cret-s3cret")[1]["Set-Cookie"].partition(";")[0]
    monkeypatch.setattr(shown.streams, "_news", lambda: {"rows": 1})
    host = f"Host: localhost:{shown.port}\r\nCookie: {cookie}\r\n".encode()
    with listen(shown, ask=ASK.replace(b"Host: localhost\r\n", host)) as sock:
        news = named_events(sock)
        next(news), next(news)
        assert shown.ask("POST", "/logout", "", Cookie=cookie)[0] == 303
        for _ in news:  # until they end
            pass
    until(lambda: shown.streams.count == 0)


@pytest.fixture
def _hasty(monkeypatch):
    monkeypatch.setattr(listen_address, "_STALLED_MS", 1000)
    monkeypatch.setattr(streams, "PERIOD", 0.01)


@pytest.mark.usefixtures("_hasty")
def test_a_browser_that_stops_reading_is_disconnected_and_nothing_is_kept_for_it(show, monkeypatch):
    shown = show()
    made = []
    with listen(shown) as reads:
        first_event(reads)
        stream = shown.streams
        big = "x" * (1 << 20)
        monkeypatch.setattr(stream, "_news", lambda: made.append(1) or {"rows": 1, "text": big})
        with listen(shown, room=4096):
            until(lambda: stream.count == 2)
            reads.close()
            until(lambda: stream.count == 0)
            assert len(made) > 1
