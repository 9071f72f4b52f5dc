"""Read arms from URDF files by pinocchio (the extra ``dynamics``) into plain values.

It runs only where a problem file is read. The result replaces the file's name, so nodes need no pinocchio.
"""

from __future__ import annotations

import os
import re
import sysconfig
from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.plain_values import is_file

_PACKAGE = "example-robot-data"
_LEAST_INERTIA = 1e-12  # kg m²: a mass matrix with a smaller eigenvalue counts as singular
_MOST = 1e6  # the greatest value of any limit, as in a problem file
_MISSING = "{} is not installed: pip install 'supernode[dynamics]'"


def read(name: str, joints: list[str] | None, folder: Path, stated: Container[str] = ()) -> dict[str, Any]:
    """Return the fields ``bodies``, ``torque`` and ``velocity`` of an arm.

    Joints that are not named are held at their neutral positions, and their links become part of the link before.

    Args:
        name: The URDF's name as in the problem file.
        joints: The names of the joints that move; None for all revolute ones.
        folder: The folder of the problem file.
        stated: Fields that the problem file states itself, so that the URDF need not.

    Raises:
        BadInput: If pinocchio is not installed, the URDF cannot be read, its joints are no serial chain, a link has no
            mass, or a limit is missing.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise BadInput(f"arm.urdf: {_MISSING.format('pinocchio')}") from error
    path = _path(name, folder)
    model = _reduced(pinocchio, _parsed(pinocchio, path), joints)
    # Joint 0 is pinocchio's universe, which never moves.
    for joint in range(1, model.njoints):
        if model.parents[joint] != joint - 1:
            raise BadInput(
                f"arm.joints: expected a serial chain, found {model.names[joint]!r} after "
                f"{model.names[model.parents[joint]]!r}; name the joints of one chain"
            )
    # A joint with nothing heavy beyond it could accelerate without bound, so no least time would exist.
    if np.linalg.eigvalsh(_mass_matrix(pinocchio, model))[0] < _LEAST_INERTIA:
        raise BadInput(f"arm.urdf: expected links with a mass beyond every joint that moves, found none in {path}")
    limits = {"torque": ("effort", "N m", model.effortLimit), "velocity": ("velocity", "rad/s", model.velocityLimit)}
    read: dict[str, Any] = {"bodies": [_body(model, joint) for joint in range(1, model.njoints)]}
    for field, (attribute, unit, values) in limits.items():
        if field not in stated:
            read[field] = [_limit(*each, field, attribute, unit) for each in zip(model.names[1:], values, strict=True)]
    return read


def _limit(joint: str, value: float, field: str, attribute: str, unit: str) -> float:
    """Return a limit of a joint, if the URDF states one.

    Some exporters write 0 for an unknown limit, and a continuous joint may have none at all. Both are refused, since
    neither 0 nor infinity would be the robot's limit.
    """
    if not 0.0 < value <= _MOST:
        raise BadInput(
            f"arm.{field}: expected the URDF to state a limit above 0 for every joint that moves, found "
            f"{attribute} {value:g} of {joint!r}; state {field} = [..] in the problem file, {unit}, one a joint"
        )
    return float(value)


def _parsed(pinocchio: Any, path: Path) -> Any:
    """Return the model of all joints; what the parser writes to stderr becomes one line of the error."""
    with TemporaryFile() as complaints:
        try:
            with _stderr_to(complaints.fileno()):
                return pinocchio.buildModelFromUrdf(str(path))
        except Exception as error:
            complaints.seek(0)
            reason = _first_complaint(complaints.read().decode(errors="replace")) or error
            raise BadInput(f"arm.urdf: expected a URDF, found {path}: {reason}") from None


@contextmanager
def _stderr_to(descriptor: int) -> Iterator[None]:
    """Redirect file descriptor 2 for a while: urdfdom (C++) writes its errors there, past Python's `sys.stderr`."""
    kept = os.dup(2)
    os.dup2(descriptor, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _first_complaint(text: str) -> str:
    """Return the first error of urdfdom, which writes a line ``Error: ..`` and a line with the place in its source."""
    complaint = re.search(r"^Error:\s*(.*\S)", text, re.MULTILINE)
    return complaint[1] if complaint else ""


def _mass_matrix(pinocchio: Any, model: Any) -> NDArray[np.float64]:
    """Return the mass matrix at the neutral position, kg m²; pinocchio fills only its upper triangle."""
    upper = np.triu(pinocchio.crba(model, model.createData(), pinocchio.neutral(model)))
    matrix: NDArray[np.float64] = upper + np.triu(upper, 1).T
    return matrix


def _path(name: str, folder: Path) -> Path:
    package, _, inner = name.partition(":")
    if package != _PACKAGE or not inner:
        path = folder / name
    else:
        home = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
        if not home.is_dir():
            raise BadInput(f"arm.urdf: {_MISSING.format(_PACKAGE)}")
        path = home / inner
    if not is_file(path):
        raise BadInput(f"arm.urdf: expected a URDF, found no file {path}")
    return path


def _is_revolute(model: Any, joint: int) -> bool:
    kind: str = model.joints[joint].shortname()
    return bool(model.joints[joint].nv == 1) and kind.startswith("JointModelR")


def _reduced(pinocchio: Any, model: Any, joints: list[str] | None) -> Any:
    """Return the model with only the joints that move; the others are locked at their neutral positions."""
    revolute = [model.names[joint] for joint in range(1, model.njoints) if _is_revolute(model, joint)]
    if not revolute:
        raise BadInput("arm.urdf: expected revolute joints, found none")
    wanted = revolute if joints is None else joints
    unknown = [name for name in wanted if name not in revolute]
    if unknown or not wanted:
        raise BadInput(f"arm.joints: expected some of {', '.join(revolute)}, found {unknown or 'none'}")
    locked = [joint for joint in range(1, model.njoints) if model.names[joint] not in wanted]
    return pinocchio.buildReducedModel(model, locked, pinocchio.neutral(model))


def _body(model: Any, joint: int) -> dict[str, Any]:
    placement, inertia = model.jointPlacements[joint], model.inertias[joint]
    moving = model.joints[joint]
    motion = moving.createData()
    moving.calc(motion, np.array([1.0, 0.0])[: moving.nq])  # a continuous joint's state is a cosine and a sine
    body = {
        "name": model.names[joint],
        "rotation": placement.rotation.tolist(),
        "place": placement.translation.tolist(),
        "axis": np.ravel(motion.S)[3:].tolist(),
        "mass": float(inertia.mass),
        "centre": inertia.lever.tolist(),
        "inertia": inertia.inertia.tolist(),
    }
    if moving.nq == 1:
        place = moving.idx_q
        body["limits"] = [float(model.lowerPositionLimit[place]), float(model.upperPositionLimit[place])]
    return body
