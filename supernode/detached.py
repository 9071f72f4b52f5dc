"""Work that goes on in the background when the command that began it has returned.

Only the standard library is imported here: the fork comes before anything that has threads.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

Ready = Callable[[str], None]
"""What the work calls when it is ready, with a line for people."""


def detached(work: Callable[[Ready], None]) -> str:
    """Fork a process that does ``work``, and return the line that the work says when it is ready.

    Raises:
        BadInput: what the work raises before it is ready, as far as input is to blame.
        ClusterFailed: what else it raises, or if it ends without a word.
    """
    heard, tell = os.pipe()
    if os.fork() == 0:
        os.close(heard)
        _live(work, tell)
    os.close(tell)
    with os.fdopen(heard, encoding="utf-8") as pipe:
        kind, _, text = pipe.read().partition(" ")
    return _line(kind, text)


def _line(kind: str, text: str) -> str:
    if kind == "ready":
        return text
    from coordinator.errors import ClusterFailed
    from problems.errors import BadInput

    raise BadInput(text) if kind == "input" else ClusterFailed(text or "the cluster ended before it was ready")


def _live(work: Callable[[Ready], None], tell: int) -> None:
    """The child's life, which ends here; it leads a session of its own, so that Ctrl-C is none of its business."""
    said = False
    code = 1

    def say(kind: str, text: str) -> None:
        nonlocal said
        said = True
        os.write(tell, f"{kind} {text}".encode())
        os.close(tell)

    try:
        os.setsid()
        work(lambda line: say("ready", line))
        code = 0
    except BaseException as error:
        if said:
            sys.stderr.write(f"error: {error}\n")
        else:
            say(_blame(error), str(error) or type(error).__name__)
    finally:
        os._exit(code)


def _blame(error: BaseException) -> str:
    from problems.errors import BadInput

    return "input" if isinstance(error, BadInput) else "failure"


def leave_terminal(log: Path) -> None:
    """Standard input from nowhere, all output to the log: the terminal, or the pipe, belongs to others.

    To be called before other processes are started, which would keep it open.
    """
    nothing = os.open(os.devnull, os.O_RDONLY)
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for number, descriptor in ((0, nothing), (1, file), (2, file)):
        os.dup2(descriptor, number)
    os.close(nothing)
    os.close(file)
