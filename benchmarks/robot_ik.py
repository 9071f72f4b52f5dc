"""Compare robot-ik with TRAC-IK and with pinocchio's damped least squares on poses that a robot reaches.

    python -m benchmarks.robot_ik [--poses 1000] [--robot example-robot-data:panda --group arm --link panda_hand]
    python -m benchmarks.robot_ik --scenes 5 [--robots panda,ur5,fetch]

A pose is that of the link at a random configuration, by pinocchio. All solvers run in this process, one pose after
another on one core, without obstacles and without self-collision, and begin at random configurations. robot-ik is the
compiled search that a node runs, called directly until its first solution. TRAC-IK (`pytracik`) has the time limit
that its authors use, and ten times that. pinocchio's least squares are in Python; each restart has 50 steps. A pose
counts as solved if pinocchio finds the link within 1e-4 m and 1e-3 rad, and all joints within their limits.

With ``--scenes`` the poses are those of the goals of MotionBenchMaker's problems in `../shared/data`, the first of each
family, and nothing may touch: obstacles nor the robot itself. The rival is the multi-start solver above, which goes on
with another start where coal finds a contact on the exact meshes. robot-ik must pass its check.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple

import numpy as np

from benchmarks.motion_bench import Problem, gathered, problems
from problems.robot_ik import RobotIk
from problems.robot_ik.checker import proof_of
from problems.robot_ik.solving import Solver
from problems.robots.proof import Proof
from problems.robots.verifying import missed_by

NEAR, TURNED = 1e-4, 1e-3  # m, rad
LINKS = {"panda": "panda_hand", "ur5": "ee_link", "fetch": "gripper_link"}
_RESTARTS, _STEPS = 40, 50  # of pinocchio's least squares
_RESTARTS_AMONG_OBSTACLES = 300

Solve = Callable[[np.ndarray, np.ndarray, int], np.ndarray | None]


def main() -> None:
    """Print one row for each solver."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1000, help="(1000)")
    parser.add_argument("--seed", type=int, default=1, help="of the poses (1)")
    parser.add_argument("--robot", default="example-robot-data:panda", help="a URDF (example-robot-data:panda)")
    parser.add_argument("--group", default="arm", help="of its SRDF (arm)")
    parser.add_argument("--link", default="panda_hand", help="(panda_hand)")
    parser.add_argument("--scenes", type=int, default=0, help="of each family: compare among obstacles")
    parser.add_argument("--robots", default="panda,ur5,fetch", help="for --scenes (panda,ur5,fetch)")
    options = parser.parse_args()
    if options.scenes:
        _among_obstacles(options.robots.split(","), options.scenes)
        return
    problem = _problem(options.robot, options.group, options.link)
    poses, starts = _poses(problem, options.poses, options.seed)
    solvers: dict[str, Solve] = {"robot-ik, compiled search": _ours(problem)}
    for limit in (0.005, 0.05):
        solver = _trac_ik(problem, limit)
        if solver is not None:
            solvers[f"pytracik, {1e3 * limit:g} ms"] = solver
    solvers[f"pinocchio, least squares, {_RESTARTS} restarts"] = _pinocchio(problem, _RESTARTS)
    print(f"{options.poses} poses of {options.link}, seed {options.seed}")
    print("| solver | solved | median / ms | mean / ms | 95 % / ms | longest / ms |\n|---|---|---|---|---|---|")
    for name, solve in solvers.items():
        _measure(name, problem, solve, poses, starts)


def _problem(robot: str, group: str, link: str) -> RobotIk:
    fields = {
        "kind": "robot-ik",
        "self_collision": False,
        "goal_pose": {
            "link": link,
            "position": [0.0, 0.0, 0.0],
            "quaternion": [0.0, 0.0, 0.0, 1.0],
            "position_tolerance": NEAR,
            "angle_tolerance": TURNED,
        },
        "robot": {"urdf": robot, "group": group},
    }
    return RobotIk.model_validate(RobotIk.derive_fields(RobotIk.gather(fields, Path())))


def _poses(problem: RobotIk, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return reachable poses, shape (count, 4, 4), and as many random configurations to start from."""
    proof, generator = proof_of(problem), np.random.default_rng(seed)
    low, high = proof.limits.T
    there, starts = generator.uniform(low, high, (2, count, len(low)))
    return np.array([proof.pose(each, problem.goal_pose.link) for each in there]), starts


def _measure(name: str, problem: RobotIk, solve: Solve, poses: np.ndarray, starts: np.ndarray) -> None:
    proof, times, solved = proof_of(problem), [], 0
    solve(poses[0], starts[0], 0)  # what only a first call does is not measured
    for number, (pose, start) in enumerate(zip(poses, starts, strict=True)):
        begin = time.perf_counter()
        found = solve(pose, start, number)
        times.append(1e3 * (time.perf_counter() - begin))
        solved += found is not None and _is_there(proof, problem, found, pose)
    print(
        f"| {name} | {solved / len(poses):.2%} | {statistics.median(times):.3f} | {statistics.fmean(times):.3f} "
        f"| {np.percentile(times, 95):.3f} | {max(times):.3f} |",
        flush=True,
    )


def _is_there(proof: Any, problem: RobotIk, configuration: np.ndarray, pose: np.ndarray) -> bool:
    if next(proof.beyond_limits(configuration), None) is not None:
        return False
    x, y, z, w = quaternion_of(pose)
    place = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
    target = problem.goal_pose.model_copy(update={"position": place, "quaternion": (x, y, z, w)})
    away, turned = missed_by(target, proof, configuration)
    return away <= NEAR and turned <= TURNED


def quaternion_of(pose: np.ndarray) -> tuple[float, float, float, float]:
    """Return the quaternion x, y, z, w of a pose."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = (float(each) for each in Rotation.from_matrix(pose[:3, :3]).as_quat())
    return x, y, z, w


def _ours(problem: RobotIk) -> Solve:
    solver = Solver(problem)

    def solve(pose: np.ndarray, start: np.ndarray, number: int) -> np.ndarray | None:
        found = solver.solve(pose, seed=number)
        return found.configuration if found.error <= 1.0 else None

    return solve


def _trac_ik(problem: RobotIk, limit: float) -> Solve | None:
    """Return TRAC-IK with a time limit, s; None if it is not installed."""
    try:
        from trac_ik import TracIK
    except ImportError:
        print("pytracik is not installed: not measured")
        return None
    with NamedTemporaryFile("w", suffix=".urdf") as file:  # it reads a file only
        file.write(problem.robot.urdf)
        file.flush()
        root = problem.scene.arm.links[0]
        solver = TracIK(root, problem.goal_pose.link, file.name, timeout=limit)
    low, high = problem.scene.arm.limits.T
    solver.joint_limits = low.tolist(), high.tolist()  # where a URDF has safety controllers, it reads limits of 0

    def solve(pose: np.ndarray, start: np.ndarray, number: int) -> np.ndarray | None:
        found = solver.ik(pose[:3, 3], pose[:3, :3], start)
        return None if found is None else np.asarray(found)

    return solve


def _pinocchio(problem: RobotIk, restarts: int, proof: Proof | None = None) -> Solve:
    """Return damped least squares as in pinocchio's documentation, with limits and random restarts.

    Args:
        problem: the robot and the link.
        restarts: the most starts.
        proof: refuses configurations that touch something; None if nothing is to be tested.
    """
    import pinocchio

    model = pinocchio.buildModelFromXML(problem.robot.urdf)
    moving = set(problem.scene.arm.joints)
    still = [joint for joint in range(1, model.njoints) if model.names[joint] not in moving]
    model = pinocchio.buildReducedModel(model, still, pinocchio.neutral(model))
    data, frame = model.createData(), model.getFrameId(problem.goal_pose.link)
    low, high = proof_of(problem).limits.T
    order = [problem.scene.arm.joints.index(name) for name in model.names[1:]]  # pinocchio has its own
    back = np.argsort(order)
    low, high = low[order], high[order]

    def solve(pose: np.ndarray, start: np.ndarray, number: int) -> np.ndarray | None:
        target, generator, q = pinocchio.SE3(pose), np.random.default_rng(number), start[order]
        for _ in range(restarts):
            for _ in range(_STEPS):
                pinocchio.forwardKinematics(model, data, q)
                here = pinocchio.updateFramePlacement(model, data, frame)
                twist = pinocchio.log6(here.actInv(target)).vector
                if np.linalg.norm(twist[:3]) < 0.1 * NEAR and np.linalg.norm(twist[3:]) < 0.1 * TURNED:
                    if proof is None or not proof.contacts(q[back]):
                        return q[back]
                    break
                jacobian = pinocchio.computeFrameJacobian(model, data, q, frame, pinocchio.LOCAL)
                step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-4 * np.eye(6), twist)
                q = np.clip(q + step, low, high)
            q = generator.uniform(low, high)
        return None

    return solve


# Among obstacles ------------------------------------------------------------------------------------------------------
def _among_obstacles(robots: list[str], first: int) -> None:
    print("| robot | poses | multi-start solves | of these robot-ik solves | proven | median / ms | 95 % / ms |")
    print("|---|---|---|---|---|---|---|")
    for robot in robots:
        rows = [_compared(each) for each in problems(robot, first)]
        feasible = [row for row in rows if row.rival]
        both = sum(row.own for row in feasible)
        times = [row.milliseconds for row in rows if row.own]
        print(
            f"| {robot} | {len(rows)} | {len(feasible)} | {both} ({both / len(feasible):.1%}) "
            f"| {sum(row.proven for row in rows)} of {sum(row.own for row in rows)} | {statistics.median(times):.2f} "
            f"| {np.percentile(times, 95):.1f} |",
            flush=True,
        )


class _Row(NamedTuple):
    rival: bool  # whether the multi-start solver finds a solution
    own: bool  # whether robot-ik does
    proven: bool  # whether the check accepts it
    milliseconds: float  # of robot-ik


def _compared(bench: Problem) -> _Row:
    link = LINKS[bench.robot]
    fields = {"kind": "robot-ik", "robot": gathered(bench), "obstacles": bench.fields["obstacles"]}
    pose = Proof(fields["robot"]).pose(bench.goal, link)
    x, y, z, w = quaternion_of(pose)
    target = {"link": link, "position": pose[:3, 3].tolist(), "quaternion": [x, y, z, w]}
    problem = RobotIk.model_validate(RobotIk.derive_fields(fields | {"goal_pose": target}))
    proof, solver = proof_of(problem), Solver(problem)
    start = np.random.default_rng(1).uniform(*proof.limits.T)
    rival = _pinocchio(problem, _RESTARTS_AMONG_OBSTACLES, proof)(pose, start, 1)
    begin = time.perf_counter()
    found = solver.solve(pose, seed=1)
    spent = 1e3 * (time.perf_counter() - begin)
    own = found.error <= 1.0
    accepted = own and not proof.contacts(found.configuration) and _is_there(proof, problem, found.configuration, pose)
    return _Row(rival is not None, own, accepted, spent)


if __name__ == "__main__":
    main()
