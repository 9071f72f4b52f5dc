"""Runs that begin anew, on the command line: what is said of them, and that their results are good for all else."""

import json

import pytest
from stubborn import stubborn_file

from supernode.__main__ import main


@pytest.fixture
def supernode(capfd):
    """Runs a command; returns its exit code, stdout and stderr."""

    def run(name, *options):
        code = main([name, *map(str, options)])
        return code, *capfd.readouterr()

    return run


@pytest.fixture
def problem(tmp_path):
    return stubborn_file(tmp_path, "[run]", "stall = 25", 'topology = "torus 2x2"')


@pytest.mark.parametrize("command", ["simulate", "solve"])
def test_each_attempt_is_told_of(supernode, problem, tmp_path, command):
    picture = tmp_path / "picture.png"
    code, out, err = supernode(command, problem, "--plot", picture)
    assert code == 0
    anew = [line for line in err.splitlines() if line.startswith("stalled: ")]
    assert [line.split(", seed")[0] for line in anew] == [f"stalled: begins anew, restart {n}" for n in (1, 2)]
    assert anew[0].endswith(", size = 24, hurdles = 1")
    assert out.splitlines()[0].endswith(" of epoch 2")
    assert "  restarts after a stall: 2\n" in out
    assert (f"picture: {picture}" in err, "warning" in err) == (True, False)


def test_a_result_with_restarts_is_checked_and_repeated(supernode, problem, tmp_path):
    code, out, _ = supernode("solve", problem, "--json", "--quiet", "--seed", 5)
    assert code == 0
    result = json.loads(out)
    path = tmp_path / "result.json"
    path.write_text(out)
    assert supernode("check", problem, path)[0] == 0
    code, out, err = supernode("simulate", problem, "--replay", path, "--json", "--quiet")
    assert (code, err) == (0, "")
    again = json.loads(out)
    for name in ("history_sha256", "directives", "generations", "evaluations", "found_at", "solution", "status", "run"):
        assert again[name] == result[name], name


def test_restarts_are_an_option_and_a_setting(supernode, problem):
    _, out, _ = supernode("simulate", problem, "--json", "--quiet", "--restarts", 1)
    assert json.loads(out)["run"]["restarts"] == 1
    problem.write_text(problem.read_text() + "restarts = 0\n")
    code, out, _ = supernode("simulate", problem, "--json", "--quiet")
    assert (code, json.loads(out)["status"], json.loads(out)["directives"]) == (3, "stalled", [])
    code, _, err = supernode("simulate", problem, "--restarts", -1)
    assert (code, err) == (2, "error: options: restarts: expected greater than or equal to 0, found -1\n")


def test_the_log_tells_of_each_attempt(supernode, problem, tmp_path):
    logs = [tmp_path / f"{command}.jsonl" for command in ("simulate", "solve")]
    told = []
    for log in logs:
        supernode(log.stem, problem, "--quiet", "--log", log)
        events = [json.loads(line) for line in log.read_text().splitlines()]
        ends = [each for each in events if each["event"] in ("start", "end")]
        told.append([(each["event"], each.get("epoch"), each.get("status"), each.get("generations")) for each in ends])
    assert told[0] == told[1]
    assert [each[0] for each in told[0]] == ["start", "end"] * 3
    assert [each[2] for each in told[0][1::2]] == ["stalled", "stalled", "solved"]


def test_ctrl_c_ends_the_attempt_that_runs(supernode, problem, monkeypatch):
    """Between two attempts the request is known still."""
    from node.simulation import StopRequest

    requests = iter([None] * 60)
    monkeypatch.setattr(StopRequest, "reason", lambda _: next(requests, "cancel"))
    _, out, _ = supernode("simulate", problem, "--json", "--quiet")
    result = json.loads(out)
    assert (result["status"], [each["do"] for each in result["directives"]]) == ("cancelled", ["retry", "stop"])
