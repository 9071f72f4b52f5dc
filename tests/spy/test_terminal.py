"""Progress on stderr."""

import topologies
from spy.terminal import Terminal
from wire.news import Improvement, Statistics

BETTER = Improvement(1, 0, 1.25, 17, 6, 0.125, True, {})


def test_a_line_for_each_improvement_where_stderr_is_no_terminal(capsys):
    with Terminal(topologies.parse("torus 4x4")) as terminal:
        terminal.improvement(BETTER)
        terminal.statistics(Statistics(1, 0, 5, 100, 80, 320, 0, 0, 16, 160.0, 1.0, 2.0, 3.0, 4, 0.5, 0.01))
    assert capsys.readouterr().err.split() == [
        *("1.250", "s", "generation", "17", "cell", "(1,", "2)", "fitness", "0.125", "feasible")
    ]


def test_quiet_says_nothing(capsys):
    with Terminal(topologies.parse("torus 4x4"), quiet=True) as terminal:
        terminal.improvement(BETTER)
        terminal.say("anything")
    captured = capsys.readouterr()
    assert captured.err == captured.out == ""
