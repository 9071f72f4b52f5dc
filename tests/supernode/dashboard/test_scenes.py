"""Pictures of jobs: whoever asks gets the one that was asked for."""

import asyncio
import time

import numpy as np
from live_service import ROOT

import supernode
from problems import ProblemFile
from supernode.dashboard import scenes as module
from supernode.dashboard.scenes import Scenes

FILE = supernode.load(ROOT / "examples" / "arm-ik.toml").to_json()


def test_a_picture_of_what_the_check_does_not_accept_says_so(monkeypatch):
    titles = []
    monkeypatch.setattr(module, "as_png", lambda figure, _: titles.append(figure.get_suptitle()) or b"")
    problem = ProblemFile.from_json(FILE).problem()
    solution = problem.decode(np.zeros(problem.coding.genome_bytes, np.uint8))
    for feasible in (True, False):
        module._draw(FILE, {"solution": solution, "feasible": feasible}, "png")
    module._draw(FILE, None, "png")
    assert titles == ["", "infeasible: the best attempt, not a solution", ""]


def view_of(fitness):
    return {"number": 1, "job": "a", "epoch": 0, "best": None, "file_now": FILE} | (
        {} if fitness is None else {"best": {"epoch": 0, "fitness": fitness, "solution": None}}
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
