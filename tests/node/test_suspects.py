"""Individuals whose evaluation kills its process, in real processes that die."""

import ctypes
import faulthandler
import os
import signal
import threading
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from node.evaluation_limits import EvaluationLimits
from node.suspects import Avoiding, Suspects
from problems import EvaluationFailed, Problem
from problems.file import parse
from supernode import BitString

DEADLY = 7
GENOMES = np.array([[1], [DEADLY], [3]], np.uint8)


class Deadly(Problem):
    """What it does to the genome 7 is in ``harm``."""

    kind: str = "deadly"
    harm: str

    @property
    def coding(self):
        return BitString(8, 1)

    def evaluate(self, genomes):
        if (genomes == DEADLY).any():
            HARMS[self.harm]()
        return genomes[:, 0].astype(float)


class MostlyDeadly(Deadly):
    """All odd genomes are deadly."""

    def evaluate(self, genomes):
        if (genomes % 2).any():
            crash()
        return genomes[:, 0].astype(float)


class DeadlyTogether(Deadly):
    """Each is harmless alone."""

    def evaluate(self, genomes):
        if len(genomes) > 1:
            crash()
        return genomes[:, 0].astype(float)


class Leaving(Deadly):
    """The deadly genome ends its process with the status ``harm``."""

    def evaluate(self, genomes):
        if (genomes == DEADLY).any():
            os._exit(int(self.harm))
        return genomes[:, 0].astype(float)


class CrashingLater(Deadly):
    """Its process crashes a moment after each evaluation."""

    def evaluate(self, genomes):
        threading.Timer(0.1, crash).start()
        return genomes[:, 0].astype(float)


class Failing(Deadly):
    """It fails."""

    def evaluate(self, genomes):
        raise ValueError("no")


class Unmakable(Deadly):
    """It cannot be made for a cell."""

    def for_cell(self):
        crash()


class Changing(Deadly):
    """It changes what it evaluates."""

    def evaluate(self, genomes):
        genomes += 1
        return genomes[:, 0] - 1.0


class Counting(Deadly):
    """The fitness is the number of individuals that are evaluated together."""

    def evaluate(self, genomes):
        return np.full(len(genomes), float(len(genomes)))


def crash():
    ctypes.string_at(0)


def loop():
    for each in count():
        time.sleep(each % 2 / 1000)


def eat():
    np.ones(1 << 30)  # 8 GiB


HARMS = {"crash": crash, "loop": loop, "eat": eat, "": os.getpid}
LIMITS = EvaluationLimits(seconds=0.2, memory=1 << 28)


def file_of(problem):
    text = f'kind = "test_suspects:{type(problem).__name__}"\nharm = "{problem.harm}"\n'
    return parse(text, "deadly", Path(__file__).parent)


def watch(folder, problem, crash=""):
    """What watches a node's evaluations of a problem; the process before it ended by ``crash``."""
    return Suspects(folder, 3, crash, LIMITS).of(1, file_of(problem))


def live(folder, problem, crash="", genomes=GENOMES):
    """Evaluate in another process, as a node does.

    Returns:
        The signal that it dies by, or "" and the fitness.
    """
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        try:
            faulthandler.disable()  # the crash is wanted
            LIMITS.apply()
            os.write(writing, watch(folder, problem, crash).guard(problem)(genomes.copy()).tobytes())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        fitness = np.frombuffer(pipe.read())
    _, status = os.waitpid(process, 0)
    return (signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else ""), fitness.tolist()


def children_of(process):
    """Not from a helper of the tests: other processes import this module, and do not find these."""
    return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


@pytest.mark.parametrize(("harm", "by"), [("crash", "SIGSEGV"), ("loop", "SIGALRM"), ("eat", "SIGABRT")])
def test_what_has_killed_two_processes_is_infeasible_and_the_node_dies_once(tmp_path, harm, by):
    problem, told = Deadly(harm=harm), []
    assert live(tmp_path, problem) == (by, [])
    suspects = Suspects(tmp_path, 3, by, LIMITS, lambda: told.extend(suspects.news()))
    evaluate = suspects.of(1, file_of(problem)).guard(problem)
    assert evaluate(GENOMES.copy()).tolist() == [1.0, np.inf, 3.0]
    assert suspects.infeasible == {(file_of(problem).sha256, b"\x07")}
    (line,) = told
    assert line.startswith("genome 07 counts as infeasible: it")
    assert by in line
    assert evaluate(GENOMES.copy()).tolist() == [1.0, np.inf, 3.0]
    assert live(tmp_path, problem) == ("", [1.0, np.inf, 3.0]), "another process of the node knows it, too"
    assert len(told) == 1


def test_the_job_goes_on_however_many_are_deadly(tmp_path):
    problem = MostlyDeadly(harm="crash")
    assert live(tmp_path, problem) == ("SIGSEGV", [])
    its = watch(tmp_path, problem, "SIGSEGV")
    batches = np.arange(12, dtype=np.uint8).reshape(6, 2, 1)
    evaluate = its.guard(problem)
    assert [evaluate(batch.copy()).tolist() for batch in batches] == [[each, np.inf] for each in range(0, 12, 2)]
    assert [genome for _, genome in its.infeasible] == [bytes([each]) for each in range(1, 12, 2)]


def test_those_who_only_die_together_fail_the_job(tmp_path):
    problem = DeadlyTogether(harm="crash")
    assert live(tmp_path, problem) == ("SIGSEGV", [])
    with pytest.raises(EvaluationFailed, match="3 individuals end their process together, by SIGSEGV, but none alone"):
        watch(tmp_path, problem, "SIGSEGV").guard(problem)(GENOMES.copy())


@pytest.mark.parametrize("status", [0, 3])
def test_code_that_ends_its_process_is_deadly_too(tmp_path, status):
    live(tmp_path, Deadly(harm="crash"))
    problem = Leaving(harm=str(status))
    assert watch(tmp_path, problem, "SIGSEGV").guard(problem)(GENOMES.copy()).tolist() == [1.0, np.inf, 3.0]


def test_code_that_crashes_later_makes_nobody_suspect_and_answers_stay_right(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    problem = CrashingLater(harm="")
    its = watch(tmp_path, problem, "SIGSEGV")
    evaluate, others = its.guard(problem), set(children_of(os.getpid()))
    for first in range(10, 14):
        genomes = np.array([[first], [first + 10]], np.uint8)
        assert evaluate(genomes.copy()).tolist() == [first, first + 10]
        (process,) = set(children_of(os.getpid())) - others
        while Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
            time.sleep(0.01)
    assert its.infeasible == ()


def test_a_failure_is_no_death(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    problem = Failing(harm="")
    its = watch(tmp_path, problem, "SIGSEGV")
    with pytest.raises(EvaluationFailed, match="evaluate raised ValueError: no"):
        its.guard(problem)(GENOMES.copy())
    assert its.infeasible == ()


def test_a_problem_that_cannot_be_made_apart_fails_the_job(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    problem = Unmakable(harm="")
    with pytest.raises(EvaluationFailed, match="no process apart could be started to evaluate in"):
        watch(tmp_path, problem, "SIGSEGV").guard(problem)(GENOMES.copy())


def test_what_the_problem_changes_in_the_genomes_comes_back(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    problem, genomes = Changing(harm=""), GENOMES.copy()
    assert watch(tmp_path, problem, "SIGSEGV").guard(problem)(genomes).tolist() == [1.0, 7.0, 3.0]
    assert genomes.tolist() == [[2], [8], [4]]


def test_its_process_ends_with_it(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    evaluate, others = watch(tmp_path, problem, "SIGSEGV").guard(problem), set(children_of(os.getpid()))
    evaluate(GENOMES.copy())
    (process,) = set(children_of(os.getpid())) - others
    assert len(children_of(process)) == 1
    del evaluate
    assert set(children_of(os.getpid())) <= others


def test_whoever_survives_alone_is_not_suspected_any_more(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    harmless = np.array([[1], [3]], np.uint8)
    assert watch(tmp_path, problem, "SIGSEGV").guard(problem)(harmless).tolist() == [1.0, 3.0]
    assert Suspects(tmp_path, 3, "", LIMITS).deaths == {(file_of(problem).sha256, b"\x07"): 1}


def test_a_process_that_was_killed_from_outside_makes_nobody_suspect(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    assert Suspects(tmp_path, 3, "", LIMITS).deaths == {}


def test_whoever_is_twice_in_a_batch_has_killed_one_process(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem, genomes=np.array([[DEADLY], [1], [1]], np.uint8))
    found = Suspects(tmp_path, 3, "SIGSEGV", LIMITS)
    assert found.infeasible == set()
    assert found.deaths == {(file_of(problem).sha256, genome): 1 for genome in (b"\x07", b"\x01")}


def test_another_job_begins_without_suspects_in_the_node_itself(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    found = Suspects(tmp_path, 3, "SIGSEGV", LIMITS)
    its = found.of(2, file_of(problem))
    assert its.infeasible == ()
    others = set(children_of(os.getpid()))
    assert its.guard(problem)(np.array([[1], [3]], np.uint8)).tolist() == [1.0, 3.0]
    assert set(children_of(os.getpid())) <= others
    assert found.news() == []


def test_a_replay_avoids_the_deadly():
    deadly = [("digest", bytes([DEADLY]))]
    evaluate = Avoiding(deadly, "digest").guard(Deadly(harm="crash"))
    assert evaluate(GENOMES.copy()).tolist() == [1.0, np.inf, 3.0]
    assert evaluate(GENOMES[1:2].copy()).tolist() == [np.inf]
    assert not Avoiding(deadly, "another").counts_as_infeasible(bytes([DEADLY]))


def test_after_an_update_the_same_genome_may_be_harmless(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    its = watch(tmp_path, problem, "SIGSEGV")
    its.guard(problem)(GENOMES.copy())
    assert its.counts_as_infeasible(bytes([DEADLY]))
    assert not watch(tmp_path, Deadly(harm="loop")).counts_as_infeasible(bytes([DEADLY]))


def test_a_fitness_does_not_depend_on_who_is_suspected(tmp_path):
    live(tmp_path, Deadly(harm="crash"))
    problem = Counting(harm="")
    fitness = watch(tmp_path, problem, "SIGSEGV").guard(problem)(GENOMES.copy())
    assert fitness.tolist() == [3.0, 3.0, 3.0], "each alone to find the deadly one, and all together for their fitness"
