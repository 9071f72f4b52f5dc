"""The sphere-path planner: its file, its paths, its spheres, its judge, its oracle and its pictures."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from scipy import optimize

from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run, load
from problems.file import parse
from problems.plane import CONTACT
from problems.sphere_path import SpherePath, cells
from problems.sphere_path.floor import in_the_plane
from problems.sphere_path.hierarchy import TOGETHER, hierarchy_of
from problems.sphere_path.oracle import around
from problems.sphere_path.pose import rotations
from problems.sphere_path.random_world import corridor_of
from problems.sphere_path.solid import in_space, signed_distances
from problems.sphere_path.space import Space, length_of
from problems.sphere_path.vehicle import packed, unpacked
from problems.sphere_path.world import World
from spy.past import best_known

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TURN = [-np.pi, np.pi]
CART = {"vertices": [[-0.6, -0.2], [0.6, -0.2], [0.6, 0.2], [-0.6, 0.2]]}
DOOR = [
    {"shape": "box", "center": [2.0, 0.6], "size": [0.3, 1.4]},
    {"shape": "polygon", "vertices": [[1.8, 2.4], [2.2, 2.4], [2.2, 4.0], [1.8, 4.0]]},
    {"shape": "circle", "center": [3.2, 2.9], "radius": 0.25},
]


def made(**fields):
    """Two spheres between start and goal, unless told otherwise."""
    base = {
        "kind": "sphere-path",
        "start": [1.0, 1.0],
        "goal": [9.0, 9.0],
        "bounds": [[0.0, 10.0]] * len(fields.get("start", [1.0, 1.0])),
        "nodes": 3,
    }
    if not {"spheres", "random", "vehicle"} & fields.keys():
        base["spheres"] = [[5.0, 5.0, 2.0], [7.0, 3.0, 1.5]]
    return SpherePath.model_validate_json(json.dumps(base | fields), strict=True)


def cart(**fields):
    base = {
        "start": [0.8, 1.8, 0.0],
        "goal": [3.5, 1.0, 1.0],
        "bounds": [[0.0, 4.0], [0.0, 4.0], TURN],
        "periodic": [False, False, True],
        "vehicle": CART,
        "obstacles": DOOR,
        "accuracy": 0.25,
    }
    return made(**(base | fields))


def crowd(axes, count=60, periodic=None, **fields):
    places = {"start": [0.5] * axes, "goal": [9.5] * axes}
    random = {"seed": axes, "count": count, "radius": [0.5, 3.0]}
    return made(**places, random=random, periodic=periodic or [False] * axes, **fields)


def some_genomes(problem, count=200, seed=1):
    return problem.coding.random(Keys(np.arange(1), np.uint64(seed), 0), count)[0]


def box(centre, size):
    """The twelve triangles of a box."""
    corners = np.array(list(itertools.product([-0.5, 0.5], repeat=3))) * size + centre
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([corners[[a, b, c]] for quad in quads for a, b, c in (quad[:3], (quad[0], *quad[2:]))])


def frame():
    """A wall across x = 2 with a window in it."""
    walls = [
        ([2, 2, 0.5], [0.4, 4, 1]),
        ([2, 2, 3.5], [0.4, 4, 1]),
        ([2, 0.6, 2], [0.4, 1.2, 2]),
        ([2, 3.4, 2], [0.4, 1.2, 2]),
    ]
    return np.concatenate([box(np.array(centre), np.array(size)) for centre, size in walls])


def window(vehicle, **fields):
    base = {
        "start": [0.7, 2.0, 0.9],
        "goal": [3.3, 2.0, 3.0],
        "bounds": [[0.0, 4.0]] * 3,
        "vehicle": vehicle,
        "mesh": {"packed": packed(frame())},
        "accuracy": 0.2,
    }
    return made(**(base | fields))


# Fitness --------------------------------------------------------------------------------------------------------------
def brute_crossed(problem, path):
    """By so many points on the path that no sphere is missed by more than a millionth, of the nearest image."""
    space, crossed = problem.space, 0
    shifts = list(itertools.product(*[(-1, 0, 1) if periodic else (0,) for periodic in space.periodic]))
    for *centre, radius in problem.obstacle_spheres:
        nearest = np.inf
        for begin, end in itertools.pairwise(path):
            for shift in shifts:
                image = (
                    centre
                    + shift * space.periods
                    + space.periods * np.round((begin - centre) / np.where(space.periodic, space.span, 1.0))
                )
                found = optimize.minimize_scalar(
                    lambda t, a=begin, b=end, c=image: np.linalg.norm(a + t * (b - a) - c),
                    bounds=(0, 1),
                    method="bounded",
                    options={"xatol": 1e-12},
                )
                nearest = min(nearest, found.fun, np.linalg.norm(begin - image), np.linalg.norm(end - image))
        assert abs(nearest - radius) > 1e-6, "too near to say"
        crossed += nearest < radius
    return crossed


@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True)])
def test_fitness_is_the_number_of_spheres_crossed_each_counted_once(periodic):
    problem = crowd(3, 25, list(periodic))
    genomes = some_genomes(problem, 12)
    for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
        solution = problem.decode(genome)
        assert fitness == solution["crossed"] == brute_crossed(problem, np.array(solution["path"]))


@pytest.mark.parametrize("axes", range(2, 8))
@pytest.mark.parametrize("is_periodic", [False, True])
def test_fitness_and_check_agree_in_any_number_of_dimensions(axes, is_periodic):
    problem = crowd(axes, 60, [is_periodic and axis % 2 == 0 for axis in range(axes)], length_weight=0.5)
    genomes = some_genomes(problem, 40)
    for genome, fitness in zip(genomes, problem.evaluate(genomes), strict=True):
        verdict = problem.check(problem.decode(genome))
        assert verdict.fitness == pytest.approx(fitness, abs=1e-9)
        assert verdict.feasible == (fitness < 1.0)


def test_contact_at_exactly_the_radius_is_free():
    problem = made(
        start=[1.0, 5.0], goal=[9.0, 5.0], spheres=[[5.0, 7.0, 2.0]], bits=1, bounds=[[1.0, 9.0], [5.0, 7.0]]
    )
    genome = problem.coding.encode(np.array([[0, 0] * 3]))
    assert problem.evaluate(genome)[0] == 0.0
    assert problem.check(problem.decode(genome[0])).feasible


def test_along_a_periodic_axis_a_path_goes_the_shorter_way_unwrapped():
    problem = made(
        start=[3.0, 0.0],
        goal=[-3.0, 1.0],
        bounds=[TURN, [0.0, 1.0]],
        periodic=[True, False],
        nodes=1,
        spheres=[[0.0, 0.5, 1.0]],
    )
    places = [problem.decode(genome)["path"] for genome in some_genomes(problem, 50)]
    steps = np.diff(np.array(places)[:, :, 0], axis=1)
    assert np.abs(steps).max() <= np.pi + 1e-12
    assert {round(float(path[-1][0] + 3.0) / (2 * np.pi), 9) for path in places} >= {1.0}
    free = made(
        start=[3.0, 0.0], goal=[-3.0, 1.0], bounds=[TURN, [0.0, 1.0]], periodic=[True, False], spheres=[[0.0, 0.5, 1.0]]
    )
    assert free.oracle().fitness == 0.0


def test_the_length_breaks_ties_only():
    weighed, plain = crowd(4, length_weight=0.9), crowd(4)
    genomes = some_genomes(plain, 300)
    crossed, fitness = plain.evaluate(genomes), weighed.evaluate(genomes)
    assert np.all((fitness >= crossed) & (fitness < crossed + 0.9))
    lengths = np.array([plain.decode(genome)["length"] for genome in genomes])
    straight = np.sqrt(4 * 81.0)
    detours = lengths - straight
    np.testing.assert_allclose(fitness - crossed, 0.9 * detours / (detours + 20.0))
    assert (plain.solved_at, weighed.solved_at) == (0.0, 0.9)


@settings(max_examples=60)
@given(st.integers(2, 7), st.integers(0, 40), st.integers(0, 1 << 30))
def test_bounding_spheres_hold_what_is_in_them_and_each_obstacle_comes_once(axes, count, seed):
    generator = np.random.default_rng(seed)
    obstacles = generator.uniform(0.1, 3.0, (count, axes + 1))
    tree = hierarchy_of(obstacles)
    ends = tree.following == np.arange(len(tree.following)) + 1
    np.testing.assert_array_equal(ends, tree.group >= 0)
    groups = tree.obstacles.reshape(-1, axes + 1, TOGETHER).transpose(0, 2, 1)
    there = groups[:, :, -1] > 0.0
    found = groups[there] ** [*np.ones(axes), 0.5]
    np.testing.assert_allclose(sorted(found.tolist()), sorted(obstacles.tolist()), rtol=1e-15)
    for place, after in enumerate(tree.following):
        held = tree.group[place:after][ends[place:after]]
        members = groups[held][there[held]]
        away = np.linalg.norm(members[:, :-1] - tree.spheres[place, :-1], axis=1)
        assert np.all(away + np.sqrt(members[:, -1]) <= tree.spheres[place, -1])
        assert place < after <= len(tree.following)


# From the vehicle to configuration space ------------------------------------------------------------------------------
def random_configurations(problem, count, seed=3):
    low, high = problem.space.bounds.T
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


VEHICLES = {
    "cart": cart,
    "cart that does not turn": lambda: cart(start=[0.8, 1.8], goal=[3.3, 1.0], bounds=[[0.0, 4.0]] * 2, periodic=None),
    "disc": lambda: cart(
        start=[0.8, 1.8], goal=[3.5, 1.0], bounds=[[0.0, 4.0]] * 2, periodic=None, vehicle={"radius": 0.3}
    ),
    "ball": lambda: window({"radius": 0.3}),
    "plank": lambda: window({"mesh": {"packed": packed(box(np.zeros(3), np.array([0.8, 0.2, 0.2])))}}),
    "plank that turns": lambda: window(
        {"mesh": {"packed": packed(box(np.zeros(3), np.array([0.6, 0.2, 0.2])))}},
        start=[0.7, 2.0, 0.9, 0.0],
        goal=[3.3, 2.0, 3.0, 1.0],
        bounds=[[0.0, 4.0]] * 3 + [TURN],
        periodic=[False] * 3 + [True],
        accuracy=0.5,
    ),
}


@pytest.mark.parametrize("name", VEHICLES)
def test_every_collision_is_in_a_sphere_and_no_sphere_reaches_beyond_the_accuracy(name):
    problem = VEHICLES[name]()
    world, spheres = World(problem), problem.obstacle_spheres
    free = 0
    for configuration in random_configurations(problem, 400):
        place = configuration * problem.space.scale
        depth = spheres[:, -1] - problem.space.clearances(place[None], spheres[:, :-1])
        gap = world.clearance(configuration)
        if gap < -1e-6:
            assert depth.max() > 0.0
        elif depth.max() > 0.0:  # a point moves by the accuracy at most in each of the ways in which it can move
            angles = np.count_nonzero(problem.space.scale != 1.0)
            assert gap <= problem.accuracy * np.sqrt(1 + angles) + 1e-6 or _is_within(problem, configuration)
        else:
            free += 1
    assert free > 20


def _is_within(problem, configuration):
    """Surfaces do not meet, but the vehicle is all within an obstacle."""
    clearance = (
        in_the_plane(problem.vehicle, problem.obstacles)
        if problem.mesh is None
        else in_space(problem.vehicle, problem.mesh.triangles)
    )
    return clearance(configuration[None])[0] == 0.0


def test_the_cells_are_made_once_and_travel_as_a_text(monkeypatch):
    problem = cart()
    assert len(problem.cells_code) < 30_000
    monkeypatch.setattr(cells, "subdivide", None)
    again = made(**problem.model_dump(mode="json", exclude_unset=True) | {"hierarchy": problem.cells_code})
    np.testing.assert_array_equal(again.obstacle_spheres, problem.obstacle_spheres)


def test_when_the_world_moves_its_spheres_are_made_anew(monkeypatch):
    before = ProblemFile("cart", SpherePath.derive_fields(_written(cart())), Run(), Path())
    obstacles = before.fields["obstacles"][:-1]
    after = before.changed({"obstacles": obstacles}, {})
    fresh = SpherePath.derive_fields(_written(cart()) | {"obstacles": obstacles})
    assert after.fields == fresh
    assert len(after.problem().obstacle_spheres) < len(before.problem().obstacle_spheres)
    monkeypatch.setattr(cells, "subdivide", None)  # not needed for an end that moves
    goal = [*before.fields["goal"][:-1], before.fields["goal"][-1] + 0.01]
    assert before.changed({"goal": goal}, {}).fields["hierarchy"] == before.fields["hierarchy"]


def test_without_a_vehicle_there_are_no_spheres_of_its():
    moved = ProblemFile("cart", SpherePath.derive_fields(_written(cart())), Run(), Path())
    spheres = {"vehicle": None, "obstacles": [], "spheres": [[2.0, 2.0, 0.0, 0.1]]}
    assert moved.changed(spheres, {}).problem().obstacle_spheres.shape == (1, 4)


def _written(problem):
    return problem.model_dump(mode="json", exclude_unset=True)


def test_a_recipe_keeps_the_spheres(monkeypatch):
    problem = cart()
    problem.cells_code  # noqa: B018 - makes it
    monkeypatch.setattr(cells, "subdivide", None)
    assert problem.for_recipe("tuned", 1).evaluate(some_genomes(problem)).shape == (200,)


@pytest.mark.parametrize("text", ["", "no base64!", "AAAA", "eJwDAAAAAAE="])
def test_a_code_of_cells_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="expected a code of cells"):
        cart(hierarchy=text)


def test_too_fine_an_accuracy_is_refused(monkeypatch):
    monkeypatch.setattr(cells, "MOST_SPHERES", 2000)
    with pytest.raises(ValueError, match="accuracy: expected one that needs at most"):
        cart(accuracy=0.05)


@pytest.mark.parametrize("accuracy", [0.1, 0.2, 0.3])
def test_an_accuracy_is_refused_only_if_it_needs_more_spheres(monkeypatch, accuracy):
    """What is foreseen while cells are still large is never more than what comes of them."""
    problem = cart(accuracy=accuracy)
    parts = problem.space, 2, accuracy, problem.gaps
    needed = len(problem.forbidden_spheres)
    monkeypatch.setattr(cells, "MOST_SPHERES", needed)
    assert cells.subdivide(*parts) == problem.cells_code
    monkeypatch.setattr(cells, "MOST_SPHERES", needed - 1)
    with pytest.raises(ValueError, match="accuracy: expected one that needs at most"):
        cells.subdivide(*parts)


def test_mesh_files_are_read_once_and_not_needed_again(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    corners = frame().reshape(-1, 3)
    solid = trimesh.Trimesh(corners * 1000.0, np.arange(len(corners)).reshape(-1, 3), process=False)
    texts = []
    for suffix in ("stl", "obj"):
        folder = tmp_path / suffix
        folder.mkdir()
        solid.export(folder / f"wall.{suffix}")
        file = folder / "window.toml"
        file.write_text(
            'kind = "sphere-path"\nstart = [0.7, 2, 0.9]\ngoal = [3.3, 2, 3.0]\nbounds = [[0, 4], [0, 4], [0, 4]]\n'
            f'accuracy = 0.25\nvehicle.radius = 0.3\nmesh = {{file = "wall.{suffix}", unit = 0.001}}\n'
        )
        loaded = load(file)
        (folder / f"wall.{suffix}").unlink()
        again = ProblemFile.from_json(loaded.to_json())
        assert again.sha256 == loaded.sha256
        assert "file" not in again.fields["mesh"]
        problem = again.problem()
        np.testing.assert_allclose(np.sort(problem.mesh.triangles.ravel()), np.sort(frame().ravel()), atol=1e-5)
        texts.append(again.fields["hierarchy"])
    assert len(texts[0]) > 100


def test_worlds_are_compared_by_their_fields_whatever_was_worked_out_of_them():
    one, other = window({"radius": 0.3}), window({"radius": 0.3})
    assert one.mesh.triangles is not other.mesh.triangles
    assert one == other != window({"radius": 0.4})
    assert hash(one.mesh) == hash(other.mesh)
    assert one.mesh != one.mesh.packed


def test_triangles_pack_and_unpack():
    triangles = frame()
    np.testing.assert_allclose(unpacked(packed(triangles)), triangles, atol=1e-6)
    for text in ("", "???", "AAAA", packed(triangles)[:-8]):
        with pytest.raises(ValueError, match="expected packed triangles"):
            unpacked(text)


def test_signed_distances_of_a_box():
    points = np.random.default_rng(1).uniform(-2, 2, (500, 3))
    size = np.array([1.0, 2.0, 0.5])
    beyond = np.abs(points) - size / 2
    expected = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    for triangles in (box(np.zeros(3), size), box(np.zeros(3), size)[:, ::-1]):
        np.testing.assert_allclose(signed_distances(points, np.ascontiguousarray(triangles)), expected, atol=1e-12)


def test_what_is_swallowed_has_no_gap():
    room, crumb = packed(box(np.zeros(3), np.full(3, 4.0))), packed(box(np.zeros(3), np.full(3, 0.2)))
    for inner, outer in ((crumb, room), (room, crumb)):
        problem = window(
            {"mesh": {"packed": inner}},
            start=[9.0] * 3,
            goal=[9.0] * 3,
            bounds=[[-10, 10]] * 3,
            mesh={"packed": outer},
            accuracy=4.0,
        )
        assert in_space(problem.vehicle, problem.mesh.triangles)(np.zeros((1, 3)))[0] == 0.0


def test_rotations_turn_about_axes_that_stand_still():
    roll, pitch, yaw = 0.3, -0.8, 2.0
    turned = rotations(np.array([[roll, pitch, yaw]]), 3)[0]
    about_z = rotations(np.array([[yaw]]), 3)[0]
    np.testing.assert_allclose(about_z @ [1, 0, 0], [np.cos(yaw), np.sin(yaw), 0], atol=1e-15)
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(turned[2], [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    np.testing.assert_allclose(rotations(np.array([[yaw]]), 2)[0], about_z[:2, :2])


def test_the_world_sees_what_a_motion_runs_into():
    world = World(cart())
    assert world.contact(np.array([0.8, 1.8, 0.0]), np.array([0.8, 2.5, 1.0])) is None
    contact = world.contact(np.array([0.8, 3.0, 0.0]), np.array([3.5, 3.0, 0.0]))
    assert contact[0] == pytest.approx(1.2, abs=2e-3)
    assert World(window({"radius": 0.3})).contact(np.array([1.0, 2, 2]), np.array([3.0, 2, 2])) is None
    assert World(window({"radius": 0.9})).contact(np.array([1.0, 2, 2]), np.array([3.0, 2, 2])) is not None


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicles_find_their_way_and_the_world_agrees(name):
    problem = VEHICLES[name]()
    run = Run(topology="torus 4x4", stall=400)
    plan = Plan(problem.for_recipe("tuned", 1), run)
    best = best_known(simulate(plan), "champion")
    verdict = plan.problem.check(plan.problem.decode(np.frombuffer(best.genome, np.uint8)))
    assert (best.fitness, verdict.fitness, verdict.objections) == (0.0, 0.0, ())


# Check ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"path": [[1, 1], [9, 1], [9, 9]]}, None),
        ({"path": [[1, 1], [9, 1], [9, 9]], "crossed": 1}, "crosses 0 spheres, not 1"),
        ({"path": [[1, 1], [9, 1], [9, 9]], "length": 15.0}, "16 long, not 15"),
        ({"path": [[1, 1], [9, 9]], "length": 128**0.5}, "crosses 1 spheres"),
        ({"path": [[1, 2], [9, 1], [9, 9]]}, "starts at [1.0, 2.0], not at [1.0, 1.0]"),
        ({"path": [[1, 1], [9, 1], [9, 8]]}, "ends at [9.0, 8.0], not at [9.0, 9.0]"),
        ({"path": [[1, 1], [11, 1], [9, 9]]}, "row 2 of the path leaves the bounds of axis 1: 11"),
    ],
)
def test_check_says_what_is_wrong(change, complaint):
    verdict = made(spheres=[[5.0, 5.0, 2.0]]).check({"crossed": 0, "length": 16.0} | change)
    if complaint is None:
        assert verdict.objections == ()
    else:
        assert any(complaint in each for each in verdict.objections)


def test_check_finds_a_collision_in_the_world():
    problem = cart()
    path = [[0.8, 1.8, 0.0], [0.8, 3.2, 0.0], [3.5, 3.2, 0.0], [3.5, 1.0, 1.0]]
    places = np.array(path) * problem.space.scale
    verdict = problem.check({"path": path, "crossed": 0, "length": length_of(places)})
    assert any(
        each.startswith("segment 2 of the path: the vehicle meets an obstacle at [1.2") for each in verdict.objections
    )


@pytest.mark.parametrize("periodic", [[False, False, True], None])
def test_check_refuses_a_path_that_turns_for_too_long(periodic):
    path = [[0.8, 1.8, 0.0], [0.8, 3.2, 1e9], [3.5, 1.0, 1.0]]
    with pytest.raises(BadInput, match=r"solution: path: expected at most 103 times .* along axis 3, found 3\.1"):
        cart(periodic=periodic).check({"path": path, "crossed": 0, "length": 1.0})


# Oracle ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("axes", [2, 5])
def test_the_way_around_one_sphere_is_the_limit_of_short_paths(axes):
    generator = np.random.default_rng(axes)
    start, goal = np.zeros(axes), np.full(axes, 4.0)
    centre = np.full(axes, 2.0) + generator.uniform(-0.3, 0.3, axes)
    exact = around(start, goal, centre, 1.5)
    corners = 8

    def penalty(flat):
        path = np.vstack([start, flat.reshape(corners, axes), goal])
        return length_of(path)

    def clear(flat):
        path = np.vstack([start, flat.reshape(corners, axes), goal])
        space = Space(np.tile([-9.0, 9.0], (axes, 1)), np.ones(axes), np.zeros(axes, bool))
        return np.array([space.clearances(path[row : row + 2], centre[None])[0] - 1.5 for row in range(corners + 1)])

    side = generator.normal(size=axes)
    bow = np.sin(np.linspace(0, np.pi, corners + 2)[1:-1])[:, None] * side / np.linalg.norm(side) * 4.0
    first = np.linspace(start, goal, corners + 2)[1:-1] + bow
    found = optimize.minimize(
        penalty, first.ravel(), constraints={"type": "ineq", "fun": clear}, method="SLSQP", options={"maxiter": 300}
    )
    assert exact <= found.fun + 1e-6
    assert found.fun == pytest.approx(exact, rel=1e-2)


def test_the_way_around_one_sphere_in_the_plane_by_hand():
    assert around(np.array([-2.0, 0.0]), np.array([2.0, 0.0]), np.zeros(2), 1.0) == pytest.approx(
        2 * 3**0.5 + np.pi / 3
    )
    assert around(np.array([-2.0, 1.0]), np.array([2.0, 1.0]), np.zeros(2), 1.0) == pytest.approx(4.0)


def test_no_path_is_shorter_than_the_oracle_says():
    problem = made(spheres=[[5.0, 5.0, 3.0]], length_weight=0.9)
    answer = problem.oracle()
    assert answer.meaning == "lower bound"
    fitness = problem.evaluate(some_genomes(problem, 20_000))
    assert answer.fitness < fitness[fitness < 1.0].min()


def test_the_oracle_knows_the_corridor():
    random = {"seed": 5, "count": 200, "radius": [0.5, 2.0], "corridor": 3, "clearance": 0.1}
    problem = made(start=[0.5] * 4, goal=[9.5] * 4, random=random)
    answer = problem.oracle()
    assert (answer.meaning, answer.fitness) == ("optimum", 0.0)
    assert problem.check(answer.solution).objections == ()
    corridor = corridor_of(problem.random, problem.space, *problem.ends)
    spheres = problem.obstacle_spheres
    assert np.all(problem.space.clearances(corridor, spheres[:, :-1]) >= spheres[:, -1] + 0.1 - CONTACT)
    assert len(spheres) == 200


def test_the_straight_way_is_the_best_if_it_is_free():
    answer = made(spheres=[[8.0, 2.0, 1.0]], length_weight=0.5).oracle()
    assert (answer.meaning, answer.fitness, answer.figures["length"]) == ("optimum", 0.0, pytest.approx(128**0.5))


def test_where_nothing_is_known_the_straight_way_is_a_bound():
    answer = made(spheres=[[5.0, 5.0, 2.0], [6.0, 5.0, 2.0]], length_weight=0.5).oracle()
    assert (answer.meaning, answer.fitness, answer.solution) == ("lower bound", 0.0, None)
    assert answer.figures["length"] == pytest.approx(128**0.5)


# Runs -----------------------------------------------------------------------------------------------------------------
def outcome(problem, **run):
    reports = simulate(Plan(problem.for_recipe("tuned", run.get("deme", 1)), Run(**run)))
    return best_known(reports, "champion"), reports[0].generation


def test_start_is_goal():
    best, _ = outcome(made(goal=[1.0, 1.0]))
    assert best.fitness == 0.0
    assert made(goal=[1.0, 1.0]).oracle().fitness == 0.0
    assert made(goal=[1.0, 1.0], length_weight=0.5).evaluate(some_genomes(made())).max() < 2.5


def test_a_walled_goal_ends_as_stalled_with_the_fewest_crossed():
    ring = [[9.0 + np.cos(angle), 9.0 + np.sin(angle), 0.6] for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False)]
    best, generation = outcome(made(bounds=[[0.0, 11.0]] * 2, spheres=ring), stall=50)
    assert 1.0 <= best.fitness <= 3.0
    assert generation >= 50


def test_the_papers_recipe_renews_half_of_an_island():
    recipe = made().recipe("paper", 100)
    assert (recipe.pairing, recipe.renewal, recipe.crossover, recipe.couples(100)) == (
        "better-half",
        0.5,
        "uniform",
        25,
    )
    best, _ = outcome(crowd(3, 10), topology="torus 1x1", deme=100, recipe="paper")
    assert best.fitness == 0.0


# Files ----------------------------------------------------------------------------------------------------------------
HEAD = 'kind = "sphere-path"\nstart = [1, 1]\ngoal = [9, 9]\nbounds = [[0, 10], [0, 10]]\n'
SPACE = 'kind = "sphere-path"\nstart = [1, 1, 1]\ngoal = [9, 9, 9]\nbounds = [[0, 10], [0, 10], [0, 10]]\n'
BAD_FILES = [
    ('kind = "sphere-path"\ngoal = [1, 1]\nbounds = [[0, 1], [0, 1]]', "start: expected this field, found nothing"),
    (HEAD, "expected one of spheres, random and vehicle, found none"),
    (HEAD + "spheres = []\nrandom = {seed = 1, count = 1, radius = [1, 1]}", "found spheres and random"),
    (HEAD.replace("[9, 9]", "[9]") + "spheres = []", "goal: expected at least 2 items"),
    (HEAD.replace("[9, 9]", "[9, 9, 9]") + "spheres = []", "goal: expected 2, as many as start has, found 3"),
    (HEAD.replace("[9, 9]", "[9, 11]") + "spheres = []", "goal[1]: expected 0 to 10, found 11"),
    (HEAD.replace("[1, 1]", "[1, nan]") + "spheres = []", "start[1]: expected"),
    (HEAD.replace("[0, 10]]", "[10, 0]]") + "spheres = []", "bounds[1]: expected least < greatest, found [10"),
    (HEAD + "spheres = [[5, 5]]", "spheres[0]: expected at least 3 items"),
    (HEAD + "spheres = [[5, 5, 5, 1]]", "spheres[0]: expected 2 numbers and a radius, found 4 in all"),
    (HEAD + "spheres = [[5, 5, 0]]", "spheres[0]: expected a radius greater than 0, found 0"),
    (
        HEAD + "spheres = [[5, 5, 1], [1, 2, 1.5]]",
        "start: expected a place clear of all obstacles, found [1.0, 1.0] in spheres[1]",
    ),
    (HEAD + "spheres = [[9, 9, 1]]", "goal: expected a place clear of all obstacles, found [9.0, 9.0] in spheres[0]"),
    (HEAD + "spheres = []\nperiodic = [true]", "periodic: expected 2, as many as start has, found 1"),
    (
        HEAD + "spheres = [[5, 5, 6]]\nperiodic = [true, false]",
        "spheres[0]: expected a radius of at most half a period, 5, found 6",
    ),
    (HEAD + "random = {seed = 1, count = 9, radius = [2, 1]}", "random.radius: expected [least, greatest], found [2"),
    (
        HEAD + "random = {seed = 1, count = 9, radius = [20, 20]}",
        "random.count: expected at most 0, the number that fits, found 9",
    ),
    (
        HEAD + "random = {seed = 1, count = 9, radius = [1, 1], corridor = 9}",
        "random.corridor: expected at most nodes, 4",
    ),
    (HEAD + "spheres = []\nlength_weight = 1.0", "length_weight: expected less than 1, found 1.0"),
    (HEAD + "spheres = []\nnodes = 0", "nodes: expected greater than or equal to 1, found 0"),
    (HEAD + "spheres = []\nradius = 1", "radius: unknown field"),
    (HEAD + "spheres = []\nmesh.packed = ''", "mesh: expected packed triangles, found another text"),
    (
        HEAD + "spheres = []\naccuracy = 0.1\nobstacles = [{shape = 'circle', center = [5, 5], radius = 1}]",
        "vehicle: expected a vehicle, since obstacles or a mesh are given",
    ),
    (HEAD + "[vehicle]", "vehicle: expected one of radius, vertices and mesh, found none"),
    (
        HEAD + "[vehicle]\nradius = 1\nvertices = [[0, 0], [1, 0], [0, 1]]",
        "vehicle: expected one of radius, vertices and mesh, found radius and",
    ),
    (HEAD + "[vehicle]\nvertices = [[0, 0], [1, 0]]", "vehicle.vertices: expected at least 3 vertices, found 2"),
    (SPACE + "[vehicle]\nradius = 1", "start: expected 2 numbers for such a vehicle, found 3"),
    (
        HEAD + "[vehicle]\nradius = 1\n[mesh]\nfile = 'none.stl'",
        "mesh.file: expected a file beside the problem file, found no",
    ),
    (
        SPACE + "[vehicle]\nradius = 1\n[mesh]\nfile = 'none.step'",
        "mesh.file: expected a file that ends in .stl or .obj, found",
    ),
    (SPACE + "[vehicle]\nradius = 1\n[mesh]\nunit = 2", "mesh: expected file or packed triangles, found neither"),
    (
        HEAD + "periodic = [true, false]\n[vehicle]\nradius = 1",
        "periodic[0]: expected false, as axis 1 is no angle, found true",
    ),
    (
        SPACE + "periodic = [false, false, true]\n[vehicle]\nvertices = [[0, 0], [1, 0], [0, 1]]",
        "bounds[2]: expected a full turn",
    ),
    (
        HEAD + "[vehicle]\nradius = 1\n[[obstacles]]\nshape = 'circle'\ncenter = [1, 3]\nradius = 1.5",
        "start: expected a place clear of all obstacles, found [1.0, 1.0] in collision",
    ),
]


@pytest.mark.parametrize(("text", "complaint"), BAD_FILES)
def test_bad_files_give_one_clear_line(text, complaint, tmp_path):
    path = tmp_path / "problem.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as error:
        load(path)
    assert str(error.value).startswith(str(path))
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("unit", ["-1", "0", "nan", "1e9", "1" + 400 * "0"])
@pytest.mark.parametrize("table", ["mesh", "vehicle.mesh"])
def test_the_unit_of_a_mesh_file_must_be_one(table, unit, tmp_path):
    pytest.importorskip("trimesh")
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    own = "" if table == "vehicle.mesh" else "radius = 1"
    path = tmp_path / "problem.toml"
    path.write_text(SPACE + f"[vehicle]\n{own}\n[{table}]\nfile = 'wall.obj'\nunit = {unit}")
    with pytest.raises(BadInput) as error:
        load(path)
    assert str(error.value).startswith(f"{path}: {table}.unit: expected ")


def test_a_named_mesh_is_asked_for_by_load():
    with pytest.raises(ValueError, match=r"as `supernode\.load` reads them"):
        made(start=[1.0] * 3, goal=[9.0] * 3, vehicle={"radius": 0.1}, mesh={"file": "wall.stl"})


# Pictures -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("make", [*(lambda axes=axes: crowd(axes, 20) for axes in (2, 3, 4, 7)), *VEHICLES.values()])
def test_every_world_has_a_picture(make, tmp_path):
    problem = make()
    genomes = some_genomes(problem, 5)
    figure = Figure()
    problem.draw(figure, problem.decode(genomes[0]), {0: genomes, 3: genomes})
    figure.savefig(tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5000


def test_the_template_explains_itself_and_its_path_is_no_zig_zag():
    file = parse(SpherePath.template, "template", Path())
    problem = file.problem()
    best = best_known(simulate(Plan.of(file)), "champion")
    solution = problem.decode(np.frombuffer(best.genome, np.uint8))
    assert (problem.nodes, solution["crossed"]) == (2, 0)
    assert solution["length"] - length_of(problem.straight) < 1.11


@pytest.mark.parametrize("turns", [0.4, 1.0, 3.5, -2.5])
def test_a_long_segment_along_a_periodic_axis_meets_all_that_it_crosses(turns):
    """A solution that is checked may turn more than once within a segment."""
    space = Space(np.array([[-5.0, 5.0], [0.0, 8.0]]), np.ones(2), np.array([False, True]))
    path = np.array([[-4.0, 1.0], [4.0, 1.0 + 8.0 * turns]])
    places = path[0] + np.linspace(0.0, 1.0, 41)[:, None] * (path[1] - path[0])
    centres = np.column_stack([places[:, 0], np.mod(places[:, 1], 8.0)])
    assert space.clearances(path, centres) == pytest.approx(np.zeros(41), abs=1e-9)
