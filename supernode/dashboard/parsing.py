"""Parse the problem files that browsers send, each in a process of its own.

TOML is parsed in plain Python, and a malicious text (one key with very many dots) keeps the parser busy for hours. The
server's process must not be blocked by that; in a process of its own the kernel's CPU limit ends it.
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

_WITHIN = 20  # seconds of CPU time to parse a file
_AT_ONCE = 2  # processes at the same time
_NOWHERE = Path("/nonexistent")  # a problem from a form names no files, neither here nor on the cluster's machine


class Parser:
    """Parses at most `_AT_ONCE` files at a time; other requests wait."""

    def __init__(self) -> None:
        self._turn = asyncio.Semaphore(_AT_ONCE)

    async def read(self, text: str, name: str) -> ProblemFile:
        """Return the problem file with this text; see `problems.file.parse`.

        Raises:
            BadInput: if it is not a valid problem file, or parsing it takes too long.
        """
        async with self._turn:
            status, answer = await _asked(json.dumps([text, name, _WITHIN]).encode())
        if status == -signal.SIGXCPU:
            raise BadInput(f"{name}: expected TOML that can be read within {_WITHIN} s, found some that takes longer")
        try:
            file, complaint = json.loads(answer)
        except ValueError:  # it wrote nothing
            raise BadInput(f"{name}: expected TOML that can be read, but its parser exited with {status}") from None
        if complaint is not None:
            raise BadInput(complaint)
        return ProblemFile.from_json(file)


async def _asked(question: bytes) -> tuple[int | None, bytes]:
    """Send a question to a parser process; return the process's exit status and its answer."""
    command = [sys.executable, "-P", "-m", __name__]
    process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, stderr=DEVNULL)
    try:
        answer, _ = await process.communicate(question)
    finally:
        if process.returncode is None:  # the request was cancelled
            process.kill()
    return process.returncode, answer


def _main() -> None:
    """Parse in the child: text, name and limit come on standard input; the file or an error goes to standard output."""
    text, name, seconds = json.load(sys.stdin)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))  # holds even if the parent has died
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
