"""What must hold of a cell between any two steps."""

import numpy as np

from node.engine.kernels import OWN
from wire.exchange_layout import GENERATION


def validate(cell):
    """Check a cell.

    Raises:
        AssertionError: if something does not hold; it says what, and what the cell was given lately.
    """
    cell.inbox.validate()
    if cell.state in ("prepared", "failed"):
        return
    rows, now, stop_at = cell.rows, cell.rows.generation, cell.rows.stop_at.item(0)
    best, known = rows.fitness.min(), rows.messages.fitness.item(OWN, -1)
    births = fitness_of_births(cell)
    interval, lockstep = cell.plan.run.interval, cell.plan.run.mode == "lockstep"
    exchanges, running = now // interval + 1, cell.state == "running"
    for wrong, what in (
        (not best > -np.inf, "a fitness is NaN or -inf"),
        (known > best, "an individual is fitter than the champion"),
        (rows.messages.fitness.item(OWN, 0) != best, "the first emigrant is not the fittest individual"),
        (rows.messages.header.item(OWN, GENERATION) != now, "the message is of another generation"),
        (not 0 <= rows.better_at.item(0) <= now, "the champion became fitter in the future"),
        ((np.diff(births) >= 0.0).any(), "an improvement is none"),
        (running and now >= stop_at, "the cell runs on after its last generation"),
        (lockstep and now > stop_at, "the cell has bred after its last generation"),
        (lockstep and running and cell.sent != exchanges, "a message was left out, or sent twice"),
        (cell.sent > exchanges + (not lockstep), "more messages were sent than there are"),
        (lockstep and cell.inbox.exchange != -(-now // interval), "it expects another exchange"),
    ):
        assert not wrong, f"{what}\n{cell.told()}"


def fitness_of_births(cell):
    """Of each improvement that the cell has noted; from its array, since to make a list of objects takes long."""
    generations = cell.generations
    if generations is None:
        return np.array([birth.fitness for birth in cell.births])
    return generations._birth_fitness[: generations._birth_count.item()]
