"""The min-time planner: its file, its operators, its trajectories, its judge, its oracle and its pictures."""

import json
import os
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from timed_arms import DIAGONAL, genome_of, genomes_of, problem_of, spoiled, time_of

from genetics import Keys, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run, load
from problems.file import parse
from problems.min_time import MinTime, checker, oracle
from problems.min_time.coding import FINEST, Trajectories
from problems.min_time.levels import LEVELS

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


# Time scaling ---------------------------------------------------------------------------------------------------------
def test_one_joint_takes_the_time_of_bang_and_bang():
    """A rod alone: half the way at full acceleration, half at full braking."""
    arm = {"masses": [3.0], "lengths": [2.0], "tip_mass": 0.0, "torque": [5.0]}
    problem = problem_of(start=[0.0], goal=[1.0], arm=arm)
    inertia = 3.0 * 2.0**2 / 3
    assert time_of(problem, [[step] for step in range(1, 10)]) == pytest.approx(2 * np.sqrt(inertia / 5.0), rel=1e-4)


def test_the_straight_joint_line_takes_what_fine_integration_says():
    assert time_of(problem_of(), DIAGONAL) == pytest.approx(0.840, abs=5e-4)


def test_luus_benchmark_is_near_its_published_optimum():
    """From (0, 0.5) to (0.522, 0.5) in 2.9826 s at |τ| ≤ 1; here joint 2, which starts where it ends, stays there."""
    problem = problem_of(start=[0.0, 0.5], goal=[0.522, 0.5], arm={"torque": [1.0, 1.0]})
    assert 2.9826 <= time_of(problem, [[step, 0] for step in range(1, 10)]) < 6.0


def test_time_grows_as_torque_levels_fall_and_as_their_root_without_gravity():
    problem = problem_of(recipe="paper")
    times = [time_of(problem, DIAGONAL, level=level) for level in range(1, 9)]
    np.testing.assert_allclose(np.array(times) * np.sqrt(np.arange(1, 9)), times[-1] * np.sqrt(8), rtol=1e-6)


def test_what_cannot_be_held_is_infeasible():
    problem = problem_of(recipe="paper", arm={"gravity": 9.81})
    assert np.isfinite(time_of(problem, DIAGONAL))
    assert time_of(problem, DIAGONAL, level=1) == np.inf


def test_a_curve_that_would_stand_still_is_infeasible():
    problem = problem_of()
    assert time_of(problem, [[1, 1], [1, 1], [9, 9]]) == np.inf
    assert time_of(problem, [[1, 1], [5, 5], [1, 1], [9, 9]]) == np.inf


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_torques_hold_between_grid_points_as_an_independent_judge_sees_them(gravity):
    problem = problem_of(arm={"gravity": gravity}, free=True)
    genomes = genomes_of(problem, 200)
    times = problem.evaluate(genomes)
    for best in np.argsort(times)[:20]:
        verdict = problem.check(json.loads(json.dumps(problem.decode(genomes[best]))))
        assert verdict.objections == ()
        assert verdict.fitness == pytest.approx(times[best], rel=1e-7)


def test_a_finer_grid_of_the_parameter_changes_little():
    """More nodes on the same straight line are more grid points: the time stays what it is."""
    coarse, fine = problem_of(), problem_of(grid=37)
    assert time_of(fine, [[step, step] for step in range(1, 37)]) == pytest.approx(time_of(coarse, DIAGONAL), rel=1e-3)


# Dynamics -------------------------------------------------------------------------------------------------------------
def states(arm, count=20):
    return np.random.default_rng(1).normal(size=(3, count, arm.size)) * [[[1.0]], [[3.0]], [[20.0]]]


def compiled_torques(problem, q, qd, qdd):
    """By the compiled a, b and c, through a straight curve of one stretch around each state."""
    from lowlevel.compiled import kernel
    from problems.min_time import dynamics

    @kernel("float64[:,::1](float64[:,::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1])")
    def by_chain(rows, gravity, q, qd, qdd):
        chain = dynamics.chain_of(rows, gravity)
        torque = np.empty(q.shape)
        for state in range(len(q)):
            dynamics.turn_joints(chain, q[state])
            dynamics.inverse_dynamics(chain, qd[state], qdd[state], 1.0, torque[state])
        return torque

    return by_chain(problem.arm.rows, problem.arm.falling, q, qd, qdd)


def test_recursive_newton_euler_kane_and_pinocchio_agree_on_rods():
    pytest.importorskip("pinocchio")
    for count in (1, 2, 4):
        arm = {"masses": [1.0, 2.0, 0.5, 0.3][:count], "lengths": [1.0, 0.7, 0.4, 0.2][:count], "gravity": 9.81}
        problem = problem_of(start=[0.0] * count, goal=[1.0] * count, arm=arm | {"torque": [100.0] * count})
        q, qd, qdd = states(problem.arm)
        expected = checker.torques(problem.arm, q, qd, qdd)
        np.testing.assert_allclose(checker.kane(problem.arm, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(compiled_torques(problem, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)
        held = [problem.arm.holding_torque(list(angles)) for angles in q]
        np.testing.assert_allclose(checker.torques(problem.arm, q, 0 * q, 0 * q), held, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("example", "path"),
    [
        ("min-time-panda.toml", "panda_description/urdf/panda.urdf"),
        ("min-time-ur5.toml", "ur_description/urdf/ur5_robot.urdf"),
    ],
)
def test_the_chain_of_a_urdf_has_the_dynamics_that_pinocchio_reads_from_it(example, path):
    pinocchio = pytest.importorskip("pinocchio")
    from problems.min_time import urdf

    problem = load(EXAMPLES / example).problem()
    whole = pinocchio.buildModelFromUrdf(str(urdf._path(f"example-robot-data:{path}", EXAMPLES)))
    model = urdf._reduced(pinocchio, whole, problem.arm.names)
    data = model.createData()
    q, qd, qdd = states(problem.arm)
    expected = [pinocchio.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)]
    np.testing.assert_allclose(compiled_torques(problem, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(checker.torques(problem.arm, q, qd, qdd), expected, rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def panda():
    pytest.importorskip("pinocchio")
    return load(EXAMPLES / "min-time-panda.toml").problem()


def test_two_links_in_closed_form_and_by_recursion_take_the_same_time():
    """A third joint that stays where it is, of a rod that weighs next to nothing, makes the arm a chain."""
    two = problem_of(arm={"gravity": 9.81, "tip_mass": 0.0})
    three = problem_of(
        start=[-0.5, -1.0, 0.0],
        goal=[0.5, 1.0, 0.0],
        arm={"gravity": 9.81, "tip_mass": 0.0, "masses": [1, 1, 1e-9], "lengths": [1, 1, 1e-3], "torque": [64.5] * 3},
    )
    nodes = [[1, 2], [3, 4], [6, 6], [9, 9]]
    items = three.coding.encode([[*node, 0, LEVELS] for node in nodes])
    assert three.evaluate(items[None])[0] == pytest.approx(time_of(two, nodes), rel=1e-6)


# Operators ------------------------------------------------------------------------------------------------------------
def codings():
    return st.builds(
        lambda grid, moving, free, full: Trajectories(
            [grid - 1 if each else 0 for each in moving], max(2, 5 * (grid - 1)), 0.25, free, full
        ),
        st.integers(2, 12),
        st.lists(st.booleans(), min_size=1, max_size=4),
        st.booleans(),
        st.booleans(),
    )


def assert_sound(coding, genome):
    """It arrives, and never stands still on the way."""
    assert coding.alphabet.admits(genome)
    items = coding.items(genome)
    assert items[-1, :-1].tolist() == list(coding.greatest)
    if any(coding.greatest):
        places = [[0] * len(coding.greatest), *items[:, :-1].tolist()]
        assert all(one != other for one, other in pairwise(places))
        assert all(one != other for one, other in zip(places, places[2:], strict=False))


@settings(max_examples=40)
@given(codings(), st.integers(0, 1 << 60))
def test_first_trajectories_arrive_by_moves_to_neighbours(coding, seed):
    for genome in coding.random(Keys(np.arange(3), np.uint64(seed), 0), 5).reshape(-1, coding.genome_bytes):
        assert_sound(coding, genome)
        steps = np.maximum(coding.greatest, 1) / np.maximum(coding.grid_steps, 1)
        places = np.rint(np.vstack([np.zeros(len(steps)), coding.items(genome)[:, :-1]]) / steps)
        moves = np.diff(places, axis=0)
        assert np.abs(moves).max(initial=0) <= 1
        assert (moves < 0).sum(axis=1).max() <= 1


@settings(max_examples=40)
@given(codings(), st.integers(0, 1 << 60), st.sampled_from(["analogous", "refining"]), st.sampled_from([0.0, 0.3, 1.0]))
def test_offspring_arrive_and_are_within_bounds(coding, seed, crossover, rate):
    keys = Keys(np.arange(2), np.uint64(seed), 1)
    parents = coding.random(keys, 20).reshape(2, 10, 2, -1)
    for genome in coding.recombine(parents, Recipe(crossover, rate), keys).reshape(-1, coding.genome_bytes):
        assert_sound(coding, genome)


def test_without_mutation_children_are_heads_and_tails_of_their_parents_cut_near_each_other():
    coding = problem_of().coding
    keys = Keys(np.arange(1), np.uint64(3), 1)
    parents = coding.random(keys, 200).reshape(1, 100, 2, -1)
    offspring = coding.recombine(parents, Recipe("analogous", 0.0), keys)[0]
    crossed = 0
    for couple, children in zip(parents[0], offspring.reshape(100, 2, -1), strict=True):
        one, other = (coding.items(parent)[:, :2].tolist() for parent in couple)
        child = coding.items(children[0])[:, :2].tolist()
        if child in (one, other):
            continue
        crossed += 1
        cuts = [
            (cut, match)
            for cut, match in product(range(len(one)), range(len(other)))
            if np.hypot(*np.subtract(one[cut], other[match])) / 9 <= 0.25 and child[-1:] == other[-1:]
        ]
        assert any(
            set(map(tuple, child)) <= set(map(tuple, one[: cut + 1])) | set(map(tuple, other[match + 1 :]))
            for cut, match in cuts
        )
    assert crossed > 50


def test_a_radius_of_nothing_crosses_only_where_both_parents_pass():
    coding = problem_of(radius=0.0, free=True).coding
    keys = Keys(np.arange(1), np.uint64(3), 1)
    parents = coding.random(keys, 100).reshape(1, 50, 2, -1)
    offspring = coding.recombine(parents, Recipe("analogous", 0.0), keys)[0].reshape(50, 2, -1)
    for couple, children in zip(parents[0], offspring, strict=True):
        one, other = ({tuple(node) for node in coding.items(parent)[:-1, :2].tolist()} for parent in couple)
        if not one & other:
            assert children.tobytes() == couple.tobytes()


def test_no_more_than_two_copies_are_among_the_offspring():
    coding = problem_of().coding
    keys = Keys(np.arange(1), np.uint64(3), 1)
    same = np.tile(coding.random(keys, 1), (1, 40, 1)).reshape(1, 20, 2, -1)
    offspring = coding.recombine(same, Recipe("analogous", 0.0), keys)[0]
    _, counts = np.unique(offspring, axis=0, return_counts=True)
    assert sorted(counts)[-1] == 2
    assert len(counts) > 20


def test_levels_are_all_full_unless_they_are_coded():
    assert set(problem_of().coding.items(genomes_of(problem_of(), 1)[0])[:, -1]) == {LEVELS}
    paper = problem_of(recipe="paper")
    levels = np.concatenate([paper.coding.items(genome)[:, -1] for genome in genomes_of(paper, 30)])
    assert set(levels) == set(range(1, 9))


def test_moves_towards_the_goal_are_likelier_by_powers_of_two():
    """From the middle of the grid: (1, 1) has weight 4, (1, 0) 2, (1, -1) 1, (0, -1) 1/2."""
    problem = problem_of(grid=200)
    moves = []
    for genome in genomes_of(problem, 200):
        places = problem.coding.items(genome)[:, :2]
        inner = np.all((places[:-1] > 0) & (places[:-1] < 199), axis=1)
        moves += [tuple(move) for move in np.diff(places, axis=0)[inner].tolist()]
    share = {move: moves.count(move) / len(moves) for move in set(moves)}
    assert share[1, 1] / share[1, 0] == pytest.approx(2.0, rel=0.1)
    assert share[1, 0] / share[1, -1] == pytest.approx(2.0, rel=0.2)
    assert (-1, -1) not in share


# Recipes and files ----------------------------------------------------------------------------------------------------
def test_recipes():
    problem = problem_of()
    assert problem.recipe("paper", 100) == Recipe("analogous", 0.3, "offspring", renewal=1.0, most_selections=2)
    assert problem.recipe("paper", 1).crossover == "analogous"
    assert problem.recipe("tuned", 1).replacement == "elitist"
    assert problem_of("paper").profile == "coded"
    assert problem_of("tuned").profile == "optimal"
    assert problem_of("paper", profile="optimal").profile == "optimal"
    assert problem_of(free=True).coding.greatest == (FINEST, FINEST)


@pytest.mark.parametrize(
    ("fields", "arm", "expected"),
    [
        ({"start": [0.0]}, {}, "start: expected 2 angles, found 1"),
        ({"goal": [0.0, 1.0, 2.0]}, {}, "goal: expected 2 angles, found 3"),
        ({"start": [float("nan"), 0.0]}, {}, "start"),
        ({}, {"torque": [1.0]}, "torque: expected one limit for each of 2 joints, found 1"),
        ({}, {"torque": [1.0, -1.0]}, "arm.torque"),
        ({}, {"velocity": [1.0]}, "velocity: expected one limit for each of 2 joints, found 1"),
        ({}, {"acceleration": [1.0, 0.0]}, "arm.acceleration"),
        ({}, {"jerk": []}, "arm.jerk"),
        ({}, {"masses": [1.0]}, "expected as many masses as lengths, found 1 and 2"),
        ({}, {"gravity": 9.81, "torque": [64.5, 1.0]}, "start: expected a place that the arm can hold, found"),
        ({"profile": "best"}, {}, "profile: "),
        ({"grid": 1}, {}, "grid: "),
        ({"radius": -1.0}, {}, "radius: "),
        ({"gird": 10}, {}, "gird: unknown field"),
        ({}, {"urdf": "arm.urdf"}, "urdf: expected an arm loaded from a problem file"),
    ],
)
def test_bad_files_are_refused_in_one_line_that_names_the_field(fields, arm, expected):
    with pytest.raises(BadInput, match=expected) as error:
        problem_of(arm=arm, **fields)
    assert len(str(error.value).splitlines()) == 1
    assert str(error.value).startswith("arm.toml: ")


@pytest.mark.parametrize(
    ("urdf", "joints", "expected"),
    [
        ("none.urdf", "", "arm.urdf: expected a URDF, found no file"),
        ("example-robot-data:none.urdf", "", "arm.urdf: expected a URDF, found no file"),
        ("bad.urdf", "", "arm.urdf: expected a URDF, found .*bad.urdf: Error=XML_ERROR_MISMATCHED_ELEMENT"),
        ("loose.urdf", "", "arm.urdf: expected a URDF, found .*loose.urdf: Joint .hinge. is .* not specify limits"),
        ("example-robot-data:panda_description/urdf/panda.urdf", "joints = ['wrist']", "arm.joints: expected some of"),
        ("example-robot-data:panda_description/urdf/panda.urdf", "joints = 3", "arm.joints: expected a list of names"),
        ("light.urdf", "", "arm.urdf: expected links with a mass beyond every joint that moves, found none"),
        ("stiff.urdf", "", "arm.urdf: expected revolute joints, found none"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_refused_in_one_line(urdf, joints, expected, tmp_path, panda, capfd):
    (tmp_path / "bad.urdf").write_text("<robot>")
    (tmp_path / "loose.urdf").write_text(
        '<robot name="loose"><link name="base"/><link name="tip"/>'
        '<joint name="hinge" type="revolute"><parent link="base"/><child link="tip"/></joint></robot>'
    )
    (tmp_path / "stiff.urdf").write_text('<robot name="stiff"><link name="base"/></robot>')
    (tmp_path / "light.urdf").write_text(
        '<robot name="light"><link name="base"/><link name="tip"/>'
        '<joint name="hinge" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    file = tmp_path / "arm.toml"
    file.write_text(f"kind = 'min-time'\nstart = [0.0]\ngoal = [1.0]\n[arm]\nurdf = '{urdf}'\n{joints}\n")
    with pytest.raises(BadInput, match=expected) as error:
        load(file)
    assert len(str(error.value).splitlines()) == 1
    os.write(2, b"as before")
    assert capfd.readouterr().err == "as before"


def test_without_pinocchio_a_urdf_says_what_to_install_and_rods_are_judged_all_the_same(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "pinocchio", None)
    with pytest.raises(BadInput, match=r"arm.urdf: pinocchio is not installed: pip install 'supernode\[dynamics\]'"):
        load(EXAMPLES / "min-time-panda.toml")
    problem = problem_of()
    assert problem.check(problem.decode(genome_of(problem, DIAGONAL))).feasible


def test_a_urdf_in_the_problem_file_is_read_once_and_may_be_held_at_some_joints(panda, tmp_path):
    assert panda.arm.size == 7
    assert panda.arm.limit_of("torque").tolist() == [87, 87, 87, 87, 12, 12, 12]
    file = tmp_path / "arm.toml"
    file.write_text(
        "kind = 'min-time'\nstart = [0.0, -1.5]\ngoal = [0.5, -1.0]\n[arm]\n"
        "urdf = 'example-robot-data:panda_description/urdf/panda.urdf'\njoints = ['panda_joint1', 'panda_joint4']\n"
    )
    two = load(file).problem()
    assert two.arm.names == ["panda_joint1", "panda_joint4"]
    assert two.check(two.decode(genome_of(two, DIAGONAL))).feasible


# The judge ------------------------------------------------------------------------------------------------------------
def test_the_judge_sees_torques_beyond_their_limits_a_curve_out_of_the_box_and_no_rest():
    problem, weak = problem_of(), problem_of(arm={"torque": [64.5, 60.0]})
    genome = genome_of(problem, [[3, 0], [5, 1], [0, 9], [4, 9], [9, 9]])
    solution = problem.decode(genome)
    assert problem.check(solution).feasible
    (objection,) = weak.check(solution).objections
    assert objection.startswith("a torque is 1.07")
    assert objection.endswith("of its limit, 60 N m of joint 2")
    narrow = problem_of(start=[-0.5, -1.0], goal=[0.4, 1.0])
    assert any("box" in each for each in narrow.check(solution).objections)
    moving = [[0.1, 0.1], *solution["trajectory"]["qd"][1:]]
    assert any("rest" in each for each in problem.check(spoiled(solution, qd=moving)).objections)


def test_start_equal_to_goal_takes_no_time_and_no_move():
    problem = problem_of(goal=[-0.5, -1.0], arm={"gravity": 9.81})
    genomes = genomes_of(problem, 3)
    assert problem.evaluate(genomes).tolist() == [0.0] * 3
    solution = json.loads(json.dumps(problem.decode(genomes[0])))
    assert solution["time"] == 0.0
    assert len(solution["trajectory"]["t"]) == 1
    assert problem.check(solution).feasible
    assert not problem.check(solution | {"nodes": [[0.0, 0.0], [0.0, 0.0]]}).feasible
    problem.draw(Figure(), solution, {})


# The oracle -----------------------------------------------------------------------------------------------------------
def every_monotone_path(lines):
    """Of moves to neighbours, from (0, 0), which is left out, to the far corner."""
    if lines == 1:
        return
    stack = [[(0, 0)]]
    while stack:
        path = stack.pop()
        row, column = path[-1]
        if row == column == lines - 1:
            yield path[1:]
            continue
        moves = [(row + 1, column), (row, column + 1), (row + 1, column + 1)]
        stack += [[*path, move] for move in moves if max(move) < lines]


SLOW = {"velocity": [2.0, 3.0], "acceleration": [8.0, 30.0]}


@pytest.mark.parametrize(
    ("lines", "arm"),
    [
        (2, {}),
        (3, {}),
        (4, {}),
        (4, {"gravity": 9.81}),
        (4, {"velocity": [2.0, 3.0]}),
        (4, {"gravity": 9.81} | SLOW),
    ],
)
def test_dynamic_program_and_tree_search_find_what_brute_force_finds(lines, arm):
    problem = problem_of(grid=lines, arm=arm)
    best = min(time_of(problem, path) for path in every_monotone_path(lines))
    assert oracle.dynamic_program(problem, 1, 96).time == pytest.approx(best, rel=0.01)
    found = oracle.tree_search(problem)
    assert found.searched == 1.0
    assert found.time == pytest.approx(best, rel=0.01)


def test_the_oracle_of_the_papers_problem():
    answer = load(EXAMPLES / "min-time.toml").problem().oracle()
    assert answer.meaning == "upper bound"
    assert answer.fitness == pytest.approx(0.809, abs=0.004)
    assert answer.solution["time"] == pytest.approx(answer.fitness)


def test_who_is_there_needs_no_time():
    answer = problem_of(goal=[-0.5, -1.0]).oracle()
    assert (answer.meaning, answer.fitness) == ("optimum", 0.0)


def test_other_arms_have_no_oracle():
    with pytest.raises(BadInput, match="expected two joints that move"):
        problem_of(goal=[0.5, -1.0]).oracle()


# Runs and pictures ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("recipe", "deme", "topology"), [("tuned", 10, "torus 2x2"), ("paper", 100, "torus 1x1")])
def test_islands_get_better_and_end_within_the_limits(recipe, deme, topology):
    run = Run(recipe=recipe, deme=deme, topology=topology, generations=60)
    file = ProblemFile("arm.toml", parse(MinTime.template, "", Path()).fields, run, Path())
    plan = Plan.of(file)
    best = min(report.champion.fitness for report in simulate(plan))
    assert best < plan.problem.evaluate(genomes_of(plan.problem, 100)).min()


def test_a_picture_shows_the_curve_and_the_limits(tmp_path):
    problem = problem_of()
    solution = problem.decode(genome_of(problem, DIAGONAL))
    figure = Figure()
    problem.draw(figure, solution, {0: genomes_of(problem, 9), 5: genomes_of(problem, 2)})
    figure.savefig(tmp_path / "arm.png")
    space, scheme, angles, torques = figure.axes
    *odds, explained = [text.get_text() for text in scheme.texts if text.get_text()]
    assert sorted(odds) == ["1", "1", "2", "2", "4", "½", "½"]
    assert explained.startswith("The first trajectories")
    assert [text.get_text() for text in torques.texts] == ["limit"]
    assert angles.get_title() == f"{solution['time']:.4f} s"
    assert space.get_xlabel() == "joint 1 / rad"


def test_the_scheme_shows_only_moves_of_joints_that_have_somewhere_to_go():
    problem = problem_of(goal=[0.5, -1.0])
    figure = Figure()
    problem.draw(figure, None, {})
    *odds, _ = [text.get_text() for text in figure.axes[1].texts if text.get_text()]
    assert sorted(odds) == ["2", "½"]
