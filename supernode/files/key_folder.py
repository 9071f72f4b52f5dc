"""Find the key folder of a process: who it shows itself to be on encrypted links; `supernode keys` made the folder."""

import stat
from pathlib import Path

from problems.errors import BadInput
from supernode.files.private_file import read_private
from supernode.files.secret_file import is_secret
from wire.members import KEY, MEMBER, SECRET, BadMemberError, Identity


def identity_in(folder: Path, role: str, option: str = "--keys") -> Identity:
    """Return the identity of a process: that of a member's folder, or of the folder for the role in an authority's.

    Args:
        folder: the folder that the user named.
        role: the role that the process has.
        option: the option that named the folder, for errors.

    Raises:
        BadInput: if there is no such identity, it has another role, or others may read its key.
    """
    inner = folder / role
    place = inner if inner.is_dir() and not (folder / MEMBER).exists() else folder
    try:
        found, mode = Identity.read(place), (place / KEY).stat().st_mode
    except OSError as error:
        expected = f"expected the key folder of a {role}, which `supernode keys` makes"
        raise BadInput(f"{option}: {error.filename}: {expected}, found: {error.strerror}") from None
    except BadMemberError as error:
        raise BadInput(f"{option}: {place / MEMBER}: {error}") from None
    if found.member.role != role:
        raise BadInput(f"{option}: {place}: expected the key folder of a {role}, found that of a {found.member.role}")
    if mode & (stat.S_IRGRP | stat.S_IROTH):
        raise BadInput(
            f"{option}: {place / KEY}: expected a file that only its owner can read; chmod 600 {place / KEY}"
        )
    return found


def secret_in(identity: Identity) -> bytes:
    """Return the secret that coordinator, spy and nodes share, from the key folder of one of them.

    Raises:
        BadInput: if it cannot be read.
    """
    text = read_private(identity.folder / SECRET, "--keys", "the cluster's secret")
    if not is_secret(text):
        raise BadInput(f"--keys: {identity.folder / SECRET}: expected the secret that `supernode keys` made")
    return bytes.fromhex(text)
