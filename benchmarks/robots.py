"""Solve the problems of ../shared/data (MotionBenchMaker) by robot-path, and print one table.

Usage: python -m benchmarks.robots [--robots panda,ur5,fetch,baxter] [--families box,cage] [--first 5] [--seconds 5]
                                   [--nodes 4 | --in-process] [--data FOLDER] [--each]
                                   [--rivals RRTConnect,AORRTC,BITstar,mplib,roboplan] [--cpu]

By default the problems run one after another on processes that are already up, with the spy and the proof as in any
run; with --in-process they run in the simulator. *first* is the time from submitting a job to its first path that the
proof accepts. Lengths are means over the problems that had a path by then. *CPU* is that of all processes until the end
of the run, a mean. *solved* counts problems with a proven path in time (5 % late at most; what is later counts
nowhere), *proven* those whose last path the proof accepts, in time or not.

With --rivals, other planners solve each problem after ours; `benchmarks.robot_rivals` says how. Where RRTConnect is
among them, the last columns compare each line with it over the problems that *both* solved: geometric means of the
ratios of the times to the *first* proven path, and of the *lengths* at the end. With --cpu, rivals stop when they have
used as much CPU time as ours had for that problem. Their times are then CPU times, and 1 s of ours is compared with as
many seconds of theirs as ours used in 1 s on average.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import math
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import supernode
from benchmarks.robot_outcomes import LATE, REFUSED, Outcome, Solver, head, row
from benchmarks.robot_rivals import REFERENCE, RIVALS, solver_of
from problems import ProblemFile, Run
from problems.robot_path import RobotPath

Fields = dict[str, Any]

Solvers = dict[str, tuple[Solver, bool]]  # by name: the solver, and whether its time is the CPU time of ours

OURS = "supernode"
DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
ROBOTS = ("panda", "ur5", "fetch", "baxter")
_JOINTS = {"panda": [f"panda_joint{number}" for number in range(1, 8)]}
_ROUNDING = 1e-5  # rad or m
_FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


def families_of(robot: str, data: Path = DATA) -> list[str]:
    """Return the names of a robot's families of problems."""
    return sorted(path.stem for path in (data / "motionbenchmaker" / robot).glob("*.json"))


def problems_of(robot: str, family: str, data: Path = DATA) -> Iterator[tuple[int, Fields]]:
    """Yield each problem's number and fields, as of a problem file in the folder of the robot."""
    read = json.loads((data / "motionbenchmaker" / robot / f"{family}.json").read_text())
    for problem in read["problems"]:
        fields = _fields(robot, read.get("joints") or _JOINTS[robot], _movable(robot, data), problem)
        for end in ("start", "goal"):
            fields[end] = put_within(_limits(robot, data), fields["robot"]["joints"], fields[end])
        yield problem["index"], fields


def put_within(limits: dict[str, tuple[float, float]], joints: list[str], values: list[float]) -> list[float]:
    """Return values of joints; those that are beyond a limit by rounding, as pi where a URDF rounds it, are on it."""
    put = []
    for joint, value in zip(joints, values, strict=True):
        low, high = limits.get(joint, (-math.inf, math.inf))
        nearest = min(max(value, low), high)
        put.append(nearest if abs(nearest - value) < _ROUNDING else value)
    return put


@functools.cache
def _limits(robot: str, data: Path) -> dict[str, tuple[float, float]]:
    """Return the limits that a URDF gives to joints, rad or m."""
    limits = {}
    for joint in ElementTree.parse(data / robot / f"{robot}.urdf").getroot().findall("joint"):
        limit = joint.find("limit")
        if limit is not None and joint.get("type") in ("revolute", "prismatic"):
            limits[str(joint.get("name"))] = float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))
    return limits


def _movable(robot: str, data: Path) -> set[str]:
    """Return the names of the joints of a URDF that can be held: those that are neither fixed nor mimic another."""
    joints = ElementTree.parse(data / robot / f"{robot}.urdf").getroot().findall("joint")
    return {str(each.get("name")) for each in joints if each.get("type") != "fixed" and each.find("mimic") is None}


def _fields(robot: str, joints: list[str], movable: set[str], problem: Fields) -> Fields:
    others = dict(problem.get("others") or zip(_FINGERS, problem.get("fingers", []), strict=False))
    fixed = {name: value for name, value in others.items() if name in movable}
    described = {"urdf": f"{robot}.urdf", "srdf": f"{robot}.srdf", "joints": joints}
    return {
        "kind": "robot-path",
        "start": [float(value) for value in problem["start"]],
        "goal": [float(value) for value in problem["goal"]],
        "robot": described | {"fixed": {name: float(value) for name, value in fixed.items()}},
        "obstacles": [_obstacle(each) for each in problem["obstacles"]],
    }


def _obstacle(given: Fields) -> Fields:
    size = given["dimensions"]
    match given["shape"]:
        case "box":
            shape = {"size": size}
        case "cylinder":
            shape = {"length": size[0], "radius": size[1]}
        case _:
            shape = {"radius": size[0]}
    place = {"position": given["position"], "quaternion": given["quaternion_xyzw"]}
    return {"id": given["id"], "shape": given["shape"], **shape, **place}


def load(robot: str, fields: Fields, name: str, run: Run, data: Path = DATA) -> ProblemFile:
    """Return a problem file as `supernode.load` does.

    Raises:
        BadInput: if the problem is refused, say because its start touches something.
    """
    gathered = RobotPath.derive_fields(RobotPath.gather(fields, data / robot))
    file = ProblemFile(name, gathered, run, data / robot)
    file.problem()
    return file


def on_cluster(cluster: supernode.LocalCluster) -> Solver:
    """Return a solver that submits jobs to a cluster."""

    def solve(file: ProblemFile, seconds: float) -> Outcome:
        outcome, began = Outcome(), time.monotonic()
        job = cluster.submit(file, seconds=seconds)
        for better in job.improvements():
            outcome.found.append((time.monotonic() - began, better.fitness, better.feasible))
        result = job.result()
        outcome.proven, outcome.cpu, outcome.message = result.feasible, result.cpu_seconds, result.message
        return outcome

    return solve


def in_process(file: ProblemFile, seconds: float) -> Outcome:
    """Solve a problem by the simulator; improvements are seen at the end of their generation."""
    outcome, began, used = Outcome(), time.monotonic(), time.process_time()

    def see(generation: supernode.Generation) -> None:
        best = generation.best
        if best is not None and (not outcome.found or best.fitness < outcome.found[-1][1]):
            outcome.found.append((time.monotonic() - began, best.fitness, best.feasible))

    result = supernode.simulate(file, callback=see, seconds=seconds)
    outcome.proven, outcome.message = result.feasible, result.message
    outcome.cpu = time.process_time() - used
    return outcome


def measure(files: Iterator[ProblemFile | Outcome], solvers: Solvers, seconds: float) -> dict[str, list[Outcome]]:
    """Solve problems by each solver in turn, and return the outcomes by its name; a refused problem is one for all."""
    outcomes: dict[str, list[Outcome]] = {name: [] for name in solvers}
    for file in files:
        cpu = math.nan
        for name, (solve, by_cpu) in solvers.items():
            limit = cpu if by_cpu else seconds
            outcome = file if isinstance(file, Outcome) else solve(file, limit)
            outcome.until = LATE * limit
            outcomes[name].append(outcome)
            cpu = outcome.cpu if name == OURS else cpu
    return outcomes


def files_of(robot: str, family: str, first: int, run: Run, data: Path = DATA) -> Iterator[ProblemFile | Outcome]:
    """Yield the first problems of a family; where one is refused, an outcome that says why."""
    for number, fields in list(problems_of(robot, family, data))[:first]:
        try:
            yield load(robot, fields, f"{robot} {family} {number}", run, data)
        except supernode.BadInput as error:
            yield Outcome(message=f"{REFUSED}{error}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--families", default="")
    parser.add_argument("--first", type=int, default=1000, help="problems of each family")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--nodes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--in-process", action="store_true")
    parser.add_argument("--each", action="store_true", help="a line for each problem, too")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--rivals", default="", help=f"of {','.join(RIVALS)}; the packages must be installed")
    parser.add_argument("--cpu", action="store_true", help="give rivals as much CPU time as ours has used")
    options = parser.parse_args()
    rows = max(each for each in range(1, math.isqrt(options.nodes) + 1) if options.nodes % each == 0)
    run = Run(topology=f"torus {rows}x{options.nodes // rows}", seed=options.seed)
    rivals = [name for name in options.rivals.split(",") if name]
    if unknown := [name for name in rivals if name not in RIVALS]:
        parser.error(f"--rivals: expected some of {', '.join(RIVALS)}, found {', '.join(unknown)}")
    if missing := [name for name in options.robots.split(",") if not families_of(name, options.data)]:
        parser.error(f"--data: expected motionbenchmaker/{missing[0]}/*.json in {options.data}, found none")
    with contextlib.ExitStack() as stack:
        solvers: Solvers = {OURS: (in_process, False)}
        if not options.in_process:
            solvers[OURS] = on_cluster(stack.enter_context(supernode.LocalCluster(topology=run.topology))), False
        for name in rivals:
            try:
                solver = solver_of(name, options.seed, options.seconds if options.cpu else None)
            except ModuleNotFoundError as error:
                parser.error(f"--rivals: {error}")
            solvers[name] = solver, options.cpu
        print(head(REFERENCE if REFERENCE in rivals else None), flush=True)
        for robot in options.robots.split(","):
            every: dict[str, list[Outcome]] = {name: [] for name in solvers}
            for family in families_of(robot, options.data):
                if options.families and family not in options.families.split(","):
                    continue
                files = files_of(robot, family, options.first, run, options.data)
                outcomes = measure(files, solvers, options.seconds)
                for name, each in outcomes.items():
                    every[name] += each
                _show(f"{robot} {family}", outcomes, options.each)
            _show(f"{robot}, all", every, None)


def _show(title: str, outcomes: dict[str, list[Outcome]], each: bool | None) -> None:
    """Print a line for each solver, and before it one for each problem, for those that are not proven, or for none."""
    if len(outcomes) > 1:
        print(title)
    for name, known in outcomes.items():
        if each is not None:
            _show_each(known, each)
        print(row(f"  {name}" if len(outcomes) > 1 else title, known, outcomes.get(REFERENCE)), flush=True)


def _show_each(outcomes: list[Outcome], all_of_them: bool) -> None:
    for number, each in enumerate(outcomes, start=1):
        if all_of_them or not each.proven:
            best = each.length_at(math.inf)
            why = textwrap.shorten(each.message or ("accepted" if each.proven else "not proven"), 160)
            print(f"    {number:3}: first {1e3 * each.first:.0f} ms, best {best:.3f} rad, {why}")


if __name__ == "__main__":
    main()
