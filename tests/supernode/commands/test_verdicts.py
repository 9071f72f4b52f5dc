"""What `solve`, `simulate` and `check` say of a result: its clearance, and that an attempt is no solution."""

import json
import re
from pathlib import Path

import pytest
from command_line import in_process

from problems import load
from supernode.__main__ import main
from supernode.runs.results import result_in
from supernode.terminal.present import clearance_words, headline

ROOT = Path(__file__).resolve().parents[3]
NEAR = """

class Near(OneMax):
    clearance: float = 0.0

    def check(self, solution):
        where = {"configuration": [0.123456789, 1], "link": 2}
        return supernode.Verdict(super().check(solution).fitness, (), supernode.Clearance(0.031, where))
"""
WORDS = "least clearance 0.031 m (0.02 m required), at configuration [0.1235, 1], link 2"


def of_a_kind(own_problem, kind, code, *lines):
    """A problem file of one's own class ``kind``, which ``code`` defines."""
    path = own_problem(*lines)
    module = path.with_name("own_module.py")
    module.write_text(module.read_text() + code)
    path.write_text(path.read_text().replace("OneMax", kind))
    return path


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_a_result_tells_its_least_clearance_and_where_that_is(own_problem, tmp_path, capsys, command):
    path, result = of_a_kind(own_problem, "Near", NEAR, "clearance = 0.02"), tmp_path / "result.json"
    _, out, _ = in_process(capsys, command, path, "--torus", "1x1", "--json", "--quiet")
    told = {"least": 0.031, "where": {"configuration": [0.123456789, 1], "link": 2}, "required": 0.02, "unit": "m"}
    assert json.loads(out)["clearance"] == told
    result.write_text(out)
    assert in_process(capsys, "check", path, result)[:2] == (0, f"accepted: fitness 0, {WORDS}\n")
    assert json.loads(in_process(capsys, "check", path, result, "--json")[1])["clearance"] == told


def test_a_result_in_words_tells_its_clearance(own_problem, capsys):
    path = of_a_kind(own_problem, "Near", NEAR, "clearance = 0.02")
    assert WORDS in in_process(capsys, "simulate", path, "--torus", "1x1", "--quiet")[1]


def test_nothing_near_is_said_in_words():
    assert clearance_words({"least": None, "where": {}, "required": 0.0, "unit": "m"}) == "nothing to come close to"


def test_a_kind_without_obstacles_tells_of_no_clearance(own_problem, capsys):
    _, out, _ = in_process(capsys, "simulate", own_problem(), "--torus", "1x1", "--json", "--quiet")
    assert json.loads(out)["clearance"] is None


# What the check does not accept ---------------------------------------------------------------------------------------
REFUSED = """

class Refused(OneMax):
    def check(self, solution):
        return supernode.Verdict(super().check(solution).fitness, ("it hits a wall",))

    def draw(self, figure, solution, populations):
        figure.suptitle("ones" if solution else "nothing")
"""
FEW = ("--torus", "2x2", "--generations", 3, "--target", -1)


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_what_the_check_refuses_is_an_attempt_and_no_solution(own_problem, tmp_path, capsys, command):
    path, result, log = of_a_kind(own_problem, "Refused", REFUSED), tmp_path / "result.json", tmp_path / "log.jsonl"
    code, out, err = in_process(capsys, command, path, *FEW, "--json", "--log", log)
    told = json.loads(out)
    assert (code, told["feasible"], told["solution"], list(told["best_attempt"])) == (3, False, None, ["integers"])
    assert all(line.endswith("  infeasible") for line in err.splitlines() if "fitness" in line)
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert {each["feasible"] for each in events if each["event"] == "news"} == {False}
    result.write_text(out)
    code, out, _ = in_process(capsys, "check", path, result)
    assert (code, out) == (3, "rejected: there is no solution, only a best attempt; it hits a wall\n")
    verified = json.loads(in_process(capsys, "check", path, result, "--json")[1])
    assert (verified["accepted"], verified["fitness"]) == (False, told["fitness"])


def test_an_attempt_that_the_check_would_accept_is_no_solution_either(own_problem, tmp_path, capsys):
    result = tmp_path / "result.json"
    result.write_text(json.dumps({"solution": None, "best_attempt": {"integers": [1] * 40}}))
    code, out, _ = in_process(capsys, "check", own_problem(), result)
    assert (code, out) == (3, "rejected: there is no solution, only a best attempt\n")


def test_an_attempt_is_called_so_in_words(own_problem, capsys):
    path = of_a_kind(own_problem, "Refused", REFUSED)
    headline, message, *_ = in_process(capsys, "simulate", path, *FEW, "--quiet")[1].splitlines()
    assert headline.startswith("exhausted: no solution; the best attempt has fitness ")
    assert message == "  it hits a wall"


def test_a_feasible_improvement_is_called_so(own_problem, capsys):
    err = in_process(capsys, "simulate", own_problem(), *FEW)[2]
    assert all(line.endswith("  feasible") for line in err.splitlines() if "fitness" in line)


@pytest.mark.parametrize(
    ("kind", "title"), [("Refused", "infeasible: the best attempt, not a solution: ones"), ("Drawn", "ones")]
)
def test_a_picture_of_an_attempt_says_so(own_problem, tmp_path, capsys, monkeypatch, kind, title):
    path, titles = of_a_kind(own_problem, kind, REFUSED.replace("Refused", kind)), []
    if kind == "Drawn":
        module = path.with_name("own_module.py")
        module.write_text(module.read_text().replace('("it hits a wall",)', "()"))
    monkeypatch.setattr("supernode.pictures.picture.save", lambda figure, _: titles.append(figure.get_suptitle()))
    in_process(capsys, "simulate", path, *FEW, "--quiet", "--plot", tmp_path / "x.png")
    assert titles == [title]


@pytest.mark.parametrize("feasible", [True, False])
def test_a_lost_result_holds_what_was_known_as_what_it_was(file, feasible):
    best = {"epoch": 0, "fitness": 0.5, "feasible": feasible, "solution": {"x": [0.5, 0.0]}}
    view = {"job": "a", "status": "failed", "result": None, "best": best, "file": load(file).to_json()}
    result = result_in(view)
    assert (result.fitness, result.feasible, result.found) == (0.5, feasible, best["solution"])
    assert (result.solution is None, result.best_attempt is None) == (not feasible, feasible)


# What misled ----------------------------------------------------------------------------------------------------------
def test_the_result_of_another_kind_is_said_to_be_one(own_problem, file, tmp_path, capsys):
    result = tmp_path / "result.json"
    result.write_text(
        in_process(capsys, "simulate", file, "--generations", 1, "--torus", "1x1", "--json", "--quiet")[1]
    )
    code, out, _ = in_process(capsys, "check", own_problem(), result)
    assert (code, len(out.splitlines())) == (3, 1)
    assert out.startswith("rejected: the result is of another problem: it is of kind 'function', and ")
    assert out.endswith("own.toml is of kind 'own_module:OneMax'\n")


MANY = """

class Many(OneMax):
    def check(self, solution):
        return supernode.Verdict(super().check(solution).fitness, tuple(f"wall {n}" for n in range(300)))
"""


def test_of_many_objections_three_are_named_after_what_explains_them(own_problem, tmp_path, capsys):
    path, result = of_a_kind(own_problem, "Many", MANY), tmp_path / "result.json"
    result.write_text(json.dumps({"problem_sha256": "0" * 64, "solution": {"integers": [1] * 40}}))
    code, out, _ = in_process(capsys, "check", path, result)
    first = f"rejected: the result is of another problem than {path}: problem_sha256 differs; "
    assert (code, out) == (3, f"{first}wall 0; wall 1; wall 2; and 297 more\n")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (["slove", "x.toml"], "'solve'"),
        (["solve", "x.toml", "--sed", "7"], "'--seed'"),
        (["export", "5f3a09c1", "--records", "histry"], "'history'"),
    ],
)
def test_what_is_spelled_wrongly_gets_a_suggestion(capsys, typed, meant):
    with pytest.raises(SystemExit):
        main(typed)
    assert f"; did you mean {meant}? (see `supernode" in capsys.readouterr().err


def test_a_search_for_the_least_that_finds_nothing_better_says_for_how_long(tmp_path, capsys):
    terrain = tmp_path / "terrain.toml"
    terrain.write_text(re.sub(r"(?m)^target = .*$", "", (ROOT / "examples" / "terrain.toml").read_text()))
    code, out, _ = in_process(capsys, "simulate", terrain, "--torus", "2x2", "--stall", 30, "--quiet", "--no-oracle")
    assert (code, out.startswith("stalled, nothing better for 30 generations: fitness ")) == (0, True)


def test_a_job_that_never_ran_says_so_in_words(file):
    view = {"job": "a", "status": "deadline", "result": None, "best": None, "file": load(file).to_json()}
    assert headline(result_in(view)) == "deadline: it was still waiting for nodes, and never ran"
