"""The layout of genomes and of the table of all operators, and the random draws of one individual.

The parts of the table: numbers of joints and of items (1, 2); limits (2, joints); start and goals (1 + goals, joints);
the memo of segments; then the arrays of the scene. A rate may follow.

A *way* is a list of configurations in an array of shape (`MOST_POINTS`, joints), the start first. All of its points but
the start and the goal lie on the grid of the genes, so what is proven for a way holds for the decoded genome.
"""

from typing import Any, NamedTuple

import numpy as np

from genetics.randomness import draw, normal, unit
from genetics.sequence_kernels import clear_after
from lowlevel import pointers
from lowlevel.compiled import subroutine
from problems.robot_path.memo_kernels import IS_BLOCKED, IS_FREE, UNKNOWN, key_of, recall, remember
from problems.robots.motion_kernels import is_way_free, make_room
from problems.robots.scene_kernels import SCENE_PARTS, scene_of

MOST_POINTS = 512
"""The most points of a way while it is made; a genome has fewer."""
FINEST = 0xFFFF
"""The greatest gene."""
SCENE = 4
"""The place of the scene's first array in the table."""
RATE = SCENE + SCENE_PARTS
"""The place of the rate of mutation in the table of a variation."""


class Task(NamedTuple):
    """All that an operator needs to know."""

    joints: Any
    most: Any  # items of a genome
    low: Any  # (joints,)
    step: Any  # (joints,): what one gene is worth
    start: Any  # (joints,)
    goals: Any  # (goals, joints)
    scene: Any
    room: Any  # scratch of the motion checks
    memo: Any  # the segments that were tested last


class Dice(NamedTuple):
    """The coordinates of the draws of one individual, and how many have been made."""

    seed: Any
    cell: Any
    generation: Any
    purpose: Any
    individual: Any
    made: Any  # (1,) int64


@subroutine
def task_of(table: Any) -> Any:
    """Return the task of a table, with new scratch."""
    sizes, limits, ends = pointers.integers(table, 0)[0], pointers.reals(table, 1), pointers.reals(table, 2)
    scene = scene_of(table, SCENE)
    step = (limits[1] - limits[0]) / FINEST
    memo = pointers.integers(table, 3)
    return Task(sizes[0], sizes[1], limits[0], step, ends[0], ends[1:], scene, make_room(scene), memo)


@subroutine
def dice_of(seed: Any, cell: Any, generation: Any, purpose: Any, individual: Any) -> Any:
    """Return the draws of an individual, none of them made yet."""
    return Dice(seed, cell, generation, purpose, individual, np.zeros(1, np.int64))


@subroutine
def toss(dice: Any) -> Any:
    """Return the next draw, a number in [0, 1)."""
    dice.made[0] += 1
    return unit(draw(dice.seed, dice.cell, dice.generation, dice.purpose, dice.individual, dice.made[0]))


@subroutine
def deviate(dice: Any) -> Any:
    """Return a standard normal number, which takes two draws."""
    dice.made[0] += 2
    first = draw(dice.seed, dice.cell, dice.generation, dice.purpose, dice.individual, dice.made[0] - 1)
    second = draw(dice.seed, dice.cell, dice.generation, dice.purpose, dice.individual, dice.made[0])
    return normal(first, second)


@subroutine
def pick(dice: Any, limit: Any) -> Any:
    """Return a whole number below ``limit``."""
    return min(np.int64(limit) - 1, np.int64(toss(dice) * limit))


# Points and genes -----------------------------------------------------------------------------------------------------
@subroutine
def gene_of(task: Any, joint: Any, value: Any) -> Any:
    """Return the gene nearest to a value of a joint."""
    if task.step[joint] <= 0.0:
        return 0
    return np.int64(min(float(FINEST), max(0.0, np.rint((value - task.low[joint]) / task.step[joint]))))


@subroutine
def value_of(task: Any, joint: Any, gene: Any) -> Any:
    """Return the value of a joint, as every decoding has it."""
    return task.low[joint] + task.step[joint] * gene


@subroutine
def snap(task: Any, point: Any) -> Any:
    """Move a point to the grid of the genes, in place."""
    for joint in range(task.joints):
        point[joint] = value_of(task, joint, gene_of(task, joint, point[joint]))


@subroutine
def distance(one: Any, other: Any) -> Any:
    """Return the Euclidean distance of two configurations."""
    total = 0.0
    for joint in range(one.size):
        total += (one[joint] - other[joint]) ** 2
    return np.sqrt(total)


@subroutine
def is_same(one: Any, other: Any) -> Any:
    """Return whether two configurations are equal."""
    for joint in range(one.size):  # noqa: SIM110 - compiled code has no generators
        if one[joint] != other[joint]:
            return False
    return True


@subroutine
def length_of(way: Any, count: Any) -> Any:
    """Return the length of a way."""
    total = 0.0
    for place in range(count - 1):
        total += distance(way[place], way[place + 1])
    return total


@subroutine
def read_way(numbers: Any, task: Any, way: Any) -> Any:
    """Fill a way from a genome's numbers; return the number of points and the index of the goal."""
    items = np.int64(numbers[0])
    way[0] = task.start
    for item in range(items - 1):
        for joint in range(task.joints):
            way[1 + item, joint] = value_of(task, joint, np.int64(numbers[1 + item * task.joints + joint]))
    # A genome from outside may name a goal that does not exist.
    goal = min(np.int64(numbers[1 + (items - 1) * task.joints]), task.goals.shape[0] - 1)
    way[items] = task.goals[goal]
    return items + 1, goal


@subroutine
def write_way(way: Any, count: Any, goal: Any, task: Any, numbers: Any) -> Any:
    """Write a way into a genome's numbers; return False, and write nothing, if it has too many points."""
    items = count - 1
    if items > task.most:
        return False
    for item in range(items - 1):
        for joint in range(task.joints):
            numbers[1 + item * task.joints + joint] = gene_of(task, joint, way[1 + item, joint])
    last = 1 + (items - 1) * task.joints
    numbers[last : last + task.joints] = 0
    numbers[last] = goal
    clear_after(numbers, items, task.joints)
    return True


@subroutine
def is_step_free(task: Any, one: Any, other: Any) -> Any:
    """Return whether the straight segment between two configurations is free."""
    key = key_of(one, other)
    answer = recall(task.memo, key, one, other)
    if answer == UNKNOWN:
        answer = IS_FREE if is_way_free(task.scene, one, other, task.room) else IS_BLOCKED
        remember(task.memo, key, one, other, answer)
    return answer == IS_FREE


@subroutine
def is_free_all_along(task: Any, way: Any, count: Any) -> Any:
    """Return whether all segments of a way are free."""
    for place in range(count - 1):  # noqa: SIM110 - as above
        if not is_step_free(task, way[place], way[place + 1]):
            return False
    return True
