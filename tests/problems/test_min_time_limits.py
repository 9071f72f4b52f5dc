"""The limits of min-time: torque, velocity, acceleration and jerk hold, and the judge sees where they do not."""

import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from timed_arms import DIAGONAL, genome_of, genomes_of, problem_of, spoiled, time_of

from problems import BadInput, load
from problems.min_time import checker
from problems.min_time.levels import LEVELS


# The search -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"velocity": [1.0], "acceleration": [2.0]}, 1.0 / 1.0 + 1.0 / 2.0),  # a trapezium
        ({"acceleration": [2.0]}, 2.0 * np.sqrt(1.0 / 2.0)),  # a triangle
        ({"jerk": [10.0]}, np.cbrt(32.0 / 10.0)),  # bang, bang and bang
    ],
)
def test_one_joint_within_limits_takes_what_closed_forms_say(limits, expected):
    arm = {"masses": [3.0], "lengths": [2.0], "tip_mass": 0.0, "torque": [500.0]}
    problem = problem_of(start=[0.0], goal=[1.0], arm=arm | limits)
    assert time_of(problem, [[step] for step in range(1, 10)]) == pytest.approx(expected, rel=1e-3)
    assert time_of(problem, [[9]]) == pytest.approx(expected, rel=1e-3)


limits_of_two = st.fixed_dictionaries(
    {},
    optional={
        "velocity": st.lists(st.floats(0.2, 10.0), min_size=2, max_size=2),
        "acceleration": st.lists(st.floats(0.5, 100.0), min_size=2, max_size=2),
        "jerk": st.lists(st.floats(2.0, 1e4), min_size=2, max_size=2),
    },
)


@settings(max_examples=40)
@given(limits_of_two, st.sampled_from([0.0, 9.81]), st.integers(0, 1 << 30))
def test_no_limit_is_exceeded_as_an_independent_judge_sees_it(limits, gravity, seed):
    problem = problem_of(arm={"gravity": gravity} | limits, free=True)
    genomes = genomes_of(problem, 8, seed)
    times, unlimited = problem.evaluate(genomes), problem_of(arm={"gravity": gravity}, free=True).evaluate(genomes)
    assert np.array_equal(np.isfinite(times), np.isfinite(unlimited))
    for best in np.argsort(times)[:3]:
        solution = json.loads(json.dumps(problem.decode(genomes[best])))
        verdict = problem.check(solution)
        assert verdict.objections == ()
        assert verdict.fitness == pytest.approx(times[best], rel=1e-7)
        shares = checker.greatest_shares(problem, solution)
        assert shares.keys() == {"torque", *limits}
        assert max(each.max() for each in shares.values()) <= 1.01


def test_a_limit_of_jerk_makes_accelerations_continuous_and_begins_and_ends_without_any():
    problem = problem_of(arm={"velocity": [2.0, 2.0], "jerk": [60.0, 60.0]})
    rows = problem.decode(genome_of(problem, DIAGONAL))["trajectory"]
    t, q, qd, qdd = (np.array(rows[name]) for name in ("t", "q", "qd", "qdd"))
    np.testing.assert_allclose(np.diff(t), t[1], rtol=1e-9)
    assert np.abs(np.diff(qdd, axis=0)).max() <= 60.0 * t[1] * 1.001
    assert np.all(qdd[[0, -1]] == 0.0)
    np.testing.assert_allclose(np.diff(q, axis=0), (qd[1:] + qd[:-1]) / 2 * t[1], atol=1e-3)


# URDFs ----------------------------------------------------------------------------------------------------------------
UR5 = "example-robot-data:ur_description/urdf/ur5_robot.urdf"
SWING = {
    "start": [-2.5, -2.2, -1.5, -2.5, -2.0, -2.0],
    "goal": [2.5, -0.6, 1.5, 0.5, 2.0, 2.4],
    "grid": 6,
    "free": True,
}


def ur5(tmp_path, lines=""):
    pytest.importorskip("pinocchio")
    fields = "\n".join(f"{name} = {json.dumps(value)}" for name, value in SWING.items())
    (tmp_path / "arm.toml").write_text(f'kind = "min-time"\n{fields}\n[arm]\nurdf = "{UR5}"\n{lines}\n')
    return load(tmp_path / "arm.toml").problem()


def test_a_urdf_s_speed_limits_hold_unless_the_file_states_others(tmp_path):
    problem = ur5(tmp_path)
    assert problem.arm.velocity == [3.15, 3.15, 3.15, 3.2, 3.2, 3.2]
    straight = problem.coding.encode([[*problem.coding.greatest, LEVELS]])
    speeds = np.abs(problem.decode(straight)["trajectory"]["qd"]).max(axis=0)
    assert np.all(speeds <= problem.arm.limit_of("velocity") * (1 + 1e-6))
    assert problem.evaluate(straight[None])[0] > 5.0 / 3.15
    slow = ur5(tmp_path, "velocity = [1, 1, 1, 1, 1, 1]")
    assert slow.arm.velocity == [1.0] * 6
    assert any(each.startswith("a velocity is 3.") for each in slow.check(problem.decode(straight)).objections)


def test_a_urdf_that_states_no_limit_needs_the_file_to_state_one(tmp_path):
    pytest.importorskip("pinocchio")
    (tmp_path / "lazy.urdf").write_text(
        '<robot name="lazy"><link name="base"/><link name="tip"><inertial><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="hinge" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="0"/></joint></robot>'
    )
    file = tmp_path / "arm.toml"
    text = "kind = 'min-time'\nstart = [0.0]\ngoal = [1.0]\n[arm]\nurdf = 'lazy.urdf'\n"
    file.write_text(text)
    with pytest.raises(
        BadInput, match=r"arm.velocity: expected the URDF to state a limit .* found velocity 0 of 'hinge'"
    ):
        load(file)
    file.write_text(text + "velocity = [2.0]\n")
    assert load(file).problem().arm.velocity == [2.0]
    file.write_text(text.replace("[1.0]", "[1.1]") + "velocity = [2.0]\n")
    with pytest.raises(BadInput, match=r"goal: expected hinge within \[-1.0, 1.0\], found 1.1"):
        load(file).problem()


# The judge ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"velocity": [9.0, 1.0]}, r"a velocity is \d\.\d{4} of its limit, 1 rad/s of joint 2"),
        ({"acceleration": [5.0, 90.0]}, r"an acceleration is \d\.\d{4} of its limit, 5 rad/s² of joint 1"),
        ({"jerk": [1e6, 1e6]}, r"a jerk is without bound, beyond its limit, 1e\+06 rad/s³ of joint 1"),
    ],
)
def test_the_judge_refuses_what_breaks_a_limit_that_the_search_did_not_know(limits, said):
    careless = problem_of()
    solution = careless.decode(genome_of(careless, DIAGONAL))
    (objection,) = problem_of(arm=limits).check(solution).objections
    assert re.fullmatch(said, objection)


def test_the_judge_sees_through_a_smooth_trajectory_that_is_none():
    problem = problem_of(arm={"jerk": [20.0, 20.0]})
    solution = problem.decode(genome_of(problem, DIAGONAL))
    rows = solution["trajectory"]
    assert problem.check(solution).feasible
    quick = [0.5 * t for t in rows["t"]]
    for wrong in (
        spoiled(solution, t=quick) | {"time": quick[-1]},
        spoiled(solution, t=[0.1 + t for t in rows["t"]]) | {"time": 0.1 + solution["time"]},
        spoiled(solution, place=[0.9 * place for place in rows["place"]]),
        spoiled(solution, qdd=[[0.5, 0.5], *rows["qdd"][1:]]),
        spoiled(solution, t=rows["t"][:-2] + rows["t"][-1:] * 2),
    ):
        assert problem.check(wrong).objections
    strict = problem_of(arm={"jerk": [20.0, 16.0]})
    assert any(each.startswith("a jerk is 1.2") for each in strict.check(solution).objections)
    with pytest.raises(BadInput, match=r"trajectory.place: expected \d+ numbers, found 1"):
        problem.check(spoiled(solution, place=[0.0]))
