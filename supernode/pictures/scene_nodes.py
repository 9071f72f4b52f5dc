"""Convert animations to the nodes of a scene that a viewer can draw: meshes, lines, frames, and poses at each step.

Nothing here knows the viewer (`viewer` does). The name of a node is a path such as ``/robot/3/hand``: a node moves with
the node above it, and a viewer can hide all nodes below a name.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from problems.animation import WORLD, Animation, Body, Floats, Ghost, Role

Color = tuple[int, int, int]

COLORS: dict[Role, Color] = {"robot": (76, 120, 168), "attached": (230, 126, 34), "obstacle": (184, 168, 136)}
GHOST_COLORS: dict[str, Color] = {"start": (70, 160, 90), "goal": (200, 70, 70)}
LINE_COLOR: Color = (138, 79, 191)

_OTHER_GHOST: Color = (130, 130, 130)
_GHOST_OPACITY = 0.25
_OPACITIES: dict[Role, float] = {"obstacle": 0.5}  # the motion is often behind an obstacle; others are opaque
_SAME = 1e-6  # of the entries of placements: a ghost that is nearer to the robot is where the robot is
_LONGEST = 5.0  # seconds in which all steps are played that are not moments in time
_TIME = "time / s"


@dataclass(frozen=True, eq=False)
class FrameNode:
    """A frame without a shape; its bodies are the nodes below it.

    Attributes:
        name: the path of the node.
        frame: the number of the animation's frame.
    """

    name: str
    frame: int


@dataclass(frozen=True, eq=False)
class MeshNode:
    """A surface of triangles in the frame of the node above it.

    Attributes:
        name: the path of the node.
        vertices: points in that frame, m, shape (V, 3).
        triangles: the numbers of their corners, shape (T, 3).
        color: red, green, blue, from 0 to 255.
        opacity: from 0 to 1; None is opaque.
    """

    name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    color: Color
    opacity: float | None = None


@dataclass(frozen=True, eq=False)
class GhostNode:
    """A pale copy of all that moves.

    Attributes:
        name: the path of the node above all of its frames.
        frames: its frames.
        meshes: its bodies.
        placements: the placement of each of the animation's frames, shape (F, 12).
    """

    name: str
    frames: tuple[FrameNode, ...]
    meshes: tuple[MeshNode, ...]
    placements: Floats


@dataclass(frozen=True, eq=False)
class SceneNodes:
    """All nodes of an animation. Only the frames move from step to step.

    Attributes:
        frames: the frames of the bodies, one for each role and frame.
        meshes: the bodies.
        ghosts: the pale copies.
        lines: names, and segments of shape (steps - 1, 2, 3), m.
        targets: names, and placements of shape (12,).
        placements: the placement of each of the animation's frames at each step, shape (steps, F, 12).
    """

    frames: tuple[FrameNode, ...]
    meshes: tuple[MeshNode, ...]
    ghosts: tuple[GhostNode, ...]
    lines: tuple[tuple[str, Floats], ...]
    targets: tuple[tuple[str, Floats], ...]
    placements: Floats

    @staticmethod
    def of(animation: Animation) -> "SceneNodes":
        """Return the nodes of an animation."""
        frames, meshes = _bodies(animation.bodies)
        # What stands still is at the same place in every ghost.
        moving = tuple(body for body in animation.bodies if body.role != "obstacle" and body.frame != WORLD)
        lines = [line for line in animation.lines if len(line) > 1]
        return SceneNodes(
            frames=frames,
            meshes=meshes,
            ghosts=tuple(_ghost(ghost, moving) for ghost in animation.ghosts),
            lines=tuple((f"/lines/{at}", np.stack([each[:-1], each[1:]], axis=1)) for at, each in enumerate(lines)),
            targets=tuple((f"/targets/{number}", each) for number, each in enumerate(animation.targets)),
            placements=animation.frames,
        )

    def shown(self, ghost: GhostNode, step: int) -> bool:
        """Return whether a ghost is to be seen at a step: where the robot stands now, a copy of it would flicker."""
        return float(np.abs(ghost.placements - self.placements[step]).max()) > _SAME


def pose_of(placement: Floats) -> tuple[Floats, Floats]:
    """Return a placement, shape (12,), as a position, m, and a quaternion w, x, y, z."""
    matrix = placement.reshape(3, 4)
    turn: Floats = Rotation.from_matrix(matrix[:, :3]).as_quat(scalar_first=True)
    return matrix[:, 3], turn


def seconds_of(animation: Animation) -> Floats:
    """Return when each step is played, in seconds after the first, shape (steps,).

    Moments in time are played as they are. Other steps, such as solutions side by side, take a second each, and at most
    five seconds together.
    """
    along: Floats = animation.along - animation.along[0]
    if animation.along_name == _TIME or along[-1] <= 0.0:
        return along
    seconds: Floats = along / along[-1] * min(len(along) - 1.0, _LONGEST)
    return seconds


def slider_of(along: Floats) -> tuple[float, float, float]:
    """Return the least and greatest value of a slider over increasing numbers, and a step of few digits between them.

    The step is a power of ten, at most the mean distance of two numbers, so that each number has a place of its own.
    """
    span = float(along[-1] - along[0])
    digits = -int(np.floor(np.log10(span / (len(along) - 1)) + 1e-9))
    step = 10.0**-digits
    low, high = np.floor(along[0] / step + 1e-6) * step, np.ceil(along[-1] / step - 1e-6) * step
    return round(float(low), digits), round(float(high), digits), round(step, max(digits, 0))


class Playback:
    """Which step is shown, and how it changes while the animation plays.

    Args:
        along: the quantity of each step, increasing, shape (steps,).
        seconds: when each step is played, see `seconds_of`.
    """

    def __init__(self, along: Floats, seconds: Floats) -> None:
        self._along, self._seconds = along, seconds
        self._moment = 0.0  # seconds after the first step
        self.step = 0
        self.playing = False

    def toggle(self) -> None:
        """Play, or pause; at the end, play from the beginning."""
        self.playing = not self.playing
        if self.playing and self.step == len(self._along) - 1:
            self._moment, self.step = 0.0, 0

    def seek(self, value: float) -> None:
        """Go to the step whose quantity is nearest to a value."""
        self.step = int(np.argmin(np.abs(self._along - value)))
        self._moment = float(self._seconds[self.step])

    def advance(self, elapsed: float) -> bool:
        """Play for so many seconds, at most to the last step, where it pauses; return whether the step changed."""
        if not self.playing:
            return False
        before = self.step
        self._moment += elapsed
        self.step = int(np.searchsorted(self._seconds, self._moment, side="right")) - 1
        self.playing = self.step < len(self._along) - 1
        return self.step != before


def _bodies(bodies: tuple[Body, ...]) -> tuple[tuple[FrameNode, ...], tuple[MeshNode, ...]]:
    """Return the frames and meshes of bodies, below a node for each role."""
    places = dict.fromkeys((body.role, body.frame) for body in bodies)
    frames = tuple(FrameNode(f"/{role}/{frame}", frame) for role, frame in places)
    names = _unique(f"/{body.role}/{body.frame}/{_word(body.name)}" for body in bodies)
    return frames, tuple(
        _mesh(name, body, COLORS[body.role], _OPACITIES.get(body.role))
        for name, body in zip(names, bodies, strict=True)
    )


def _ghost(ghost: Ghost, bodies: tuple[Body, ...]) -> GhostNode:
    root, color = f"/ghosts/{_word(ghost.name)}", GHOST_COLORS.get(ghost.name, _OTHER_GHOST)
    numbers = dict.fromkeys(body.frame for body in bodies)
    names = _unique(f"{root}/{body.frame}/{_word(body.name)}" for body in bodies)
    meshes = (_mesh(name, body, color, _GHOST_OPACITY) for name, body in zip(names, bodies, strict=True))
    frames = tuple(FrameNode(f"{root}/{number}", number) for number in numbers)
    return GhostNode(root, frames, tuple(meshes), ghost.frames)


def _mesh(name: str, body: Body, color: Color, opacity: float | None = None) -> MeshNode:
    return MeshNode(name, body.vertices.astype(np.float32), body.triangles.astype(np.uint32), color, opacity)


def _word(name: str) -> str:
    """Return a name as one word of a path."""
    return name.replace("/", "_") or "_"


def _unique(names: Iterable[str]) -> Iterator[str]:
    """Yield each name, with a number where it has been before: nodes of one name would replace each other."""
    seen: set[str] = set()
    for name in names:
        number, own = 1, name
        while own in seen:
            number += 1
            own = f"{name} {number}"
        seen.add(own)
        yield own
