"""The users' modules that a process may import: those it was started with, whatever a message names.

Importing a module runs its code, so a client of a cluster must not choose which one.
"""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from problems.errors import BadInput
from problems.file import ProblemFile


class Modules:
    """The modules that a process of a cluster may import, and their folder.

    Args:
        allowed: the names of the modules.
        folder: the folder in which they are looked up before ``sys.path``; None for the process's working directory.
    """

    def __init__(self, allowed: Collection[str] = (), folder: Path | None = None) -> None:
        self.allowed = frozenset(allowed)
        self.folder = Path.cwd() if folder is None else folder

    def read(self, text: str) -> ProblemFile:
        """Return the problem file in the JSON ``text`` if this process may run it; its problem is not yet validated.

        The folder that the text names is replaced by this process's own, so that a client cannot choose which file is
        imported.

        Raises:
            BadInput: if ``text`` is no problem file, or its kind is in a module that is not allowed.
        """
        file = ProblemFile.from_json(text)
        module, own, _ = file.kind.partition(":")  # built-in kinds have no colon, and are always allowed
        if own and module not in self.allowed:
            raise BadInput(
                f"{file.name}: kind: this cluster does not run {file.kind!r}: it was not started with"
                f" --allow-module {module}"
            )
        return replace(file, folder=self.folder)


class AnyModules(Modules):
    """Permission to import any module from the folder that a file names.

    Only for processes that serve the user who started them, and that nobody else can reach.
    """

    def read(self, text: str) -> ProblemFile:
        """Return the problem file in the JSON ``text``, see `Modules.read`."""
        return ProblemFile.from_json(text)
