"""A user-defined problem: pack a knapsack as full as possible, on sixteen processes.

A problem is a subclass of `supernode.Problem`. Its fields are those of the problem file. `coding` says how an
individual is coded. `evaluate` returns the fitness of a batch of individuals: lower is better, infinity is infeasible.
Run this file, or

    supernode solve examples/own_problem.toml
"""

from pathlib import Path

import numpy as np

import supernode


class Knapsack(supernode.Problem):
    """Select items so that as little capacity as possible is left over."""

    weights: list[float]
    capacity: float

    @property
    def coding(self) -> supernode.BitString:
        """Return a coding with one bit for each item: 1 takes it."""
        return supernode.BitString(parameters=len(self.weights), bits=1)

    @property
    def solved_at(self) -> float:
        """Return the fitness that counts as solved: 10 g of unused capacity."""
        return 0.01

    def evaluate(self, genomes: np.ndarray) -> np.ndarray:
        """Return the unused capacity of each individual, kg; infinity if the load exceeds it."""
        load = (self.coding.integers(genomes) * self.weights).sum(axis=1)
        return np.where(load <= self.capacity, self.capacity - load, np.inf)


def main() -> None:
    """Solve the problem and print each improvement when it arrives."""
    file = supernode.load(Path(__file__).with_suffix(".toml"))
    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        job = cluster.submit(file, seed=1)
        for best in job.improvements():
            print(f"{best.fitness:.4f} kg left, found in generation {best.generation}")
        result = job.result()
    assert result.solved
    print(f"{result.status} after {result.evaluations} evaluations")


if __name__ == "__main__":
    main()
