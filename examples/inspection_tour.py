"""A problem on permutations: the order in which a robot visits inspection points on the shortest closed tour.

Individuals are permutations (`supernode.Permutation`). The tour begins and ends at the first point. Run this file, or

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
    """Find the shortest closed tour through all points."""

    points: list[tuple[float, float]]  # m

    is_batch_invariant = True

    @cached_property
    def coding(self) -> supernode.Permutation:
        """Return a permutation of all points; a mutation reverses a stretch of it."""
        return supernode.Permutation(len(self.points), inversions=1.0)

    @cached_property
    def distances(self) -> np.ndarray:
        """Return the distance from each point to each, (points, points), m."""
        points = np.array(self.points)
        return np.linalg.norm(points[:, None] - points, axis=2)

    def recipe(self, name: str, deme: int) -> supernode.Recipe:
        """Use edge recombination, because the length depends on which points are adjacent."""
        return supernode.Recipe("edge", 1.0 if deme == 1 else 0.3, "elitist")

    def evaluate(self, genomes: np.ndarray) -> np.ndarray:
        """Return the length of each tour, m: (n, genome_bytes) to (n,)."""
        orders = self.coding.orders(genomes)
        return self.distances[orders, np.roll(orders, -1, axis=1)].sum(axis=1)

    def decode(self, genome: np.ndarray) -> dict[str, Any]:
        """Return the numbers of the points in tour order, from the first point on, and the length of the tour."""
        order = self.coding.orders(genome[None])[0]
        tour = np.roll(order, -int(order.argmin()))
        return {"tour": tour.tolist(), "length": float(self.evaluate(genome[None])[0])}

    def check(self, solution: dict[str, Any]) -> supernode.Verdict:
        """Check that the tour visits each point once and that its length is right.

        The length is computed anew from `points`, not from the distances that `evaluate` uses.
        """
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
        """Return the length of the shortest tour, by dynamic programming (Held and Karp 1962) in n² 2ⁿ steps."""
        count = len(self.points) - 1  # all points except the first, where the ways below begin
        if count > 16:
            raise supernode.BadInput(f"points: an exact answer takes too long for more than 17, found {count + 1}")
        away, home = self.distances[1:, 1:], self.distances[1:, 0]
        # shortest[visited, last]: the length of the shortest way from the first point through the set `visited` (one
        # bit for each point) that ends at point `last`. Supersets have greater numbers, so one pass upwards is enough.
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
    """Solve the problem and print each improvement when it arrives."""
    file = supernode.load(Path(__file__).with_suffix(".toml"))
    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        job = cluster.submit(file, seed=1)
        for best in job.improvements():
            print(f"{best.fitness:.3f} m, found in generation {best.generation}")
        result = job.result()
    print(f"{result.solution['tour']}: the shortest is {file.problem().oracle().fitness:.3f} m")


if __name__ == "__main__":
    main()
