"""Checks what clients submit before it is accepted; a user's own problem only in a process of its own.

A client names a module, never the place where it lies: modules are those that the cluster was started with.
"""

import json
import os
import subprocess
import sys

from problems import BadInput, ProblemFile, child_process, registry
from problems.modules import Modules

_WITHIN = 60.0  # seconds: a user's module may have much to import


class Checker(Modules):
    """Checks the problem files of modules that may be run."""

    def check(self, file: ProblemFile, before: ProblemFile | None = None) -> None:
        """Refuse a wrong problem, or one whose individuals are coded otherwise than ``before``.

        Raises:
            BadInput: names the file and the field.
        """
        if is_own(file):
            _check_in_a_child(file, before)
        else:
            check(file, before)


def is_own(file: ProblemFile) -> bool:
    """Whether checking the problem runs a user's code, and so takes a while."""
    return not registry.is_built_in(file.kind) and ":" in file.kind


def check(file: ProblemFile, before: ProblemFile | None = None) -> None:
    """As `Checker.check`, in this process."""
    problem = file.problem()
    file.refuse_unreachable()
    if before is not None:
        file.go_on_from(before, problem)


def _check_in_a_child(file: ProblemFile, before: ProblemFile | None) -> None:
    files = [file.to_json(), None if before is None else before.to_json()]
    command = [sys.executable, "-P", "-m", "coordinator.checking", str(os.getpid())]
    try:
        done = subprocess.run(
            command, input=json.dumps(files).encode(), capture_output=True, timeout=_WITHIN, check=False
        )
        complaint = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise BadInput(f"{file.name}: the check of {file.kind!r} took longer than {_WITHIN:.0f} s") from None
    except ValueError:  # it has said nothing
        raise BadInput(f"{file.name}: the check of {file.kind!r} died: {_last_words(done)}") from None
    if complaint is not None:
        raise BadInput(complaint)


def _last_words(done: "subprocess.CompletedProcess[bytes]") -> str:
    lines = done.stderr.decode(errors="replace").split("\n")
    said = [line for line in lines if line.strip()]
    return said[-1] if said else f"exit status {done.returncode}"


def _main() -> None:
    """In the child: files on standard input, a complaint or null on standard output, whatever the module prints."""
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
