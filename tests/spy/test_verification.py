"""The spy believes only what it has evaluated itself, and verifies a run by an independent check."""

import dataclasses
import json
import math
import resource

import numpy as np
import pytest
from one_max import OneMax, plan_of

from node.plan import Plan
from problems import BadInput, Clearance, ProblemFile, Run, Verdict
from spy.collector import Collector
from spy.judgement import Judgement
from spy.past import Lived, Past, best_known, stopped_after
from spy.result import Clocks, result_of, stop_reasons
from spy.run_log import RunLog
from spy.verification import verify
from wire.champion import Champion
from wire.control import decode_answer, encode_answer
from wire.news import Improvement
from wire.report import Proposal, Report, Staleness

FULL, HALF, EMPTY = b"\xff" * 5, b"\xff\xff\xf0\x00\x00", b"\x00" * 5


def collected(plan, *champions):
    collector = Collector(plan, job=1)
    for champion in champions:
        collector.hear(champion, 0.5)
    return collector


def test_improvements_are_told_once_and_only_if_better():
    collector = Collector(plan_of(), job=7)
    first = collector.hear(Champion(20.0, 3, 5, HALF), 0.25)
    assert first == Improvement(7, 0, 0.25, 3, 5, 20.0, True, {"integers": [1] * 20 + [0] * 20})
    assert collector.hear(Champion(20.0, 3, 5, HALF), 0.3) is None
    assert collector.hear(Champion(40.0, 1, 0, EMPTY), 0.3) is None
    assert collector.hear(None, 0.3) is None
    assert collector.hear(Champion(0.0, 9, 1, FULL), 0.5).fitness == 0.0


def test_an_improvement_says_for_which_epoch_it_is_an_answer():
    collector = Collector(dataclasses.replace(plan_of(), epoch=3), job=7)
    better = collector.hear(Champion(20.0, 3, 5, HALF), 0.25)
    assert (better.job, better.epoch) == (7, 3)
    assert collector.best == better


def test_an_earlier_birth_of_the_same_fitness_is_the_champion_but_no_improvement():
    collector = collected(plan_of(), Champion(20.0, 3, 5, HALF))
    assert collector.hear(Champion(20.0, 2, 9, HALF), 0.6) is None
    assert (collector.best.generation, collector.best.cell) == (2, 9)


def test_what_was_known_before_the_nodes_were_rewired_is_known_still():
    before = collected(plan_of(), Champion(20.0, 3, 5, HALF)).best
    collector = Collector(dataclasses.replace(plan_of(), epoch=1), 1, before.carried_to(1))
    assert (collector.best.epoch, collector.best.fitness, collector.best.generation) == (1, 20.0, 0)
    assert collector.hear(Champion(40.0, 1, 0, EMPTY), 0.3) is None
    assert collector.hear(Champion(20.0, 0, 9, HALF), 0.4) is None
    assert collector.best.cell == 9, "who has it now"
    assert collector.hear(Champion(0.0, 9, 1, FULL), 0.5).fitness == 0.0


def test_the_best_of_an_earlier_attempt_stays_as_it_was_found():
    before = collected(plan_of(), Champion(20.0, 3, 5, HALF)).best
    collector = Collector(dataclasses.replace(plan_of(), epoch=1, attempt=1), 1, before)
    assert collector.best == before
    assert collector.hear(Champion(20.0, 0, 9, HALF), 0.4) is None
    assert collector.best == before, "one that is as good is no better"
    assert collector.hear(Champion(0.0, 9, 1, FULL), 0.5).epoch == 1


def test_a_lie_is_not_believed_and_fails_the_run():
    collector = collected(plan_of(), Champion(20.0, 3, 5, HALF), Champion(0.0, 4, 6, EMPTY))
    assert collector.best.fitness == 20.0
    judgement = verify(collector, 10, ["target"])
    assert judgement.status == "failed"
    assert judgement.message == "cell 6 claims a fitness of 0.0, the spy finds 40.0"
    assert judgement.best.fitness == 20.0


@pytest.mark.parametrize(
    ("settings", "generation", "reasons", "status"),
    [
        ({}, 8, ["target"], "solved"),
        ({"target": -1.0, "generations": 8}, 8, [], "exhausted"),
        ({"target": -1.0, "generations": 8}, 7, ["stall"], "stalled"),
        ({"target": -1.0}, 7, ["stall"], "stalled"),
        ({"target": -1.0}, 7, ["deadline"], "deadline"),
        ({"target": -1.0}, 7, ["cancel"], "cancelled"),
        ({"target": 0.0, "generations": 8}, 8, ["target"], "solved"),
        ({"target": -1.0, "generations": 8}, 7, [], "exhausted"),  # in async mode, after another epoch
        ({"target": -1.0}, 7, [], "failed"),
    ],
)
def test_status(settings, generation, reasons, status):
    collector = collected(plan_of(**settings), Champion(0.0, 3, 5, FULL))
    target = settings.get("target", 0.0)
    words, when = f"integers: {[1] * 40}", "as asked for" if "target" in settings else None
    advice = tuple(collector.plan.problem.advice(None, collector.plan.run)) if status == "stalled" else ()
    judgement = Judgement(status, True, None, collector.best, words, target, solved_when=when, advice=advice)
    assert verify(collector, generation, reasons) == judgement


class Explained(OneMax):
    """A problem that says what its target means."""

    says: str | int = "as many ones\nas can be"

    @property
    def solved_when(self):
        if self.says == "nothing":
            raise RuntimeError
        return self.says


@pytest.mark.parametrize(
    ("says", "settings", "told"),
    [
        ("as many ones\nas can be", {}, "as many ones as can be"),
        ("as many ones", {"target": -1.0}, "as asked for"),
        ("nothing", {}, None),
        (7, {}, None),
    ],
)
def test_a_judgement_tells_what_its_target_means(says, settings, told):
    plan = Plan(Explained(kind="explained", says=says), Run(**settings))
    for champion in (Champion(0.0, 3, 5, FULL), None):
        judgement = verify(collected(plan, champion), 8, ["stall"])
        assert judgement.solved_when == told
        assert Judgement.of(decode_answer(encode_answer(judgement.answer()))) == judgement


@pytest.mark.parametrize(
    ("settings", "reasons", "lived", "status", "fields"),
    [
        ({"restarts": 2}, ["stall"], 100, "stalled", {}),
        ({"restarts": 2}, ["deadline"], 100, "deadline", None),
        ({"restarts": 2}, ["cancel"], 100, "cancelled", None),
        ({"restarts": 0}, ["stall"], 100, "stalled", None),
        ({"restarts": 2, "target": 30.0}, ["stall"], 100, "solved", None),
        ({"restarts": 2, "generations": 109}, ["stall"], 100, "stalled", {}),
        ({"restarts": 2, "generations": 108}, ["stall"], 100, "exhausted", None),
        # 16 cells; 16 evaluations first in each of the two epochs, and 128 a generation
        ({"restarts": 2, "evaluations": 32 + 128 * 109}, ["stall"], 100, "stalled", {}),
        ({"restarts": 2, "evaluations": 32 + 128 * 109 - 1}, ["stall"], 100, "exhausted", None),
        ({"keep_alive": True}, ["stall"], 100, "stalled", {}),
    ],
)
def test_what_stalls_without_its_target_begins_anew(settings, reasons, lived, status, fields):
    """Epoch 0 has ended after its generation 8."""
    collector = collected(plan_of(**settings), Champion(20.0, 3, 5, HALF))
    judgement = verify(collector, 8, reasons, since=lived)
    assert (judgement.status, judgement.next_attempt) == (status, fields)
    assert Judgement.of(decode_answer(encode_answer(judgement.answer()))) == judgement


def test_what_is_kept_alive_without_a_target_seeks_a_feasible_answer():
    class Endless(OneMax):
        @property
        def solved_at(self):
            return None

    plan = Plan(Endless(kind="endless"), Run(keep_alive=True))
    found = verify(collected(plan, Champion(20.0, 3, 5, HALF)), 8, ["stall"])
    assert (found.status, found.feasible, found.next_attempt) == ("stalled", True, None)
    assert verify(collected(plan), 8, ["stall"]).next_attempt == {}


def test_nothing_feasible():
    plan = plan_of()
    advice = tuple(plan.problem.advice(None, plan.run))
    expected = Judgement("stalled", False, None, None, None, 0.0, advice=advice)
    assert verify(collected(plan), 200, ["stall"]) == expected


def test_a_judgement_travels():
    judgement = verify(collected(plan_of(), Champion(0.0, 3, 5, FULL)), 8, ["target"])
    assert Judgement.of(decode_answer(encode_answer(judgement.answer()))) == judgement


class Measured(OneMax):
    """A problem whose check measures a clearance."""

    clearance: float = 0.02
    least: float | str = 0.031

    def check(self, solution):
        where = {"link": 2, "x": [np.inf]} if self.least == "nowhere" else {"link": 2}
        return Verdict(0.0, (), Clearance({"wide": np.inf, "nowhere": 0.5}.get(self.least, self.least), where))


@pytest.mark.parametrize(("least", "told"), [(0.031, 0.031), ("wide", None)])
def test_a_judgement_tells_of_the_clearance_that_the_check_measured(least, told):
    plan = Plan(Measured(kind="measured", least=least), Run())
    judgement = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"])
    assert judgement.clearance == {"least": told, "where": {"link": 2}, "required": 0.02, "unit": "m"}
    assert Judgement.of(decode_answer(encode_answer(judgement.answer()))) == judgement


@pytest.mark.parametrize("least", ["much", "nowhere"])
def test_a_clearance_that_cannot_be_told_is_a_failure(least):
    plan = Plan(Measured(kind="measured", least=least), Run())
    judgement = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"])
    assert judgement.status == "failed"
    assert "check must return a supernode.Clearance of a number and plain JSON values" in judgement.message


class Checked(OneMax):
    """A problem whose check says what it is told to."""

    verdict: str

    def check(self, solution):
        if self.verdict == "raises":
            raise ZeroDivisionError("oh")
        if self.verdict == "unreadable":
            raise BadInput("solution: expected another")
        return Verdict(5.0 if self.verdict == "other" else 0.0, ("it hits a wall",) if self.verdict == "wall" else ())


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        ("raises", "checked: check raised ZeroDivisionError: oh"),
        ("unreadable", "the check cannot read the solution: solution: expected another"),
        ("other", "the check finds a fitness of 5, the run claims 0"),
        ("wall", "the check refuses the solution: it hits a wall"),
    ],
)
def test_a_check_that_disagrees_fails_the_run_and_says_why(verdict, said):
    plan = Plan(Checked(kind="checked", verdict=verdict), Run())
    judgement = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"])
    assert (judgement.status, judgement.message, judgement.feasible) == ("failed", said, False)


def test_what_is_not_claimed_to_be_solved_may_be_infeasible():
    plan = Plan(Checked(kind="checked", verdict="wall"), Run(target=-1.0))
    judgement = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["stall"])
    assert (judgement.status, judgement.feasible, judgement.message) == ("stalled", False, "it hits a wall")


class Counting(OneMax):
    trouble: bool = False

    def merge(self, solution, reports, finder):
        if self.trouble:
            raise RuntimeError("out of ink")
        return solution | {"told": sum(each[0] for each in reports.values()), "finder": finder}


def test_what_cells_report_goes_into_the_solution():
    plan = Plan(Counting(kind="counting"), Run())
    told = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"], states={2: b"\x03", 5: b"\x04"})
    assert told.status == "solved"
    assert told.best.solution == {"integers": [1] * 40, "told": 7, "finder": 5}
    assert verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"]).best.solution["told"] == 0


def test_a_merge_that_breaks_fails_the_run():
    plan = Plan(Counting(kind="counting", trouble=True), Run())
    judgement = verify(collected(plan, Champion(0.0, 3, 5, FULL)), 8, ["target"], states={2: b"\x03"})
    assert (judgement.status, judgement.feasible) == ("failed", False)
    assert judgement.message == "counting: merge raised RuntimeError: out of ink"


def report(cell, generation=8, champion=None, proposals=()):
    counts = (9, 8, 32, 0, 0, Staleness(0, 0, 0, 0))
    return Report(cell, generation, bytes([cell]) * 32, *counts, champion, tuple(proposals), (), b"", b"", None)


def test_the_best_known_is_the_least_champion_or_the_roots():
    reports = [
        report(0, champion=Champion(3.0, 1, 2, b"a")),
        report(1, champion=Champion(1.0, 5, 1, b"b")),
        report(2, champion=Champion(1.0, 4, 9, b"c")),
        report(3),
    ]
    assert best_known(reports, "champion").genome == b"c"
    assert best_known(reports, "root").genome == b"a"
    assert best_known([report(0)], "champion") is None


def test_reasons_are_those_of_the_stop():
    reports = [report(0, proposals=[Proposal(8, "stall", 0, 3)]), report(1, proposals=[Proposal(9, "target", 1, 4)])]
    assert stop_reasons(reports, "lockstep") == ("stall",)
    assert stop_reasons(reports, "async") == ("stall", "target")
    assert stopped_after([report(0, 4), report(1, 6), report(2, 9)]) == 6


def test_infinity_is_null_in_json(tmp_path):
    file = ProblemFile("x", {"kind": "x:Y"}, Run(topology="torus 1x2"), tmp_path)
    judgement = Judgement("stalled", False, None, None)
    epoch = Lived(file, [report(0), report(1)])
    result = result_of("1", file.run, Past(), epoch, judgement, {}, Clocks(1.0, 2.0, 3.0))
    assert math.isinf(result.fitness)
    plain = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert (plain["fitness"], plain["solution"], plain["found_at"]) == (None, None, None)
    assert plain["messages"] == {"sent": 16, "received": 64, "lost": 0, "rejected": 0}


def test_the_run_log_is_json_lines(tmp_path):
    path = tmp_path / "log.jsonl"
    log = RunLog(path)
    log.write("one", number=1.5, infinite=np.inf)
    log.end(Judgement("stalled", False, None, None), 9)
    log.start(7, 1, Run())
    log.end(Judgement("solved", True, None, None), 12)
    log.close()
    log.close()
    log.write("late")
    events = [json.loads(line) for line in path.read_text().splitlines()]
    assert [event["event"] for event in events] == ["one", "end", "start", "end"], "each epoch has an end"
    assert [event["generations"] for event in events if event["event"] == "end"] == [9, 12]
    assert events[0]["infinite"] is None
    with pytest.raises(BadInput, match="--log: expected a file that can be written"):
        RunLog(tmp_path)


def test_a_run_log_on_a_full_disk_ends_with_a_whole_line(tmp_path, capsys):
    path = tmp_path / "log.jsonl"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    log = RunLog(path)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, before[1]))
        for number in range(20):
            log.write("one", number=number)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    text = path.read_text()
    assert 0 < len(text) < 500
    assert text.endswith("\n")
    assert [json.loads(line)["number"] for line in text.splitlines()] == list(range(text.count("\n")))
    assert f"warning: {path}: the run log ends here" in capsys.readouterr().err
