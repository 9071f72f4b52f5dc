"""DEAP's islands, as in DEAP's example onemax_island.py: one process each, a ring of blocking pipes.

measure.py runs this script in DEAP's own environment, so that DEAP is no dependency of the project. The fitness is
DEAP's own `benchmarks.rastrigin`: plain Python, one individual at a time, as DEAP is normally used.
"""

import json
import multiprocessing
import random
import sys
import time

from deap import algorithms, base, benchmarks, creator, tools

LIMIT = 5.12

creator.create("Fitness", base.Fitness, weights=(-1.0,))
creator.create("Individual", list, fitness=creator.Fitness)


def toolbox(dimension: int) -> base.Toolbox:
    """Return a toolbox with real-valued operators within bounds."""
    box = base.Toolbox()
    bounds = {"low": -LIMIT, "up": LIMIT, "eta": 20.0}
    box.register("number", random.uniform, -LIMIT, LIMIT)
    box.register("individual", tools.initRepeat, creator.Individual, box.number, dimension)
    box.register("population", tools.initRepeat, list, box.individual)
    box.register("evaluate", benchmarks.rastrigin)
    box.register("mate", tools.cxSimulatedBinaryBounded, **bounds)
    box.register("mutate", tools.mutPolynomialBounded, indpb=1.0 / dimension, **bounds)
    box.register("select", tools.selTournament, tournsize=3)
    return box


def evaluate(box: base.Toolbox, individuals: list) -> int:
    """Evaluate the individuals without a fitness; return how many there were."""
    new = [each for each in individuals if not each.fitness.valid]
    for each, fitness in zip(new, box.map(box.evaluate, new), strict=True):
        each.fitness.values = fitness
    return len(new)


class Board:
    """The memory that all processes share."""

    def __init__(self, islands: int) -> None:
        self.evaluations = multiprocessing.RawArray("q", islands)
        self.generations = multiprocessing.RawArray("q", islands)
        self.best = multiprocessing.RawArray("d", [float("inf")] * islands)
        self.reached = multiprocessing.RawValue("d", 0.0)  # the time at which the target was reached
        self.start = multiprocessing.Barrier(islands + 1)


def island(number: int, setting: dict, board: Board, receiving, sending) -> None:  # noqa: ANN001
    """Run one island, in a process of its own."""
    random.seed(setting["seed"] * setting["islands"] + number)
    box, deme = toolbox(setting["dimension"]), setting["deme"]
    population = box.population(n=deme)
    board.evaluations[number] = evaluate(box, population)
    board.start.wait()
    while setting["generations"] is None or board.generations[number] < setting["generations"]:
        offspring = algorithms.varOr(population, box, lambda_=deme, cxpb=0.5, mutpb=0.5)
        board.evaluations[number] += evaluate(box, offspring)
        population = box.select(population + offspring, deme)
        board.generations[number] += 1
        board.best[number] = min(board.best[number], *(each.fitness.values[0] for each in population))
        if setting["target"] is not None and board.best[number] <= setting["target"] and not board.reached.value:
            board.reached.value = time.monotonic()
        if board.generations[number] % setting["interval"] == 0:
            sending.send(tools.selBest(population, 1))
            population[population.index(tools.selWorst(population, 1)[0])] = receiving.recv()[0]


def wait(processes: list, setting: dict, board: Board, began: float) -> float:
    """Wait until the limit or the target, end the processes, and return the time at which it was reached."""
    if setting["generations"] is not None:
        for process in processes:
            process.join()
        return time.monotonic()
    while time.monotonic() < began + setting["seconds"] and not board.reached.value:
        time.sleep(0.005)
    ended = board.reached.value or time.monotonic()
    for process in processes:
        process.terminate()
    return ended


def main() -> None:
    """Print a JSON line when ready, then one with the outcome."""
    setting = json.loads(sys.argv[1])
    called = time.monotonic()
    islands = setting["islands"]
    board = Board(islands)
    pipes = [multiprocessing.Pipe(False) for _ in range(islands)]
    processes = [
        multiprocessing.Process(
            target=island,
            args=(number, setting, board, pipes[number][0], pipes[(number + 1) % islands][1]),
            daemon=True,
        )
        for number in range(islands)
    ]
    for process in processes:
        process.start()
    board.start.wait()
    began = time.monotonic()
    print(json.dumps({"spawn": began - called, "workers": [process.pid for process in processes]}), flush=True)
    seconds = wait(processes, setting, board, began) - began
    print(
        json.dumps(
            {
                "seconds": seconds,
                "generations": sum(board.generations) / islands,
                "evaluations": sum(board.evaluations),
                "best": min(board.best),
            }
        ),
        flush=True,
    )


if __name__ == "__main__":
    main()
