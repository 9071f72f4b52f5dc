"""Robots that no kernel or example was made for: from a URDF to a pose, and to a path among boxes."""

import numpy as np
import pytest

import supernode
from problems.robots.collision import Collisions
from problems.robots.verifying import proof_of

ROBOTS = {
    "kinova": ({"group": "end_effector"}, "j2s6s200_end_effector"),
    "xarm7": ({}, "link7"),
    "talos_left_arm": ({"joints": [f"arm_left_{number}_joint" for number in range(2, 8)]}, "arm_left_7_link"),
    "solo12": ({"joints": ["FL_HAA", "FL_HFE", "FL_KFE"]}, "FL_FOOT"),
    "tiago": ({"joints": [f"arm_{number}_joint" for number in range(1, 8)]}, "arm_7_link"),
}


@pytest.fixture(scope="module", params=ROBOTS)
def cluttered(request):
    """Return a robot, the pose of a link at the goal, two free configurations, and two boxes where the link can be."""
    pytest.importorskip("pinocchio")
    chosen, link = ROBOTS[request.param]
    robot = supernode.load_robot(request.param, **chosen)
    pose = {"link": link, "position": [0.3, 0.0, 0.3]}
    empty = supernode.RobotIk(robot=robot, goal_pose=pose)
    scene, proof = empty.scene, proof_of(empty)
    low, high = np.clip(scene.arm.limits, -3.1, 3.1).T
    rng, free = np.random.default_rng(3), Collisions(scene)
    start = next(q for q in rng.uniform(low, high, (1000, len(low))) if free.is_free(q))
    steps = rng.normal(size=(1000, len(low))) * 0.3
    goal = next(q for q in np.clip(start + steps, low, high) if free.is_way_free(start, q))
    boxes = []
    for q in rng.uniform(low, high, (40, len(low))):
        box = supernode.Box(id=f"box {len(boxes)}", size=[0.05] * 3, position=proof.pose(q, link)[:3, 3])
        among = Collisions(supernode.RobotIk(robot=robot, goal_pose=pose, obstacles=[*boxes, box]).scene)
        if among.is_free(start) and among.is_free(goal):
            boxes.append(box)
        if len(boxes) == 2:
            break
    return robot, {"link": link, "position": proof.pose(goal, link)[:3, 3]}, start, goal, boxes


def test_it_reaches_a_position_among_boxes(cluttered):
    robot, goal_pose, *_, boxes = cluttered
    problem = supernode.RobotIk(robot=robot, goal_pose=goal_pose, obstacles=boxes)
    result = supernode.simulate(problem, torus="2x2", generations=300)
    assert result.status == "solved"
    assert problem.check(result.solution).feasible


def test_it_finds_a_path_among_boxes(cluttered):
    robot, _, start, goal, boxes = cluttered
    problem = supernode.RobotPath(robot=robot, start=start, goal=goal, obstacles=boxes)
    result = supernode.simulate(problem, torus="1x2", generations=3)
    assert problem.check(result.solution).feasible
    assert len(boxes) == 2
