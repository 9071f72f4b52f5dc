"""Random robots of boxes among random solids, as the compact model, and the same in coal."""

import itertools

import numpy as np

from problems.robots.arm import BOX, CYLINDER, PRISMATIC, REVOLUTE, SPHERE, Arm, Scene

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def rotation(rng):
    quaternion = rng.normal(size=4)
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def placement(turn, shift):
    return np.column_stack([turn, shift]).ravel()


def box_triangles(half, pieces=4):
    """The surface of a box, each side in 2 · pieces² triangles, shape (T, 3, 3)."""
    triangles = []
    grid = np.linspace(0, 1, pieces + 1)
    for side in SIDES:
        a, b, _, d = (CORNERS[corner] * half for corner in side)
        for u0, u1 in itertools.pairwise(grid):
            for v0, v1 in itertools.pairwise(grid):
                p, q, r, s = (a + u * (b - a) + v * (d - a) for u, v in ((u0, v0), (u1, v0), (u1, v1), (u0, v1)))
                triangles += [[p, q, r], [p, r, s]]
    return np.array(triangles)


def tree(triangles, first_sphere, first_triangle, most=2):
    """Spheres, children and triangles of a piece, by halving along the longest side."""
    spheres, children, ordered = [], [], []
    waiting = [np.arange(len(triangles))]
    while waiting:
        own = waiting.pop(0)
        corners = triangles[own].reshape(-1, 3)
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        spheres.append([*centre, np.linalg.norm(corners - centre, axis=1).max() * (1 + 1e-12)])
        if len(own) <= most:
            children.append([-(first_triangle + len(ordered)) - 1, len(own)])
            ordered += list(triangles[own].reshape(-1, 9))
            continue
        middles = triangles[own].mean(axis=1)
        by = own[np.argsort(middles[:, np.argmax(np.ptp(middles, axis=0))], kind="stable")]
        children.append([first_sphere + len(spheres) + len(waiting), 2])
        waiting += [by[: len(by) // 2], by[len(by) // 2 :]]
    return spheres, children, ordered


def boxes_arm(rng, joints):
    """A chain of boxes, and their half sizes; all joints are revolute but for the last one, which is prismatic."""
    halves = rng.uniform(0.02, 0.15, (joints + 1, 3))
    spheres, children, triangles, roots = [], [], [], []
    for half in halves:
        roots.append(len(spheres))
        more = tree(box_triangles(half), len(spheres), len(triangles))
        spheres += more[0]
        children += more[1]
        triangles += more[2]
    placements = np.array(
        [placement(np.eye(3), np.zeros(3))]
        + [placement(rotation(rng), rng.uniform(-0.25, 0.25, 3)) for _ in range(joints)]
    )
    axes = np.vstack([np.zeros(3), rng.normal(size=(joints, 3))])
    axes[1:] /= np.linalg.norm(axes[1:], axis=1)[:, None]
    kinds = np.array([0] + [REVOLUTE] * (joints - 1) + [PRISMATIC])
    limits = np.array([[-2.5, 2.5]] * (joints - 1) + [[-0.2, 0.2]])
    names = tuple(f"joint{each}" for each in range(joints))
    pairs = [[one, other] for one in range(joints + 1) for other in range(one + 2, joints + 1)]
    arm = Arm(
        joints=names,
        bodies=("world", *names),
        links=(),
        pieces=tuple(f"link{each}" for each in range(joints + 1)),
        link_body=np.empty(0, np.int64),
        link_placements=np.empty((0, 12)),
        parents=np.arange(-1, joints),
        kinds=kinds,
        variables=np.arange(-1, joints),
        scales=np.tile([1.0, 0.0], (joints + 1, 1)),
        placements=placements,
        axes=axes,
        limits=limits,
        velocity=np.full(joints, np.nan),
        acceleration=np.full(joints, np.nan),
        effort=np.full(joints, np.nan),
        reach=_reach(halves, placements),
        piece_body=np.arange(joints + 1),
        piece_root=np.array(roots),
        spheres=np.array(spheres),
        children=np.array(children),
        triangles=np.array(triangles),
        pairs=np.array(pairs, np.int64).reshape(-1, 2),
    )
    return arm, halves


def _reach(halves, placements):
    """A bound for chains whose last joint slides by up to 0.2 m."""
    bodies = len(halves)
    reach = np.zeros((bodies, bodies - 1))
    shifts = np.linalg.norm(placements.reshape(-1, 3, 4)[:, :, 3], axis=1)
    for body in range(1, bodies):
        own = np.linalg.norm(halves[body])
        for joint in range(1, body + 1):
            slides = 0.2 if body == bodies - 1 else 0.0
            reach[body, joint - 1] = own + shifts[joint + 1 : body + 1].sum() + slides
        if body == bodies - 1:
            reach[body, -1] = 1.0
    return reach


def random_solids(rng, count):
    rows = np.empty((count, 16))
    for row in rows:
        kind = rng.integers(3)
        sizes = rng.uniform(0.03, 0.3, 3)
        if kind == CYLINDER:
            sizes[1] = sizes[0]
        elif kind == SPHERE:
            sizes[:] = sizes[0]
        row[:] = [kind, *rotation(rng).ravel(), *rng.uniform(-0.8, 0.8, 3), *sizes]
    return rows


def random_scene(rng, joints=4, solids=4, clearance=0.0):
    """A scene, and the half sizes of the boxes of its pieces."""
    arm, halves = boxes_arm(rng, joints)
    return Scene(arm, random_solids(rng, solids), tuple(f"solid{each}" for each in range(solids)), clearance), halves


def random_configurations(rng, scene, count):
    low, high = scene.arm.limits.T
    return rng.uniform(low, high, (count, len(low)))


class Rival:
    """The same scene in coal, with its own shapes."""

    def __init__(self, scene, halves):
        import coal

        self.coal, self.scene = coal, scene
        self.boxes = [coal.Box(*(2 * half)) for half in halves]
        self.solids = []
        for row in scene.solids:
            kind, sizes = int(row[0]), row[13:]
            shape = {BOX: lambda s: coal.Box(*(2 * s)), CYLINDER: lambda s: coal.Cylinder(s[0], 2 * s[2])}.get(
                kind, lambda s: coal.Sphere(s[0])
            )(sizes)
            self.solids.append((shape, coal.Transform3s(row[1:10].reshape(3, 3).T, row[10:13])))

    def gap(self, frames):
        """The least distance of what is tested against each other; 0 or less for contact."""
        poses = [self.coal.Transform3s(f.reshape(3, 4)[:, :3], f.reshape(3, 4)[:, 3]) for f in frames]
        gaps = [np.inf]
        for piece, box in enumerate(self.boxes):
            if piece > 0:
                gaps += [self._between(box, poses[piece], *solid) for solid in self.solids]
        for one, other in self.scene.arm.pairs:
            gaps.append(self._between(self.boxes[one], poses[one], self.boxes[other], poses[other]))
        return min(gaps)

    def _between(self, one, pose, other, other_pose):
        result = self.coal.DistanceResult()
        return self.coal.distance(one, pose, other, other_pose, self.coal.DistanceRequest(), result)
