"""Check submitted problems before they are accepted.

A user's own problem is checked in a child process: its code may be slow, crash or never return. A client names the
module only, never its folder: modules come from the folder that the cluster was started with.
"""

import json
import os
import subprocess
import sys

from problems import BadInput, ProblemFile, child_process, registry
from problems.modules import Modules

_WITHIN = 60.0  # seconds; a user's module may import a lot


class Checker(Modules):
    """Reads and checks problem files; users' problems only of modules that may be run."""

    def check(self, file: ProblemFile, before: ProblemFile | None = None) -> None:
        """Refuse a wrong problem, or an update that codes individuals in another way than the problem ``before`` it.

        Raises:
            BadInput: if the problem is refused; the message names the file and the field.
        """
        if is_own(file):
            _check_in_a_child(file, before)
        else:
            check(file, before)


def is_own(file: ProblemFile) -> bool:
    """Return whether checking the problem runs a user's code."""
    return registry.is_users_own(file.kind)


def check(file: ProblemFile, before: ProblemFile | None = None) -> None:
    """Check a problem as `Checker.check` does, but always in this process."""
    problem = file.problem()
    file.refuse_unreachable()
    if before is not None:
        file.go_on_from(before, problem)


def _check_in_a_child(file: ProblemFile, before: ProblemFile | None) -> None:
    files = [file.to_json(), None if before is None else before.to_json()]
    command = [sys.executable, "-P", "-m", "coordinator.service.checking", str(os.getpid())]
    try:
        done = subprocess.run(
            command, input=json.dumps(files).encode(), capture_output=True, timeout=_WITHIN, check=False
        )
        complaint = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise BadInput(f"{file.name}: the check of {file.kind!r} took longer than {_WITHIN:.0f} s") from None
    except ValueError:  # no JSON on its output: it ended before it could answer
        raise BadInput(f"{file.name}: the check of {file.kind!r} died: {_last_words(done)}") from None
    if complaint is not None:
        raise BadInput(complaint)


def _last_words(done: "subprocess.CompletedProcess[bytes]") -> str:
    lines = done.stderr.decode(errors="replace").split("\n")
    said = [line for line in lines if line.strip()]
    return said[-1] if said else f"exit status {done.returncode}"


def _main() -> None:
    """Run the check in the child: files on standard input, an error message or null on standard output.

    `child_process.begin` keeps that output apart from what the user's module prints.
    """
    answer = child_process.begin(int(sys.argv[1]))
    file, before = (None if each is None else ProblemFile.from_json(each) for each in json.load(sys.stdin))
    assert file is not None
    try:
        check(file, before)
    except BadInput as error:
        complaint: str | None = str(error)
    else:
        complaint = None
    os.write(answer, json.dumps(complaint).encode())
    os._exit(0)


if __name__ == "__main__":
    _main()
