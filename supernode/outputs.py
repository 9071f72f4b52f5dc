"""Files that commands write: one that cannot be written is one line of complaint, not a traceback."""

from pathlib import Path

from problems import BadInput


def write_output(data: bytes, name: str) -> None:
    """Write the file that ``-o`` names.

    Raises:
        BadInput: if it cannot be written.
    """
    try:
        Path(name).write_bytes(data)
    except OSError as error:
        raise unwritable(name, error) from None


def unwritable(name: str, error: OSError) -> BadInput:
    """The complaint about it."""
    return BadInput(f"-o: expected a file that can be written, found {name}: {error.strerror or error}")
