"""propulate's islands: two MPI ranks each, its default propagator, pollination around a ring.

measure.py runs this script under `mpiexec` in propulate's own environment, so that propulate is no dependency of the
project. With one rank for each island a rank would send a message to itself and wait forever (MPICH's blocking send
to oneself waits for the receiver). So there are half as many islands, with twice the individuals each, on the same
number of processes. A rank breeds and evaluates one individual at a time and calls that a generation. Here a
generation is as many of those as an island has individuals. The probability of a migration gives one migration in an
interval on average.
"""

import json
import os
import random
import sys
import time
from contextlib import suppress

import numpy as np
from mpi4py import MPI
from propulate import Islands
from propulate.utils import get_default_propagator
from propulate.utils.benchmark_functions import rastrigin

LIMIT = 5.12
RANKS = 2  # MPI ranks of an island
EVALUATIONS, BEST, REACHED = range(3)


class LimitReached(Exception):  # noqa: N818
    """Raised to end a rank's run, because propulate has no limit except the number of generations."""


class Loss:
    """propulate's own Rastrigin function, which counts in memory that all ranks share."""

    def __init__(self, setting: dict, board: np.ndarray, rank: int) -> None:
        self.target, self.board, self.own = setting["target"], board, board[rank]
        self.deadline = np.inf if setting["seconds"] is None else time.monotonic() + setting["seconds"]

    def __call__(self, individual) -> float:  # noqa: ANN001
        """Return the loss of one individual."""
        loss = float(rastrigin(individual))
        self.own[EVALUATIONS] += 1
        self.own[BEST] = min(self.own[BEST], loss)
        if self.target is not None and loss <= self.target:
            self.board[0, REACHED] = 1.0
        if self.board[0, REACHED] or time.monotonic() > self.deadline:
            raise LimitReached
        return loss


def shared_board(world: MPI.Comm) -> np.ndarray:
    """Return shared memory with one line for each rank."""
    size = world.size * 3 * 8
    window = MPI.Win.Allocate_shared(size if world.rank == 0 else 0, 8, comm=world)
    memory, _ = window.Shared_query(0)
    board = np.frombuffer(memory, np.float64).reshape(world.size, 3)
    board[world.rank] = 0.0, np.inf, 0.0
    world.Barrier()
    return board


def islands(setting: dict, loss: Loss, world: MPI.Comm) -> Islands:
    """Return this rank's part of the islands."""
    count, deme = world.size // RANKS, setting["deme"] * RANKS
    generator = random.Random(setting["seed"] * world.size + world.rank)
    limits = {f"x{number}": (-LIMIT, LIMIT) for number in range(setting["dimension"])}
    return Islands(
        loss_fn=loss,
        propagator=get_default_propagator(deme, limits, rng=generator),
        rng=generator,
        generations=-1 if setting["generations"] is None else setting["generations"] * setting["deme"],
        num_islands=count,
        migration_topology=np.roll(np.eye(count, dtype=int), 1, axis=1),
        migration_probability=RANKS / (setting["interval"] * deme),
        pollination=True,
        checkpoint_path="checkpoints",
    )


def main() -> None:
    """Print a JSON line when ready, then one with the outcome."""
    setting = json.loads(sys.argv[1])
    world = MPI.COMM_WORLD
    board = shared_board(world)
    workers = world.gather(os.getpid())
    began = time.monotonic()
    loss = Loss(setting, board, world.rank)
    run = islands(setting, loss, world)
    if world.rank == 0:
        print(json.dumps({"spawn": None, "workers": workers}), flush=True)
    with suppress(LimitReached):
        run.propulate(logging_interval=1 << 30, debug=0)
    seconds = time.monotonic() - began
    world.Barrier()
    if world.rank == 0:
        evaluations = int(board[:, EVALUATIONS].sum())
        generations = evaluations / setting["deme"] / world.size
        ended = {"seconds": seconds, "generations": generations, "evaluations": evaluations}
        print("\n" + json.dumps(ended | {"best": float(board[:, BEST].min())}), flush=True)


if __name__ == "__main__":
    main()
