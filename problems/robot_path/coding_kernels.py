"""The compiled operators of the coding, and the kernels that a node needs besides: loaded before nodes are forked."""

from problems.robot_path import paper_kernels
from problems.robot_path.making_kernels import initialise
from problems.robot_path.variation_kernels import variation
from problems.robots.collision import Collisions

__all__ = ["Collisions", "initialise", "paper_kernels", "variation"]
