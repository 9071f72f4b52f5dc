"""Pictures of jobs: whoever asks gets the one that was asked for."""

import asyncio

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
    monkeypatch.setattr(module, "_draw", lambda *_: drawn.append(1) or str(len(drawn)).encode())

    async def looked():
        scenes = Scenes()
        loop = asyncio.get_running_loop()
        try:
            first = await scenes.drawn(view_of(None), "png")
            began = loop.time()
            both = await asyncio.gather(*[scenes.drawn(view_of(0.5), "png") for _ in range(2)])
            return first, both, loop.time() - began
        finally:
            scenes.close()

    first, both, took = asyncio.run(looked())
    assert (first, both) == (b"1", [b"2", b"2"])
    assert took > 0.5 * module._AT_MOST_EVERY
