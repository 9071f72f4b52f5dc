"""A cell's generations as one compiled call, from its neighbours' messages to its own.

With few individuals most of a generation's cost is Python between kernels. So one kernel takes all steps of the rule
(`node.engine.rule`), and calls the coding's and the problem's functions by their addresses. It repeats this up to the
generation that has a message to send. Import it only where `lowlevel.capabilities` allows such calls.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numba import types

from genetics.calls_by_address import call_fitness, call_mutate_one_bit, call_variation
from genetics.operators import TABLE, Table
from genetics.recipe import ONE_BIT
from genetics.selection import first_unsound
from lowlevel.compiled import kernel, subroutine
from lowlevel.numba_calls import entry
from lowlevel.pointers import integers, octets, reals
from node.engine import cell_table as at
from node.engine import ring
from node.engine.flags import REFUSED, UNSOUND
from node.engine.generation import Generations, Operators
from node.engine.history import History
from node.engine.inbox import Inbox, hear, packed
from node.engine.kernels import OWN
from node.engine.outbox import Outbox
from node.engine.rows import Rows
from node.engine.rule import finish, is_missing_any, make_couples, replace
from node.plan import Plan
from problems import EvaluationFailed
from wire.exchange_layout import SENT
from wire.exchange_reader import PAYLOAD


@subroutine
def _mutate_one_bit(table: Any, settings: Any, individuals: Any, now: Any) -> Any:
    """Apply one-bit mutation to one of the individuals, in place; return the index of the one that has changed."""
    seed, cell = np.uint64(settings[at.SEED]), settings[at.CELL]
    return call_mutate_one_bit(
        settings[at.MUTATE_ONE_BIT], individuals, seed, cell, now, integers(table, at.MUTATE_TABLE)
    )


@subroutine
def _breed(table: Any, now: Any) -> Any:
    """Breed generation ``now``, up to replacement; return the index of an offspring of unsound fitness, or -1.

    `Generations.breed` takes the same steps from Python.
    """
    settings = integers(table, at.SETTINGS_ROW)[0]
    deme, deme_fitness = octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0]
    offspring, offspring_fitness = octets(table, at.OFFSPRING), reals(table, at.OFFSPRING_FITNESS)[0]
    fitness_table, alone = integers(table, at.FITNESS_TABLE), deme_fitness.size == 1
    seed, cell = np.uint64(settings[at.SEED]), settings[at.CELL]
    couples = make_couples(table, now)
    call_variation(settings[at.VARIATION], couples, offspring, seed, cell, now, integers(table, at.VARIATION_TABLE))
    # One-bit mutation changes an offspring of a single individual, but an individual of an island after replacement,
    # as in step 5 of §3.1; so only the latter costs one more evaluation.
    if settings[at.MUTATE_ONE_BIT] and alone:
        _mutate_one_bit(table, settings, offspring, now)
    call_fitness(settings[at.FITNESS_KERNEL], offspring, offspring_fitness, fitness_table)
    wrong = first_unsound(offspring_fitness)
    if wrong >= 0:
        return wrong
    replace(table, now)
    if settings[at.MUTATE_ONE_BIT] and not alone:
        changed = _mutate_one_bit(table, settings, deme, now)
        offspring[0] = deme[changed]  # the offspring are in the deme by now, so their room serves for this one
        call_fitness(settings[at.FITNESS_KERNEL], offspring[:1], offspring_fitness[:1], fitness_table)
        deme_fitness[changed] = offspring_fitness[0]
        wrong = first_unsound(offspring_fitness[:1])
    return wrong


@subroutine
def breed_on(table: Any, most: Any) -> Any:
    """Breed until there is something to say or to wait for, but at most ``most`` generations; return how many.

    An offspring whose fitness is unsound ends the call, with that generation not counted.
    """
    done, clock = integers(table, at.OUTCOME_ROW)[0], integers(table, at.CLOCK)[0]
    done[:] = 0
    while done[at.BRED] < most and done[at.SIZE] == 0 and done[at.FLAGS] == 0 and not is_missing_any(table):
        now = clock[0] + 1
        done[at.WRONG] = _breed(table, now)
        if done[at.WRONG] >= 0:
            done[at.FLAGS] = UNSOUND
            break
        finish(table, now)
    return done[at.BRED]


@subroutine
def inbox_of(table: Any) -> Any:
    """Return the table of the cell's inbox."""
    return integers(table, at.INBOX)


@subroutine
def nothing_bred(table: Any) -> Any:
    """Leave the outcome that `breed_on` leaves when it breeds no generation."""
    integers(table, at.OUTCOME_ROW)[0, :] = 0


@subroutine
def next_message_replaces_it(table: Any) -> Any:
    """Return whether the next generation's message can replace the one that `breed_on` has just written.

    Not if there is anything to say beside it, or if the next generation is the last one, which sends no message.
    """
    settings, done = integers(table, at.SETTINGS_ROW)[0], integers(table, at.OUTCOME_ROW)[0]
    plain = done[at.FLAGS] == 0 and done[at.SIZE] > 0
    return plain and integers(table, at.CLOCK)[0, 0] + 1 < settings[at.LIMIT]


@subroutine
def take_back(table: Any) -> Any:
    """In async mode give the number of the latest message, which was sent to nobody, to the next one.

    Otherwise receivers would count the gap as a lost message.
    """
    integers(table, at.HEADER)[OWN, SENT] -= 1


@subroutine
def only_a_message(table: Any) -> Any:
    """Return the bytes of the latest message if `breed_on` had nothing else to say; otherwise an empty array."""
    done, room = integers(table, at.OUTCOME_ROW)[0], octets(table, at.OUT)[0]
    if done[at.SIZE] == 0 or done[at.FLAGS] != 0:
        return room[:0]
    if done[at.HAS_STATE]:
        return octets(table, at.OUT_WITH_STATE)[0][: done[at.SIZE]]
    return ring.latest(room, integers(table, at.OUT_ENTRIES), integers(table, at.OUT_MARKS)[0])


@kernel(types.void(TABLE, PAYLOAD, types.int64), may_be_long=True)
def take_in_and_breed(table: Table, news: bytes, most: int) -> None:
    """Take in the messages ``news``, then `breed_on`; other threads may run Python meanwhile."""
    refused = len(news) > 0 and hear(news, integers(table, at.INBOX)) > 0
    breed_on(table, most)
    if refused:  # set afterwards, since `breed_on` clears the outcome first, and a flag would end it
        integers(table, at.OUTCOME_ROW)[0, at.FLAGS] |= REFUSED


class CompiledGenerations(Generations):
    """The generations of a cell whose problem has a compiled fitness, several in one call.

    During a call other threads may run Python.
    """

    is_compiled = True

    def __init__(self, plan: Plan, rows: Rows, inbox: Inbox, history: History, champion: bool, outbox: Outbox) -> None:
        super().__init__(plan, rows, inbox, history, champion, outbox)
        self._take_in_and_breed = partial(entry(take_in_and_breed), self.table)

    def _operators(self, plan: Plan, rows: Rows) -> Operators:
        """Return the coding's and the problem's compiled operators."""
        mutate_one_bit = plan.coding.mutate_one_bit() if plan.recipe.mutation == ONE_BIT else None
        return Operators(plan.coding.variation(plan.recipe), mutate_one_bit, rows.problems[0].fitness_kernel)

    def __call__(self, news: Sequence[tuple[int, bytes]], most: int) -> None:
        """Take in ``news`` and breed at most ``most`` generations, see `take_in_and_breed`; then ask `done`."""
        self._take_in_and_breed(packed(news) if news else b"", most)

    def failure(self) -> EvaluationFailed:
        """Return what is wrong with the fitness of an offspring, after `UNSOUND`."""
        wrong = self.done()[at.WRONG]
        try:
            self._evaluate(self._offspring[wrong : wrong + 1])
        except EvaluationFailed as error:
            return error
        return EvaluationFailed("the compiled fitness of an individual is NaN or -inf, but `evaluate` accepts it")
