"""Generations in one compiled call: the same life as without it, and as in the simulator."""

import random
from dataclasses import replace

import numba
import numpy as np
import pytest
from functions import DEMES, PROBLEMS, plan_of
from lists import Adding, AddingSlowly
from one_max import Bus, OneMax
from tours import Visiting, VisitingSlowly

from genetics import Recipe
from genetics.operators import FITNESS, Operator
from lowlevel import capabilities
from lowlevel.pointers import integers
from node.cell import Cell
from node.events import Publish, Start
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.function import Function
from wire.report import Report

SHAPES = ["torus 1x1", "torus 1x2", "torus 2x3", "torus 4x4"]
ENDS = [
    {"target": -1.0, "generations": 20},
    {"target": -1.0, "generations": 70},  # more than a history keeps before it digests
    {"stall": 60},  # or the problem's own target, whichever comes first
    {"target": -1.0, "stall": 7},
    {"target": -1.0, "seconds": 1e6},  # until somebody outside proposes a stop
]
ASKED_TO_STOP = (11, "cancel")  # at which generation of the root
MOST = (1 << 64) - 1


class Slow(Function):
    """The same functions, not compiled into the generation."""

    @property
    def fitness_kernel(self):
        return None


def choices(name, shape):
    """Settings of every kind, each with an end that differs from problem to problem and from torus to torus."""
    turn = list(PROBLEMS).index(name) + SHAPES.index(shape)
    for recipe in ("paper", "tuned"):
        for spy in ("champion", "root"):
            for interval in (1, 3):
                turn += 1
                rule = {"topology": shape, "recipe": recipe, "spy": spy, "interval": interval} | DEMES[
                    turn % len(DEMES)
                ]
                yield rule | {"seed": MOST - turn if turn % 2 else turn} | ENDS[turn % len(ENDS)]
    if name != "rastrigin of reals":
        for deme in (1, 7):
            yield {"topology": shape, "deme": deme, "recipe": "paper", "mutation": "one-bit", "generations": 30}


def reports_of(plan, order=1, **bus):
    """What cells on a bus report."""
    return Bus(plan, random.Random(order), ASKED_TO_STOP if plan.run.seconds else None, **bus).run()


def simulated(plan):
    generations = iter(range(1 << 30))
    return simulate(
        plan, outside=lambda: ASKED_TO_STOP[1] if plan.run.seconds and next(generations) >= ASKED_TO_STOP[0] else None
    )


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("shape", SHAPES)
def test_it_reports_what_it_would_without(shape, name):
    for settings in choices(name, shape):
        compiled, slow = plan_of(name, **settings), plan_of(name, Slow, **settings)
        assert compiled.problem.fitness_kernel is not None
        assert reports_of(compiled) == reports_of(slow, order=2), settings


def test_generations_whose_number_takes_more_than_a_byte_are_noted_alike():
    plan = plan_of("onemax", topology="torus 1x2", generations=300)
    assert reports_of(plan) == simulated(plan)


@pytest.mark.parametrize("interval", [1, 3])
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("shape", SHAPES)
def test_it_reports_what_the_simulator_does(shape, name, interval):
    for settings in choices(name, shape):
        if settings.get("interval", 1) == interval:
            plan = plan_of(name, **settings)
            assert reports_of(plan) == simulated(plan), settings


def test_every_kind_of_end_occurs_with_every_problem():
    for name in PROBLEMS:
        settings = [each for shape in SHAPES for each in choices(name, shape)]
        assert all(any(end.items() <= each.items() for each in settings) for end in ENDS)
    reasons = set()
    for name in PROBLEMS:
        for settings in choices(name, "torus 4x4"):
            reasons |= {each.reason for report in simulated(plan_of(name, **settings)) for each in report.proposals}
    assert reasons == {"target", "stall", "cancel"}


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("shape", SHAPES)
def test_in_async_mode_too(shape, name):
    for settings in choices(name, shape):
        compiled, slow = (plan_of(name, problem, mode="async", **settings) for problem in (Function, Slow))
        same = {"at_once": (1,)}  # and the same messages in the same order
        assert reports_of(compiled, **same) == reports_of(slow, **same)
        assert simulated(compiled) == simulated(slow)


# Islands of other rules, and genomes of variable length --------------------------------------------------------------
RULES = [
    {},
    {"renewal": 0.5},
    {"renewal": 1.0, "replacement": "elitist"},
    {"renewal": 1.0, "pairing": "better-half"},
    {"renewal": 0.4, "most_selections": 1, "replacement": "elitist"},
    {"most_selections": 2},
    {"pairing": "better-half", "replacement": "elitist"},
]


def ruled(problem, recipe, fields, **run):
    """The plan of a problem whose recipe is another."""
    kind = type(problem.__name__, (problem,), {"__module__": __name__, "recipe": lambda *_: recipe})
    return Plan(kind.model_validate(fields), Run(**run))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    ("compiled", "slow", "fields", "recipe"),
    [
        (Adding, AddingSlowly, {"kind": "adding"}, Recipe("splice", 0.1)),
        (Visiting, VisitingSlowly, {"kind": "visiting"}, Recipe("order", 0.3)),
        (Visiting, VisitingSlowly, {"kind": "visiting"}, Recipe("edge", 0.3)),
        (Function, Slow, {"kind": "function"} | PROBLEMS["onemax"], Recipe("uniform", 0.02)),
        (Function, Slow, {"kind": "function"} | PROBLEMS["trap"], Recipe("one-point", "one-bit")),
    ],
)
def test_whatever_the_rule_of_an_island_it_lives_the_same_with_and_without(compiled, slow, fields, recipe, rule):
    for deme, shape in ((1, "torus 2x3"), (2, "torus 2x2"), (7, "torus 1x2"), (10, "torus 1x1")):
        settings = {"topology": shape, "deme": deme, "target": -1.0, "generations": 25, "seed": deme}
        its_recipe = replace(recipe, **rule)
        fast = ruled(compiled, its_recipe, fields, **settings)
        assert fast.problem.fitness_kernel is not None
        reports = reports_of(fast)
        assert reports == reports_of(ruled(slow, its_recipe, fields, **settings), order=2) == simulated(fast)
        assert {report.evaluations for report in reports} == {deme + 25 * fast.evaluations_per_generation}


# Evaluations ----------------------------------------------------------------------------------------------------------
class Watched(Function):
    """Counts the genomes that it is asked about in Python."""

    @property
    def fitness_kernel(self):
        return super().fitness_kernel

    def evaluate(self, genomes):
        asked.append(len(genomes))
        return super().evaluate(genomes)


asked: list[int] = []
bred_by_address = pytest.mark.skipif(
    not capabilities().numba_calls, reason="kernels must not be called by their addresses here"
)


@bred_by_address
@pytest.mark.parametrize("deme", [1, 5])
@pytest.mark.parametrize("cost", [0.0, 0.001])
def test_only_the_first_deme_is_evaluated_in_python(deme, cost):
    settings = {"topology": "torus 1x1", "deme": deme, "target": -1.0, "generations": 10}
    fields = {"kind": "function", "name": "onemax", "dimension": 30, "cost_us": cost}
    asked.clear()
    Bus(Plan(Watched.model_validate(fields), Run(**settings)), random.Random(1)).run()
    assert asked == [deme]


@bred_by_address
@pytest.mark.parametrize("deme", [1, 4])
def test_no_more_generations_are_bred_at_once_than_up_to_the_next_message(deme):
    plan = plan_of("onemax", topology="torus 1x2", deme=deme, interval=5, target=-1.0, generations=1000)
    cell = Cell(plan, 0, job=1)
    cell.step(events=[Start()])
    (heard,) = Cell(plan, 1, job=1).step(events=[Start()])
    assert cell.step([(1, heard)], most=3) == []
    assert cell.rows.generation == 3
    (message,) = cell.step(most=1000)
    assert isinstance(message, Publish)
    assert cell.rows.generation == 5
    assert cell.missing_count == 1


class Repairing(OneMax):
    """Changes the genomes that it is asked about, and keeps them."""

    def evaluate(self, genomes):
        genomes[:, 0] |= 0x80
        kept.append((genomes, genomes.copy()))
        return super().evaluate(genomes)


kept: list[tuple[np.ndarray, np.ndarray]] = []


@pytest.mark.parametrize("rule", [{"deme": 1}, {"deme": 5}, {"deme": 5, "recipe": "paper", "mutation": "one-bit"}])
def test_what_a_fitness_in_python_does_to_its_genomes_counts_and_what_it_keeps_stays(rule):
    plan = Plan(Repairing(kind="repairing"), Run(topology="torus 2x3", target=-1.0, generations=12, **rule))
    simulation = simulated(plan)
    kept.clear()
    assert reports_of(plan) == simulation
    of_offspring = [each for each in kept if len(each[0]) != rule["deme"]]  # the first deme is the cell's own array
    assert len(of_offspring) >= 12 * 6
    assert all((genomes == as_they_were).all() for genomes, as_they_were in of_offspring)


# What is no fitness ---------------------------------------------------------------------------------------------------
@numba.njit(FITNESS)  # not kept on disk, as kernels are
def broken(genomes, fitness, table):
    """The zeros of genomes of as many bits as the table says; nothing below as many as it says."""
    layout = integers(table, 0)[0]
    for row in range(fitness.size):
        zeros = layout[0]
        for bit in range(layout[0]):
            zeros -= (genomes[row, bit >> 3] >> (7 - (bit & 7))) & 1
        fitness[row] = zeros if zeros >= layout[1] else (-np.inf if layout[2] else np.nan)


class Breaking(OneMax):
    """Whose fitness breaks once there are few zeros."""

    infinite: bool = False

    @property
    def fitness_kernel(self):
        return Operator.of(broken, [self.size, self.size // 3, self.infinite])

    def evaluate(self, genomes):
        return Operator.of(broken, [self.size, self.size // 3, self.infinite]).fitness(genomes)


class BreakingSlowly(Breaking):
    @property
    def fitness_kernel(self):
        return None


def life_of(problem, **run):
    """What a cell alone does until it has ended."""
    cell = Cell(Plan(problem, Run(topology="torus 1x1", target=-1.0, generations=500, **run)), 0, job=1)
    actions = cell.step(events=[Start()])
    while not cell.ended:
        actions += cell.step()
    return cell, actions


@pytest.mark.parametrize("infinite", [False, True])
@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_fitness_that_is_none_ends_the_cell_with_the_same_words(mode, infinite):
    cell, actions = life_of(Breaking(kind="breaking", infinite=infinite), mode=mode)
    slow, slowly = life_of(BreakingSlowly(kind="breaking", infinite=infinite), mode=mode)
    assert cell.state == slow.state == "failed"
    assert actions[:-1] == slowly[:-1]
    report, expected = actions[-1], slowly[-1]
    assert report.generation == expected.generation
    assert isinstance(report, Report)
    value = "-inf" if infinite else "nan"
    assert report.error.startswith(f"breaking: evaluate must not return NaN or -inf, got {value} for genome ")
    assert (report.error, report.digest, report.sent, report.champion, report.deme) == (
        (expected.error, expected.digest, expected.sent, expected.champion, expected.deme)
    )
    assert report.generation > 1
    assert cell.step(events=[Start()]) == []
