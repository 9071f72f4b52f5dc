"""Write the files that commands produce; a file that cannot be written is one line of error, not a traceback."""

from pathlib import Path

from problems import BadInput


def write_output(data: bytes, name: str) -> None:
    """Write ``data`` to the file that the option ``-o`` names.

    Raises:
        BadInput: if it cannot be written.
    """
    try:
        Path(name).write_bytes(data)
    except OSError as error:
        raise unwritable(name, error) from None


def unwritable(name: str, error: OSError) -> BadInput:
    """Return the error about a file that cannot be written."""
    return BadInput(f"-o: expected a file that can be written, found {name}: {error.strerror or error}")
