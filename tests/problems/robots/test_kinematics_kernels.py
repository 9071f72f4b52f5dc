import numpy as np
import pytest
from robot_scenes import placement, random_configurations, random_scene, rotation

from genetics.operators import pointers
from lowlevel.compiled import kernel
from problems.robots.collision import Collisions
from problems.robots.kinematics_kernels import make_step_room, place, point_jacobian, step_towards
from problems.robots.scene_kernels import scene_of

POSE = placement(np.eye(3), [0.1, -0.05, 0.2])


@kernel("void(float64[::1], int64, float64[::1], float64[:,::1], int64[:,::1])")
def jacobian_of(q, body, point, jacobian, table):
    scene = scene_of(table, 0)
    frames = np.empty((scene.kinds.size, 12))
    place(scene, q, frames)
    point_jacobian(scene, frames, body, point, jacobian)


@kernel("void(float64[::1], int64, float64[::1], float64[::1], float64, int64, float64[::1], int64[:,::1])")
def approach(q, body, pose, target, angle_weight, steps, left, table):
    scene = scene_of(table, 0)
    frames = np.empty((scene.kinds.size, 12))
    place(scene, q, frames)
    room = make_step_room(scene)
    for _ in range(steps):
        left[0], left[1] = step_towards(scene, q, frames, body, pose, target, angle_weight, 0.02, 0.3, room)


def table_of(scene):
    kept = [
        np.require(np.atleast_2d(each), np.float64 if each.dtype.kind == "f" else np.int64, ["C", "W"])
        for each in scene.arrays()
    ]
    return pointers(*kept), kept


def world(frame, pose):
    """A pose in a frame, as 4×4 matrices would have it."""
    one, other = (np.vstack([each.reshape(3, 4), [0, 0, 0, 1]]) for each in (frame, pose))
    return (one @ other)[:3].ravel()


@pytest.mark.parametrize("seed", range(5))
def test_placements_are_products_of_matrices(seed):
    rng = np.random.default_rng(seed)
    scene, _ = random_scene(rng)
    q = random_configurations(rng, scene, 1)[0]
    arm, frames = scene.arm, Collisions(scene).frames(q)
    for body in range(1, len(arm.kinds)):
        value, axis = q[arm.variables[body]], arm.axes[body]
        if arm.kinds[body] == 1:
            cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
            motion = placement(np.eye(3) + np.sin(value) * cross + (1 - np.cos(value)) * cross @ cross, np.zeros(3))
        else:
            motion = placement(np.eye(3), value * axis)
        expected = world(world(frames[arm.parents[body]], arm.placements[body]), motion)
        np.testing.assert_allclose(frames[body], expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_jacobian_is_the_derivative_of_a_pose(seed):
    rng = np.random.default_rng(seed)
    scene, _ = random_scene(rng)
    table, _kept = table_of(scene)
    q, collisions = random_configurations(rng, scene, 1)[0], Collisions(scene)
    body = len(scene.arm.kinds) - 1
    pose = world(collisions.frames(q)[body], POSE).reshape(3, 4)
    jacobian = np.empty((6, len(q)))
    jacobian_of(q, body, pose[:, 3].copy(), jacobian, table)
    for variable in range(len(q)):
        step = np.zeros(len(q))
        step[variable] = 1e-6
        later, sooner = (world(collisions.frames(each)[body], POSE).reshape(3, 4) for each in (q + step, q - step))
        slope = (later - sooner) / 2e-6
        turning = slope[:, :3] @ pose[:, :3].T
        np.testing.assert_allclose(jacobian[:3, variable], slope[:, 3], atol=1e-8)
        np.testing.assert_allclose(
            jacobian[3:, variable], [turning[2, 1], turning[0, 2], turning[1, 0]], atol=1e-8
        )  # fmt: skip


def test_steps_reach_a_pose_nearby_and_stay_within_limits():
    reached = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        scene, _ = random_scene(rng, joints=7)
        table, _kept = table_of(scene)
        low, high = scene.arm.limits.T
        goal = rng.uniform(low * 0.7, high * 0.7)
        target = world(Collisions(scene).frames(goal)[-1], POSE)
        q, left = np.clip(goal + rng.normal(size=7) * 0.1, low, high), np.empty(2)
        approach(q, 7, POSE, target, 0.3, 100, left, table)
        assert (q >= low).all()
        assert (q <= high).all()
        reached += left[0] < 1e-6 and left[1] < 1e-6
    assert reached >= 18


def test_steps_towards_a_position_leave_the_angle_alone():
    rng = np.random.default_rng(3)
    scene, _ = random_scene(rng, joints=6)
    table, _kept = table_of(scene)
    goal = random_configurations(rng, scene, 1)[0] * 0.5
    target = world(Collisions(scene).frames(goal)[-1], POSE)
    target = placement(rotation(rng), target.reshape(3, 4)[:, 3])
    q, left = goal + 0.1, np.empty(2)
    approach(q, 6, POSE, target, 0.0, 200, left, table)
    assert left[0] < 1e-6
