"""Read files that only their owner may read."""

import stat
from pathlib import Path

from problems.errors import BadInput


def read_private(path: Path, option: str, what: str) -> str:
    """Return the text of a file, stripped of surrounding white space.

    Args:
        path: the file.
        option: the option that named it, for the error.
        what: what the file is expected to hold, for the error.

    Raises:
        BadInput: if it cannot be read, or users other than its owner may read it.
    """
    try:
        text, mode = path.read_text(encoding="utf-8").strip(), path.stat().st_mode
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{option}: {path}: expected {what}, found {error}") from None
    if mode & (stat.S_IRGRP | stat.S_IROTH):
        expected = f"expected a file that only its owner can read, found mode {stat.S_IMODE(mode):o}"
        raise BadInput(f"{option}: {path}: {expected}; chmod 600 {path}")
    return text
