"""Show a cluster on a terminal: its torus, its jobs or one of them, and the latest log records."""

import asyncio
import contextlib
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Self

from rich.color import Color
from rich.console import Group, RenderableType
from rich.style import Style
from rich.table import Table
from rich.text import Text

from coordinator.errors import ClusterFailed
from problems import BadInput
from supernode.client.cluster_info import Place
from supernode.live.view import View, shape_of
from supernode.live.watcher import PATIENCE, Watcher
from wire.jobs import Show
from wire.printable import printable, printable_lines

_PERIOD = 0.5  # seconds between two snapshots
_JOBS, _LINES = 8, 5  # jobs and log records shown
_LOW, _MIDDLE, _HIGH = (68, 1, 84), (33, 145, 140), (253, 231, 37)  # the ends and the middle of viridis
_UNKNOWN, _DEAD = (60, 60, 60), (200, 40, 40)

RGB = tuple[int, int, int]


class Screen:
    """The current view of a cluster, as Rich draws it; a context manager.

    A thread with an asyncio loop of its own follows the cluster and replaces `snapshot` as a whole. Rich's thread only
    reads it, so no lock is needed.

    Args:
        place: where the cluster is.
        job: the id of the only job to show; None for all.
    """

    def __init__(self, place: Place, job: str | None = None) -> None:
        self._place = place
        self._job = job
        self._ended = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._watch()), name="screen", daemon=True)
        self.snapshot: dict[str, Any] = View().snapshot()
        self._cell_nodes: Sequence[int] = ()  # the nodes of the job to show, in the order of its cells

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def __rich__(self) -> RenderableType:
        return drawn(self.snapshot, self._job, self._cell_nodes)

    async def _watch(self) -> None:
        view = View()
        watcher = Watcher(self._place, view)
        watching = asyncio.create_task(watcher.run())
        dead: set[int] = set()
        while not await asyncio.to_thread(self._ended.wait, _PERIOD):
            snapshot = view.snapshot()
            before, dead = dead, _dead(snapshot["nodes"])
            # Statistics do not say at which cell a node was that died: ask the coordinator.
            if self._job is not None and dead - before:
                await self._look(watcher, self._job)
            self.snapshot = snapshot
        watching.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watching

    async def _look(self, watcher: Watcher, job: str) -> None:
        """Ask which nodes have the job's cells."""
        with contextlib.suppress(ClusterFailed, BadInput):  # then keep what was known before
            self._cell_nodes = (await watcher.client.ask(Show(job), PATIENCE))["nodes"]


def drawn(snapshot: Mapping[str, Any], job: str | None, cell_nodes: Sequence[int] = ()) -> RenderableType:
    """Draw a snapshot of a cluster, or of one of its jobs.

    Args:
        snapshot: the state of the cluster, from `supernode.live.view.View.snapshot`.
        job: the id of the only job to show; None for all.
        cell_nodes: the nodes of that job, in the order of its cells, as far as they are known.
    """
    if not snapshot["answers"]:
        return _text(snapshot["trouble"] or "waiting for the cluster", style="italic")
    parts: list[RenderableType] = [_head(snapshot)]
    if job is None:
        parts += [_torus(snapshot), _jobs(snapshot)]
    else:
        found = next((each for each in snapshot["jobs"] if each["job"] == job), None)
        if found is not None:
            parts += [_of_job(snapshot, found), _torus(snapshot, found, cell_nodes)]
    lines = (printable(f"{each['level']}: {each['text']}") for each in snapshot["lines"][-_LINES:])
    return Group(*parts, _text("\n".join(lines), style="dim"))


def _text(text: str, style: str = "") -> Text:
    return Text(printable_lines(text), style)


def _head(snapshot: Mapping[str, Any]) -> Text:
    states = snapshot["nodes"]["state"]
    alive = sum(state == "alive" for state in states)
    jobs = ", ".join(f"{count} {status}" for status, count in snapshot["counts"].items()) or "none yet"
    return _text(f"cluster {snapshot['cluster']}: {alive} of {len(states)} nodes alive; jobs: {jobs}", style="bold")


def _of_job(snapshot: Mapping[str, Any], job: Mapping[str, Any]) -> Text:
    """Return the state and the statistics of a job, in one line or two."""
    words = f"job {job['job']} ({job['kind']}, {job['topology']}): {job['status']}, fitness {_figure(job['fitness'])}"
    now = snapshot["statistics"].get(job["number"])
    if now is None:
        return _text(words)
    spread = "  ".join(f"{name} {_figure(now[name])}" for name in ("best", "median", "worst"))
    messages = f"{now['messages_per_second']:.0f} messages/s  lost {now['lost']}  rejected {now['rejected']}"
    spread += f"  diversity {now['diversity']:.0%}  champion's age {now['age']}"
    return _text(f"{words}\ngeneration {now['generation']}  {spread}  {messages}")


def _jobs(snapshot: Mapping[str, Any]) -> RenderableType:
    table = Table("job", "kind", "status", "fitness", "generation", "cells", box=None, padding=(0, 2, 0, 0))
    for job in snapshot["jobs"][: -_JOBS - 1 : -1]:
        now = snapshot["statistics"].get(job["number"], {})
        figures = (_figure(job["fitness"]), str(now.get("generation", "-")), str(job["cells"]))
        table.add_row(*map(_text, (job["job"], job["kind"], job["status"])), *figures)
    return table


def _torus(snapshot: Mapping[str, Any], job: Mapping[str, Any] | None = None, cell_nodes: Sequence[int] = ()) -> Text:
    """Return the torus, a character for two cells, one above the other: the better its best individual, the lighter."""
    nodes = snapshot["nodes"]
    dead = _dead(nodes)
    places = _bests(nodes, dead, None if job is None else job["number"])
    if job is not None:  # a cell whose node died may have got another one since `cell_nodes` were asked for
        dead = {cell for cell, node in enumerate(cell_nodes) if node in dead and cell not in places}
    rows, columns = (snapshot["rows"], snapshot["columns"]) if job is None else shape_of(job["topology"])
    colours = _colours(places)
    text = Text()
    for row in range(0, rows, 2):
        for column in range(columns):
            above, below = (_colour(each * columns + column, colours, dead) for each in (row, row + 1))
            text.append("▀▀", Style(color=above, bgcolor=below if row + 1 < rows else None))
        text.append("\n")
    return text


def _dead(nodes: Mapping[str, list[Any]]) -> set[int]:
    return {node for node, state in zip(nodes["node"], nodes["state"], strict=True) if state == "dead"}


def _bests(nodes: Mapping[str, list[Any]], dead: set[int], job: int | None) -> dict[int, float]:
    """Return the known best fitness of each living place: of the cells of ``job``, or of all nodes if it is None."""
    told = zip(*(nodes[name] for name in ("node", "cell", "job", "best")), strict=True)
    return {
        node if job is None else cell: best
        for node, cell, at, best in told
        if best is not None and node not in dead and job in (None, at)
    }


def _colours(places: Mapping[int, float]) -> dict[int, RGB]:
    """Colour places by the rank of their fitness, which may span many orders of magnitude."""
    ranks = {best: rank for rank, best in enumerate(sorted(set(places.values())))}
    greatest = max(1, len(ranks) - 1)
    return {place: _shade(1.0 - ranks[best] / greatest) for place, best in places.items()}


def _shade(lightness: float) -> RGB:
    """Return a colour between dark (0) and light (1)."""
    begin, end, share = (_LOW, _MIDDLE, 2 * lightness) if lightness < 0.5 else (_MIDDLE, _HIGH, 2 * lightness - 1)
    red, green, blue = (round(one + (other - one) * share) for one, other in zip(begin, end, strict=True))
    return red, green, blue


def _colour(place: int, colours: Mapping[int, RGB], dead: set[int]) -> Color:
    return Color.from_rgb(*(_DEAD if place in dead else colours.get(place, _UNKNOWN)))


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
