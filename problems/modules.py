"""Which users' modules a process may run: those that it was started with, whatever a message says."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from problems.errors import BadInput
from problems.file import ProblemFile


class Modules:
    """The modules that a process of a cluster may import, and where they lie.

    Args:
        allowed: their names.
        folder: where they lie, if not on ``sys.path``; None: the folder that the process was started in.
    """

    def __init__(self, allowed: Collection[str] = (), folder: Path | None = None) -> None:
        self.allowed = frozenset(allowed)
        self.folder = Path.cwd() if folder is None else folder

    def read(self, text: str) -> ProblemFile:
        """Return the problem file that ``text`` is as JSON, if it may be run here; its problem is not yet checked.

        The folder that it names, where a module would be looked for, is replaced by that of this process.

        Raises:
            BadInput: if it is none, or of a user's module that is not allowed.
        """
        file = ProblemFile.from_json(text)
        module, own, _ = file.kind.partition(":")
        if own and module not in self.allowed:
            raise BadInput(
                f"{file.name}: kind: this cluster does not run {file.kind!r}: it was not started with"
                f" --allow-module {module}"
            )
        return replace(file, folder=self.folder)


class AnyModules(Modules):
    """All of them, wherever a file says: for the processes of one user's own, which nobody else can reach."""

    def read(self, text: str) -> ProblemFile:
        """See `Modules`."""
        return ProblemFile.from_json(text)
