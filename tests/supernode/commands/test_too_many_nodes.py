import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = str(Path(__file__).parents[3] / "examples/arm-ik.toml")


@pytest.mark.parametrize(
    "arguments",
    [
        ("solve", EXAMPLE, "--torus", "300x300"),
        ("solve", EXAMPLE, "--torus", "300x300", "--dashboard", "127.0.0.1:0"),
        ("up", "--torus", "300x300", "--state", "state"),
        ("up", "--torus", "300x300", "--state", "state", "--detach"),
        ("node", "--connect", "tcp/127.0.0.1:1", "--nodes", "90000"),
    ],
    ids=" ".join,
)
def test_a_command_for_too_many_nodes_says_how_many_there_can_be(arguments: tuple[str, ...], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "supernode", *arguments]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    error = done.stderr.splitlines()[-1]
    assert error.startswith("error: expected at most ")
    assert "found 90000; ask for fewer, or insist with --force" in error


def test_an_experiment_with_too_many_nodes_does_not_begin(tmp_path: Path, monkeypatch, capsys) -> None:
    from coordinator.launch import capacity
    from supernode.__main__ import main

    monkeypatch.setattr(capacity, "limits", lambda _: [capacity.Limit(8, "it is a small machine")])
    output = tmp_path / "experiment"
    assert main(["scale", EXAMPLE, "--nodes", "4,16", "-o", str(output)]) == 2
    assert "expected at most 8 nodes" in capsys.readouterr().err
    assert not output.exists()
