"""`supernode simulate --replay`: a run is repeated from its result."""

import json

import pytest

import supernode
from supernode.__main__ import main

FUNCTION = """
kind = "function"
name = "rastrigin"
dimension = 4

[run]
topology = "torus 2x2"
deme = 3
"""


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "function.toml"
    path.write_text(FUNCTION)
    return path


@pytest.fixture
def simulate(capsys):
    """Runs the command; returns its exit code, result (None if there is none) and what it says."""

    def run(path, *options):
        code = main(["simulate", str(path), "--json", "--quiet", *map(str, options)])
        captured = capsys.readouterr()
        return code, json.loads(captured.out) if captured.out else None, captured.err

    return run


@pytest.fixture
def kept(tmp_path):
    """Keeps a result in a file, with some of its values replaced."""

    def keep(result, **changes):
        path = tmp_path / "result.json"
        path.write_text(json.dumps(result | changes))
        return path

    return keep


SAME = ("status", "fitness", "solution", "found_at", "generations", "evaluations", "run", "directives", "topology")


@pytest.mark.parametrize(
    "options",
    [
        ("--generations", 9, "--target", -1, "--seed", 5),
        ("--stall", 3, "--spy", "root", "--interval", 2, "--topology", "ring 5"),
        ("--seconds", 0.2, "--target", -1),
        ("--target", 1e9),
    ],
)
def test_a_plain_run_is_repeated_with_its_own_settings(simulate, kept, problem, options):
    code, result, _ = simulate(problem, *options)
    again = simulate(problem, "--replay", kept(result))
    assert (again[0], again[2]) == (code, "")
    for name in (*SAME, "history_sha256", "problem_sha256", "messages"):
        assert again[1][name] == result[name], name


def test_a_run_of_processes_in_several_epochs_is_repeated(simulate, kept, problem):
    file = supernode.load(problem)
    with supernode.LocalCluster(torus=(2, 3)) as cluster:
        job = cluster.submit(file, target=-1.0, stall=10**9, deme=4)
        next(job.improvements())
        job.update(name="sphere")
        job.rewire("ring 6")
        job.update(name="rastrigin")
        job.cancel()
        result = job.result(timeout=60).to_json()
    code, again, said = simulate(problem, "--replay", kept(result))
    assert (code, said) == (3, "")
    assert again["history_sha256"] == result["history_sha256"]
    assert [each["do"] for each in again["directives"]] == ["update", "rewire", "update", "stop"]
    for name in ("directives", "run", "topology", "status", "generations", "evaluations", "fitness", "found_at"):
        assert again[name] == result[name], name
    assert (again["run"]["topology"], again["topology"]) == ("torus 2x3", "ring 6")


def test_the_settings_of_the_result_win_over_those_of_the_file(simulate, kept, problem):
    _, result, _ = simulate(problem, "--generations", 9, "--target", -1)
    problem.write_text(FUNCTION + "seed = 7\nstall = 2\nmutation = 0.5\n")
    code, again, said = simulate(problem, "--replay", kept(result))
    assert (code, said) == (3, "")
    assert again["run"] == result["run"]


def test_another_history_is_an_error_after_the_result(simulate, kept, problem):
    _, result, _ = simulate(problem, "--generations", 9, "--target", 1e9)
    code, again, said = simulate(problem, "--replay", kept(result, history_sha256="0" * 64))
    assert code == 3
    assert again["history_sha256"] == result["history_sha256"]
    assert said.startswith("error: ")
    assert f"history_sha256: expected {'0' * 64}, found {result['history_sha256']}\n" in said
    other = result["versions"] | {"numpy": "0.1"}
    _, _, said = simulate(problem, "--replay", kept(result, history_sha256="0" * 64, versions=other))
    assert said.endswith("; versions differ: numpy\n")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"run": None}, "expected a result as `solve --json` prints it, found {"),
        ({"run": {"mode": "async"}}, 'mode: expected lockstep, which alone can be repeated, found "async"'),
        ({"run": {"mode": "lockstep", "sede": 3}}, "run: sede: unknown field"),
        ({"run": {"mode": "lockstep", "deme": 0}}, "run: deme: expected"),
        ({"directives": 3}, "expected a result as `solve --json` prints it"),
        ({"directives": [3]}, "directives: expected tables, found 3"),
        ({"directives": [{"do": "several", "epoch": 9}]}, "such a run cannot be repeated: it had so many epochs"),
        ({"directives": [{"do": "stop", "generation": 3}]}, "directives: reason: expected one, found null"),
        ({"directives": [{"do": "stop", "reason": "cancel"}]}, "directives: generation: expected a whole number"),
        (
            {"directives": [{"do": "rewire", "generation": 3, "topology": "ring 9"}]},
            "topology: expected one of 4 cells",
        ),
        ({"directives": [{"do": "update", "generation": 3, "fields": {"names": 1}}]}, "names: unknown field"),
        ({"history_sha256": None}, "history_sha256: expected one, found null: there is nothing to repeat"),
        ({"problem_sha256": None}, "problem_sha256: expected one, found null"),
        ({"problem_sha256": "0" * 64}, "the result is of another problem than "),
    ],
)
def test_a_result_that_cannot_be_repeated_is_one_error_line(simulate, kept, problem, changes, said):
    _, result, _ = simulate(problem, "--generations", 9, "--target", -1)
    path = kept(result, **changes)
    code, again, error = simulate(problem, "--replay", path)
    assert (code, again) == (2, None)
    assert error.startswith(f"error: {path}: ")
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("text", ["", "[1]", "{", "3", '"text"', "{}"])
def test_what_is_no_result_is_one_error_line(simulate, problem, tmp_path, text):
    path = tmp_path / "result.json"
    path.write_text(text)
    code, _, error = simulate(problem, "--replay", path)
    assert code == 2
    assert error.startswith((f"error: {path}: expected a result", f"error: {path}: expected JSON"))


def test_a_result_that_is_not_there(simulate, problem, tmp_path):
    code, _, error = simulate(problem, "--replay", tmp_path / "none.json")
    assert code == 2
    assert "none.json: expected a result, found No such file or directory" in error


def test_a_replay_takes_no_other_settings(simulate, kept, problem):
    _, result, _ = simulate(problem, "--generations", 9, "--target", -1)
    code, _, error = simulate(problem, "--replay", kept(result), "--seed", 3)
    assert code == 2
    assert error == "error: --replay: the settings are those of the result, expected no other, found seed\n"


def test_a_result_of_another_run_is_found_out(simulate, kept, problem):
    """Its directives do not fit: the target is reached before the update came."""
    _, result, _ = simulate(problem, "--target", 1e9)
    turn = {"do": "update", "epoch": 1, "generation": 500, "fields": {"cost_us": 0.0}}
    changed = supernode.load(problem).changed(turn["fields"], {}).sha256
    code, _, error = simulate(problem, "--replay", kept(result, directives=[turn], problem_sha256=changed))
    assert code == 2
    assert "directives: expected cells to leave after generation 500, but epoch 0 ends after generation" in error
