import threading
from pathlib import Path

import pytest

from problems import BadInput
from supernode.__main__ import main
from supernode.files.secret_file import read_or_make


def test_a_secret_that_is_not_there_is_made_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "secret"
    secret = read_or_make(path)
    assert len(secret) == 32
    assert read_or_make(path) == secret
    assert path.stat().st_mode & 0o777 == 0o600
    assert list(path.parent.iterdir()) == [path]
    assert read_or_make(tmp_path / "other") != secret


def test_who_start_at_the_same_time_share_one_secret(tmp_path: Path) -> None:
    found: list[bytes] = []
    gate = threading.Barrier(8)

    def start() -> None:
        gate.wait()
        found.append(read_or_make(tmp_path / "secret"))

    threads = [threading.Thread(target=start) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert len(set(found)) == 1


def test_a_secret_of_one_s_own(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    path.write_text("ab" * 32 + "\n")
    path.chmod(0o400)
    assert read_or_make(path) == b"\xab" * 32


@pytest.mark.parametrize("text", ["", "short", "AB" * 32, "g" * 64, "ab" * 33, "é"])
def test_what_is_no_secret_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "secret"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(BadInput, match=f"--secret-file: {path}: expected "):
        read_or_make(path)


def test_a_secret_that_others_may_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    path.write_text("ab" * 32)
    path.chmod(0o644)
    with pytest.raises(BadInput, match=f"found mode 644; chmod 600 {path}"):
        read_or_make(path)


def test_a_place_where_it_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"--secret-file: .*: cannot make it: "):
        read_or_make(tmp_path / "file" / "secret")


@pytest.mark.parametrize(
    "command",
    [("coordinator", "--nodes", "1", "--state", "state"), ("spy",), ("node", "--nodes", "1")],
    ids=lambda command: command[0],
)
def test_each_of_those_who_share_it_asks_for_it(command, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret").write_text("nonsense")
    words = ["--connect", "tcp/127.0.0.1:1", "--secret-file", "secret"]
    assert main([*command, *words]) == 2
    assert capsys.readouterr().err.startswith("error: --secret-file: secret: expected ")


def test_by_default_it_is_the_user_s_own(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "supernode").write_text("no folder")
    assert main(["node", "--connect", "tcp/127.0.0.1:1", "--nodes", "1"]) == 2
    assert capsys.readouterr().err.startswith(f"error: --secret-file: {tmp_path}/supernode/secret: ")
