"""A problem for tests of nodes, and an in-process bus that delivers their messages in any order."""

import numpy as np

from genetics import BitString
from node.cell import Cell
from node.events import (
    Answer,
    Answered,
    AnswerStates,
    Ask,
    Asked,
    AskedForStates,
    Propose,
    Publish,
    Start,
    Waited,
)
from node.plan import Plan
from problems import Problem, Run
from wire.report import Report


class OneMax(Problem):
    """As many bits as possible are to be 1."""

    size: int = 40

    @property
    def coding(self):
        return BitString(self.size, 1)

    @property
    def solved_at(self):
        return 0.0

    def evaluate(self, genomes):
        return self.size - np.unpackbits(genomes, axis=1)[:, : self.size].sum(axis=1).astype(float)


def plan_of(size=40, **run):
    return Plan(OneMax(kind="onemax", size=size), Run(**run))


class Bus:
    """Steps cells in random order and lets each take a random part of its messages, to the end."""

    def __init__(self, plan, random, request=None, drop=0.0, at_once=(1, 2, 100)):
        self.cells = [Cell(plan, number, job=1) for number in range(plan.topology.cells)]
        self.news = [[] for _ in self.cells]
        self.events = [[Start()] for _ in self.cells]
        self.random = random
        self.request = request  # (at which generation of the root, reason)
        self.drop = drop
        self.at_once = at_once  # generations in a step, if nothing is to be said between them
        self.reports = {}

    def run(self):
        while len(self.reports) < len(self.cells):
            cell = self.random.choice(self.cells)
            news, events = self.some_of(self.news[cell.number]), self.some_of(self.events[cell.number])
            if self.request and cell.number == 0 and cell.rows.generation >= self.request[0]:
                events.append(Propose(self.request[1]))
                self.request = None
            most = 1 if self.request else self.random.choice(self.at_once)
            for action in cell.step(news, events, most):
                self.carry_out(cell, action)
        return [self.reports[number] for number in range(len(self.cells))]

    def some_of(self, messages):
        """The first few, which are taken out."""
        count = self.random.randint(0, len(messages))
        taken = messages[:count]
        del messages[:count]
        return taken

    def carry_out(self, cell, action):
        if isinstance(action, Publish):
            for other in cell.neighbours:
                if self.random.random() >= self.drop:
                    self.news[other].append((cell.number, action))
        elif isinstance(action, Report):
            assert cell.number not in self.reports, "a cell reports once"
            self.reports[cell.number] = action


MOST_STEPS = 200_000


class AskingBus(Bus):
    """A bus on which cells also ask for what they miss; a test takes it step by step.

    Attributes:
        kept: by cell, what it answered when it was last asked for states.
    """

    def __init__(self, plan, random):
        super().__init__(plan, random)
        self.kept = {}

    def run(self):
        for _ in range(MOST_STEPS):
            if len(self.reports) == len(self.cells):
                break
            self.one_step()
        else:
            raise AssertionError(f"only the cells {sorted(self.reports)} have ended: the others wait for ever")
        return [self.reports[number] for number in range(len(self.cells))]

    def one_step(self):
        cell = self.random.choice(self.cells)
        news, events = self.some_of(self.news[cell.number]), self.some_of(self.events[cell.number])
        if not self.random.randrange(20):  # as a node does that has waited for long
            events.append(Waited())
        for action in cell.step(news, events, self.random.choice(self.at_once)):
            self.carry_out(cell, action)

    def carry_out(self, cell, action):
        if isinstance(action, Ask):
            self.events[action.neighbour].append(Asked(action.generation, (cell.number, action.generation)))
        elif isinstance(action, Answer):
            asker, generation = action.question
            self.events[asker].append(Answered(cell.number, generation, action.payloads))
        elif isinstance(action, AnswerStates):
            self.kept[cell.number] = action.kept
        else:
            super().carry_out(cell, action)

    def ask_for_states(self, cells, once=False):
        """Note in `kept` what each of these cells answers."""
        self.kept = {}
        for number in cells:
            for action in self.cells[number].step(events=[AskedForStates(None, once)]):
                self.carry_out(self.cells[number], action)
