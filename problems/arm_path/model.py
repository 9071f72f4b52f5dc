"""The model of arm-path: a motion between two configurations that moves one joint at a time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import ONE_BIT, Recipe
from problems.angles import Angle
from problems.planar_arm import model as planar_arm
from problems.planar_arm.model import ArmProblem
from problems.plane import Shapes
from problems.problem import Solution
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator
    from problems.arm_path.stretching import Move

MOST_LINKS = 6
MOST_BITS = 12
_KEPT = 1 << 12  # slices that are cached for an arm of more than two links
_SLICES = slice(8, 12)  # the places of `kernels.Slices` in the table of the kernels
_COARSE = 4  # leading bits of an angle that the tuned recipe uses in the first generations
_MUTATION = 0.03  # probability that a bit flips (tuned)

Rate = Annotated[float, Field(gt=0, le=1e6)]
Path = NDArray[np.float64]  # (rows, links), rad, unwrapped
Cells = NDArray[np.bool_]  # (2^q, 2^q), indexed by the codes of joint 1 and joint 2


class Arm(planar_arm.Arm):
    """A planar arm whose joints may have limits of speed and acceleration."""

    velocity: list[Rate] | None = quantity(
        "rad/s", "greatest speed of each joint, for `supernode export`; if not given, --speed", default=None
    )
    acceleration: list[Rate] | None = quantity(
        "rad/s²", "greatest one of each joint, for `supernode export`; if not given, --acceleration", default=None
    )

    @model_validator(mode="after")
    def _one_rate_a_link(self) -> Self:
        for name, rates in (("velocity", self.velocity), ("acceleration", self.acceleration)):
            if rates is not None and len(rates) != len(self.links):
                raise ValueError(f"{name}: expected one limit for each of {len(self.links)} joints, found {len(rates)}")
        return self


class ArmPathModel(ArmProblem):
    """The fields, coding, recipe, fitness and decoding; `ArmPath` adds what verifies and shows solutions."""

    about: ClassVar[str] = "a path of an arm among obstacles, one joint at a time"
    template: ClassVar[str] = """\
kind = "arm-path"
# unit = "deg"                  # of all angles in this file; "rad" if not given
start = [0.3, 0.4]              # rad, one angle a joint
goal = [2.9, -0.5]              # rad
rounds = 24                     # k: how often each joint is moved, in turn
bits = 8                        # of each move: the angle where it ends
# scan = "from-start"           # or "from-both-ends"; if not given, the recipe's
# self_collision = true         # links that are not neighbours must not touch
# clearance = 0.02              # m, to obstacles and between links that are not neighbours; 0 if not given
# stretch = true                # drop moves that are not needed, and shorten the others

[arm]
links = [1.0, 0.8]              # m, from the base outwards; two to six
base = [0.0, 0.0]               # m
radius = 0.04                   # m, half the thickness of a link
# limits = [[-3.1, 3.1], [-2.6, 2.6]]   # rad, one pair a joint; full circles if not given
# velocity = [1.0, 1.5]         # rad/s, greatest one of each joint in an exported motion
# acceleration = [2.0, 4.0]     # rad/s², greatest one of each joint in an exported motion

[[obstacles]]
shape = "circle"
center = [0.6, 1.3]             # m
radius = 0.25                   # m

[[obstacles]]
shape = "box"
center = [-0.6, 1.1]            # m
size = [0.5, 0.3]               # m
angle = 0.3                     # rad

[[obstacles]]
shape = "polygon"
vertices = [[-1.5, -0.4], [-0.8, -0.9], [-1.4, -1.3]]   # m

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    arm: Arm = quantity("", "the arm")
    start: list[Angle] = quantity("rad", "the configuration where the arm stands, one angle a joint")
    goal: list[Angle] = quantity("rad", "the configuration to reach, one angle a joint")
    rounds: int = quantity("", "how often each joint is moved, in turn: k of M(k, q)", default=24, ge=1, le=1000)
    bits: int = quantity("bit", "bits of each move, the angle where it ends", default=8, ge=1, le=MOST_BITS)
    code: Literal["binary", "gray"] | None = quantity(
        "", 'how an angle is written in bits; if not given, the recipe\'s: "binary"', default=None
    )
    coarse: int | None = quantity(
        "bit",
        "leading bits of each angle that are used in the first generations; if not given, the recipe's: tuned 4, "
        "paper all; the Gray code uses all",
        default=None,
        ge=1,
        le=MOST_BITS,
    )
    scan: Literal["from-start", "from-both-ends"] | None = quantity(
        "",
        "from-start: all moves lead away from the start, until one is blocked; from-both-ends: half of the rounds lead "
        "away from the goal, and blocked moves are left out; if not given, the recipe's: paper from-start, tuned "
        "from-both-ends",
        default=None,
    )
    stretch: bool = quantity(
        "",
        "whether the path found is shortened: moves dropped, merged, and slid within their legal ranges",
        default=False,
    )

    @model_validator(mode="after")
    def _two_to_six_links(self) -> Self:
        links = len(self.arm.links)
        if not 2 <= links <= MOST_LINKS:
            raise ValueError(f"arm.links: expected 2 to {MOST_LINKS} links, found {links}")
        return self

    @property
    def solved_at(self) -> float:
        """0, the fitness of a motion that reaches the goal."""
        return 0.0

    @property
    def solved_when(self) -> str:
        """What `solved_at` means, in words."""
        return "rad from the goal, which is reached"

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return this problem with the recipe's ``code``, ``coarse`` and ``scan`` where the file does not set them."""
        tuned = name == "tuned"
        code = self.code or "binary"
        open_ = {
            "code": code,
            "coarse": min(self.bits, _COARSE) if tuned and code == "binary" else self.bits,
            "scan": "from-both-ends" if tuned else "from-start",
        }
        chosen = self.model_dump(exclude_unset=True)
        return self.model_validate(
            chosen | {field: value for field, value in open_.items() if chosen.get(field) is None}
        )

    @cached_property
    def coding(self) -> BitString:
        """One integer for each move: joint 1, joint 2, .., joint 1, .. (§4)."""
        from genetics.bit_string import BitString
        from problems.arm_path.coding import CoarseToFine

        moves = len(self.arm.links) * self.rounds
        if self.code == "gray" or self.coarse is None or self.coarse >= self.bits:
            return BitString(moves, self.bits, gray=self.code == "gray")
        return CoarseToFine(moves, self.bits, coarse=self.coarse)

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the paper's operators (§3.1, §6), or the tuned ones: elitist, uniform crossover and more mutation."""
        if name == "paper":
            return Recipe("one-point", ONE_BIT if deme > 1 else 1.0 / self.coding.length, "offspring")
        return Recipe("uniform", _MUTATION, "elitist")

    def for_cell(self) -> Self:
        """Return this problem with an empty cache of slices of its own."""
        own = self.model_copy()
        vars(own).pop("_compiled", None)  # the arrays of the cache belong to this operator
        return own

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return 0 if a motion leads to the goal, else its distance to the goal, rad: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code, for every combination of fields."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"path": [[θ..], ..], "cspace_evaluated": share, "slices": ..}``.

        The last two count the slices that this motion alone needs; `merge` replaces them. For two links, ``slices``
        lists the places of the other joint at which the legal ranges of joint 1, then of joint 2, were computed: codes,
        ``"start"`` or ``"goal"``. For more links it is the number of slices computed.
        """
        from problems.arm_path import kernels, stretching

        own = self.for_cell()  # an empty cache, so that only this motion is counted
        path = kernels.follow(writable(genome), own._compiled.table)
        if self.stretch:
            path = stretching.stretched(path, own.are_legal)
        return own._evaluated([own.report()]) | {"path": path.tolist()}

    def report(self) -> bytes:
        """Return which slices this cell has computed.

        For two links, this is a bit for each slice; for more, the number of computed slices and of the cells in them.
        """
        keys, *_, tally = self._compiled.kept[_SLICES]
        return np.packbits(keys[:, -1] != 0).tobytes() if self.is_flat else tally.tobytes()

    def merge(self, solution: Solution, reports: Mapping[int, bytes], finder: int) -> Solution:
        """Return the solution with what was evaluated by all cells; for more than two links by the finder alone.

        Several cells compute the same slices; only the reports of two links tell which ones.
        """
        told = list(reports.values()) if self.is_flat else [reports[each] for each in (finder,) if each in reports]
        return solution | self._evaluated(told) if told else solution

    def _evaluated(self, reports: list[bytes]) -> Solution:
        """Return the share of configuration space in the computed legal ranges, and the slices, as `decode` does.

        For more than two links the share is an upper bound: it counts a cell once for every slice that contains it, and
        a slice again when it is computed again after its eviction from the cache.
        """
        if not self.is_flat:
            slices, cells = np.frombuffer(reports[0], np.int64).tolist()
            return {"cspace_evaluated": min(1.0, cells / self.levels ** len(self.arm.links)), "slices": slices}
        flags = np.bitwise_or.reduce([np.frombuffer(each, np.uint8) for each in reports])
        computed = np.unpackbits(flags)[: 2 * (self.levels + 2)].reshape(2, -1)
        names = [*range(self.levels), "start", "goal"]
        return {
            "cspace_evaluated": float(self.cells_in(computed).mean()),
            "slices": [[names[place] for place in np.flatnonzero(each)] for each in computed],
        }

    def cells_in(self, computed: Genomes) -> Cells:
        """Return the cells in the legal ranges of some slices, for two links.

        A slice of joint 1 tests both links, one of joint 2 only the second.

        Args:
            computed: 1 for each of these slices, shape (2, 2^q + 2), indexed by joint and by the place of the other
                joint.
        """
        from problems.arm_path import kernels

        own = self.for_cell()  # this reference must outlive the call: the table holds only addresses of its arrays
        cells = np.zeros((self.levels, self.levels), np.uint8)
        kernels.mark(np.require(computed.ravel(), np.uint8, ["C", "W"]), cells, own._compiled.table)
        return cells.astype(np.bool_)

    def describe(self, solution: Solution) -> str:
        """Return the moves in words, one a line."""
        path = np.array(solution["path"])
        turns = np.diff(path, axis=0)
        joints = np.argmax(np.abs(turns), axis=1)
        calls = [
            f"joint {joint + 1} by {turn[joint]:+.4f} to {row[joint]:.4f} rad"
            for joint, turn, row in zip(joints, turns, path[1:], strict=True)
        ]
        share = 100 * solution["cspace_evaluated"]
        return "\n".join([f"{len(calls)} moves; {share:.3g} % of configuration space evaluated:", *calls])

    def are_legal(self, rows: Path, moves: list[Move]) -> bool:
        """Return whether moves keep to the joint limits and to the legal ranges of their slices, one after another.

        Args:
            rows: the configurations before the first move and after each, rad, shape (moves + 1, links).
            moves: the moves.
        """
        if self.arm.limits is not None:
            lowest, ranges = self.joint_ranges
            if (rows < lowest).any() or (rows > lowest + ranges).any():
                return False
        return all(self.is_legal(row, move.joint, move.turn) for row, move in zip(rows, moves, strict=False))

    def is_legal(self, configuration: Path, joint: int, turn: float) -> bool:
        """Return whether a joint can turn by ``turn``, rad, from a free configuration of shape (links,)."""
        from problems.arm_path import kernels

        ranges = kernels.ranges_at(joint, np.require(configuration, np.float64, ["C", "W"]), self._compiled.table)
        return kernels.may_turn(ranges, float(configuration[joint]), turn)

    @property
    def is_flat(self) -> bool:
        """Whether the arm has two links, so that every slice can be cached."""
        return len(self.arm.links) == 2

    @property
    def levels(self) -> int:
        """The number of coded angles of a joint."""
        return 1 << self.bits

    @cached_property
    def angles(self) -> Path:
        """The angle of each place, rad, shape (links, 2^q + 2): the coded angles, then start and goal."""
        lowest, ranges = self.joint_ranges
        coded = lowest[:, None] + ranges[:, None] * np.arange(self.levels) / self.steps
        return np.column_stack([coded, self.start, self.goal])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness as an operator. Its table, laid out as `problems.arm_path.kernels` says, serves all kernels."""
        from genetics.operators import Operator
        from problems.arm_path import kernels, ranges

        links, levels, moves = len(self.arm.links), self.levels, self.coding.parameters
        slots = 2 * (levels + 2) if self.is_flat else _KEPT
        both_ends = self.scan == "from-both-ends"
        forward = links * (self.rounds - self.rounds // 2) if both_ends else moves
        shapes = Shapes.of(self.obstacles)
        contacts, blocked = ranges.room_needed(links, np.diff(shapes.starts).tolist())
        return Operator.of(
            kernels.evaluate,
            [self.bits, self.coding.gray, self.self_collision, self.arm.limits is None, both_ends, forward],
            self._nearest,
            np.array(self.arm.links),
            self.angles,
            [*self.arm.base, self.reach_of_links, self.apart],
            shapes.corners,
            shapes.starts,
            shapes.thickness,
            np.zeros((slots, links + 1), np.int64),
            np.zeros(slots, np.int64),
            np.zeros((slots, 2 * ranges.MOST_RANGES)),
            np.zeros(2, np.int64),
            np.zeros((links + 1, 2)),
            np.zeros(contacts),
            np.zeros((blocked, 2)),
            np.zeros((moves + 4, links), np.int64),
            np.zeros(moves, np.int64),
            np.zeros(moves),
            np.zeros(links),
        )

    @cached_property
    def _nearest(self) -> NDArray[np.int64]:
        """The codes of the angles nearest to start and goal, shape (2, links)."""
        lowest, ranges = self.joint_ranges
        steps = np.rint((np.array([self.start, self.goal]) - lowest) / ranges * self.steps).astype(np.int64)
        return steps % self.levels
