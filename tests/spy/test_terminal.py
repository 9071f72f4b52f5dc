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


def told(capsys):
    """The fitness of each line."""
    return [line.split()[-2] for line in capsys.readouterr().err.splitlines()]


def better(fitness, seconds=1.0, epoch=0):
    return Improvement(1, epoch, seconds, 17, 6, fitness, True, {})


def test_only_improvements_that_matter_have_a_line_but_the_first_and_the_last_always(capsys):
    with Terminal(topologies.parse("torus 4x4"), patience=1e6) as terminal:
        for step in range(100):
            terminal.improvement(better(10.0 - 1e-4 * step))
        assert told(capsys) == ["10"]
        terminal.improvement(better(9.5))
        terminal.improvement(better(9.4999))
        terminal.improvement(better(9.4998))
        terminal.improvement(better(20.0, epoch=1))
        assert told(capsys) == ["9.5", "20"], "an epoch begins anew"
        terminal.improvement(better(19.9999, epoch=1))
    assert told(capsys) == ["19.9999"]


def test_all_have_a_line_if_that_is_wanted(capsys):
    with Terminal(topologies.parse("torus 4x4"), least=0.0) as terminal:
        for step in range(20):
            terminal.improvement(better(10.0 - 1e-4 * step))
        assert len(told(capsys)) == 20
    assert told(capsys) == []


def test_a_best_that_stands_for_a_while_has_a_line_however_little_it_improves(capsys):
    with Terminal(topologies.parse("torus 4x4"), patience=0.0) as terminal:
        terminal.improvement(better(10.0))
        terminal.improvement(better(9.9999))
        waiting = terminal._timer
        if waiting is not None:  # else the line is there already
            waiting.join()
        assert told(capsys) == ["10", "9.9999"]
    assert told(capsys) == []
