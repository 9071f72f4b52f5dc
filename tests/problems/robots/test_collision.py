import itertools
from dataclasses import replace

import numpy as np
import pytest
from robot_scenes import Rival, boxes_arm, random_configurations, random_scene, random_solids

from problems.robots.arm import BOX, SPHERE, Scene
from problems.robots.collision import Collisions

ACCURACY = 1e-5  # m, of coal's distances


def both(seed, configurations=60, **options):
    rng = np.random.default_rng(seed)
    scene, halves = random_scene(rng, **options)
    return scene, Collisions(scene), Rival(scene, halves), random_configurations(rng, scene, configurations)


@pytest.mark.parametrize("seed", range(12))
def test_verdicts_and_gaps_are_those_of_coal(seed):
    pytest.importorskip("coal")
    _, collisions, rival, qs = both(seed)
    for q, free in zip(qs, collisions.are_free(qs), strict=True):
        expected, found = rival.gap(collisions.frames(q)), collisions.gap(q, 0.5)
        if expected > ACCURACY:
            assert free
            assert found == pytest.approx(min(expected, 0.5), abs=ACCURACY)
        elif expected < -ACCURACY:
            assert not free
            assert found == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_clearance_is_kept(seed):
    pytest.importorskip("coal")
    _, collisions, rival, qs = both(seed, clearance=0.05)
    for q, free in zip(qs, collisions.are_free(qs), strict=True):
        expected = rival.gap(collisions.frames(q))
        if abs(expected - 0.05) > ACCURACY:
            assert free == (expected > 0.05)


def test_the_greater_the_clearance_the_fewer_configurations_are_free():
    rng = np.random.default_rng(5)
    scene, _ = random_scene(rng)
    qs = random_configurations(rng, scene, 500)
    freedoms = [Collisions(scene.with_clearance(each)).are_free(qs) for each in (0.0, 0.01, 0.03, 0.1)]
    for less, more in itertools.pairwise(freedoms):
        assert (less | ~more).all()
    assert freedoms[0].sum() > freedoms[-1].sum()


@pytest.mark.parametrize("kind", [BOX, SPHERE])
def test_what_a_link_encloses_is_in_contact_with_it(kind):
    rng = np.random.default_rng(1)
    arm, halves = boxes_arm(rng, 2)
    frames = Collisions(Scene(arm, np.empty((0, 16)), (), 0.0)).frames([0.3, 0.1])
    small = 0.2 * halves[2].min()
    solid = np.array([[kind, *np.eye(3).ravel(), *frames[2].reshape(3, 4)[:, 3], small, small, small]])
    collisions = Collisions(Scene(arm, solid, ("pea",), 0.0))
    assert not collisions.is_free([0.3, 0.1])
    assert collisions.gap([0.3, 0.1]) == 0.0


def test_a_link_within_another_is_in_contact_with_it():
    rng = np.random.default_rng(2)
    arm, halves = boxes_arm(rng, 2)
    shifted = arm.placements.copy()
    shifted[1:, 3::4] = 0.0
    # The last piece's tree shrinks to a fraction of the first one's size.
    scale = 0.1 * halves[0].min() / np.linalg.norm(halves[2])
    spheres, triangles = arm.spheres.copy(), arm.triangles.copy()
    spheres[arm.piece_root[2] :] *= scale
    triangles[2 * len(triangles) // 3 :] *= scale
    arm = replace(arm, placements=shifted, triangles=triangles, spheres=spheres)
    assert not Collisions(Scene(arm, np.empty((0, 16)), (), 0.0)).is_free([0.0, 0.0])


@pytest.mark.parametrize("seed", range(6))
def test_a_segment_called_free_has_no_contact(seed):
    pytest.importorskip("coal")
    _, collisions, rival, qs = both(seed, configurations=40, solids=3)
    free = collisions.are_ways_free(qs[:-1], qs[1:])
    assert (free == collisions.are_ways_free(qs[1:], qs[:-1])).all()
    ends = collisions.are_free(qs)
    assert (~free | (ends[:-1] & ends[1:])).all()
    for a, b in [pair for pair, is_free in zip(itertools.pairwise(qs), free, strict=True) if is_free][:4]:
        for share in np.linspace(0, 1, 250):
            assert rival.gap(collisions.frames(a + share * (b - a))) > -ACCURACY


def test_a_segment_that_is_free_by_far_is_proven_free():
    proven = wide = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene, _ = random_scene(rng, solids=3)
        collisions, qs = Collisions(scene), random_configurations(rng, scene, 40)
        for a, b in itertools.pairwise(qs):
            if min(collisions.gap(a + share * (b - a)) for share in np.linspace(0, 1, 100)) > 0.03:
                wide += 1
                proven += collisions.is_way_free(a, b)
    assert wide > 5
    assert proven == wide


def test_a_segment_without_length_is_as_free_as_its_ends():
    rng = np.random.default_rng(8)
    scene, _ = random_scene(rng)
    collisions, qs = Collisions(scene), random_configurations(rng, scene, 200)
    assert (collisions.are_ways_free(qs, qs) == collisions.are_free(qs)).all()


def test_a_scene_without_obstacles_or_pairs_is_free():
    rng = np.random.default_rng(9)
    arm, _ = boxes_arm(rng, 3)
    arm = replace(arm, pairs=np.empty((0, 2), np.int64))
    collisions = Collisions(Scene(arm, np.empty((0, 16)), (), 0.0))
    assert collisions.is_free([0.0, 0.0, 0.0])
    assert collisions.is_way_free([0.0, 0.0, 0.0], [1.0, 1.0, 0.1])
    assert collisions.gap([0.0, 0.0, 0.0], 0.7) == 0.7
    with pytest.raises(ValueError, match="expected configurations of 3 numbers, found 2"):
        collisions.is_free([0.0, 0.0])


def test_hundreds_of_solids_are_all_tested():
    rng = np.random.default_rng(10)
    arm, _ = boxes_arm(rng, 3)
    solids = random_solids(rng, 300)
    qs = rng.uniform(-1, 1, (100, 3)) * [2, 2, 0.2]
    together = Collisions(Scene(arm, solids, (), 0.0)).are_free(qs)
    parts = [Collisions(Scene(arm, solids[part : part + 50], (), 0.0)).are_free(qs) for part in range(0, 300, 50)]
    assert (together == np.all(parts, axis=0)).all()
