"""The part that the checkers of robot-ik and robot-path share: the proof of a scene, and how far a pose is missed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.robots.fields import GoalPose, rotation_of

if TYPE_CHECKING:
    from problems.robots.model import RobotModel
    from problems.robots.proof import Configuration, Proof


def proof_of(problem: RobotModel, self_collision: bool = True) -> Proof:
    """Return the proof of the problem's robot and scene.

    Args:
        problem: the problem; its compact model is not used.
        self_collision: whether the robot must not touch itself.

    Raises:
        BadInput: if pinocchio or coal is not installed, or robot and scene do not fit.
    """
    from problems.robots.proof import Proof

    fields = problem.model_dump(mode="json", include={"robot", "obstacles", "attached"})
    return Proof.of(fields["robot"], fields["obstacles"], fields["attached"], self_collision)


def refuse_standing_contacts(problem: RobotModel) -> None:
    """Refuse a problem in which a part of the robot that stands still touches an obstacle.

    Raises:
        ValueError: names the pair, and how deep it overlaps.
    """
    contacts = proof_of(problem).standing_contacts(problem.clearance)
    if contacts:
        raise ValueError(
            "robot.fixed: expected joints that hold their links clear of obstacles, found some where "
            f"{contacts[0].in_words(problem.clearance)}; move the obstacle, or state where the joints stand"
        )


def missed_by(target: GoalPose, proof: Proof, configuration: Configuration) -> tuple[float, float]:
    """Return the distance, m, and the angle, rad, of the link from the pose; 0 rad if any rotation will do."""
    pose = proof.pose(configuration, target.link)
    away = float(np.linalg.norm(pose[:3, 3] - target.position))
    if target.quaternion is None:
        return away, 0.0
    # The length of the difference of two rotations is the sine of half the angle between them times the root of 8.
    sine = np.linalg.norm(pose[:3, :3] - rotation_of(target.quaternion)) / np.sqrt(8.0)
    return away, 2.0 * float(np.arcsin(min(1.0, sine)))
