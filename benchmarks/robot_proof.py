"""Measure how long the proof of a robot's path takes, on exact meshes, in scenes of MotionBenchMaker.

    python -m benchmarks.robot_proof [--robots panda,ur5,fetch] [--scenes 2] [--length 5]

A path begins at the start of a problem in `../shared/data` and goes on by random straight segments that the compiled
test calls free, until it is so long, in rad. Every path must be accepted. The scene's trees are built before.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from benchmarks.motion_bench import Problem, gathered, problems, scene_of
from problems.robots.collision import Collisions
from problems.robots.proof import PathProof, Proof

_MOST_TRIES = 5000  # random ends of segments
_STEP = 1.5  # rad, the most that a joint turns on a segment


def main() -> None:
    """Print one row for each robot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default="panda,ur5,fetch", help="(panda,ur5,fetch)")
    parser.add_argument("--scenes", type=int, default=2, help="of each family (2)")
    parser.add_argument("--length", type=float, default=5.0, help="of the paths, rad (5)")
    options = parser.parse_args()
    print(
        "| robot | paths | accepted | length / rad | tests | median / ms | 95 % / ms |\n|---|---|---|---|---|---|---|"
    )
    for robot in options.robots.split(","):
        rows = [_measured(problem, options.length) for problem in problems(robot, options.scenes)]
        times = [spent for _, spent in rows]
        print(
            f"| {robot} | {len(rows)} | {sum(not found.objections for found, _ in rows)} "
            f"| {statistics.median(found.length for found, _ in rows):.2f} "
            f"| {statistics.median(found.tests for found, _ in rows):.0f} | {statistics.median(times):.1f} "
            f"| {np.percentile(times, 95):.1f} |",
            flush=True,
        )


def _measured(problem: Problem, length: float) -> tuple[PathProof, float]:
    """Return the proof of a path in a problem's scene, and its time, ms."""
    path = _path(problem, length)
    proof = Proof(gathered(problem), problem.fields["obstacles"])
    proof.of_path(path[:1])
    begin = time.perf_counter()
    found = proof.of_path(path)
    return found, 1e3 * (time.perf_counter() - begin)


def _path(problem: Problem, length: float) -> np.ndarray:
    scene = scene_of(problem)
    collisions, generator = Collisions(scene), np.random.default_rng(1)
    low, high = scene.arm.limits.T
    path = [np.array(problem.start)]
    for _ in range(_MOST_TRIES):
        step = generator.uniform(-1.0, 1.0, len(low)) * generator.uniform(0.1, _STEP)
        there = np.clip(path[-1] + step, low, high)
        if collisions.is_way_free(path[-1], there):
            path.append(there)
        if np.linalg.norm(np.diff(path, axis=0), axis=1).sum() >= length:
            break
    return np.array(path)


if __name__ == "__main__":
    main()
