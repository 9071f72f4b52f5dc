import numpy as np
import pytest
from robot_scenes import random_configurations, random_scene

from genetics.operators import pointers
from lowlevel.compiled import kernel
from problems.robots.collision import Collisions
from problems.robots.collision_kernels import gap, is_free
from problems.robots.kinematics_kernels import place
from problems.robots.scene_kernels import SCENE_PARTS, scene_of


@kernel("boolean(float64[::1], float64[::1], int64[:,::1])")
def keeps(q, margins, table):
    scene = scene_of(table, 0)
    frames = np.empty((scene.kinds.size, 12))
    place(scene, q, frames)
    return is_free(scene, frames, margins)


@kernel("float64(float64[::1], float64, int64[:,::1])")
def gap_of(q, most, table):
    scene = scene_of(table, 0)
    frames = np.empty((scene.kinds.size, 12))
    place(scene, q, frames)
    return gap(scene, frames, most)


def tabled(scene):
    kept = [
        np.require(np.atleast_2d(each), np.float64 if each.dtype.kind == "f" else np.int64, ["C", "W"])
        for each in scene.arrays()
    ]
    assert len(kept) == SCENE_PARTS
    return pointers(*kept), kept


@pytest.mark.parametrize("seed", range(4))
def test_margins_are_kept_from_solids_and_twice_between_pieces(seed):
    rng = np.random.default_rng(seed)
    scene, _ = random_scene(rng)
    table, _kept = tabled(scene)
    bodies, collisions = len(scene.arm.kinds), Collisions(scene)
    for q in random_configurations(rng, scene, 200):
        distance = gap_of(q, 1.0, table)
        assert distance == collisions.gap(q)
        verdicts = [keeps(q, np.full(bodies, margin), table) for margin in (0.0, 0.01, 0.02, 0.05, 0.1, 0.3)]
        assert verdicts == sorted(verdicts, reverse=True)
        if distance > 2e-5:
            assert keeps(q, np.full(bodies, 0.5 * distance - 5e-6), table)
            assert not keeps(q, np.full(bodies, distance + 5e-6), table)
        else:
            assert not any(verdicts)


def test_a_margin_of_one_body_concerns_that_body_alone():
    rng = np.random.default_rng(4)
    scene, _ = random_scene(rng)
    table, _kept = tabled(scene)
    bodies = len(scene.arm.kinds)
    for q in random_configurations(rng, scene, 200):
        each = [keeps(q, 0.04 * (np.arange(bodies) == body), table) for body in range(bodies)]
        if keeps(q, np.full(bodies, 0.04), table):
            assert all(each)
        if any(each):
            assert keeps(q, np.zeros(bodies), table)
