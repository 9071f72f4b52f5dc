"""A real server of an animation: it listens where it is asked to, shows the scene, and leaves nothing behind."""

import contextlib
import socket
import urllib.error
import urllib.request

import numpy as np
import pytest
from jointed_robots import FIELDS, problem_of
from live_service import until

from problems import BadInput
from problems.guard import animated
from supernode.pictures.viewer import Viewer

pytest.importorskip("viser")
PATH = {"path": [FIELDS["start"], [0.0, -1.0, 0.3], FIELDS["goal"]], "length": 3.0, "clearance": 0.0}


@pytest.fixture(scope="module")
def animation():
    return animated(problem_of(), PATH)


@contextlib.contextmanager
def viewing(animation, port=0):
    viewer = Viewer(animation, "chain", "127.0.0.1", port)
    try:
        yield viewer
    finally:
        viewer.close()


def body_of(address):
    with urllib.request.urlopen(address, timeout=10) as answer:
        return answer.read()


def placed(viewer):
    """The positions and rotations of all frames that move."""
    return [np.concatenate([handle.position, handle.wxyz]).tolist() for _, handle in viewer._moving]


def test_it_serves_a_page_until_it_is_closed(animation):
    with viewing(animation) as viewer:
        assert viewer.address.startswith("http://127.0.0.1:")
        assert b"<html" in body_of(viewer.address).lower()
    with pytest.raises(OSError, match="refused"):
        body_of(viewer.address)


def test_a_port_in_use_is_refused_rather_than_replaced(animation):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        with pytest.raises(
            BadInput, match=f"--host, --port: cannot listen at 127.0.0.1:{port}: Address already in use; --port"
        ):
            Viewer(animation, "chain", "127.0.0.1", port)


def test_a_port_can_be_used_again_at_once(animation):
    with viewing(animation) as viewer:
        port = int(viewer.address.rstrip("/").rpartition(":")[2])
        body_of(viewer.address)
    with viewing(animation, port) as viewer:
        body_of(viewer.address)


def test_it_moves_the_robot_while_it_plays_and_stops_at_the_end(animation):
    with viewing(animation) as viewer:
        first = placed(viewer)
        viewer.tick(0.5)
        assert placed(viewer) == first
        viewer._on_button(None)
        assert viewer._button.label == "pause"
        viewer.tick(float(animation.along[-1]) / 2)
        middle = placed(viewer)
        assert middle != first
        assert [root.visible for root in viewer._ghosts] == [True, True]
        viewer.tick(1000.0)
        assert placed(viewer) not in (first, middle)
        assert [root.visible for root in viewer._ghosts] == [True, False]
        assert viewer._button.label == "play"
        assert viewer._slider.value == pytest.approx(animation.along[-1])


def test_the_problem_alone_has_nothing_to_play():
    with viewing(animated(problem_of(), None)) as viewer:
        viewer.tick(1.0)
        assert not hasattr(viewer, "_slider")
        assert [root.visible for root in viewer._ghosts] == [False, True]


CONTROLS = "() => [...document.querySelectorAll('button')].map((each) => each.textContent)"


def test_a_browser_shows_and_plays_it_and_asks_nobody_else(chromium, animation):
    complaints, foreign = [], []
    with viewing(animation) as viewer:
        page = chromium.new_page(viewport={"width": 1000, "height": 700})
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "request",
            lambda request: (
                None if request.url.startswith((viewer.address, "data:", "blob:")) else foreign.append(request.url)
            ),
        )
        page.goto(viewer.address)
        page.wait_for_selector("canvas", timeout=60_000)
        page.wait_for_selector("text=time / s", timeout=60_000)
        page.click("button:has-text('play')")
        until(lambda: viewer._playback.playing)
        viewer.tick(1000.0)
        page.wait_for_selector("button:has-text('play')")
        page.close()
    assert complaints == []
    assert foreign == []
