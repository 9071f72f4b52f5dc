"""A cell's generations as one compiled call, from its neighbours' messages to its own.

With few individuals most of a generation's cost is Python between kernels. So one kernel applies the rules of the other
modules in turn: merge champions, breed, evaluate, replace, prepare the message, propose stops, note and encode
(Ahuactzin et al. 1992, §3.1 and §6). It repeats this up to the generation that has a message to send.
`node.engine.rows` and `node.cell` take the same steps in Python, with the same bits. The kernel finds its arrays by a
table of pointers, since passing an array to a kernel costs as much as breeding with it.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numba import types

from genetics.calls_by_address import call_fitness, call_mutate_one_bit, call_variation
from genetics.operators import TABLE, Operator, Table
from genetics.recipe import ONE_BIT
from genetics.replacement import replace_families_row, replace_local_row, replace_worst_row
from genetics.selection import first_unsound
from lowlevel.compiled import kernel, subroutine
from lowlevel.numba_calls import entry
from lowlevel.pointers import integers, octets, reals
from node.engine import cell_table as at
from node.engine.flags import REFUSED, UNSOUND
from node.engine.history import History
from node.engine.inbox import Inbox, hear, packed
from node.engine.kernels import OWN
from node.engine.outbox import Outbox
from node.engine.rows import Rows
from node.engine.rule import couple, encode_message, lacks, merge_received, record, update_message
from node.plan import Plan
from wire.exchange_kernels import PAYLOAD, SENT
from wire.report import MOST_BIRTHS, Birth


@subroutine
def _mutate_one_bit(table: Any, settings: Any, individuals: Any, now: Any) -> Any:
    """Apply one-bit mutation to one of the individuals, in place; return the index of the one that has changed."""
    seed, cell = np.uint64(settings[at.SEED]), settings[at.CELL]
    return call_mutate_one_bit(
        settings[at.MUTATE_ONE_BIT], individuals, seed, cell, now, integers(table, at.MUTATE_TABLE)
    )


@subroutine
def _breed(table: Any, settings: Any, source_row: Any, now: Any) -> Any:
    """Couple, mate, evaluate and replace; return the index of an offspring whose fitness is unsound, or -1.

    The order is that of `genetics.breeding`, so that both give the same bits.
    """
    deme, deme_fitness = octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0]
    offspring, offspring_fitness = octets(table, at.OFFSPRING), reals(table, at.OFFSPRING_FITNESS)[0]
    fitness_table, elitist = integers(table, at.FITNESS_TABLE), settings[at.ELITIST] != 0
    seed, cell, alone = np.uint64(settings[at.SEED]), settings[at.CELL], deme_fitness.size == 1
    couples = couple(table, settings, source_row, now)
    call_variation(settings[at.VARIATION], couples, offspring, seed, cell, now, integers(table, at.VARIATION_TABLE))
    # One-bit mutation changes an offspring of a single individual, but an individual of an island after replacement,
    # as in step 5 of §3.1; so only the latter costs one more evaluation.
    if settings[at.MUTATE_ONE_BIT] and alone:
        _mutate_one_bit(table, settings, offspring, now)
    call_fitness(settings[at.FITNESS_KERNEL], offspring, offspring_fitness, fitness_table)
    wrong = first_unsound(offspring_fitness)
    if wrong >= 0:
        return wrong
    if alone:
        replace_local_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)
    else:
        if settings[at.FAMILIES]:
            parents = integers(table, at.PARENTS)
            replace_families_row(deme, deme_fitness, parents, offspring, offspring_fitness, elitist, seed, cell, now)
        else:
            replace_worst_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)
        if settings[at.MUTATE_ONE_BIT]:
            changed = _mutate_one_bit(table, settings, deme, now)
            offspring[0] = deme[changed]  # the offspring are in the deme by now, so their room serves for this one
            call_fitness(settings[at.FITNESS_KERNEL], offspring[:1], offspring_fitness[:1], fitness_table)
            deme_fitness[changed] = offspring_fitness[0]
            wrong = first_unsound(offspring_fitness[:1])
    return wrong


@subroutine
def breed_on(table: Any, most: Any) -> Any:
    """Breed until there is something to say or to wait for, but at most ``most`` generations; return how many.

    ``most`` must not exceed the room left in the history. An offspring whose fitness is unsound ends the call, with
    that generation not counted.
    """
    settings, done = integers(table, at.SETTINGS_ROW)[0], integers(table, at.OUTCOME_ROW)[0]
    clock, noted = integers(table, at.CLOCK)[0], integers(table, at.NOTED)[0]
    done[:] = 0
    while done[at.BRED] < most and done[at.SIZE] == 0 and done[at.FLAGS] == 0 and not lacks(table):
        now = clock[0] + 1
        source_row = merge_received(table, settings, now)
        done[at.WRONG] = _breed(table, settings, source_row, now)
        if done[at.WRONG] >= 0:
            done[at.FLAGS] = UNSOUND
            break
        clock[0] = now  # only now: a generation with an unsound offspring does not count
        flags = update_message(table, settings, now)
        record(octets(table, at.RECORDS)[noted[0]], now, octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0])
        noted[0] += 1
        done[at.BRED] += 1
        encode_message(table, settings, now, flags, done)
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

    Not if there is anything to say beside it, if the history is full, or if the next generation is the last one, which
    sends no message.
    """
    settings, done = integers(table, at.SETTINGS_ROW)[0], integers(table, at.OUTCOME_ROW)[0]
    room = integers(table, at.NOTED)[0, 0] < octets(table, at.RECORDS).shape[0]
    plain = done[at.FLAGS] == 0 and done[at.SIZE] > 0
    return plain and room and integers(table, at.CLOCK)[0, 0] + 1 < settings[at.LIMIT]


@subroutine
def take_back(table: Any) -> Any:
    """In async mode give the number of the latest message, which was sent to nobody, to the next one.

    Otherwise receivers would count the gap as a lost message.
    """
    integers(table, at.HEADER)[OWN, SENT] -= 1


@subroutine
def only_a_message(table: Any) -> Any:
    """Return the bytes of the latest message if `breed_on` had nothing else to say; otherwise an empty array."""
    done, place = integers(table, at.OUTCOME_ROW)[0], integers(table, at.HEADER)[OWN, SENT] % 2
    return octets(table, at.OUT)[place][: done[at.SIZE] if done[at.FLAGS] == 0 else 0]


@kernel(types.void(TABLE, PAYLOAD, types.int64), may_be_long=True)
def take_in_and_breed(table: Table, news: bytes, most: int) -> None:
    """Take in the messages ``news``, then `breed_on`; other threads may run Python meanwhile."""
    refused = len(news) > 0 and hear(news, integers(table, at.INBOX)) > 0
    breed_on(table, most)
    if refused:  # set afterwards, since `breed_on` clears the outcome first, and a flag would end it
        integers(table, at.OUTCOME_ROW)[0, at.FLAGS] |= REFUSED


class Generations:
    """The compiled generations of one cell, whose problem must have a compiled fitness (`Problem.fitness_kernel`).

    It shares its arrays with the given objects by address, so these must not replace them later.

    Args:
        plan: the plan of the cell's epoch.
        rows: the cell's only row; its first generation must have been made (`Rows.begin`).
        inbox: the cell's inbox.
        history: the cell's history.
        champion: whether the cell's messages carry its champion.
        outbox: where the cell's messages are written.

    Attributes:
        offspring: the latest offspring, shape (2 * couples, genome_bytes).
        table: pointers to everything that `take_in_and_breed` works on.
    """

    def __init__(self, plan: Plan, rows: Rows, inbox: Inbox, history: History, champion: bool, outbox: Outbox) -> None:
        fitness_kernel, variation = rows.problems[0].fitness_kernel, plan.coding.variation(plan.recipe)
        assert fitness_kernel is not None, "only for a compiled fitness"
        mutate_one_bit = plan.coding.mutate_one_bit() if plan.recipe.mutation == ONE_BIT else None
        alone = plan.run.deme == 1
        couples = plan.slots * plan.run.emigrants if alone else plan.recipe.couples(plan.run.deme)
        operators = _Operators(variation, mutate_one_bit, fitness_kernel)
        self.offspring = np.zeros((2 * couples, plan.coding.genome_bytes), np.uint8)
        outcome = at.OUTCOME.zeros()
        self._births, self._birth_fitness = np.zeros((MOST_BIRTHS, 2), np.int64), np.zeros(MOST_BIRTHS)
        self._birth_count = np.zeros(1, np.int64)
        header, genomes, fitness = rows.messages
        arrays = {
            "header": header,
            "genomes": genomes,
            "fitness": fitness,
            "source_rows": inbox.source_rows,
            "latest": inbox.latest,
            "counts": inbox.counts,
            "used": inbox.used,
            "staleness": inbox.staleness,
            "inbox": inbox.table,
            "deme": rows.genomes,
            "deme_fitness": rows.fitness,
            "better_at": rows.better_at,
            "clock": rows.clock,
            "noted_fitness": rows.noted,
            "target": np.array([rows.target]),
            "parents": np.zeros((couples, 2), np.int64),
            "couples": np.zeros_like(self.offspring),  # two parents need the room of two offspring
            "offspring": self.offspring,
            "offspring_fitness": np.zeros(2 * couples),
            "variation_table": variation.table,
            "mutate_table": variation.table if mutate_one_bit is None else mutate_one_bit.table,
            "fitness_table": fitness_kernel.table,
            "records": history.records,
            "noted": history.counts,
            "out": outbox.room,
            "said": outbox.said,
            "births": self._births,
            "birth_fitness": self._birth_fitness,
            "birth_count": self._birth_count,
            "settings_row": _settings(plan, rows, champion, operators),
            "outcome_row": outcome,
        }
        # The table holds bare addresses, so everything that they point to must live as long as this object.
        self._kept = (operators, arrays, inbox)
        self.table = at.TABLE.build(**arrays)
        self._live_on = partial(entry(take_in_and_breed), self.table)
        self._outcome = outcome.data

    def __call__(self, news: Sequence[tuple[int, bytes]], most: int) -> None:
        """Take in ``news`` and breed at most ``most`` generations, see `take_in_and_breed`; then ask `done`."""
        self._live_on(packed(news) if news else b"", most)

    def done(self) -> list[int]:
        """Return the outcome of the latest call, or of `breed_on` called by other compiled code.

        Returns:
            The number of generations bred, the flags, the size of the message to send in bytes (0: there is none), and
            after `UNSOUND` the index of the offspring whose fitness is unsound.
        """
        done: list[int] = self._outcome.tolist()
        return done

    def births(self) -> list[Birth]:
        """Return the improvements noted in compiled generations; that of generation 0 is in `Rows.births`."""
        noted = slice(self._birth_count.item())
        births, fitness = self._births[noted].tolist(), self._birth_fitness[noted].tolist()
        return [Birth(born, cell, its) for (born, cell), its in zip(births, fitness, strict=True)]


class _Operators(NamedTuple):
    variation: Operator
    mutate_one_bit: Operator | None
    fitness: Operator


def _settings(plan: Plan, rows: Rows, champion: bool, operators: _Operators) -> Any:
    run, recipe = plan.run, plan.recipe
    return at.SETTINGS.build(
        variation=operators.variation.address,
        mutate_one_bit=0 if operators.mutate_one_bit is None else operators.mutate_one_bit.address,
        fitness_kernel=operators.fitness.address,
        emigrants=run.emigrants,
        elitist=recipe.replacement == "elitist",
        seed=plan.seed.astype(np.int64),  # the same 64 bits, which the kernel reads as unsigned again
        cell=rows.cells[0],
        first_evaluations=run.deme,
        evaluations=plan.evaluations_per_generation,
        interval=run.interval,
        lockstep=run.mode == "lockstep",
        champion=champion,
        target_reporter=rows.target_reporter,
        stall=-1 if rows.stall is None else rows.stall,
        stop_distance=plan.stop_distance,
        limit=rows.limit,
        families=recipe.renewal is None,
        better_half=recipe.pairing == "better-half",
        most_selections=recipe.most_selections,
    )
