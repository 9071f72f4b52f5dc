"""What `solve`, `simulate` and `check` say of a result: its clearance, and that an attempt is no solution."""

import json

import pytest

from supernode.__main__ import main
from supernode.present import clearance_words

NEAR = """

class Near(OneMax):
    clearance: float = 0.0

    def check(self, solution):
        where = {"configuration": [0.123456789, 1], "link": 2}
        return supernode.Verdict(super().check(solution).fitness, (), supernode.Clearance(0.031, where))
"""
WORDS = "least clearance 0.031 m (0.02 m required), at configuration [0.1235, 1], link 2"


def in_process(capsys, *arguments):
    """Exit code, stdout and stderr of a command, without a new process."""
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


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
    told = {"least": 0.031, "where": {"configuration": [0.123456789, 1], "link": 2}, "required": 0.02}
    assert json.loads(out)["clearance"] == told
    result.write_text(out)
    assert in_process(capsys, "check", path, result)[:2] == (0, f"accepted: fitness 0, {WORDS}\n")
    assert json.loads(in_process(capsys, "check", path, result, "--json")[1])["clearance"] == told


def test_a_result_in_words_tells_its_clearance(own_problem, capsys):
    path = of_a_kind(own_problem, "Near", NEAR, "clearance = 0.02")
    assert WORDS in in_process(capsys, "simulate", path, "--torus", "1x1", "--quiet")[1]


def test_nothing_near_is_said_in_words():
    assert clearance_words({"least": None, "where": {}, "required": 0.0}) == "nothing to come close to"


def test_a_kind_without_obstacles_tells_of_no_clearance(own_problem, capsys):
    _, out, _ = in_process(capsys, "simulate", own_problem(), "--torus", "1x1", "--json", "--quiet")
    assert json.loads(out)["clearance"] is None
