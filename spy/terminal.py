"""The progress display of a run: a line for each improvement, and on a terminal a live line of statistics."""

import threading
from collections.abc import Mapping
from typing import Any

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from problems.errors import shorten
from spy.least_improvement import LEAST, is_worth_telling
from topologies import Topology
from wire.news import Improvement, Statistics
from wire.printable import printable


class Terminal:
    """Shows progress on stderr; a context manager, which removes the live display at the end.

    An improvement gets a line if it is the first of its epoch, or large enough, or still the best after a while or at
    the end. A real-valued fitness may improve hundreds of times a second by amounts that do not matter.

    Args:
        topology: the topology of the cells.
        quiet: whether to print nothing at all.
        below: the live display under the lines, in place of one line of statistics.
        least: the least improvement that gets a line at once, as a share of the fitness in the line before.
        patience: seconds after which the best improvement gets a line however small it is.
    """

    def __init__(
        self,
        topology: Topology,
        quiet: bool = False,
        *,
        below: RenderableType = "",
        least: float = LEAST,
        patience: float = 1.0,
    ) -> None:
        self.topology = topology
        self._quiet = quiet
        self._least = least
        self._patience = patience
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._best: float | None = None
        self._printed: Improvement | None = None
        self._unprinted: Improvement | None = None  # the best so far, if only a little better than the one printed
        self._timer: threading.Timer | None = None  # prints the one above after a while, on a thread of its own
        self._turn = threading.RLock()  # held by the caller or by the timer's thread
        self._live: Live | None = None
        if self._console.is_terminal and not quiet:
            self._live = Live(below, console=self._console, transient=True, refresh_per_second=4)

    def __enter__(self) -> "Terminal":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._print_the_rest()
        if self._live is not None:
            self._live.stop()

    def say(self, text: str) -> None:
        """Print a line."""
        if not self._quiet:
            self._console.print(Text(printable(text)))

    def begins_anew(self, why: Mapping[str, Any]) -> None:
        """Print a line about a restart, which the directive ``why`` describes."""
        self._print_the_rest()
        fields = "".join(f", {name} = {shorten(value)}" for name, value in why["fields"].items())
        self.say(f"stalled: begins anew, restart {why['attempt']}, seed {why['seed']}{fields}")

    def improvement(self, better: Improvement) -> None:
        """Print an improvement, now or later if it stays the best."""
        with self._turn:
            self._best, told = better.fitness, self._printed
            self._stop_waiting()
            if (
                told is None
                or (told.epoch, told.feasible) != (better.epoch, better.feasible)
                or is_worth_telling(told.fitness, better.fitness, self._least)
            ):
                self._print(better)
            else:
                self._unprinted = better
                self._timer = threading.Timer(self._patience, self._print_the_rest)
                self._timer.daemon = True
                self._timer.start()

    def _print(self, better: Improvement) -> None:
        """Print a line with time, generation, cell, fitness, and whether the check accepts the solution."""
        self._printed, self._unprinted = better, None
        place = ", ".join(str(part) for part in self.topology.place(better.cell))
        self.say(
            f"{better.seconds:9.3f} s  generation {better.generation:<6d} cell ({place})  fitness {better.fitness:.6g}"
            f"  {'feasible' if better.feasible else 'infeasible'}"
        )

    def _print_the_rest(self) -> None:
        """Print the best improvement so far unless it has a line; the timer calls this on a thread of its own."""
        with self._turn:
            self._stop_waiting()
            if self._unprinted is not None:
                self._print(self._unprinted)

    def _stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def statistics(self, now: Statistics) -> None:
        """Update the live line; does nothing if stderr is no terminal."""
        if self._live is not None:
            best = "-" if self._best is None else f"{self._best:.6g}"
            self._live.update(
                Text(
                    f"best {best}   generation {now.generation}   {now.messages_per_second:.0f} messages/s   "
                    f"{now.nodes_alive} of {self.topology.cells} nodes alive",
                    style="bold",
                )
            )
