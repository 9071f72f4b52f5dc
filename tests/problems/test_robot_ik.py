"""robot-ik: configurations of a robot that bring a link to a pose, verified on the exact meshes."""

import dataclasses
import functools
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_robots import LIMITS, crane

import supernode
from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems.errors import BadInput
from problems.robot_ik import RobotIk
from problems.robot_ik.checker import proof_of
from problems.robot_ik.solving import Solver
from problems.robots.verifying import missed_by
from problems.run import Run
from spy.past import best_known

pytest.importorskip("coal", reason="an extra")

EXAMPLE = Path(__file__).resolve().parent.parent.parent / "examples" / "panda-ik.toml"
PANDA = {"urdf": "example-robot-data:panda", "group": "arm", "fixed": {"panda_finger_joint1": 0.03}}
POSE = {"link": "panda_hand", "position": [0.5, 0.1, 0.4], "quaternion": [1.0, 0.0, 0.0, 0.0]}
AWAY = [0.3, -0.5, 0.2, -2.0, 0.4, 1.8, 0.5]  # a configuration that is free


@functools.cache
def example():
    return supernode.load(EXAMPLE)


@functools.cache
def gathered(fields):
    return RobotIk.derive_fields(RobotIk.gather(json.loads(fields), Path()))


def problem(**fields):
    """A Panda, with other fields as given."""
    fields = {"kind": "robot-ik", "robot": PANDA, "goal_pose": POSE} | fields
    return RobotIk.model_validate_json(json.dumps(gathered(json.dumps(fields))), strict=True)


def cranes(**fields):
    base = {"kind": "robot-ik", "robot": crane(), "goal_pose": {"link": "tip", "position": [0.5, 0.1, 0.5]}}
    return RobotIk.model_validate(gathered(json.dumps(base | fields)))


def found_by(problem, seed=1, **run):
    run = Run.model_validate({"topology": "torus 3x3", "seed": seed, "stall": 30} | run)
    champion = best_known(simulate(Plan(problem, run)), 0)
    return champion.fitness, problem.decode(np.frombuffer(champion.genome, np.uint8))


def some_genomes(problem, count=200, seed=3):
    return problem.coding.random(Keys(np.arange(1), np.uint64(seed), 0), count)[0]


# Solving --------------------------------------------------------------------------------------------------------------
def test_poses_that_are_reached_are_found():
    free = problem(self_collision=False)
    proof, solver = proof_of(free), Solver(free)
    low, high = proof.limits.T
    for number, q in enumerate(np.random.default_rng(5).uniform(low, high, (60, 7))):
        pose = proof.pose(q, "panda_hand")
        found = solver.solve(pose, seed=number)
        assert found.error <= 1.0
        reached = proof.pose(found.configuration, "panda_hand")
        assert np.linalg.norm(reached[:3, 3] - pose[:3, 3]) <= 1e-4
        assert np.linalg.norm(reached[:3, :3] - pose[:3, :3]) <= np.sqrt(2) * 1e-3
        assert list(proof.beyond_limits(found.configuration)) == []
        assert solver.solve(pose, seed=number).configuration.tobytes() == found.configuration.tobytes()


def test_a_solver_leaves_the_problem_as_it_is():
    own = problem()
    before = own.evaluate(some_genomes(own))
    Solver(own).solve(np.eye(4), most=3)
    assert own.evaluate(some_genomes(own)).tobytes() == before.tobytes()


@pytest.mark.parametrize("pose", [np.eye(3), np.zeros(7), np.full((4, 4), np.nan)])
def test_a_solver_refuses_what_is_no_pose(pose):
    with pytest.raises(BadInput, match="pose: expected a 4x4 or 3x4 matrix of finite numbers, found one of shape"):
        Solver(problem()).solve(pose)


@settings(deadline=None, max_examples=30)
@given(st.tuples(*(st.floats(0, 1) for _ in range(4))))
def test_a_genome_codes_a_configuration_within_limits_and_its_figures_are_true(genes):
    own = cranes()
    genome = np.array(genes).view(np.uint8)
    solution = own.decode(genome)
    q = np.array(solution["configuration"])
    assert np.all((LIMITS[:, 0] <= q) & (q <= LIMITS[:, 1]))
    away, turned = missed_by(own.goal_pose, proof_of(own), q)
    assert (solution["position_error"], solution["angle_error"]) == (pytest.approx(away, abs=1e-9), turned)
    verdict = own.check(solution)
    assert verdict.fitness == pytest.approx(own.evaluate(genome[None])[0], rel=1e-6, abs=1e-6)
    assert verdict.clearance.least >= solution["clearance"] - 1e-5
    assert verdict.feasible or solution["clearance"] == 0.0


def test_any_rotation_will_do_where_none_is_given():
    fitness, solution = found_by(problem(goal_pose={"link": "panda_hand", "position": [0.3, 0.3, 0.6]}))
    assert fitness <= 1.0
    assert solution["angle_error"] == 0.0
    assert problem(goal_pose={"link": "panda_hand", "position": [0.3, 0.3, 0.6]}).check(solution).feasible


def test_several_solutions_differ():
    own = example().problem()
    for seed in (1, 2, 3):
        fitness, solution = found_by(own, seed)
        assert fitness <= 1.0
        several = np.array([solution["configuration"], *solution["others"]])
        assert len(several) == 4
        apart = np.abs(several[:, None] - several).max(axis=2) + 10 * np.eye(4)
        assert apart.min() >= 0.1
        verdict = own.check(solution)
        assert (verdict.feasible, verdict.fitness) == (True, pytest.approx(fitness, abs=1e-6))
        assert verdict.clearance.least > 0.005


def test_solutions_that_do_not_exist_are_counted_as_missing():
    """The crane has six or so configurations for a place, as its joints have it, and no rotation to turn around."""
    own = cranes(solutions=24, apart=1.5)
    fitness, solution = found_by(own, generations=5)
    assert 100.0 < fitness < 2400.0
    verdict = own.check(solution)
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(fitness, abs=1e-6)


def test_a_pose_among_obstacles_that_touches_everywhere_ends_with_a_contact():
    ball = {"id": "ball", "shape": "sphere", "radius": 0.02, "position": [0.5, 0.1, 0.36]}  # where the hand is to be
    own = problem(obstacles=[ball])
    fitness, solution = found_by(own, generations=3)
    assert fitness == pytest.approx(10.0, abs=1e-2)
    verdict = own.check(solution)
    assert verdict.fitness == pytest.approx(fitness, abs=1e-6)
    assert any("panda_hand" in text and "ball" in text for text in verdict.objections)
    assert "nothing shows that the clearance of 0 m is kept" in verdict.objections


def test_an_update_moves_the_obstacles():
    ball = {"id": "ball", "shape": "sphere", "radius": 0.02, "position": [0.5, 0.1, 0.36]}
    file = dataclasses.replace(
        example(), fields=gathered(json.dumps({"kind": "robot-ik", "robot": PANDA, "goal_pose": POSE}))
    )
    changed = file.changed({"obstacles": [ball]}, {})
    assert changed.fields["model"] != file.fields["model"]
    genomes = some_genomes(file.problem())
    assert (file.problem().evaluate(genomes) <= 1.0).any()
    assert not (changed.problem().evaluate(genomes) <= 1.0).any()


# The check ------------------------------------------------------------------------------------------------------------
def mirrored(scene, body):
    """The scene with a joint that turns the wrong way."""
    axes = scene.arm.axes.copy()
    axes[body] *= -1.0
    return dataclasses.replace(scene, arm=dataclasses.replace(scene.arm, axes=axes))


def without(scene, name):
    """The scene without the pieces of a link."""
    arm = scene.arm
    kept = [number for number, piece in enumerate(arm.pieces) if piece != name]
    pairs = [[kept.index(each) for each in pair] for pair in arm.pairs.tolist() if all(each in kept for each in pair)]
    fewer = dataclasses.replace(
        arm,
        pieces=tuple(arm.pieces[number] for number in kept),
        piece_body=arm.piece_body[kept],
        piece_root=arm.piece_root[kept],
        pairs=np.array(pairs, np.int64).reshape(-1, 2),
    )
    return dataclasses.replace(scene, arm=fewer)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("body", [2, 4, 6])
def test_a_joint_of_the_wrong_sign_in_the_planner_is_caught(seed, body):
    own = problem()
    faulty = own.model_copy(update={"model": mirrored(own.scene, body).to_text()})
    faulty.__dict__.pop("scene")
    fitness, solution = found_by(faulty, seed)
    assert fitness <= 1.0
    assert own.check(solution).objections


@pytest.mark.parametrize("seed", range(6))
def test_a_piece_that_the_planner_leaves_out_is_caught(seed):
    ball = {"id": "ball", "shape": "sphere", "radius": 0.02, "position": [0.5, 0.1, 0.36]}
    own = problem(obstacles=[ball])
    faulty = own.model_copy(update={"model": without(own.scene, "panda_hand").to_text()})
    faulty.__dict__.pop("scene")
    fitness, solution = found_by(faulty, seed)
    assert fitness <= 1.0
    assert any("panda_hand" in text and "ball" in text for text in own.check(solution).objections)


def test_the_check_says_what_is_wrong():
    own = problem(solutions=3)
    _, solution = found_by(own)
    assert own.check(solution).feasible
    first, other, third = solution["configuration"], *solution["others"]
    wrong = own.check(solution | {"others": [other, other]}).objections
    assert wrong == ("solutions 2 and 3 differ by less than 0.1 in every joint",)
    turned = [*third[:6], third[6] + 2 * np.pi]
    wrong = own.check(solution | {"others": [third, turned]}).objections
    assert any(text.startswith("solution 3: joint panda_joint7 is at") for text in wrong)
    assert "solutions 2 and 3 differ by less than 0.1 in every joint" in wrong
    wrong = own.check(solution | {"others": [other, AWAY]}).objections
    assert any(text.startswith("solution 3 is ") and text.endswith(" rad from the pose") for text in wrong)
    assert own.check(solution | {"others": [other]}).fitness == pytest.approx(100.0, abs=1.0)
    assert "the robot keeps" in own.check(solution | {"clearance": 0.9}).objections[0]
    for nonsense, message in [
        ({"others": None}, "others: expected a list"),
        ({"others": [first[:3]]}, "configuration: expected 7 values, found 3"),
        ({"others": [first] * 3}, "others: expected at most 2, found 3"),
        ({"configuration": "x"}, "configuration"),
    ]:
        with pytest.raises(BadInput, match=f"^solution: {message}"):
            own.check(solution | nonsense)
    with pytest.raises(BadInput, match=r"^solution: others: expected none"):
        problem().check(solution)


# The fields -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ({"link": "panda_foot"}, r"goal_pose.link: expected one of panda_link0, .*, found 'panda_foot'"),
        ({"link": "panda_link0"}, r"goal_pose.link: expected a link that the joints move, found 'panda_link0'"),
        ({"quaternion": [1.0, 1.0, 0.0, 0.0]}, "unit quaternion"),
    ],
)
def test_a_pose_that_makes_no_sense_is_refused(pose, message):
    with pytest.raises(ValueError, match=message):
        problem(goal_pose=POSE | pose)


def test_a_pose_out_of_reach_is_refused_with_the_reason():
    far = problem(goal_pose=POSE | {"position": [1.5, 0.0, 0.4]})
    assert far.unreachable.startswith("goal_pose.position: expected a point at most 0.98")
    assert "set the run's target above" in far.unreachable
    assert problem().unreachable is None
    low, high = proof_of(problem()).limits.T
    for q in np.random.default_rng(1).uniform(low, high, (50, 7)):  # what is reached is never refused
        place = proof_of(problem()).pose(q, "panda_hand")[:3, 3].tolist()
        near = problem().goal_pose.model_copy(update={"position": tuple(place)})
        assert problem().model_copy(update={"goal_pose": near}).unreachable is None


def test_the_oracle_finds_a_solution_that_the_check_accepts():
    own = example().problem()
    answer = own.oracle()
    assert (answer.meaning, answer.fitness < 1.0) == ("optimum", True)
    verdict = own.check(answer.solution)
    assert verdict.feasible
    assert verdict.fitness == pytest.approx(300.0, abs=1.0)


def test_a_solution_in_words():
    own = example().problem()
    _, solution = found_by(own)
    text = own.describe(solution)
    assert text.startswith("4 of 4 solutions, ")
    assert "panda_joint7" in text
    assert len(text.splitlines()) == 5
