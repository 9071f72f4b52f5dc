"""Measure the compiled collision test of robots beside pinocchio with coal, and beside python-fcl.

Usage: python -m benchmarks.robot_collisions [--robots panda,ur5] [--scenes 2] [--configurations N]

Without ``--configurations`` it prints, for random configurations in MotionBenchMaker's scenes, microseconds for each
configuration, median / mean: kinematics, obstacles and self-collision, with early exit. All three run in the same
process, one after another, scene by scene. python-fcl is timed without kinematics, which it does not have.

With ``--configurations`` it counts, over ten scenes for each robot, the random configurations that the compiled test
calls free although coal finds contact on the exact meshes. There must be none.
"""

import argparse
import statistics
import time
from typing import Any

import numpy as np

from benchmarks.motion_bench import DATA, Problem, gathered, problems, scene_of
from problems.robots.collision import Collisions
from problems.robots.meshes import mesh_of

_TIMED = 2000  # configurations of a scene
_TIMED_EACH = 300  # of these, one by one
_TIMED_BY_FCL = 100
_SCENES = 10  # in which false verdicts are counted


def main() -> None:
    """Measure, or count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", default="panda,ur5", help="folders of ../shared/data, separated by commas")
    parser.add_argument("--scenes", type=int, default=2, help="of each family")
    parser.add_argument("--configurations", type=int, default=0, help="for each robot: count false verdicts")
    parser.add_argument("--seed", type=int, default=0, help="of the random configurations")
    options = parser.parse_args()
    for robot in options.robots.split(","):
        if not (DATA / robot).is_dir():
            print(f"{robot}: not measured, since {DATA / robot} is not there")
        elif options.configurations:
            _count(robot, options.configurations, options.seed)
        else:
            _compare(robot, options.scenes, options.seed)


# Speed ----------------------------------------------------------------------------------------------------------------
def _compare(robot: str, scenes: int, seed: int) -> None:
    rows = []
    print("| scene | solids | free | compiled µs | pinocchio + coal µs | python-fcl µs |\n|---|---|---|---|---|---|")
    for problem in problems(robot, scenes):
        scene = scene_of(problem)
        collisions, coal, fcl = Collisions(scene), Coal(problem), Fcl(problem)
        qs = _random(scene, _TIMED, seed)
        collisions.are_free(qs)
        # A single call of the compiled test is too short for the clock: each configuration is tested 20 times in one.
        repeated = [np.repeat(q[None], 20, axis=0) for q in qs[:_TIMED_EACH]]
        own = _median_and_mean([_time_of(collisions.are_free, each) / 20 for each in repeated])
        # All configurations after one another: no branch is predicted and little is in the cache.
        batch = min(_time_of(collisions.are_free, qs) / len(qs) for _ in range(5))
        theirs = _median_and_mean([_time_of(coal.touches, q) for q in qs[:_TIMED_EACH]])
        slowest = _median_and_mean(fcl.times_of(qs[:_TIMED_BY_FCL]))
        free = float(collisions.are_free(qs).mean())
        rows.append((own[0], batch, *theirs, *slowest))
        print(
            f"| {problem.name} | {len(scene.solids)} | {free:.0%} | {own[0]:.2f} / {batch:.2f} "
            f"| {theirs[0]:.1f} / {theirs[1]:.1f} | {slowest[0]:.1f} / {slowest[1]:.1f} |",
            flush=True,
        )
    own_median, own_mean, *others = (statistics.median(each) for each in zip(*rows, strict=True))
    print(
        f"\n{robot}, medians over scenes of median / mean over configurations: "
        f"compiled {own_median:.2f} / {own_mean:.2f} µs"
    )
    for name, median, mean in (("pinocchio + coal", *others[:2]), ("python-fcl", *others[2:])):
        print(f"{name}: {median:.1f} / {mean:.1f} µs, {median / own_median:.1f} / {mean / own_mean:.1f} times as long")
    print()


def _median_and_mean(times: list[float]) -> tuple[float, float]:
    return statistics.median(times), statistics.fmean(times)


def _time_of(run: Any, argument: Any) -> float:
    """Return the processor time of a call, µs."""
    start = time.thread_time()
    run(argument)
    return 1e6 * (time.thread_time() - start)


def _random(scene: Any, count: int, seed: int) -> Any:
    low, high = scene.arm.limits.T
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


# False verdicts -------------------------------------------------------------------------------------------------------
def _count(robot: str, count: int, seed: int) -> None:
    false = needless = free = 0
    for number, problem in enumerate(_ten(robot)):
        scene = scene_of(problem)
        collisions, coal = Collisions(scene), Coal(problem)
        qs = _random(scene, count // _SCENES, seed + number)
        verdicts = collisions.are_free(qs)
        touches = np.array([coal.touches(q) for q in qs])
        false += int((verdicts & touches).sum())
        needless += int((~verdicts & ~touches).sum())
        free += int((~touches).sum())
        print(f"{problem.name}: {len(qs)} configurations, {int((verdicts & touches).sum())} falsely free", flush=True)
    print(
        f"{robot}: {false} of {count} configurations are called free that touch; {needless} of {free} free ones are "
        "called blocked\n"
    )


def _ten(robot: str) -> list[Problem]:
    """Return ten scenes of as many families as there are."""
    found = list(problems(robot, 2))
    return (found[::2] + found[1::2])[:_SCENES]


# Rivals ---------------------------------------------------------------------------------------------------------------
class Coal:
    """Pinocchio's kinematics and coal on the exact meshes.

    The meshes are those that the project has read: the loader of pinocchio 4.1 gives a mesh of several materials (the
    Panda's link 6) triangles between wrong corners.
    """

    def __init__(self, problem: Problem) -> None:
        import coal
        import pinocchio as pin

        self.pin = pin
        own = problem.fields["robot"]
        model = pin.buildModelFromUrdf(own["urdf"])
        shapes = pin.buildGeomFromUrdf(model, own["urdf"], pin.COLLISION, package_dirs=own["packages"])
        q = pin.neutral(model)
        for name, value in own["fixed"].items():
            joint = model.joints[model.getJointId(name)] if model.existJointName(name) else None
            if joint is not None and joint.nq == 1:
                q[joint.idx_q] = value
        locked = [number for number in range(1, model.njoints) if model.names[number] not in own["joints"]]
        self.model, self.shapes = pin.buildReducedModel(model, shapes, locked, q)
        self.data = self.model.createData()
        self.robots = self.shapes.ngeoms
        meshes = gathered(problem)["meshes"]
        for shape in self.shapes.geometryObjects:
            name = next((each for each in meshes if shape.meshPath.endswith(each.removeprefix("package://"))), None)
            if name is not None:
                shape.geometry = _coal_mesh(coal, *mesh_of(meshes, name, tuple(shape.meshScale)))
                shape.meshScale = np.ones(3)
        for each in problem.fields["obstacles"]:
            turn = pin.Quaternion(np.array(each["quaternion"])).normalized().matrix()
            place = pin.SE3(turn, np.array(each["position"]))
            self.shapes.addGeometryObject(pin.GeometryObject(each["id"], 0, 0, place, _coal_shape(coal, each)))
        self.shapes.addAllCollisionPairs()
        pin.removeCollisionPairs(self.model, self.shapes, own["srdf"])
        self._remove_adjacent()
        self.shape_data = self.shapes.createData()

    def _remove_adjacent(self) -> None:
        """Remove the pairs of links on both sides of one joint, of one link, and of what stands still."""
        objects, parents = self.shapes.geometryObjects, self.model.parents
        for pair in list(self.shapes.collisionPairs):
            one, other = objects[pair.first], objects[pair.second]
            still = one.parentJoint == other.parentJoint == 0
            links = pair.first < self.robots and pair.second < self.robots
            joints = sorted((one.parentJoint, other.parentJoint))
            frames = sorted((one.parentFrame, other.parentFrame))
            across = links and parents[joints[1]] == joints[0] and self._carrier(frames[1]) == frames[0]
            if still or across:
                self.shapes.removeCollisionPair(pair)

    def _carrier(self, frame: int) -> int:
        """Return the frame of the link that carries a link, past the frame of the joint between."""
        joint_frame = self.model.frames[frame].parentFrame
        return int(self.model.frames[joint_frame].parentFrame)

    def touches(self, q: Any) -> bool:
        """Return whether something touches."""
        return bool(self.pin.computeCollisions(self.model, self.data, self.shapes, self.shape_data, q, True))


def _coal_mesh(coal: Any, vertices: Any, triangles: Any) -> Any:
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(triangles), len(vertices))
    mesh.addVertices(vertices)
    mesh.addTriangles(triangles)
    mesh.endModel()
    return mesh


def _coal_shape(coal: Any, table: dict[str, Any]) -> Any:
    if table["shape"] == "box":
        return coal.Box(*table["size"])
    if table["shape"] == "cylinder":
        return coal.Cylinder(table["radius"], table["length"])
    return coal.Sphere(table["radius"])


class Fcl:
    """python-fcl on the same meshes, pairs and obstacles; pinocchio places the links."""

    def __init__(self, problem: Problem) -> None:
        import fcl

        self.fcl, self.coal = fcl, Coal(problem)
        objects = self.coal.shapes.geometryObjects
        self.objects = [fcl.CollisionObject(self._shape(each)) for each in list(objects)[: self.coal.robots]]
        for table in problem.fields["obstacles"]:
            x, y, z, w = table["quaternion"]
            place = fcl.Transform(np.array([w, x, y, z]), np.array(table["position"]))
            self.objects.append(fcl.CollisionObject(self._solid(table), place))
        self.pairs = [(pair.first, pair.second) for pair in self.coal.shapes.collisionPairs]

    def _shape(self, each: Any) -> Any:
        kind, own = type(each.geometry).__name__, each.geometry
        if kind == "Box":
            return self.fcl.Box(*(2.0 * own.halfSide))
        if kind == "Cylinder":
            return self.fcl.Cylinder(own.radius, 2.0 * own.halfLength)
        if kind == "Sphere":
            return self.fcl.Sphere(own.radius)
        vertices, triangles = _parts_of(own)
        model = self.fcl.BVHModel()
        model.beginModel(len(vertices), len(triangles))
        model.addSubModel(vertices, triangles)
        model.endModel()
        return model

    def _solid(self, table: dict[str, Any]) -> Any:
        if table["shape"] == "box":
            return self.fcl.Box(*table["size"])
        if table["shape"] == "cylinder":
            return self.fcl.Cylinder(table["radius"], table["length"])
        return self.fcl.Sphere(table["radius"])

    def times_of(self, qs: Any) -> list[float]:
        """Return the microseconds for each configuration, without kinematics."""
        times, coal = [], self.coal
        for q in qs:
            coal.pin.updateGeometryPlacements(coal.model, coal.data, coal.shapes, coal.shape_data, q)
            places = [coal.shape_data.oMg[number] for number in range(coal.robots)]
            poses = [self.fcl.Transform(each.rotation.copy(), each.translation.copy()) for each in places]
            times.append(_time_of(self._touches, poses))
        return times

    def _touches(self, poses: list[Any]) -> bool:
        for each, pose in zip(self.objects, poses, strict=False):
            each.setTransform(pose)
        request = self.fcl.CollisionRequest()
        return any(
            self.fcl.collide(self.objects[one], self.objects[other], request, self.fcl.CollisionResult())
            for one, other in self.pairs
        )


def _parts_of(geometry: Any) -> tuple[Any, Any]:
    """Return the vertices and triangles of coal's mesh."""
    triangles = [geometry.tri_indices(number) for number in range(geometry.num_tris)]
    return np.array(geometry.vertices()), np.array([[each[0], each[1], each[2]] for each in triangles])


if __name__ == "__main__":
    main()
