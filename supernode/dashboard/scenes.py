"""Draw the jobs' best solutions so far, on request, one at a time in a thread."""

import asyncio
import json
import time
from collections import OrderedDict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from problems import BadInput, Problem, ProblemFile, Solution, registry
from problems.animation import Animation
from problems.errors import EvaluationFailed
from problems.guard import animated
from supernode.dashboard.animations import Bodies, bodies_of, encoded, placements_of
from supernode.dashboard.spaces import spaces_of
from supernode.pictures.picture import as_png, drawn

Form = Literal["png", "spaces"]
"""A PNG picture; or JSON of what moves, see `animations`, else of what is drawn in three dimensions, see `spaces`."""

_KEPT = 32  # pictures
_KEPT_STAGES = 4  # a large robot takes tens of megabytes
_AT_MOST_EVERY = 1.0  # seconds between two pictures of a job, at least
_REST = 20.0  # the pause after a picture, as a multiple of the time it took: planning has priority
_DOTS_PER_INCH = 96


@dataclass(frozen=True)
class _Picture:
    of: tuple[Any, ...]  # what the picture shows: job, epoch and best answer; another picture is due when it changes
    next_at: float  # when the next picture may be drawn, by the monotonic clock
    data: bytes


class Scenes:
    """Draws and keeps pictures of jobs; only the server's loop may call it.

    Matplotlib draws in one thread, so that at most one picture is drawn at a time and the loop is not blocked.
    """

    def __init__(self) -> None:
        self._pictures: OrderedDict[tuple[str, Form], _Picture] = OrderedDict()
        self._thread = ThreadPoolExecutor(1, "scenes")
        self._drawing = asyncio.Lock()

    async def drawn(self, view: Mapping[str, Any], form: Form) -> bytes:
        """Return a picture of a job's best answer; if the last one was drawn a moment ago, wait before drawing.

        Args:
            view: the answer to `show` about the job.
            form: the form of the picture.

        Raises:
            BadInput: if the problem cannot be drawn here.
        """
        best, name = view["best"], (view["job"], form)
        of = (view["number"], view["epoch"], None if best is None else (best["epoch"], best["fitness"]))
        known = self._pictures.get(name)
        if known is not None and known.of != of:
            await asyncio.sleep(known.next_at - time.monotonic())
        async with self._drawing:
            # Ask again: while this request waited, another one may have drawn the same picture.
            known = self._pictures.get(name)
            if known is None or known.of != of:
                loop, began = asyncio.get_running_loop(), time.monotonic()
                data = await loop.run_in_executor(self._thread, _draw, view["file_now"], best, form)
                now = time.monotonic()
                rest = max(_AT_MOST_EVERY, _REST * (now - began))
                known = self._pictures[name] = _Picture(of, now + rest, data)
            self._pictures.move_to_end(name)
            while len(self._pictures) > _KEPT:
                self._pictures.popitem(last=False)
            return known.data

    async def bodies(self, view: Mapping[str, Any]) -> Bodies | None:
        """Return the bodies that move in a job's problem; None if its kind has no animation.

        Args:
            view: the answer to `show` about the job.

        Raises:
            BadInput: if the problem cannot be drawn here.
        """
        async with self._drawing:
            return await asyncio.get_running_loop().run_in_executor(self._thread, _bodies, view["file_now"])

    def close(self) -> None:
        """Stop drawing."""
        self._thread.shutdown(wait=False, cancel_futures=True)


@dataclass(frozen=True)
class _Stage:
    """A problem whose solutions move; making it reads all meshes, so it is kept for the next solutions."""

    problem: Problem
    bodies: Bodies


def _draw(text: str, best: Mapping[str, Any] | None, form: Form) -> bytes:
    found, is_attempt = (None, False) if best is None else (best["solution"], not best["feasible"])
    stage = _stage(text) if form == "spaces" else None
    if stage is not None:
        animation = _animated(stage.problem, found)
        if animation is not None:
            placements = placements_of(animation, stage.bodies.key)
            return encoded({"spaces": [], "whole": True, "animation": placements})
    figure = drawn(_drawable(text).problem(), found, is_attempt=is_attempt)
    return as_png(figure, _DOTS_PER_INCH) if form == "png" else json.dumps(spaces_of(figure), allow_nan=False).encode()


def _bodies(text: str) -> Bodies | None:
    stage = _stage(text)
    return None if stage is None else stage.bodies


@lru_cache(_KEPT_STAGES)
def _stage(text: str) -> _Stage | None:
    file = _drawable(text)
    if registry.find_built_in(file.kind).animation is Problem.animation:
        return None  # without making the problem
    problem = file.problem(checked=True)  # by the coordinator
    animation = _animated(problem, None)  # its bodies are those of all solutions
    return None if animation is None else _Stage(problem, bodies_of(animation))


def _animated(problem: Problem, solution: Solution | None) -> Animation | None:
    try:
        return animated(problem, solution)
    except EvaluationFailed as error:
        raise BadInput(str(error)) from error


def _drawable(text: str) -> ProblemFile:
    file = ProblemFile.from_json(text)
    if not registry.is_built_in(file.kind):
        raise BadInput(f"{file.kind}: a problem of one's own is not drawn here, where its code is not run")
    return file
