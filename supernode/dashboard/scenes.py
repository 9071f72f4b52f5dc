"""Pictures of jobs' best solutions so far, drawn while somebody looks, one after the other in a thread."""

import asyncio
import time
from collections import OrderedDict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from problems import BadInput, ProblemFile, registry
from supernode.picture import as_png, drawn

_KEPT = 32  # pictures
_AT_MOST_EVERY = 1.0  # seconds
_DOTS_PER_INCH = 96


@dataclass(frozen=True)
class _Picture:
    of: tuple[Any, ...]
    drawn: float
    png: bytes


class Scenes:
    """The planners' own drawings."""

    def __init__(self) -> None:
        self._pictures: OrderedDict[str, _Picture] = OrderedDict()
        self._thread = ThreadPoolExecutor(1, "scenes")
        self._drawing = asyncio.Lock()

    async def png(self, view: Mapping[str, Any]) -> bytes:
        """The picture of a job, at most a second old if there is a better solution.

        Args:
            view: what `show` tells of the job.

        Raises:
            BadInput: if it cannot be drawn here.
        """
        best, job = view["best"], view["job"]
        of = (view["number"], len(view["worlds"]), None if best is None else (best["world"], best["fitness"]))
        async with self._drawing:
            known = self._pictures.get(job)
            if known is None or (known.of != of and time.monotonic() - known.drawn >= _AT_MOST_EVERY):
                solution = None if best is None else best["solution"]
                loop = asyncio.get_running_loop()
                png = await loop.run_in_executor(self._thread, _draw, view["file_now"], solution)
                known = self._pictures[job] = _Picture(of, time.monotonic(), png)
            self._pictures.move_to_end(job)
            while len(self._pictures) > _KEPT:
                self._pictures.popitem(last=False)
            return known.png

    def close(self) -> None:
        """Draw no more."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _draw(text: str, solution: dict[str, Any] | None) -> bytes:
    file = ProblemFile.from_json(text)
    if not registry.is_built_in(file.kind):
        raise BadInput(f"{file.kind}: a problem of one's own is not drawn here, where its code is not run")
    return as_png(drawn(file.problem(), solution), _DOTS_PER_INCH)
