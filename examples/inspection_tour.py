"""A problem on permutations: in which order a robot visits what it inspects, so that its way is shortest.

Individuals are orders (`supernode.Permutation`). The way begins and ends at the first point. Run this file, or

    supernode solve examples/inspection_tour.toml
    supernode oracle examples/inspection_tour.toml
"""

import math
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import supernode


class InspectionTour(supernode.Problem):
    """The shortest closed way through all points."""

    points: list[tuple[float, float]]  # m

    batches_alike = True

    @cached_property
    def coding(self) -> supernode.Permutation:
        """An order of all points; a mutation reverses a stretch of it."""
        return supernode.Permutation(len(self.points), inversions=1.0)

    @cached_property
    def distances(self) -> np.ndarray:
        """From each point to each, m."""
        points = np.array(self.points)
        return np.linalg.norm(points[:, None] - points, axis=2)

    def recipe(self, name: str, deme: int) -> supernode.Recipe:
        """Edge recombination, since what counts is who follows whom."""
        return supernode.Recipe("edge", 1.0 if deme == 1 else 0.3, "elitist")

    def evaluate(self, genomes: np.ndarray) -> np.ndarray:
        """The length of the way, m: (n, genome_bytes) to (n,)."""
        orders = self.coding.orders(genomes)
        return self.distances[orders, np.roll(orders, -1, axis=1)].sum(axis=1)

    def decode(self, genome: np.ndarray) -> dict[str, Any]:
        """The numbers of the points in their order, from the first point on, and the length of the way."""
        order = self.coding.orders(genome[None])[0]
        tour = np.roll(order, -int(order.argmin()))
        return {"tour": tour.tolist(), "length": float(self.evaluate(genome[None])[0])}

    def check(self, solution: dict[str, Any]) -> supernode.Verdict:
        """Each point is visited once; the length is added up anew, without what `evaluate` uses."""
        tour, length = solution.get("tour"), solution.get("length")
        if not isinstance(tour, list) or sorted(map(str, tour)) != sorted(map(str, range(len(self.points)))):
            raise supernode.BadInput(f"solution: expected a field 'tour' with each of {len(self.points)} points once")
        if not isinstance(length, float):
            raise supernode.BadInput(f"solution: expected a field 'length' with a number of m, found {length!r}")
        stops = [self.points[int(number)] for number in tour]
        found = sum(map(math.dist, stops, [*stops[1:], stops[0]]))
        wrong = () if math.isclose(length, found) else (f"the tour is {found} m long, not {length} m",)
        return supernode.Verdict(found, wrong)

    def oracle(self) -> supernode.Answer:
        """The shortest way of all, by dynamic programming (Held and Karp 1962); it takes n² 2ⁿ steps."""
        count = len(self.points) - 1  # points but the first, which the ways below begin at
        if count > 16:
            raise supernode.BadInput(f"points: an exact answer takes too long for more than 17, found {count + 1}")
        away, home = self.distances[1:, 1:], self.distances[1:, 0]
        # The shortest way through each set of points (a bit for each) that ends at each of them.
        shortest = np.full((1 << count, count), np.inf)
        shortest[1 << np.arange(count), np.arange(count)] = home
        for visited in range(1, 1 << count):
            onward = (shortest[visited][:, None] + away).min(axis=0)
            for last in range(count):
                if not visited >> last & 1:
                    then = visited | 1 << last
                    shortest[then, last] = min(shortest[then, last], onward[last])
        length = float((shortest[-1] + home).min())
        return supernode.Answer("optimum", length, "dynamic programming over sets of points")


def main() -> None:
    """Solve it, and print each improvement as it comes."""
    file = supernode.load(Path(__file__).with_suffix(".toml"))
    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        job = cluster.submit(file, seed=1)
        for best in job.improvements():
            print(f"{best.fitness:.3f} m, found in generation {best.generation}")
        result = job.result()
    print(f"{result.solution['tour']}: the shortest is {file.problem().oracle().fitness:.3f} m")


if __name__ == "__main__":
    main()
