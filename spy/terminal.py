"""What people see while a run goes on: a line for each improvement, and a live line of statistics on a terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from problems.errors import shorten
from topologies import Topology
from wire.news import Improvement, Statistics


class Terminal:
    """Progress on stderr; a context manager, since what is live must be taken away in the end.

    Args:
        topology: of the cells.
        quiet: whether to say nothing at all.
        below: what is live under the lines, instead of one line of statistics.
    """

    def __init__(self, topology: Topology, quiet: bool = False, below: RenderableType = "") -> None:
        self.topology = topology
        self._quiet = quiet
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._best: float | None = None
        self._live: Live | None = None
        if self._console.is_terminal and not quiet:
            self._live = Live(below, console=self._console, transient=True, refresh_per_second=4)

    def __enter__(self) -> "Terminal":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str) -> None:
        """A plain line."""
        if not self._quiet:
            self._console.print(Text(text))

    def begins_anew(self, why: Mapping[str, Any]) -> None:
        """A line about another attempt, which began as the directive says."""
        fields = "".join(f", {name} = {shorten(value)}" for name, value in why["fields"].items())
        self.say(f"stalled: begins anew, restart {why['attempt']}, seed {why['seed']}{fields}")

    def improvement(self, better: Improvement) -> None:
        """A line: time, generation, cell, fitness, and whether the check accepts the solution."""
        self._best = better.fitness
        place = ", ".join(str(part) for part in self.topology.place(better.cell))
        self.say(
            f"{better.seconds:9.3f} s  generation {better.generation:<6d} cell ({place})  fitness {better.fitness:.6g}"
            f"  {'feasible' if better.feasible else 'infeasible'}"
        )

    def statistics(self, now: Statistics) -> None:
        """The live line; nothing where stderr is no terminal."""
        if self._live is not None:
            best = "-" if self._best is None else f"{self._best:.6g}"
            self._live.update(
                Text(
                    f"best {best}   generation {now.generation}   {now.messages_per_second:.0f} messages/s   "
                    f"{now.nodes_alive} of {self.topology.cells} nodes alive",
                    style="bold",
                )
            )
