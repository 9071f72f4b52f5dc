"""Run work in a background process that goes on after the command has returned.

Only the standard library is imported at the top: the fork must come before anything that starts threads, because a
forked child has only the thread that forked.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

Ready = Callable[[str], None]
"""Called by the work when it is ready, with one line for people."""


def detached(work: Callable[[Ready], None]) -> str:
    """Fork a process that does ``work``, and return the line that the work reports when it is ready.

    Raises:
        BadInput: if the work raises it before it is ready.
        ClusterFailed: if the work raises anything else before it is ready, or ends without reporting.
    """
    heard, tell = os.pipe()
    if os.fork() == 0:
        os.close(heard)
        _work_and_exit(work, tell)
    os.close(tell)
    with os.fdopen(heard, encoding="utf-8") as pipe:
        # Ends when the child has reported and closed the pipe, or has died.
        kind, _, text = pipe.read().partition(" ")
    return _line(kind, text)


def _line(kind: str, text: str) -> str:
    if kind == "ready":
        return text
    from coordinator.errors import ClusterFailed
    from problems.errors import BadInput

    raise BadInput(text) if kind == "input" else ClusterFailed(text or "the cluster ended before it was ready")


def _work_and_exit(work: Callable[[Ready], None], tell: int) -> None:
    """Do the work in the child and exit; this never returns.

    The child leads a session of its own, so that Ctrl-C on the terminal does not reach it.
    """
    from wire.printable import printable_lines

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
            sys.stderr.write(f"error: {printable_lines(str(error))}\n")
        else:
            say(_blame(error), str(error) or type(error).__name__)
    finally:
        os._exit(code)


def _blame(error: BaseException) -> str:
    from problems.errors import BadInput

    return "input" if isinstance(error, BadInput) else "failure"


def leave_terminal(log: Path) -> None:
    """Take standard input from nowhere and write all output to ``log``.

    Call this before other processes are started: they would inherit the terminal or the pipe and keep it open.
    """
    nothing = os.open(os.devnull, os.O_RDONLY)
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    for number, descriptor in ((0, nothing), (1, file), (2, file)):
        os.dup2(descriptor, number)
    os.close(nothing)
    os.close(file)
