"""The file of tokens, and what is said of a wrong one."""

import pytest

from problems import BadInput
from supernode.dashboard.tokens import read_tokens

TOKEN, READER = "s3cret-s3cret-s3cret", "reader-reader-reader"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "token"
    path.touch(0o600)
    return path


def test_each_line_is_a_token_and_what_it_allows(path):
    path.write_text(f"{TOKEN}\n\n  {READER}  read\r\n")
    assert read_tokens(path) == {TOKEN: "full", READER: "read"}


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", ": expected a token in each line, found an empty file"),
        ("short", ", line 1: expected at least 16"),
        ("sixteen letters, spaces", ", line 1: expected"),
        (f"{TOKEN}\n{READER} write", ", line 2: expected"),
        (f"{TOKEN}read\n{READER} READ", ", line 2: expected"),
        (f"{TOKEN}\n{TOKEN} read", ", line 2: expected each token once"),
    ],
)
def test_what_is_no_token_is_refused_and_not_repeated(path, text, where):
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        read_tokens(path)
    assert str(refused.value).startswith(f"--dashboard-token-file: {path}{where}")
    assert TOKEN not in str(refused.value)
    assert READER not in str(refused.value)


def test_a_file_that_is_missing_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"--dashboard-token-file: .* expected a token"):
        read_tokens(tmp_path / "missing")


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604])
def test_a_token_that_others_can_read_is_refused(path, mode):
    path.write_text(TOKEN)
    path.chmod(mode)
    with pytest.raises(BadInput, match=rf"--dashboard-token-file: .* only its owner can read, found mode {mode:o}"):
        read_tokens(path)
