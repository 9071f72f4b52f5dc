"""Options about checkpoints, which `solve`, `resume` and `up` share."""

import argparse
import contextlib
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from coordinator.store.checkpoint_folder import CheckpointFolder
    from problems import ProblemFile

_UNITS = {"ms": 1e-3, "s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}


def add_checkpoint(parser: "argparse._ActionsContainer", default: str = "off") -> None:
    """Add the option that says how often checkpoints are made."""
    parser.add_argument(
        "--checkpoint",
        metavar="TIME",
        type=_duration,
        default=_duration(default),
        help=f"make a checkpoint as often, such as 30s or 5m, so that the run can go on after a power cut ({default})",
    )


@contextlib.contextmanager
def begun_checkpoints(file: "ProblemFile", options: argparse.Namespace) -> "Iterator[CheckpointFolder | None]":
    """Yield the folder of a run's checkpoints, with one of its beginning; None if it is to have no checkpoints.

    It is there before any process is started, so that a run that is killed at any moment can go on.

    Raises:
        BadInput: if a folder is given, but no time; or the folder has checkpoints of another run, or cannot be written.
    """
    from coordinator.jobs.checkpoint import Checkpoint
    from coordinator.store.checkpoint_folder import CheckpointFolder
    from problems import BadInput

    if options.checkpoint is None:
        if options.checkpoints is not None:
            raise BadInput("--checkpoints: expected --checkpoint TIME with it, such as --checkpoint 30s")
        yield None
        return
    path = Path(f"{Path(options.problem).stem}.run" if options.checkpoints is None else options.checkpoints)
    folder = CheckpointFolder(path)
    with folder.held():
        folder.refuse_other_runs()
        try:
            folder.keep(Checkpoint(file, file))
        except OSError as error:
            raise BadInput(f"{path}: expected a folder that can be written, found {error}") from None
        try:
            yield folder
        except BadInput:  # the run never began
            folder.discard()
            raise


def _duration(text: str) -> float | None:
    """Parse the value of an option: a time such as "30s", "500ms", "5m" or "1h"; None for "off"."""
    if text == "off":
        return None
    found = re.fullmatch(r"([0-9.]+)(ms|s|m|h|)", text)
    try:
        seconds = float(found[1]) * _UNITS[found[2]] if found is not None else math.nan
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"expected a time such as 30s, 500ms or 5m, or off; found {text!r}")
    return seconds
