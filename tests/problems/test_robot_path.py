"""The robot-path planner: its file, its operators, its paths, its judge, its bound, its motion and its pictures."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jointed_robots import FIELDS, WALL, chain, file_of, genomes_of, offspring_of, problem_of
from matplotlib.figure import Figure

from node.plan import Plan
from node.simulation import simulate
from problems import BadInput
from problems.motion import Pace
from problems.robot_path import RobotPath, checker, oracle
from problems.robots.proof import Proof

SEEDS = st.integers(0, 2**32)
FEW = settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def problem():
    return problem_of()


@pytest.fixture(scope="module")
def solution(problem):
    genomes = genomes_of(problem, 8)
    return problem.decode(genomes[np.argmin(problem.evaluate(genomes))])


def sampled(path, step=2e-3):
    """Configurations along a path, no farther apart than a step, rad."""
    rows = [path[:1]]
    for one, other in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(other - one) / step)))
        rows.append(one + (other - one) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(rows)


# Trees and first paths ------------------------------------------------------------------------------------------------
def test_what_trees_find_is_free_at_densely_sampled_configurations(problem):
    proof = Proof(*plain_of(problem))
    genomes = genomes_of(problem, 4)
    assert (problem.evaluate(genomes) < 1000.0).all()
    for genome in genomes:
        path = np.array(problem.decode(genome)["path"])
        assert len(path) > 2
        for configuration in sampled(path, step=0.01):
            assert proof.contacts(configuration) == []


def plain_of(problem):
    fields = problem.model_dump(mode="json")
    return fields["robot"], fields["obstacles"], fields["attached"]


def test_first_paths_depend_on_seed_and_individual_alone(problem):
    genomes = genomes_of(problem, 4)
    assert genomes.tobytes() == genomes_of(problem, 4).tobytes()
    assert genomes[:2].tobytes() == genomes_of(problem, 2).tobytes()
    assert genomes.tobytes() != genomes_of(problem, 4, seed=2).tobytes()


def test_a_free_straight_line_is_taken_at_once():
    problem = problem_of(obstacles=[])
    genome = genomes_of(problem, 1)
    length = np.linalg.norm(np.subtract(FIELDS["goal"], FIELDS["start"]))
    assert problem.evaluate(genome) == pytest.approx([length])
    answer = oracle.solve_exactly(problem)
    assert (answer.meaning, answer.fitness) == ("optimum", pytest.approx(length))


def test_the_nearest_of_several_goals_that_can_be_reached_is_taken():
    """The straight line to the second goal is free."""
    near = [-0.5, 0.0, 0.1]
    problem = problem_of(goal=None, goals=[FIELDS["goal"], near])
    assert problem.decode(genomes_of(problem, 1)[0])["path"][-1] == near


# Variation ------------------------------------------------------------------------------------------------------------
@FEW
@given(SEEDS, st.integers(1, 4))
def test_offspring_of_free_paths_are_sound_and_free(problem, seed, generation):
    parents = genomes_of(problem, 4, seed)
    offspring = offspring_of(problem, parents, seed, generation)
    assert all(problem.coding.alphabet.admits(genome) for genome in offspring)
    assert (problem.evaluate(parents) < 1000.0).all()
    assert (problem.evaluate(offspring) < 1000.0).all()


@FEW
@given(SEEDS)
def test_offspring_of_the_same_free_path_are_never_longer(problem, seed):
    parents = np.repeat(genomes_of(problem, 1, seed), 3, axis=0)
    offspring = offspring_of(problem, parents, seed)
    assert (problem.evaluate(offspring) <= problem.evaluate(parents)[0] + 1e-9).all()


@FEW
@given(SEEDS, st.integers(0, 12))
def test_offspring_of_any_genomes_are_sound(problem, seed, count):
    generator = np.random.default_rng(seed)
    items = generator.integers(0, 1 << 16, (2, count + 1, len(problem.start)))
    parents = np.stack([problem.coding.encode(each) for each in items])
    offspring = offspring_of(problem, parents, seed)
    assert all(problem.coding.alphabet.admits(genome) for genome in offspring)


def test_a_blocked_path_is_mended_or_replaced(problem):
    line = problem.coding.encode(np.zeros((1, 3)))
    assert problem.evaluate(line[None]) > 1000.0
    offspring = offspring_of(problem, np.stack([line, line]))
    assert problem.evaluate(offspring).min() < 1000.0


@pytest.mark.parametrize(
    "spoil",
    [
        lambda memo: memo.__setitem__((slice(None), -2), 3 - memo[:, -2]),
        lambda memo: memo.__setitem__((slice(None), slice(0, 3)), memo[:, 3:6]),
        lambda memo: memo.__setitem__(slice(None), np.roll(memo, 1, axis=0)),
        lambda memo: memo.__setitem__(slice(None), 0),
    ],
    ids=["answers turned round", "ends of another segment", "rows of other keys", "forgotten"],
)
def test_a_memo_never_changes_a_result(problem, spoil):
    """As when two threads write to a row at once, or when another problem was solved before."""
    genomes = genomes_of(problem, 6)
    genomes = np.concatenate([genomes, offspring_of(problem, genomes), problem.coding.encode(np.zeros((1, 3)))[None]])
    expected = problem_of().evaluate(genomes)
    memo = problem.fitness_kernel.kept[3]
    problem.evaluate(genomes)
    assert memo[:, -2].any()
    spoil(memo)
    np.testing.assert_array_equal(problem.evaluate(genomes), expected)


def test_paths_become_shorter(problem):
    """The wall is passed above: at least the second joint has to rise."""
    best = outcome_of(file_of()).min()
    assert np.linalg.norm(np.subtract(*(FIELDS[end] for end in ("goal", "start")))) < best
    assert best < problem.evaluate(genomes_of(problem, 2)).min()


def outcome_of(file):
    return np.array([report.champion.fitness for report in simulate(Plan.of(file)) if report.champion is not None])


# The file -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"start": [0.0, 0.0, 0.0]},
            r"start: expected a free configuration, found one where bar_\d touches wall, .* mm",
        ),
        ({"goal": [0.0, 0.0, 0.0]}, r"goal: expected a free configuration, found one where bar_\d touches wall"),
        ({"goal": [0.9, 0.2, 3.5]}, r"goal: expected joint_3 within \[-3, 3\] rad or m, found 3.5"),
        (
            {"goal_pose": {"link": "bar_3", "position": [0.424264, 0.424264, 0.34641]}},
            "goal: expected one of goal, goals and goal_pose, found goal and goal_pose",
        ),
        ({"robot": {"urdf": chain(), "acceleration": [1.0]}}, "robot.acceleration: expected one value, or 3 "),
        ({"goal": [0.9, 0.2]}, r"goal: expected 3 values \(joint_1, joint_2, joint_3\), found 2"),
        ({"goal": None}, "goal: expected one of goal, goals and goal_pose, found none"),
        ({"clearance": 0.5}, "start: expected a free configuration, found one where .* less than the clearance 0.5 m"),
        (
            {"goal": None, "goal_pose": {"link": "bar_3", "position": [3.0, 0.0, 0.0]}},
            "goal_pose: expected a pose that bar_3 can reach, found one that it misses by .* m",
        ),
        ({"goal": None, "goal_pose": {"link": "bar_9", "position": [0.3, 0.0, 0.0]}}, "goal_pose.link: .*'bar_9'"),
    ],
)
def test_what_cannot_be_planned_is_refused(fields, message):
    with pytest.raises(BadInput, match=message):
        problem_of(**fields)


def test_degrees_are_read():
    degrees = [float(np.degrees(angle)) for angle in FIELDS["start"]]
    fields = FIELDS | {"unit": "deg", "start": degrees, "goal": [51.0, 11.0, 0.0]}
    assert RobotPath.read_angles(fields)["start"] == pytest.approx(FIELDS["start"])


def test_joints_of_a_file_in_degrees_are_held_in_degrees_and_complaints_are(tmp_path):
    (tmp_path / "chain.urdf").write_text(chain())
    robot = {"urdf": "chain.urdf", "joints": ["joint_1", "joint_2"], "fixed": {"joint_3": 90.0}}
    own = FIELDS | {"unit": "deg", "start": [-50.0, 0.0], "goal": [50.0, 10.0], "robot": robot, "obstacles": []}
    read = RobotPath.gather(RobotPath.read_angles(own), tmp_path)
    assert read["robot"]["fixed"]["joint_3"] == pytest.approx(np.pi / 2)
    beyond = RobotPath.gather(RobotPath.read_angles(own | {"goal": [50.0, 200.0]}), tmp_path)
    with pytest.raises(ValueError, match=r"goal: expected joint_2 within \[-171.887, 171.887\] deg, found 200"):
        RobotPath.model_validate(RobotPath.derive_fields(beyond))


def test_a_link_behind_a_held_joint_must_be_clear_of_obstacles():
    held = {"urdf": chain(), "joints": ["joint_3"], "fixed": {"joint_1": 0.0, "joint_2": 0.0}}
    around_the_first_bar = {"id": "post", "shape": "box", "size": [0.1, 0.3, 0.1], "position": [0.2, 0.0, 0.0]}
    with pytest.raises(BadInput, match=r"robot.fixed: expected joints that hold .* bar_1 touches post, .* mm deep"):
        problem_of(start=[0.3], goal=[-0.3], robot=held, obstacles=[around_the_first_bar])


# Poses ----------------------------------------------------------------------------------------------------------------
def test_a_pose_is_reached():
    pose = {"link": "bar_3", "position": [0.424264, 0.424264, 0.34641]}
    problem = problem_of(goal=None, goal_pose=pose)
    assert len(problem.ends) > 1
    genome = genomes_of(problem, 1)
    path = problem.decode(genome[0])["path"]
    at = Proof(*plain_of(problem)).pose(path[-1], "bar_3")[:3, 3]
    np.testing.assert_allclose(at, pose["position"], atol=1e-4)
    verdict = problem.check(problem.decode(genome[0]))
    assert verdict.objections == ()


# The judge ------------------------------------------------------------------------------------------------------------
def test_the_check_agrees(problem, solution):
    verdict = problem.check(solution)
    assert verdict.objections == ()
    assert verdict.fitness == pytest.approx(solution["length"])
    assert verdict.clearance.least >= solution["clearance"]


def test_the_check_objects(problem, solution):
    straight = {"path": [FIELDS["start"], FIELDS["goal"]], "length": 1.0, "clearance": 0.5}
    text = "; ".join(problem.check(straight).objections)
    assert "wall" in text
    assert "rad long, not 1" in text
    assert "m, not 0.5 m" in text
    off = json.loads(json.dumps(solution))
    off["path"][0][0] += 0.1
    off["path"][-1][2] -= 0.1
    text = "; ".join(problem.check(off).objections)
    assert "the path starts at" in text
    assert "from the nearest goal" in text


def test_the_clearance_is_kept():
    problem = problem_of(clearance=0.05)
    genome = genomes_of(problem, 1)
    solution = problem.decode(genome[0])
    assert solution["clearance"] >= 0.04
    assert problem.check(solution).clearance.least >= 0.05
    assert problem.check(solution).objections == ()
    tight = problem_of()
    free = tight.decode(genomes_of(tight, 1)[0])
    assert checker.objections_to(problem, free["path"]) != () or free["clearance"] >= 0.05


def test_a_blocked_path_is_no_solution(problem):
    line = problem.coding.encode(np.zeros((1, 3)))
    solution = problem.decode(line)
    assert solution["blocked"] == pytest.approx(solution["length"])
    verdict = problem.check(solution)
    assert verdict.objections != ()
    assert verdict.fitness == pytest.approx(problem.evaluate(line[None])[0])


def test_the_oracle_bounds_the_length(problem, solution):
    answer = problem.oracle()
    assert answer.meaning == "lower bound"
    assert answer.fitness < solution["length"]


@pytest.mark.parametrize(("obstacles", "meaning"), [([], "upper bound"), ([WALL], "lower bound")])
def test_of_a_pose_the_oracle_knows_some_goals_only(obstacles, meaning):
    pose = {"link": "bar_3", "position": [0.424264, 0.424264, 0.34641]}
    problem = problem_of(goal=None, goal_pose=pose, obstacles=obstacles)
    answer = problem.oracle()
    assert answer.meaning == meaning
    if meaning == "lower bound":
        assert answer.fitness == 0.0
    else:
        assert problem.check(answer.solution).objections == ()


# Motion and pictures --------------------------------------------------------------------------------------------------
def test_the_motion_keeps_all_limits(problem, solution):
    moved = problem.motion(solution, Pace(speed=1.5, acceleration=3.0, rate=100.0))
    track = moved.tracks[0]
    assert np.abs(track.velocity).max() <= 1.5 + 1e-9
    assert np.abs(track.velocity).max() > 1.4
    assert np.abs(track.acceleration).max() <= 3.0 + 1e-9
    np.testing.assert_allclose(track.position[[0, -1]], [solution["path"][0], solution["path"][-1]])
    without = problem.motion(solution, Pace())
    assert np.abs(without.tracks[0].velocity).max() == pytest.approx(2.0, abs=0.5)


def test_a_robot_without_limits_of_speed_needs_one(solution):
    problem = problem_of(robot={"urdf": chain().replace('velocity="2.0"', 'velocity="0"')})
    with pytest.raises(BadInput, match=r"--speed: expected a speed in rad/s, .* no velocity of 'joint_1'"):
        problem.motion(solution, Pace())


def test_the_picture_renders(problem, solution, tmp_path):
    for each in (solution, None):
        figure = Figure()
        problem.draw(figure, each, {0: genomes_of(problem, 2)})
        figure.savefig(tmp_path / "picture.png")
        assert (tmp_path / "picture.png").stat().st_size > 20_000


def test_the_picture_has_the_robot_where_the_proof_has_it(problem):
    from problems.robots.pictures import frames_of

    frames = frames_of(problem.scene.arm, np.array(problem.start))
    body, placement = problem.scene.arm.link("bar_3")
    at = frames[body, :, :3] @ placement.reshape(3, 4)[:, 3] + frames[body, :, 3]
    np.testing.assert_allclose(at, Proof(*plain_of(problem)).pose(problem.start, "bar_3")[:3, 3], atol=1e-12)


def test_the_wall_is_an_obstacle_that_updates_may_move():
    file = file_of()
    moved = file.changed({"obstacles": [WALL | {"position": [0.7, 0.0, -2.0]}]}, {})
    problem = moved.problem()
    line = problem.coding.encode(np.zeros((1, 3)))
    assert problem.evaluate(line[None])[0] < 1000.0
