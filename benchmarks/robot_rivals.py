"""Other planners on the problems of robot-path: rivals for `python -m benchmarks.robots --rivals RRTConnect,mplib`.

``RRTConnect``, ``AORRTC`` and ``BITstar`` are OMPL's (extra `ompl`), with its default settings and this project's
compiled tests: states by `Collisions.is_free`, motions by `Collisions.is_way_free`, which has no resolution. ``mplib``
and ``roboplan`` bring their own collision tests, see `benchmarks.robot_own_checks`.

A rival's clock starts when its scene is ready, so unlike ours it does not pay for reading the problem. A path counts
once `Problem.check` has accepted it. Until the first one is accepted, proofs run on the rival's clock; paths found
later are proven after the clock has stopped, as many as the table needs, so those proofs cost the rival nothing. Each
rival continues until its time is over, and its shortest path is kept.
RRTConnect starts again after each path and simplifies it; AORRTC simplifies its paths itself; BIT* does not.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import robot_own_checks
from benchmarks.robot_outcomes import LATE, MOMENTS, Outcome, Solver
from problems import ProblemFile
from problems.robot_path import RobotPath
from problems.robots.collision import Collisions

Rows = list[list[float]]
Rival = Callable[[RobotPath, Path, int], AbstractContextManager[Callable[["Search"], None]]]

_MOST_PROOFS = 20  # for each moment, of paths found after the first proven one


@dataclass
class _Path:
    """A path that a rival has found, and the objections of the proof, None while unknown."""

    at: float
    rows: Rows
    length: float
    objections: tuple[str, ...] | None = None

    @property
    def proven(self) -> bool:
        """Whether the proof accepts it."""
        return self.objections == ()


@dataclass
class Search:
    """The clock of one rival on one problem, and the paths it has found.

    Attributes:
        problem: the problem.
        seconds: when the rival must stop, s of its clock.
        by_cpu: whether its clock counts processor time.
        cpu_elsewhere: processor time of other processes on its behalf, s.
    """

    problem: RobotPath
    seconds: float
    by_cpu: bool = False
    cpu_elsewhere: float = 0.0
    _found: list[_Path] = field(default_factory=list)
    _is_proven: bool = False

    def __post_init__(self) -> None:
        self._began, self._began_cpu = time.monotonic(), time.process_time()

    @property
    def cpu(self) -> float:
        """The processor time since the beginning, s."""
        return time.process_time() - self._began_cpu + self.cpu_elsewhere

    @property
    def now(self) -> float:
        """The time since the beginning, s of its clock."""
        return self.cpu if self.by_cpu else time.monotonic() - self._began

    @property
    def left(self) -> float:
        """The seconds that are left."""
        return self.seconds - self.now

    @property
    def is_over(self) -> bool:
        """Whether the rival must stop."""
        return self.left <= 0.0

    @property
    def has_proven(self) -> bool:
        """Whether a path has been accepted."""
        return self._is_proven

    def offer(self, rows: Rows) -> None:
        """Take a path that the rival has found; prove it now if none has been proven before."""
        path = _Path(self.now, rows, float(np.linalg.norm(np.diff(rows, axis=0), axis=1).sum()))
        if not self._is_proven:
            self._is_proven = self._prove(path)
            path.at = self.now
        self._found.append(path)

    def outcome(self, pace: float = 1.0) -> Outcome:
        """Return the outcome, after proofs of those paths that could be the best at the moments of the table."""
        cpu = self.cpu
        in_time = [each for each in self._found if each.at <= LATE * self.seconds]
        for moment in (*(pace * each for each in MOMENTS), math.inf):
            known = sorted((each for each in in_time if each.at <= moment), key=lambda path: path.length)
            any(self._prove(each) for each in known[:_MOST_PROOFS])
        judged = [each for each in self._found if each.objections is not None]
        failed = [each.objections[0] for each in judged if each.objections]
        return Outcome(
            [(each.at, each.length, each.proven) for each in judged],
            bool(in_time) and min(in_time, key=lambda path: path.length).proven,
            cpu,
            f"{len(failed)} of {len(judged)} paths fail the proof, one {failed[0]}" if failed else None,
            until=LATE * self.seconds,
            pace=pace,
        )

    def _prove(self, path: _Path) -> bool:
        if path.objections is None:
            solution = {"path": path.rows, "length": path.length, "clearance": 0.0}
            path.objections = self.problem.check(solution).objections
        return path.proven


def solver_of(name: str, seed: int = 1, whole: float | None = None) -> Solver:
    """Return a rival as a solver.

    Args:
        name: a key of `RIVALS`.
        seed: the seed of its random numbers, where it takes one.
        whole: None to count seconds on the wall. Otherwise the solver's seconds are of its processor, and the moments
            of the table are stretched in the ratio of these seconds to `whole`, the seconds of the run they came from.

    Raises:
        ModuleNotFoundError: if its package is not installed. mplib is looked for later, see `robot_own_checks`.
    """
    rival = RIVALS[name]
    package = {"mplib": None, "roboplan": "roboplan"}.get(name, "ompl")
    if package is not None and importlib.util.find_spec(package) is None:
        raise ModuleNotFoundError(f"{name}: expected the package {package}; pip install {package}")

    def solve(file: ProblemFile, seconds: float) -> Outcome:
        problem = file.problem(checked=True)
        assert isinstance(problem, RobotPath)
        search, message = None, None
        try:
            with rival(problem, file.folder, seed) as run:
                search = Search(problem, seconds, by_cpu=whole is not None)
                run(search)
        except Exception as error:  # a rival may not read every robot, or fail in its search; its paths still count
            message = f"{name}: {error}"
        outcome = Outcome() if search is None else search.outcome(1.0 if whole is None else seconds / whole)
        outcome.message = message or outcome.message
        return outcome

    return solve


# OMPL -----------------------------------------------------------------------------------------------------------------
def _ompl(name: str, search_by: Callable[[Any, Any, Search], None]) -> Rival:
    """Return a rival that prepares a planner of OMPL, and searches by a function of its setup and of itself."""

    @contextlib.contextmanager
    def rival(problem: RobotPath, _folder: Path, seed: int) -> Iterator[Callable[[Search], None]]:
        from ompl import geometric

        _begin(seed)
        tests = [Collisions(problem.scene)]
        setup = _setup(problem, tests)
        planner = getattr(geometric, name)(setup.getSpaceInformation())
        setup.setPlanner(planner)
        setup.setup()
        try:
            yield lambda search: search_by(setup, planner, search)
        finally:  # OMPL's objects and ours refer to each other, which no collector sees, so free what is large
            setup.clear()
            tests.clear()

    return rival


@functools.cache
def _begin(seed: int) -> None:
    """Silence OMPL and set its seed, which is possible only once in a process."""
    from ompl import util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed)


def _setup(problem: RobotPath, tests: list[Collisions]) -> Any:
    """Return the ``SimpleSetup`` of a problem, with the tests of states and motions in a list of one."""
    from ompl import base, geometric

    joints = range(len(problem.start))
    space = base.RealVectorStateSpace(len(joints))
    bounds = base.RealVectorBounds(len(joints))
    for joint, (low, high) in enumerate(problem.scene.arm.limits.tolist()):
        bounds.setLow(joint, low)
        bounds.setHigh(joint, high)
    space.setBounds(bounds)

    class Motions(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802
            return tests[0].is_way_free([one[joint] for joint in joints], [other[joint] for joint in joints])

    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: tests[0].is_free([state[joint] for joint in joints]))
    information.setMotionValidator(Motions(information))
    ends = [space.allocState() for _ in range(2)]
    for state, configuration in zip(ends, (problem.start, problem.ends[0]), strict=True):
        for joint in joints:
            state[joint] = configuration[joint]
    setup.setStartAndGoalStates(*ends)
    return setup


def _rows(setup: Any) -> Rows:
    """Return the path that a setup has found."""
    joints = range(setup.getStateSpace().getDimension())
    return [[state[joint] for joint in joints] for state in setup.getSolutionPath().getStates()]


def _expect_no_time(status: Any, search: Search) -> None:
    """Raise an error if a planner has stopped without a path before its time, as it does where an end is not free."""
    if not search.is_over:
        raise ValueError(f"it stopped with {status.asString()}")


def _again_and_again(setup: Any, _planner: Any, search: Search) -> None:
    """Search anew after each path; simplify each, and the first only after it has been offered as it is."""
    from ompl import base

    condition = base.PlannerTerminationCondition(lambda: search.is_over)
    while not search.is_over:
        setup.clear()
        status = setup.solve(condition)
        if not setup.haveExactSolutionPath():
            _expect_no_time(status, search)
            return
        if not search.has_proven:
            search.offer(_rows(setup))
        setup.getPathSimplifier().simplify(setup.getSolutionPath(), condition)
        search.offer(_rows(setup))


def _in_one_go(setup: Any, planner: Any, search: Search) -> None:
    """Search once; better paths are copied meanwhile. For planners that give each of them to the setup.

    Where the straight line is free it is offered, and that is all: AORRTC of OMPL 2.0.1 loses the start there.
    """
    from ompl import base

    if setup.getProblemDefinition().isStraightLinePathValid() is not None:
        search.offer([search.problem.start, search.problem.ends[0]])
        return
    best = math.inf

    def look() -> bool:
        nonlocal best
        if setup.haveExactSolutionPath() and planner.bestCost().value() < best:
            best = planner.bestCost().value()
            search.offer(_rows(setup))
        return search.is_over

    status = setup.solve(base.PlannerTerminationCondition(look))
    look()
    setup = planner = None  # `look` holds both, and the planner keeps `look`
    if math.isinf(best):
        _expect_no_time(status, search)


def _with_halts(setup: Any, planner: Any, search: Search) -> None:
    """Halt at each better path, take it, and go on. For planners that give their path to the setup when they halt."""
    from ompl import base

    best = math.inf
    condition = base.PlannerTerminationCondition(lambda: search.is_over or planner.bestCost().value() < best)
    while not search.is_over:
        status = setup.solve(condition)
        if not setup.haveExactSolutionPath():
            _expect_no_time(status, search)
            return
        if planner.bestCost().value() >= best:
            return  # the time is over, or no path can be shorter
        best = planner.bestCost().value()
        search.offer(_rows(setup))


REFERENCE = "RRTConnect"
RIVALS: dict[str, Rival] = {
    REFERENCE: _ompl(REFERENCE, _again_and_again),
    "AORRTC": _ompl("AORRTC", _in_one_go),
    "BITstar": _ompl("BITstar", _with_halts),
    "mplib": robot_own_checks.mplib,
    "roboplan": robot_own_checks.roboplan,
}
