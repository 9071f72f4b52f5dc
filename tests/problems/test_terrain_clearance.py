"""The clearance of terrain: all along the way, not only at centres of cells, as shapely measures it."""

import json
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from benchmarks.terrain_worlds import terrain_world
from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.terrain import Terrain
from problems.terrain.replanning import led_on
from spy.past import best_known


def terrain(**fields):
    base = {"kind": "terrain", "start": (0, 0), "goal": (3, 3), "map": ["...."] * 4}
    return Terrain.model_validate(base | fields)


def obstacles_of(problem):
    """Squares around the centres of impassable cells, row and column as coordinates."""
    cells = [(row, column) for row, line in enumerate(problem.map) for column, each in enumerate(line)]
    solid = [cell for cell in cells if problem.map[cell[0]][cell[1]] not in problem.legend]
    return shapely.union_all([shapely.box(row - 0.5, column - 0.5, row + 0.5, column + 0.5) for row, column in solid])


def world(number, side, **fields):
    """A random world whose ends are free with the clearance, if there is one."""
    made = terrain_world(number, side)
    try:
        return Terrain.model_validate(made.model_dump(exclude_unset=True) | fields)
    except ValidationError:
        return None


def solved(problem, topology="torus 4x4"):
    plan = Plan(problem.for_recipe("tuned", 1), Run(topology=topology, stall=30))
    best = best_known(simulate(plan), "champion")
    return plan.problem.decode(np.frombuffer(best.genome, np.uint8)), best.fitness


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 60),
    st.sampled_from([8, 16, 23]),
    st.sampled_from([0.0, 0.2, 0.5, 0.8, 1.3]),
    st.sampled_from([0.1, 0.5, 0.7, 1.0, 1.2]),
    st.booleans(),
    st.integers(0, 2**32),
)
def test_fitness_check_and_shapely_agree_on_the_clearance_of_any_path(number, side, radius, clearance, cuts, seed):
    fields = {"robot_radius": radius, "clearance": clearance, "corner_cutting": cuts, "founders": "lines"}
    problem = world(number, side, **fields)
    if problem is None:
        return
    solids = obstacles_of(problem)
    for genome in problem.coding.random(Keys(np.arange(2), np.uint64(seed), 0), 4).reshape(8, -1):
        solution = json.loads(json.dumps(problem.decode(genome)))
        verdict = problem.check(solution)
        fitness = problem.evaluate(genome[None])[0]
        assert verdict.fitness == pytest.approx(fitness, rel=1e-9)
        gap = shapely.LineString(solution["path"] * (2 if len(solution["path"]) == 1 else 1)).distance(solids)
        assert verdict.clearance.least == pytest.approx(gap - radius, abs=1e-9)
        if verdict.feasible:
            assert gap >= radius + clearance - 1e-9
            assert verdict.clearance.least >= clearance - 1e-9


def test_a_path_is_refused_for_its_clearance_alone():
    """Steps right, down or both, on clear ground: nothing but its gap speaks against such a path."""
    draws, refused, accepted = np.random.default_rng(4), 0, 0
    for _ in range(400):
        blocked = draws.random((9, 9)) < 0.12
        blocked[0, 0] = blocked[8, 8] = False
        rows = ["".join(".#"[int(cell)] for cell in row) for row in blocked]
        path, at = [(0, 0)], (0, 0)
        while at != (8, 8):
            d_row, d_column = [(1, 1), (0, 1), (1, 0)][draws.integers(3)]
            at = (min(8, at[0] + d_row), min(8, at[1] + d_column))
            if at != path[-1]:
                path.append(at)
        bare = terrain(map=rows, goal=(8, 8))
        line, solids = shapely.LineString(path), obstacles_of(bare)
        moves = []
        for here, there in pairwise(path):
            heading = {(0, 1): 0.0, (1, 1): 7 * np.pi / 4, (1, 0): 3 * np.pi / 2}[
                there[0] - here[0], there[1] - here[1]
            ]
            moves.append([heading, 1])
        cost = sum(float(np.hypot(b[0] - a[0], b[1] - a[1])) for a, b in pairwise(path))
        solution = {"path": path, "cost": cost, "moves": moves}
        for clearance in (0.3, 0.6, 1.1):
            try:
                problem = terrain(map=rows, goal=(8, 8), clearance=clearance)
            except ValidationError:
                continue
            feasible = problem.check(solution).feasible
            assert feasible == (line.distance(solids) >= clearance - 1e-9)
            accepted, refused = accepted + feasible, refused + (not feasible)
    assert min(accepted, refused) > 10


@pytest.mark.parametrize(("radius", "clearance"), [(0.0, 0.3), (0.3, 0.2), (0.4, 0.7), (1.0, 0.4)])
def test_solutions_and_the_oracle_keep_the_clearance(radius, clearance):
    for seed in range(3):
        blocked = np.random.default_rng(seed).random((24, 24)) < 0.03
        blocked[:4, :4] = blocked[-4:, -4:] = False
        rows = ["".join(".#"[int(cell)] for cell in row) for row in blocked]
        problem = terrain(map=rows, goal=(23, 23), robot_radius=radius, clearance=clearance)
        answer = problem.oracle()
        assert np.isfinite(answer.fitness)
        solution, fitness = solved(problem)
        solids = obstacles_of(problem)
        for each, worth in ((answer.solution, answer.fitness), (solution, fitness)):
            verdict = problem.check(each)
            assert verdict.objections == ()
            assert verdict.fitness == pytest.approx(worth)
            gap = shapely.LineString(each["path"]).distance(solids) - radius
            assert verdict.clearance.least == pytest.approx(gap, abs=1e-9)
            assert gap >= clearance - 1e-9
        assert answer.fitness <= fitness * (1 + 1e-9)


def test_a_clearance_bars_the_corner_that_may_be_cut_without():
    fields = {"map": [".#", ".."], "start": (0, 0), "goal": (1, 1)}
    diagonal = {"path": [[0, 0], [1, 1]], "cost": float(np.sqrt(2)), "moves": [[7 * np.pi / 4, 1]]}
    free = terrain(**fields).check(diagonal)
    assert (free.feasible, free.clearance.least) == (True, 0.0)
    assert free.clearance.where == {"step": 1, "place": [0.5, 0.5]}
    assert free.clearance.unit == "cells"
    barred = terrain(**fields, clearance=0.1).check(diagonal)
    assert barred.objections[0] == (
        "step 1 of the path, to [1, 1], comes nearer to an obstacle half-way than the clearance 0.1"
    )
    assert terrain(**fields, clearance=0.1).oracle().fitness == 2.0
    # A radius alone is held at the centres of cells, as in the paper; the result says what is left between them.
    assert terrain(**fields, robot_radius=0.3).check(diagonal).clearance.least == pytest.approx(-0.3)


def test_half_way_along_a_diagonal_a_far_obstacle_may_be_nearest():
    rows = ["....#", ".....", ".....", "....."]
    diagonal = {"path": [[2, 1], [3, 2]], "cost": float(np.sqrt(2)), "moves": [[7 * np.pi / 4, 1]]}
    fields = {"map": rows, "start": (2, 1), "goal": (3, 2)}
    gaps = [float(np.hypot(1.5, 2.5)), float(np.hypot(2.0, 2.0)), float(np.hypot(2.5, 1.5))]
    clearance = terrain(**fields).check(diagonal).clearance
    assert clearance.least == pytest.approx(min(gaps)) == pytest.approx(gaps[1])
    assert clearance.where == {"step": 1, "place": [2.5, 1.5]}
    between = (gaps[0] + gaps[1]) / 2
    assert not terrain(**fields, clearance=between).check(diagonal).feasible
    assert terrain(**fields, clearance=gaps[1]).check(diagonal).feasible, "contact at exactly the limit is free"


def test_without_obstacles_there_is_no_clearance_and_ends_are_held_to_it():
    straight = {"path": [[0, 0], [1, 1]], "cost": float(np.sqrt(2)), "moves": [[7 * np.pi / 4, 1]]}
    clearance = terrain(goal=(1, 1), clearance=3.0).check(straight).clearance
    assert (clearance.least, clearance.where) == (np.inf, {})
    with pytest.raises(ValidationError, match=r"start: .* '\.' or too near to an impassable one"):
        terrain(map=[".#..", "....", "....", "...."], clearance=0.6)


def test_a_population_is_led_on_into_a_world_with_a_clearance():
    old = terrain_world(3, 16).for_recipe("tuned", 1)
    new = world(3, 16, clearance=0.3)
    genomes = old.coding.random(Keys(np.arange(2), np.uint64(1), 0), 4)
    led = led_on(old, new.for_recipe("tuned", 1), genomes)
    for genome in led.reshape(-1, led.shape[-1]):
        verdict = new.check(new.decode(genome))
        assert verdict.fitness == pytest.approx(new.evaluate(genome[None])[0])
