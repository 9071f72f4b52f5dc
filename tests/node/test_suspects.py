"""Individuals whose evaluation kills its process, in real processes that die."""

import ctypes
import faulthandler
import os
import signal
import time
from itertools import count

import numpy as np
import pytest

from node.suspects import Avoiding, EvaluationLimits, Suspects
from problems import Problem
from supernode import BitString

DEADLY = 7
PROBLEM = "a" * 64
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


def crash():
    ctypes.string_at(0)


def loop():
    for each in count():
        time.sleep(each % 2 / 1000)


def eat():
    np.ones(1 << 30)  # 8 GiB


HARMS = {"crash": crash, "loop": loop, "eat": eat, "sleep": time.tzset}
LIMITS = EvaluationLimits(seconds=0.2, memory=1 << 28)


def live(folder, problem, crash="", job=1, genomes=GENOMES):
    """Evaluate in another process.

    Returns:
        The signal that it dies by, or "" and the fitness.
    """
    reading, writing = os.pipe()
    process = os.fork()
    if process == 0:
        faulthandler.disable()  # the crash is wanted
        LIMITS.apply()
        evaluate = Suspects(folder, 3, crash, LIMITS).of(job, PROBLEM).guard(problem)
        os.write(writing, evaluate(genomes.copy()).tobytes())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        fitness = np.frombuffer(pipe.read())
    _, status = os.waitpid(process, 0)
    return (signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else ""), fitness.tolist()


@pytest.mark.parametrize(("harm", "by"), [("crash", "SIGSEGV"), ("loop", "SIGALRM"), ("eat", "SIGABRT")])
def test_what_has_killed_two_processes_is_infeasible(tmp_path, harm, by):
    problem = Deadly(harm=harm)
    assert live(tmp_path, problem) == (by, [])
    assert live(tmp_path, problem, by) == (by, []), "now the three are evaluated one by one"
    found = Suspects(tmp_path, 3, by, LIMITS)
    assert found.infeasible == {(PROBLEM, b"\x07")}
    (line,) = found.news()
    assert line.startswith("genome 07 counts as infeasible: it")
    assert by in line
    assert found.news() == []
    assert live(tmp_path, problem) == ("", [1.0, np.inf, 3.0])


def test_whoever_survives_alone_is_not_suspected_any_more(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    later = Suspects(tmp_path, 3, "SIGSEGV", LIMITS).of(1, PROBLEM)
    harmless = np.array([[1], [3]], np.uint8)
    assert later.guard(problem)(harmless).tolist() == [1.0, 3.0]
    assert later.guard(problem)(harmless).tolist() == [1.0, 3.0]
    assert Suspects(tmp_path, 3, "", LIMITS).deaths == {(PROBLEM, b"\x07"): 1}


def test_a_process_that_was_killed_from_outside_makes_nobody_suspect(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    assert Suspects(tmp_path, 3, "", LIMITS).deaths == {}


def test_whoever_is_twice_in_a_batch_has_killed_one_process(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem, genomes=np.array([[DEADLY], [1], [1]], np.uint8))
    found = Suspects(tmp_path, 3, "SIGSEGV", LIMITS)
    assert found.infeasible == set()
    assert found.deaths == {(PROBLEM, b"\x07"): 1, (PROBLEM, b"\x01"): 1}


def test_another_job_begins_without_suspects(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    live(tmp_path, problem, "SIGSEGV")
    found = Suspects(tmp_path, 3, "SIGSEGV", LIMITS)
    assert found.of(2, PROBLEM).infeasible == ()
    assert found.news() == []


def test_a_replay_avoids_the_deadly():
    deadly = [(PROBLEM, bytes([DEADLY]))]
    evaluate = Avoiding(deadly, PROBLEM).guard(Deadly(harm="crash"))
    assert evaluate(GENOMES.copy()).tolist() == [1.0, np.inf, 3.0]
    assert evaluate(GENOMES[1:2].copy()).tolist() == [np.inf]
    assert not Avoiding(deadly, "another").counts_as_infeasible(bytes([DEADLY]))


def test_after_an_update_the_same_genome_may_be_harmless(tmp_path):
    problem = Deadly(harm="crash")
    live(tmp_path, problem)
    live(tmp_path, problem, "SIGSEGV")
    found = Suspects(tmp_path, 3, "SIGSEGV", LIMITS)
    assert found.of(1, PROBLEM).counts_as_infeasible(bytes([DEADLY]))
    assert not found.of(1, "b" * 64).counts_as_infeasible(bytes([DEADLY]))


def test_a_fitness_does_not_depend_on_who_is_suspected(tmp_path):
    sizes = []

    class Noting(Deadly):
        def evaluate(self, genomes):
            sizes.append(len(genomes))
            return super().evaluate(genomes)

    live(tmp_path, Deadly(harm="crash"))
    evaluate = Suspects(tmp_path, 3, "SIGSEGV", LIMITS).of(1, PROBLEM).guard(Noting(harm="sleep"))
    assert evaluate(GENOMES.copy()).tolist() == [1.0, 7.0, 3.0]
    assert sizes == [1, 1, 1, 3], "each alone to find the deadly one, and all together for their fitness"
