"""Clearance: planners hold it, checks measure it with code of their own and refuse what comes nearer."""

import itertools
import math

import fcl
import numpy as np
import pytest
import shapely

from node.plan import Plan
from node.simulation import simulate
from problems import Run
from problems.arm_ik import ArmIk
from problems.arm_path import ArmPath
from problems.coordination import Coordination, arms
from problems.nearest import least_along

CLEARANCE = 0.05
ARM = {"links": [1.0, 0.8, 0.5], "radius": 0.03}
OBSTACLES = [
    {"shape": "circle", "center": [1.1, 0.5], "radius": 0.2},
    {"shape": "box", "center": [-0.4, 1.2], "size": [0.5, 0.3], "angle": 0.3},
]
PATH = {"kind": "arm-path", "start": [0.0, 0.0], "goal": [2.4, -0.5], "arm": {"links": [1.0, 0.8], "radius": 0.03}}


def arm_ik(**fields):
    return ArmIk.model_validate({"kind": "arm-ik", "target": [0.9, 0.9], "arm": ARM, "obstacles": OBSTACLES} | fields)


def arm_path(**fields):
    return ArmPath.model_validate(PATH | {"obstacles": OBSTACLES} | fields)


def solids():
    box = shapely.affinity.rotate(shapely.box(-0.65, 1.05, -0.15, 1.35), 0.3, use_radians=True)
    return [shapely.Point(1.1, 0.5).buffer(0.2, quad_segs=4096), box]


def links_at(lengths, angles):
    steps = np.array(lengths)[:, None] * np.column_stack([np.cos(np.cumsum(angles)), np.sin(np.cumsum(angles))])
    joints = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    return [shapely.LineString(joints[link : link + 2]) for link in range(len(lengths))]


def measured(lengths, angles):
    """The least gap, m, by shapely on the shapes themselves."""
    links = links_at(lengths, angles)
    gaps = [link.distance(solid) - 0.03 for link in links for solid in solids()]
    return min(
        [*gaps, *(links[i].distance(links[j]) - 0.06 for i in range(len(links)) for j in range(i + 2, len(links)))]
    )


def champion(problem, seed):
    plan = Plan(problem.for_recipe("tuned", 1), Run(seed=seed, topology="torus 4x4"))
    best = simulate(plan)[0].champion
    return best.fitness, plan.problem.decode(np.frombuffer(best.genome, np.uint8))


@pytest.mark.parametrize("seed", range(1, 9))
def test_an_arm_that_is_found_keeps_its_clearance(seed):
    problem = arm_ik(clearance=CLEARANCE)
    fitness, solution = champion(problem, seed)
    assert fitness <= problem.solved_at
    gap = measured(ARM["links"], solution["configuration"])
    verdict = problem.check(solution)
    assert gap >= CLEARANCE - 1e-6
    assert verdict.feasible
    assert verdict.clearance.least == pytest.approx(gap, abs=1e-6)
    assert verdict.clearance.where["configuration"] == solution["configuration"]


def test_check_refuses_an_arm_that_comes_nearer_than_the_clearance():
    refused = 0
    for seed in range(1, 9):
        _, solution = champion(arm_ik(target=[0.75, 0.75]), seed)
        gap = measured(ARM["links"], solution["configuration"])
        verdict = arm_ik(target=[0.75, 0.75], clearance=max(gap, 0.0) + 1e-3).check(solution)
        assert any("nearer than the clearance" in each for each in verdict.objections)
        refused += not verdict.feasible
    assert refused == 8


@pytest.mark.parametrize("seed", range(1, 5))
def test_a_path_of_an_arm_keeps_its_clearance(seed):
    problem = arm_path(clearance=CLEARANCE)
    fitness, solution = champion(problem, seed)
    assert fitness == 0.0
    verdict = problem.check(solution)
    assert verdict.feasible
    rows = [
        row + share * (following - row)
        for row, following in zip(np.array(solution["path"]), np.array(solution["path"])[1:], strict=False)
        for share in np.linspace(0.0, 1.0, 60)
    ]
    gaps = [measured(PATH["arm"]["links"], row) for row in rows]
    assert min(gaps) >= CLEARANCE - 1e-6
    assert verdict.clearance.least <= min(gaps) + 1e-3 * 1.8 + 1e-9


def test_check_refuses_a_path_that_comes_nearer_than_the_clearance_on_its_way():
    """The stretched arm swings past a circle, 0.07 m away from it half-way."""
    circle = {"shape": "circle", "center": [2.0 * math.cos(0.75), 2.0 * math.sin(0.75)], "radius": 0.1}
    world = {"goal": [1.5, 0.0], "obstacles": [circle]}
    solution = {"path": [[0.0, 0.0], [1.5, 0.0]], "cspace_evaluated": 0.0, "slices": [[], []]}
    for clearance, refused in ((0.0, False), (0.0699, False), (0.0701, True)):
        verdict = arm_path(clearance=clearance, **world).check(solution)
        assert any("move 1 comes nearer than the clearance" in each for each in verdict.objections) == refused
        assert verdict.feasible != refused
        assert 0.07 - 1e-9 <= verdict.clearance.least <= 0.07 + 1.8e-3
        assert verdict.clearance.where["configuration"] == pytest.approx([0.75, 0.0], abs=0.1)
        assert (verdict.clearance.where["link"], verdict.clearance.where["obstacle"]) == (2, 0)


def test_ends_that_are_too_near_are_refused():
    near = {"start": [0.0, 0.0], "obstacles": [{"shape": "circle", "center": [1.0, 0.3], "radius": 0.2}]}
    arm_path(**near)
    with pytest.raises(ValueError, match=r"start: .* the arm comes nearer than the clearance 0\.1 m to obstacles\[0\]"):
        arm_path(**near, clearance=0.1)
    with pytest.raises(ValueError, match=r"arm.base: .* the clearance 0\.5, found .* in obstacles\[1\]"):
        arm_ik(obstacles=[OBSTACLES[0], OBSTACLES[0] | {"center": [0.6, 0.0]}], clearance=0.5)
    with pytest.raises(ValueError, match=r"clearance"):
        arm_ik(clearance=-0.1)


@pytest.mark.parametrize(("links", "bits"), [([1.0, 0.8], 6), ([1.0, 0.8, 0.5], 4)])
@pytest.mark.parametrize("clearance", [0.0, 0.1])
def test_the_oracle_of_arm_ik_finds_the_best_code_that_keeps_the_clearance(links, bits, clearance):
    problem = arm_ik(arm=ARM | {"links": links}, bits=bits, target=[0.75, 0.75], clearance=clearance)
    answer = problem.oracle()
    codes = itertools.product(range(1 << bits), repeat=len(links))
    by_distance = []
    for code in codes:
        angles = 2 * np.pi * np.array(code) / (1 << bits)
        tip = links_at(links, angles)[-1].coords[-1]
        by_distance.append((math.dist(tip, (0.75, 0.75)), angles))
    by_distance.sort(key=lambda each: each[0])
    best = next(distance for distance, angles in by_distance if measured(links, angles) >= clearance)
    assert (answer.meaning, answer.fitness) == ("optimum", pytest.approx(best))
    verdict = problem.check(answer.solution)
    assert verdict.feasible
    assert measured(links, answer.solution["configuration"]) >= clearance - 1e-6


@pytest.mark.parametrize("target", [[0.75, 0.75], [1.1, 0.8], [-0.4, 0.9]])
def test_the_oracle_of_arm_ik_keeps_the_clearance_where_codes_are_too_many_to_try(target):
    problem = arm_ik(target=target, bits=12, clearance=CLEARANCE)
    answer = problem.oracle()
    assert answer.meaning in ("optimum", "upper bound")
    assert measured(ARM["links"], answer.solution["configuration"]) >= CLEARANCE - 1e-6
    assert problem.check(answer.solution).feasible
    assert answer.fitness >= arm_ik(target=target, bits=12).oracle().fitness - 1e-6


def test_the_oracle_of_arm_path_proves_no_way_that_comes_nearer_than_the_clearance():
    """Two links have no links to keep from each other: a clearance is as if they were thicker by it."""
    draws, ways, none = np.random.default_rng(6), 0, 0
    for _ in range(12):
        circles = [
            {"shape": "circle", "center": [away * math.cos(angle), away * math.sin(angle)], "radius": 0.15}
            for angle, away in zip(draws.uniform(0.6, 5.6, 4), draws.uniform(1.0, 1.6, 4), strict=True)
        ]
        for clearance in (0.05, 0.25):
            world = {"obstacles": circles, "bits": 7, "goal": [3.0, 0.3], "start": [0.0, 0.3]}
            thicker = PATH["arm"] | {"radius": PATH["arm"]["radius"] + clearance}
            try:
                problem = arm_path(**world, clearance=clearance)
            except ValueError:
                continue
            answer = problem.oracle()
            same = arm_path(**world, arm=thicker).oracle()
            assert (answer.meaning, answer.fitness, answer.figures) == (same.meaning, same.fitness, same.figures)
            none += answer.fitness == math.inf
            if answer.solution is None:
                continue
            ways += 1
            rows = np.array(answer.solution["path"])
            shares = np.linspace(0.0, 1.0, 20)[:, None]
            for row, following in itertools.pairwise(rows):
                for angles in row + shares * (following - row):
                    links = links_at(PATH["arm"]["links"], angles)
                    gaps = [link.distance(shapely.Point(c["center"])) - 0.15 - 0.03 for link in links for c in circles]
                    assert min(gaps) >= clearance - 1e-6
    assert min(ways, none) >= 3


def test_nothing_near_is_no_clearance():
    alone = arm_ik(obstacles=[], self_collision=False)
    _, solution = champion(alone, 1)
    assert (alone.check(solution).clearance.least, alone.check(solution).clearance.where) == (math.inf, {})


def test_the_least_along_motions_is_within_its_accuracy():
    draws = np.random.default_rng(3)
    for _ in range(50):
        centres = draws.uniform(-1, 2, (6, 2))

        def gap(motion, share, centres=centres):
            return float(np.hypot(*(centres[motion] - [share, 0.2])) - 0.1)

        least, _, _ = least_along(gap, [1.0] * 6, 1e-4)
        exact = min(np.hypot(centre[0] - np.clip(centre[0], 0, 1), centre[1] - 0.2) - 0.1 for centre in centres)
        assert exact - 1e-9 <= least <= exact + 1e-4


def test_two_arms_keep_their_clearance():
    path = [[-0.9, 0.5, -0.9, 0.4, 0.0], [1.5, 0.5, -0.9, 0.4, 0.0]]
    robots = [{"path": path, "cells": 40}, {"path": path, "cells": 40, "base": [0.9, 0.0, 0.0, math.pi]}]
    near, far = (
        Coordination.model_validate({"kind": "coordination", "robots": robots, "clearance": clearance})
        for clearance in (0.0, 0.05)
    )
    assert (near.blocked <= far.blocked).all()
    assert near.blocked.sum() < far.blocked.sum()
    straight = {"time": float(np.max([times[-1] for times in near.move_times])), "points": []}
    assert any("collide" in each or "overlap" in each for each in near.check(straight).objections)
    for problem in (near, far):
        assert problem.check(problem.oracle().solution).feasible
    free = {"time": straight["time"], "points": []}
    apart = Coordination.model_validate(
        {"kind": "coordination", "robots": [robots[0], robots[1] | {"base": [1.3, 0.0, 0.0, math.pi]}]}
    )
    assert apart.check(free).feasible
    wide = apart.model_copy(update={"clearance": 0.5})
    assert any("the clearance is 0.5" in each for each in wide.check(free).objections)
    with pytest.raises(ValueError, match="clearance: expected robots that keep it"):
        Coordination.model_validate({"kind": "coordination", "random": {"seed": 1}, "clearance": 0.1})


def capsules(robot, where):
    """The links at a place along a path, in cells, as collision objects."""
    ends = arms.origins(robot, arms.places(robot, np.array([where])))[0]
    links = []
    for link in np.flatnonzero(robot.lengths > 0):
        z = (ends[link + 1] - ends[link]) / robot.lengths[link]
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
        x /= np.linalg.norm(x)
        turn = np.column_stack([x, np.cross(z, x), z])
        shape = fcl.Capsule(robot.radius, robot.lengths[link])
        links.append(
            (int(link) + 1, fcl.CollisionObject(shape, fcl.Transform(turn, ends[link : link + 2].mean(axis=0))))
        )
    return links


def gap_at(problem, places):
    """The least distance of two arms, m, by python-fcl, and of which links."""
    ones, others = (capsules(robot, where) for robot, where in zip(problem.robots, places, strict=True))
    return min(
        (fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult()), [i, j])
        for i, one in ones
        for j, other in others
    )


def test_check_measures_the_clearance_of_two_arms_as_python_fcl_does():
    path = [[-0.9, 0.5, -0.9, 0.4, 0.0], [1.5, 0.5, -0.9, 0.4, 0.0]]
    robots = [{"path": path, "cells": 16}, {"path": path, "cells": 16, "base": [0.9, 0.0, 0.0, math.pi]}]
    problem = Coordination.model_validate({"kind": "coordination", "robots": robots, "clearance": 0.02})
    solution = problem.oracle().solution
    verdict = problem.check(solution)
    assert verdict.objections == ()
    clearance = verdict.clearance
    gap, links = gap_at(problem, clearance.where["cells"])
    assert gap == pytest.approx(clearance.least, abs=1e-6)
    assert links == clearance.where["links"]
    corners = [[0, 0], *solution["points"], [15, 15]]
    (i, j), (k, to) = corners[clearance.where["rectangle"] - 1 : clearance.where["rectangle"] + 1]
    assert i <= clearance.where["cells"][0] <= k
    assert j <= clearance.where["cells"][1] <= to
    draws = np.random.default_rng(2)
    for begin, end in itertools.pairwise(corners):
        for places in draws.uniform(begin, end, (60, 2)):
            found = gap_at(problem, places)[0]
            assert found >= 0.02 - 1e-6
            assert found >= clearance.least - 1e-3 * problem.robots[0].lengths.sum() - 1e-6


def test_arms_that_overlap_have_less_than_no_clearance_and_a_diagram_has_none():
    path = [[-0.9, 0.5, -0.9, 0.4, 0.0], [1.5, 0.5, -0.9, 0.4, 0.0]]
    robots = [{"path": path, "cells": 16}, {"path": path, "cells": 16, "base": [0.6, 0.0, 0.0, math.pi]}]
    problem = Coordination.model_validate({"kind": "coordination", "robots": robots})
    assert problem.check({"time": 1.0, "points": []}).clearance.least < 0.0
    bare = Coordination.model_validate({"kind": "coordination", "random": {"seed": 1}})
    assert bare.check({"time": 1.0, "points": []}).clearance is None
