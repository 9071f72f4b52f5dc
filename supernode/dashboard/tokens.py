"""Read the file of the tokens that the dashboard asks visitors for, and what each of them allows."""

import re
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from problems.errors import BadInput
from supernode.files.private_file import read_private

Access = Literal["full", "read"]
"""What a visitor may do: everything; or look only, and neither submit nor cancel jobs."""

_OPTION = "--dashboard-token-file"
_SHORTEST = 16  # characters
_LINE = re.compile(rf"(?P<token>[A-Za-z0-9._~-]{{{_SHORTEST},}})(?P<read>\s+read)?")


def read_tokens(path: Path) -> Mapping[str, Access]:
    """Return what each token of a file allows; a line is a token, and the word ``read`` if it only lets people look.

    Raises:
        BadInput: if the file cannot be read, others than its owner may read it, or a line is something else.
    """
    tokens: dict[str, Access] = {}
    for number, line in enumerate(read_private(path, _OPTION, "a token").splitlines(), 1):
        if not line.strip():
            continue
        found = _LINE.fullmatch(line.strip())
        if found is None:  # the line is not repeated: it may be a secret
            expected = (
                f"at least {_SHORTEST} letters, digits, '.', '_', '~' or '-', such as {secrets.token_hex(4)}…, "
                "and perhaps the word read"
            )
            raise BadInput(f"{_OPTION}: {path}, line {number}: expected {expected}, found something else")
        if found["token"] in tokens:
            raise BadInput(f"{_OPTION}: {path}, line {number}: expected each token once, found one again")
        tokens[found["token"]] = "full" if found["read"] is None else "read"
    if not tokens:
        raise BadInput(f"{_OPTION}: {path}: expected a token in each line, found an empty file")
    return tokens
