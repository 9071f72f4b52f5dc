"""Reads the problem files that browsers send, each in a process of its own.

TOML is read by a parser in plain Python, and a text made for it (one key with very many dots) keeps it busy for hours.
So that is not done where everybody is served, and the kernel ends whoever takes too long.
"""

import asyncio
import json
import os
import resource
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE
from pathlib import Path

from problems import BadInput, ProblemFile
from problems.file import parse

_WITHIN = 20  # seconds of CPU time
_AT_ONCE = 2  # processes
_NOWHERE = Path("/nonexistent")  # a problem from a form names no files, neither here nor on the cluster's machine


class Parser:
    """Reads a few files at once; others wait."""

    def __init__(self) -> None:
        self._turn = asyncio.Semaphore(_AT_ONCE)

    async def read(self, text: str, name: str) -> ProblemFile:
        """The problem file of that text; see `problems.file.parse`.

        Raises:
            BadInput: if it is none, or takes too long.
        """
        async with self._turn:
            status, answer = await _asked(json.dumps([text, name, _WITHIN]).encode())
        if status == -signal.SIGXCPU:
            raise BadInput(f"{name}: expected TOML that can be read within {_WITHIN} s, found some that takes longer")
        try:
            file, complaint = json.loads(answer)
        except ValueError:  # it has said nothing
            raise BadInput(f"{name}: expected TOML that can be read, but its reader died of it ({status})") from None
        if complaint is not None:
            raise BadInput(complaint)
        return ProblemFile.from_json(file)


async def _asked(question: bytes) -> tuple[int | None, bytes]:
    """Exit status and answer of a process of its own."""
    command = [sys.executable, "-P", "-m", __name__]
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=DEVNULL)
    try:
        answer, _ = await process.communicate(question)
    finally:
        if process.returncode is None:  # whoever asked has gone
            process.kill()
    return process.returncode, answer


def _main() -> None:
    """In the child: text, name and seconds on standard input; the file or a complaint on standard output."""
    text, name, seconds = json.load(sys.stdin)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))  # it ends though nobody is left to kill it
    file = complaint = None
    try:
        file = parse(text, name, _NOWHERE).to_json()
    except BadInput as error:
        complaint = str(error)
    sys.stdout.write(json.dumps([file, complaint]))
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    _main()
