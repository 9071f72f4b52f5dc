"""The clearance of sphere-path: of a path among spheres, and of a vehicle in its world."""

import itertools
import json

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems import ProblemFile, Run
from problems.plane import CONTACT
from problems.sphere_path import SpherePath, making
from problems.sphere_path.vehicle import packed

CLEARANCE = 0.15
TURN = [-np.pi, np.pi]
DOOR = [
    {"shape": "box", "center": [2.0, 0.6], "size": [0.3, 1.2]},
    {"shape": "polygon", "vertices": [[1.8, 2.4], [2.2, 2.4], [2.2, 4.0], [1.8, 4.0]]},
    {"shape": "circle", "center": [3.2, 2.9], "radius": 0.25},
]
SOLIDS = [
    shapely.box(1.85, 0.0, 2.15, 1.2),
    shapely.Polygon([[1.8, 2.4], [2.2, 2.4], [2.2, 4.0], [1.8, 4.0]]),
    shapely.Point(3.2, 2.9).buffer(0.25, quad_segs=2048),
]
BODY = [[-0.5, -0.15], [0.5, -0.15], [0.5, 0.15], [-0.5, 0.15]]


def made(**fields):
    return SpherePath.model_validate_json(json.dumps({"kind": "sphere-path"} | fields), strict=True)


def among_spheres(**fields):
    base = {"start": [1.0, 1.0], "goal": [9.0, 9.0], "bounds": [[0.0, 10.0]] * 2, "nodes": 3}
    return made(**(base | {"spheres": [[5.0, 5.0, 2.0], [7.0, 3.0, 1.5]]} | fields))


def disc(**fields):
    base = {"start": [0.8, 1.8], "goal": [3.5, 1.0], "bounds": [[0.0, 4.0]] * 2, "nodes": 3, "accuracy": 0.1}
    return made(**(base | {"vehicle": {"radius": 0.25}, "obstacles": DOOR} | fields))


def cart(**fields):
    base = {
        "start": [0.8, 1.8, 0.0],
        "goal": [3.4, 1.0, 1.0],
        "bounds": [[0.0, 4.0], [0.0, 4.0], TURN],
        "periodic": [False, False, True],
        "vehicle": {"vertices": BODY},
        "accuracy": 0.2,
        "nodes": 4,
    }
    return disc(**(base | fields))


def cube(centre, size):
    """The twelve triangles of a box."""
    corners = np.array(list(itertools.product([-0.5, 0.5], repeat=3))) * size + centre
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([corners[[a, b, c]] for quad in quads for a, b, c in (quad[:3], (quad[0], *quad[2:]))])


def ball(**fields):
    """A ball beside a cube of side 2 around the middle of a room."""
    base = {"start": [1.0, 1.0, 1.0], "goal": [4.0, 4.2, 4.0], "bounds": [[0.0, 5.0]] * 3, "nodes": 3, "accuracy": 0.4}
    mesh = {"packed": packed(cube(np.full(3, 2.5), np.full(3, 2.0)))}
    return made(**(base | {"vehicle": {"radius": 0.25}, "mesh": mesh} | fields))


def gap_of(problem, configuration):
    """Between a vehicle and its obstacles, m, by shapes of the test's own."""
    if problem.mesh is not None:
        away = np.maximum(np.abs(np.array(configuration) - 2.5) - 1.0, 0.0)
        return float(np.linalg.norm(away)) - 0.25
    if problem.vehicle.radius is not None:
        return min(shapely.Point(configuration).distance(solid) for solid in SOLIDS) - 0.25
    angle = configuration[2]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    body = shapely.Polygon(np.array(BODY) @ turn.T + configuration[:2])
    return min(body.distance(solid) for solid in SOLIDS)


def least_of(problem, path, samples=300):
    shares = np.linspace(0.0, 1.0, samples)[:, None]
    rows = [begin + shares * (np.array(end) - begin) for begin, end in itertools.pairwise(np.array(path))]
    return min(gap_of(problem, row) for row in np.concatenate(rows))


def champion(problem, seed):
    plan = Plan(problem.for_recipe("tuned", 1), Run(seed=seed, topology="torus 8x8"))
    best = simulate(plan)[0].champion
    return best.fitness, plan.problem.decode(np.frombuffer(best.genome, np.uint8))


# Spheres --------------------------------------------------------------------------------------------------------------
@settings(max_examples=15, deadline=None)
@given(st.integers(2, 7), st.booleans(), st.floats(0.01, 0.4), st.integers(0, 1 << 30))
def test_a_clearance_is_as_if_spheres_were_larger_by_it(axes, is_periodic, clearance, seed):
    draws = np.random.default_rng(seed)
    spheres = np.column_stack([draws.uniform(2, 8, (12, axes)), draws.uniform(0.2, 1.0, 12)])
    fields = {"start": [0.2] * axes, "goal": [9.8] * axes, "bounds": [[0.0, 10.0]] * axes}
    fields["periodic"] = [is_periodic, False] + [is_periodic] * (axes > 2) + [False] * (axes - 3)
    kept = among_spheres(**fields, spheres=spheres.tolist(), clearance=clearance)
    spheres[:, -1] += clearance
    larger = among_spheres(**fields, spheres=spheres.tolist())
    genomes = kept.coding.random(Keys(np.arange(1), np.uint64(seed), 0), 40)[0]
    np.testing.assert_array_equal(kept.evaluate(genomes), larger.evaluate(genomes))
    for genome, fitness in zip(genomes[:6], kept.evaluate(genomes), strict=False):
        verdict = kept.check(kept.decode(genome))
        least = verdict.clearance.least
        assert verdict.fitness == fitness
        assert verdict.feasible == (fitness == 0.0) == (least >= clearance - CONTACT)
        assert least == pytest.approx(larger.check(larger.decode(genome)).clearance.least + clearance, abs=1e-9)


def test_the_least_clearance_among_spheres_is_that_of_shapely():
    problem = among_spheres(clearance=0.1)
    discs = [shapely.Point(5.0, 5.0), shapely.Point(7.0, 3.0)]
    for genome in problem.coding.random(Keys(np.arange(1), np.uint64(5), 0), 60)[0]:
        solution = problem.decode(genome)
        line = shapely.LineString(solution["path"])
        gaps = [line.distance(disc) - radius for disc, radius in zip(discs, (2.0, 1.5), strict=True)]
        clearance = problem.check(solution).clearance
        assert clearance.least == pytest.approx(min(gaps), abs=1e-9)
        assert clearance.where["sphere"] == int(np.argmin(gaps))
        segment = shapely.LineString(solution["path"][clearance.where["segment"] - 1 : clearance.where["segment"] + 1])
        assert segment.distance(discs[clearance.where["sphere"]]) == pytest.approx(
            line.distance(discs[np.argmin(gaps)])
        )
        assert clearance.unit == ""


def test_a_random_world_is_made_with_the_clearance_at_least():
    fields = {"spheres": None, "nodes": 3}
    random = {"seed": 4, "count": 40, "radius": [0.3, 1.5], "corridor": 2, "clearance": 0.3}
    problem = among_spheres(**fields, random=random, clearance=0.3)
    told = problem.oracle()
    verdict = problem.check(told.solution)
    assert (verdict.feasible, verdict.clearance.least >= 0.3 - 1e-9) == (True, True)
    with pytest.raises(ValidationError, match=r"random\.clearance: expected at least clearance, 0\.31, .* found 0\.3"):
        among_spheres(**fields, random=random, clearance=0.31)


def test_the_oracle_proves_no_way_that_comes_nearer_than_the_clearance():
    past = {"start": [1.0, 7.2], "goal": [9.0, 7.2], "spheres": [[5.0, 5.0, 2.0]]}
    assert among_spheres(**past, clearance=0.2).oracle().figures["length"] == 8.0
    around = among_spheres(**past, clearance=0.5, length_weight=0.5).oracle()
    assert around.meaning == "lower bound"
    assert around.figures["length"] > 8.0
    larger = among_spheres(**past | {"spheres": [[5.0, 5.0, 2.5]]}, length_weight=0.5).oracle()
    assert around.fitness == pytest.approx(larger.fitness)
    # An end as far away as the clearance is free, whatever rounding makes of it.
    touching = {"start": [2.8, 5.0], "goal": [7.3, 5.0], "spheres": [[5.0, 5.0, 1.9]]}
    assert among_spheres(**touching, clearance=0.3).oracle().figures["length"] > 4.5


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"clearance": -0.1}, "clearance"),
        ({"clearance": 4.0}, r"start: .* nearer than the clearance 4 to spheres\[0\]"),
        ({"clearance": 0.1, "start": [5.0, 4.0]}, r"start: .* in spheres\[0\]"),
        (
            {"clearance": 3.5, "periodic": [True, True], "start": [0.1, 9.9]},
            r"spheres\[0\]: .* half a period, 5 less the clearance 3.5, found 2",
        ),
    ],
)
def test_what_leaves_no_room_for_the_clearance_is_refused(change, complaint):
    with pytest.raises(ValidationError, match=complaint):
        among_spheres(**change)


# Vehicles -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("make", [disc, cart, ball])
def test_what_comes_nearer_than_the_clearance_is_in_a_sphere_and_little_else(make):
    problem = make(clearance=CLEARANCE)
    low, high = problem.space.bounds.T
    spheres, ways = problem.forbidden_spheres, np.sqrt(1 + np.count_nonzero(problem.space.scale != 1.0))
    free = 0
    for configuration in np.random.default_rng(3).uniform(low, high, (400, len(low))):
        place = configuration * problem.space.scale
        inside = bool((spheres[:, -1] > problem.space.clearances(place[None], spheres[:, :-1])).any())
        gap = gap_of(problem, configuration)
        if gap < CLEARANCE - 1e-6:
            assert inside
        elif gap > CLEARANCE + problem.accuracy * ways + 1e-6:
            assert not inside
            free += 1
    assert free > 20


@pytest.mark.parametrize("make", [disc, cart, ball])
def test_a_vehicle_keeps_its_clearance_and_the_check_measures_it(make):
    problem = make(clearance=CLEARANCE)
    for seed in (1, 2):
        fitness, solution = champion(problem, seed)
        assert fitness == 0.0
        verdict = problem.check(json.loads(json.dumps(solution)))
        assert verdict.objections == ()
        least = least_of(problem, solution["path"])
        assert least >= CLEARANCE - 1e-6
        assert verdict.clearance.least == pytest.approx(least, abs=2e-3 * problem.vehicle.reach + 1e-3)
        assert verdict.clearance.least >= CLEARANCE - 1e-6
        where = verdict.clearance.where
        assert gap_of(problem, where["configuration"]) == pytest.approx(verdict.clearance.least, abs=1e-3)
        assert where["obstacle"] == "mesh" or where["obstacle"] in range(3)


def test_check_refuses_a_vehicle_that_comes_nearer_than_the_clearance():
    straight = {"path": [[0.8, 1.8], [3.5, 1.5]], "crossed": 0, "length": float(np.hypot(2.7, 0.3))}
    fields = {"start": straight["path"][0], "goal": straight["path"][1], "accuracy": 0.05}
    exact = least_of(disc(**fields), straight["path"], 4000)
    assert disc(**fields, clearance=exact - 0.01).check(straight).clearance.least == pytest.approx(exact, abs=3e-4)
    near = disc(**fields, clearance=exact + 1e-3)
    (objection,) = (each for each in near.check(straight).objections if "spheres" not in each)
    assert objection.startswith("segment 1 of the path: the vehicle meets an obstacle, or comes nearer to one than")


def test_a_collision_has_no_clearance_and_where_nothing_is_there_is_none():
    through = {"path": [[0.8, 1.8], [2.0, 0.6], [3.5, 1.0]], "crossed": 0, "length": 1.0}
    clearance = disc().check(through).clearance
    assert (clearance.least, clearance.where["obstacle"], clearance.unit) == (0.0, 0, "m")
    alone = disc(obstacles=[], clearance=1.0)
    assert alone.check(alone.oracle().solution).clearance.least == np.inf


def test_an_end_nearer_than_the_clearance_and_one_that_accuracy_blocks_are_told_apart():
    near = {"start": [1.5, 1.9], "accuracy": 0.05}  # 0.1 m from the box
    with pytest.raises(ValidationError, match=r"start: .* m from an obstacle, no more than the clearance 0\.4"):
        disc(**near, clearance=0.4)
    with pytest.raises(ValidationError, match=r"start: .* `accuracy` to what the clearance 0\.3 forbids, though"):
        disc(**near | {"accuracy": 0.4}, clearance=0.3)


def test_another_clearance_makes_other_spheres(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    fields = disc().model_dump(mode="json", exclude_unset=True)
    before = ProblemFile("disc", SpherePath.derive_fields(fields), Run(), tmp_path)
    after = before.changed({"clearance": 0.1}, {})
    assert after.fields["hierarchy"] == disc(clearance=0.1).cells_code != before.fields["hierarchy"]
    assert len(list(making.folder().iterdir())) == 2
    assert before.fields["hierarchy_of"] == SpherePath.derive_fields(fields | {"clearance": 0.0})["hierarchy_of"]
