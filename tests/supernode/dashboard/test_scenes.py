"""Pictures of jobs: whoever asks gets the one that was asked for."""

import asyncio
import time

from live_service import ROOT

import supernode
from supernode.dashboard import scenes as module
from supernode.dashboard.scenes import Scenes

FILE = supernode.load(ROOT / "examples" / "arm-ik.toml").to_json()


def view_of(fitness):
    return {"number": 1, "job": "a", "world": 0, "best": None, "file_now": FILE} | (
        {} if fitness is None else {"best": {"world": 0, "fitness": fitness, "solution": None}}
    )


def test_a_newer_picture_comes_late_rather_than_an_older_one(monkeypatch):
    drawn = []
    monkeypatch.setattr(module, "_draw", lambda *_: drawn.append(time.monotonic()) or str(len(drawn)).encode())

    async def looked():
        scenes = Scenes()
        try:
            first = await scenes.drawn(view_of(None), "png")
            both = await asyncio.gather(*[scenes.drawn(view_of(0.5), "png") for _ in range(2)])
            return first, both
        finally:
            scenes.close()

    assert asyncio.run(looked()) == (b"1", [b"2", b"2"])
    assert drawn[1] - drawn[0] > 0.9 * module._AT_MOST_EVERY
