"""pygmo's archipelago: a ring of islands as threads or processes, with a C++ or a Python problem.

measure.py runs this script in pygmo's own environment, so that pygmo is no dependency of the project. Processes are
pygmo's own pool, by default one for each core. Its genetic algorithm and its bee colony have no batch evaluation.
Therefore the Python problem is one call for each individual, and plain `math` is faster than numpy for ten numbers.
"""

import json
import math
import multiprocessing
import sys
import time

import pygmo

LIMIT = 5.12


class Rastrigin:
    """The problem in Python."""

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension

    def fitness(self, x) -> list[float]:  # noqa: ANN001
        """Return the fitness of one individual."""
        values = x.tolist()
        return [10.0 * self.dimension + sum([v * v - 10.0 * math.cos(2.0 * math.pi * v) for v in values])]

    def get_bounds(self) -> tuple[list[float], list[float]]:
        """Return the lower and the upper bounds."""
        return [-LIMIT] * self.dimension, [LIMIT] * self.dimension


def algorithm(name: str, setting: dict, seed: int) -> pygmo.algorithm:
    """Return what one island runs between two migrations: the same number of evaluations for either algorithm."""
    if name == "bees":  # it evaluates twice for each individual and generation
        return pygmo.algorithm(pygmo.bee_colony(gen=setting["interval"] // 2, limit=20, seed=seed))
    rate = 1.0 / setting["dimension"]
    return pygmo.algorithm(pygmo.sga(gen=setting["interval"], m=rate, param_m=20.0, seed=seed))


def archipelago(setting: dict) -> pygmo.archipelago:
    """Return the islands, with evaluated first individuals."""
    problem, where, name = setting["variant"].split()
    islands = pygmo.archipelago(t=pygmo.ring(), seed=setting["seed"])
    for number in range(setting["islands"]):
        seed = setting["seed"] * setting["islands"] + number
        dimension = setting["dimension"]
        udp = pygmo.rastrigin(dimension) if problem == "C++" else Rastrigin(dimension)
        islands.push_back(
            udi=pygmo.mp_island() if where == "processes" else pygmo.thread_island(),
            algo=algorithm(name, setting, seed),
            pop=pygmo.population(udp, setting["deme"], seed=seed),
        )
    return islands


def evolve(islands: pygmo.archipelago, setting: dict) -> int:
    """Run to the limit; return the number of intervals.

    The target is tested after each interval, the clock about twice a second.
    """
    if setting["generations"] is not None:
        intervals = setting["generations"] // setting["interval"]
        islands.evolve(intervals)
        islands.wait_check()
        return intervals
    began, done, chunk = time.monotonic(), 0, 1
    while (left := began + setting["seconds"] - time.monotonic()) > 0.0:
        before = time.monotonic()
        islands.evolve(chunk)
        islands.wait_check()
        done += chunk
        if setting["target"] is not None:
            if best(islands) <= setting["target"]:
                break
        elif time.monotonic() - before < min(0.25, left / 2):
            chunk *= 2
    return done


def best(islands: pygmo.archipelago) -> float:
    """Return the least fitness so far."""
    return min(float(fitness[0]) for fitness in islands.get_champions_f())


def main() -> None:
    """Print a JSON line when ready, then one with the outcome."""
    setting = json.loads(sys.argv[1])
    called = time.monotonic()
    if setting["variant"].split()[1] == "processes":
        pygmo.mp_island.init_pool()
    islands = archipelago(setting)
    workers = [process.pid for process in multiprocessing.active_children()]
    print(json.dumps({"spawn": time.monotonic() - called, "workers": workers}), flush=True)
    began = time.monotonic()
    intervals = evolve(islands, setting)
    seconds = time.monotonic() - began
    evaluations = sum(island.get_population().problem.get_fevals() for island in islands)
    print(
        json.dumps(
            {
                "seconds": seconds,
                "generations": intervals * setting["interval"],
                "evaluations": evaluations,
                "best": best(islands),
            }
        ),
        flush=True,
    )


if __name__ == "__main__":
    main()
