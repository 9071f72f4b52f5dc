"""Read or make the file of a cluster's secret: coordinator, spy and hosts obey only who shares it; see `wire.seal`."""

import contextlib
import os
import re
import secrets
from pathlib import Path

from problems.errors import BadInput
from supernode.files.private_file import read_private
from wire.seal import SECRET_BYTES


def read_or_make(path: Path) -> bytes:
    """Return the secret in a file; if the file does not exist, make it with a new secret.

    Raises:
        BadInput: if it cannot be made or read, users other than its owner may read it, or it holds no secret.
    """
    _make(path)
    text = read_private(path, "--secret-file", "a secret")
    if not is_secret(text):
        raise BadInput(
            f"--secret-file: {path}: expected {2 * SECRET_BYTES} hexadecimal digits, as `openssl rand -hex"
            f" {SECRET_BYTES}` prints them, found something else"
        )
    return bytes.fromhex(text)


def is_secret(text: str) -> bool:
    """Return whether a text is a secret, in hexadecimal digits."""
    return re.fullmatch(rf"[0-9a-f]{{{2 * SECRET_BYTES}}}", text) is not None


def _make(path: Path) -> None:
    """Make the file unless it exists.

    Several processes may start at the same time. Each writes a draft and links it to the final name. Linking fails if
    the name exists, so one draft wins, and no process ever reads half a secret.

    Raises:
        BadInput: if it cannot be made.
    """
    if path.exists():
        return
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}")  # process ids repeat from container to container
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(secrets.token_hex(SECRET_BYTES) + "\n")
        with contextlib.suppress(FileExistsError):
            path.hardlink_to(draft)
        draft.unlink()
    except OSError as error:
        raise BadInput(f"--secret-file: {path}: cannot make it: {error.strerror}") from error
