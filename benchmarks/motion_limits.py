"""Test whether motions of a UR5 and a Panda between random configurations keep to their limits, by pinocchio.

    python -m benchmarks.motion_limits [--motions 50] [--generations 8]

Each motion is followed along its curve by the motion law of docs/min-time.md. At sixteen places between any two rows
its speeds, accelerations and torques are compared with the limits. pinocchio computes the torques from the URDF
itself. Every second motion also has limits of acceleration, every fourth limits of jerk.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from scipy.interpolate import BSpline, CubicHermiteSpline

from benchmarks.planners.runs import on_all_cores
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, ProblemFile, Run
from problems.min_time import MinTime, urdf
from spy.past import best_known

ARMS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", None),
    "Panda": ("panda_description/urdf/panda.urdf", [f"panda_joint{number}" for number in range(1, 8)]),
}
ACCELERATION, JERK = 8.0, 80.0  # rad/s², rad/s³: the limits of each joint, where a motion has them
_SAMPLES = 16  # places between two rows
_ALLOWED = 1.01  # share of a limit


class Found(NamedTuple):
    """The measurements of one motion."""

    time: float  # s, inf if there is none
    accepted: bool  # by `check`
    velocity: float  # greatest share of its limit; 0 without a limit. The following fields likewise
    acceleration: float
    jerk: float
    torque: float


def main() -> None:
    """Print one row for each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=50, help="of each arm (50)")
    parser.add_argument("--generations", type=int, default=8, help="of each search, on a torus of 4x4 (8)")
    options = parser.parse_args()
    print(
        "| arm | motions | accepted by check | time: median / s | velocity | acceleration | jerk | torque | over 1 % |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in ARMS:
        found = list(on_all_cores(partial(_judged, name, options.generations), range(1, options.motions + 1)))
        worst = [f"{max(getattr(each, what) for each in found):.4f}" for what in Found._fields[2:]]
        over = sum(max(each[2:]) > _ALLOWED for each in found)
        accepted, median = sum(each.accepted for each in found), np.median([each.time for each in found])
        print(f"| {name} | {len(found)} | {accepted} | {median:.3f} | {' | '.join(worst)} | {over} |", flush=True)


def _judged(name: str, generations: int, number: int) -> Found:
    """Plan motion ``number`` of an arm, check it, and compare it with the limits of the URDF."""
    import pinocchio

    path, joints = ARMS[name]
    file = _problem(name, number, generations)
    problem = file.problem()
    assert isinstance(problem, MinTime)
    best = best_known(simulate(Plan.of(file)), "champion")
    solution = problem.decode(np.frombuffer(best.genome, np.uint8))
    rows = solution["trajectory"]
    t = np.array(rows["t"])
    q, qd, qdd = _followed(solution)
    whole = pinocchio.buildModelFromUrdf(str(urdf._path(f"example-robot-data:{path}", Path())))
    model = urdf._reduced(pinocchio, whole, joints)
    data = model.createData()
    torque = np.array([pinocchio.rnea(model, data, *each) for each in zip(q, qd, qdd, strict=True)])
    jerk = np.diff(rows["qdd"], axis=0) / np.diff(t)[:, None] / JERK if problem.arm.jerk else np.zeros(1)
    return Found(
        solution["time"],
        problem.check(solution).feasible,
        float(np.abs(qd / model.velocityLimit).max()),
        float(np.abs(qdd / ACCELERATION).max()) if problem.arm.acceleration else 0.0,
        float(np.abs(jerk).max()),
        float(np.abs(torque / model.effortLimit).max()),
    )


def _followed(solution: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Return angles, speeds and accelerations between the rows of a trajectory, (samples, joints) each."""
    rows, nodes = solution["trajectory"], np.array(solution["nodes"])
    stretches, count = len(nodes) - 1, len(rows["t"])
    controls = np.concatenate([[2 * nodes[0] - nodes[1]], nodes, [2 * nodes[-1] - nodes[-2]]])
    curve = BSpline(np.arange(-3, stretches + 4), controls, 3)
    s = np.array(rows.get("place", np.linspace(0.0, stretches, count)))
    slope = curve(s, 1)
    speed = np.sum(np.array(rows["qd"]) * slope, axis=1) / np.sum(slope**2, axis=1)
    shares = np.arange(_SAMPLES + 1) / _SAMPLES
    if "place" in rows:  # s is a cubic of time
        t, law = np.array(rows["t"]), CubicHermiteSpline(rows["t"], s, speed)
        moments = (t[:-1, None] + np.diff(t)[:, None] * shares).ravel()
        s, fast, push = law(moments), law(moments, 1), law(moments, 2)
    else:  # the squared speed is a parabola of s
        square, length = speed**2, stretches / (count - 1)
        pushes = np.sum((np.array(rows["qdd"]) - curve(s, 2) * square[:, None]) * slope, axis=1)
        begin = (pushes / np.sum(slope**2, axis=1))[:-1, None]
        bend = (np.diff(square)[:, None] - 2.0 * length * begin) * shares
        s = np.minimum((s[:-1, None] + length * shares).ravel(), stretches)
        fast = np.sqrt(np.maximum(square[:-1, None] + (2.0 * length * begin + bend) * shares, 0.0)).ravel()
        push = (begin + bend / length).ravel()
    fast, push = fast[:, None], push[:, None]
    return curve(s), curve(s, 1) * fast, curve(s, 1) * push + curve(s, 2) * fast**2


def _problem(name: str, number: int, generations: int) -> ProblemFile:
    """Return a problem with random start and goal poses that the arm can hold, and with its optional limits."""
    path, joints = ARMS[name]
    generator = np.random.Generator(np.random.PCG64([1993, number]))
    arm: dict[str, Any] = urdf.read(f"example-robot-data:{path}", joints, Path())
    size = len(arm["bodies"])
    if number % 2 == 0:
        arm["acceleration"] = [ACCELERATION] * size
    if number % 4 == 0:
        arm["jerk"] = [JERK] * size
    low, high = np.clip(np.array([body["limits"] for body in arm["bodies"]]).T, -np.pi, np.pi)
    while True:
        ends = {end: generator.uniform(low, high).tolist() for end in ("start", "goal")}
        fields = {"kind": "min-time", "grid": 6, "free": True, "arm": arm} | ends
        file = ProblemFile(f"{name} {number}", fields, Run(topology="torus 4x4", generations=generations), Path())
        try:
            file.problem()
        except (BadInput, ValidationError):  # the arm cannot hold this pose
            continue
        return file


if __name__ == "__main__":
    main()
