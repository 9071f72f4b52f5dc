"""A folder with the latest checkpoints of one run, from which `supernode resume` lets it go on."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from coordinator.jobs.checkpoint import KEPT, Checkpoint
from problems import BadInput
from problems.modules import AnyModules

_SUFFIX = ".checkpoint"
_DIGITS = 8


class CheckpointFolder:
    """The checkpoints of one run, as files that are numbered in the order of time.

    A file appears under its name only when it is whole and on the disk.

    Args:
        path: the folder; it is made with the first checkpoint.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def keep(self, checkpoint: Checkpoint) -> None:
        """Write a checkpoint, and delete the oldest beyond `KEPT`.

        Raises:
            OSError: if it cannot be written, as on a full disk; then nothing of it is left. It names the folder.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            files = self._files()
            number = 1 + max((int(file.stem) for file in files), default=0)
            _write_whole(self.path / f"{number:0{_DIGITS}}{_SUFFIX}", checkpoint.encode())
            for file in files[: len(files) + 1 - KEPT]:
                file.unlink(missing_ok=True)
        except OSError as error:
            raise OSError(f"{self.path}: {error.strerror}") from error

    def latest(self) -> tuple[Checkpoint, list[str]]:
        """Return the latest checkpoint that is whole, and what is wrong with later ones, a sentence for each.

        Raises:
            BadInput: if there is none; it names the folder or each damaged file.
        """
        if not self.path.is_dir():
            raise BadInput(f"{self.path}: expected a folder that `solve --checkpoint` has made, found no folder")
        damaged: list[str] = []
        for file in reversed(self._files()):
            try:
                return Checkpoint.decode(file.read_bytes(), AnyModules()), damaged
            except BadInput as error:
                damaged.append(f"{file}: {error}")
            except OSError as error:
                damaged.append(f"{file}: expected a readable checkpoint, found {error.strerror}")
        raise BadInput("; ".join(damaged) or f"{self.path}: expected a folder with checkpoints, found none in it")

    def refuse_other_runs(self) -> None:
        """Raise BadInput if there are checkpoints already: they are another run's, and would be lost."""
        if self._files():
            raise BadInput(
                f"{self.path}: expected no checkpoints of another run, found some: let that run go on by"
                f" `supernode resume {self.path}`, delete the folder, or choose another one by --checkpoints"
            )

    def discard(self) -> None:
        """Delete the checkpoints, and the folder unless it holds something else."""
        for file in self._files():
            file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.path.rmdir()

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from writing checkpoints to the folder, which is made if it is not there.

        Raises:
            BadInput: if another process does, or the folder cannot be made.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise BadInput(f"{self.path}: expected a folder that can be written, found {error}") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise BadInput(f"{self.path}: expected no other process that writes there, found one") from None
        try:
            yield
        finally:
            os.close(descriptor)

    def _files(self) -> list[Path]:
        """Return the files of the checkpoints, the oldest first."""
        return sorted(file for file in self.path.glob(f"*{_SUFFIX}") if file.stem.isdecimal())


def _write_whole(path: Path, data: bytes) -> None:
    """Write a file that is whole or not there, also if the machine stops meanwhile.

    Raises:
        OSError: if it cannot be written.
    """
    begun = path.with_suffix(".part")
    try:
        with begun.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        begun.rename(path)
    except OSError:
        with contextlib.suppress(OSError):
            begun.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # so that the name lasts too
    finally:
        os.close(folder)
