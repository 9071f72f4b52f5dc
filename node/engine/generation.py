"""A cell's generations as one compiled call, from its neighbours' messages to its own.

With few individuals most of a generation's cost is Python between kernels. So one kernel applies the rules of the other
modules in turn: merge champions, breed, evaluate, replace, prepare the message, propose stops, note and encode
(Ahuactzin et al. 1992, §3.1 and §6). It repeats this up to the generation that has a message to send.
`node.engine.rows` and `node.cell` take the same steps in Python, with the same bits. The kernel finds its arrays by a
table of pointers, since passing an array to a kernel costs as much as breeding with it.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numba import types

from genetics.calls_by_address import call_fitness, call_mutate_one_bit, call_variation
from genetics.operators import TABLE, Table, pointers
from genetics.recipe import ONE_BIT
from genetics.replacement import admit_row, replace_families_row, replace_local_row, replace_worst_row
from genetics.selection import first_unsound, pair, pair_with
from lowlevel.compiled import kernel, subroutine
from lowlevel.numba_calls import entry
from lowlevel.pointers import blocks, integers, octets, reals
from node.engine.flags import REACHED, REFUSED, STALLED, STOPS, UNSOUND
from node.engine.history import History
from node.engine.inbox import LACKING, NEXT, Inbox, hear, packed, turn
from node.engine.kernels import OWN, PUBLISHED, is_noted, merge_champion, note_staleness, prepare_message
from node.engine.outbox import Outbox
from node.engine.rows import Rows
from node.plan import Plan
from wire.exchange_kernels import BIRTHPLACE, BORN, PAYLOAD, SENT, STOP_AT, write_message
from wire.report import MOST_BIRTHS, Birth

# Places in the table of pointers; `Generations.__init__` lists the arrays in the same order.
_HEADER, _GENOMES, _FITNESS, _SOURCE_ROWS, _LATEST, _COUNTS, _USED, _STALENESS = range(8)
_DEME, _DEME_FITNESS, _BETTER_AT, _COUPLES, _PARENTS, _OFFSPRING, _OFFSPRING_FITNESS = range(8, 15)
_RECORDS, _NOTED, _OUT, _SAID, _VARIATION_TABLE, _MUTATE_TABLE, _FITNESS_TABLE = range(15, 22)
_INBOX, _SETTINGS, _TARGET, _CLOCK, _DONE = range(22, 27)
_NOTED_FITNESS, _BIRTHS, _BIRTH_FITNESS, _BIRTH_COUNT = range(27, 31)
PLACES = 31

# Columns of the settings; `_settings` lists the values in the same order.
_VARIATION, _MUTATE_ONE_BIT, _FITNESS_KERNEL, _EACH, _ELITIST, _SEED, _CELL, _FIRST_EVALUATIONS, _EVALUATIONS = range(9)
_INTERVAL, _LOCKSTEP, _CHAMPION, _TARGET_REPORTER, _STALL, _STOP_DISTANCE, _LIMIT = range(9, 16)
_FAMILIES, _BETTER_HALF, _MOST_SELECTIONS = range(16, 19)

_BRED, _FLAGS, _SIZE, _WRONG = range(4)  # columns of a call's outcome, see `Generations.done`


@subroutine
def _message_genomes(table: Any) -> Any:
    """Return the genomes of all messages, shape (rows, emigrants + 1, genome_bytes)."""
    return blocks(table, _GENOMES, reals(table, _FITNESS).shape[1])


@subroutine
def _merge_received(table: Any, settings: Any, now: Any) -> Any:
    """Merge what the neighbours know into the cell's own message, if generation ``now`` follows an exchange.

    Returns the row of each slot's message; between exchanges that of the last exchange.
    """
    counts, source_rows = integers(table, _COUNTS)[0], integers(table, _SOURCE_ROWS)
    exchanges = source_rows.shape[0]  # kept apart: two in lockstep, one in async mode
    if (now - 1) % settings[_INTERVAL] != 0:
        return source_rows[(counts[NEXT] - 1) % exchanges]  # `turn` has moved NEXT on already
    source_row = source_rows[counts[NEXT] % exchanges]
    header, genomes = integers(table, _HEADER), _message_genomes(table)
    fitness, better_at = reals(table, _FITNESS), integers(table, _BETTER_AT)[0]
    if settings[_LOCKSTEP]:
        turn(integers(table, _LATEST), counts)
    else:
        note_staleness(header, source_row, now - 1, integers(table, _USED)[0], integers(table, _STALENESS)[0])
    merge_champion(header, genomes, fitness, better_at, OWN, now, header, genomes, fitness, source_row)
    return source_row


@subroutine
def _couple(table: Any, settings: Any, source_row: Any, now: Any) -> Any:
    """Fill and return the couples.

    A single individual is paired with each of its immigrants. An island first admits its immigrants after an exchange,
    then pairs its own individuals.
    """
    deme, deme_fitness, paired = octets(table, _DEME), reals(table, _DEME_FITNESS)[0], blocks(table, _COUPLES, 2)
    heard, each = _message_genomes(table), settings[_EACH]
    seed, cell = np.uint64(settings[_SEED]), settings[_CELL]
    if deme_fitness.size == 1:
        pair_with(deme[0], heard, source_row, each, paired)
        return paired
    if (now - 1) % settings[_INTERVAL] == 0:
        admit_row(deme, deme_fitness, heard, reals(table, _FITNESS), source_row, each, OWN, seed, cell, now)
    parents, better_half = integers(table, _PARENTS), settings[_BETTER_HALF] != 0
    pair(deme_fitness, seed, cell, now, better_half, settings[_MOST_SELECTIONS], parents)
    for couple in range(parents.shape[0]):
        paired[couple, 0], paired[couple, 1] = deme[parents[couple, 0]], deme[parents[couple, 1]]
    return paired


@subroutine
def _mutate_one_bit(table: Any, settings: Any, individuals: Any, now: Any) -> Any:
    """Apply one-bit mutation to one of the individuals, in place; return the index of the one that has changed."""
    seed, cell = np.uint64(settings[_SEED]), settings[_CELL]
    return call_mutate_one_bit(settings[_MUTATE_ONE_BIT], individuals, seed, cell, now, integers(table, _MUTATE_TABLE))


@subroutine
def _breed(table: Any, settings: Any, source_row: Any, now: Any) -> Any:
    """Couple, mate, evaluate and replace; return the index of an offspring whose fitness is unsound, or -1.

    The order is that of `genetics.breeding`, so that both give the same bits.
    """
    deme, deme_fitness = octets(table, _DEME), reals(table, _DEME_FITNESS)[0]
    offspring, offspring_fitness = octets(table, _OFFSPRING), reals(table, _OFFSPRING_FITNESS)[0]
    fitness_table, elitist = integers(table, _FITNESS_TABLE), settings[_ELITIST] != 0
    seed, cell, alone = np.uint64(settings[_SEED]), settings[_CELL], deme_fitness.size == 1
    couples = _couple(table, settings, source_row, now)
    call_variation(settings[_VARIATION], couples, offspring, seed, cell, now, integers(table, _VARIATION_TABLE))
    # One-bit mutation changes an offspring of a single individual, but an individual of an island after replacement,
    # as in step 5 of §3.1; so only the latter costs one more evaluation.
    if settings[_MUTATE_ONE_BIT] and alone:
        _mutate_one_bit(table, settings, offspring, now)
    call_fitness(settings[_FITNESS_KERNEL], offspring, offspring_fitness, fitness_table)
    wrong = first_unsound(offspring_fitness)
    if wrong >= 0:
        return wrong
    if alone:
        replace_local_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)
    else:
        if settings[_FAMILIES]:
            parents = integers(table, _PARENTS)
            replace_families_row(deme, deme_fitness, parents, offspring, offspring_fitness, elitist, seed, cell, now)
        else:
            replace_worst_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)
        if settings[_MUTATE_ONE_BIT]:
            changed = _mutate_one_bit(table, settings, deme, now)
            offspring[0] = deme[changed]  # the offspring are in the deme by now, so their room serves for this one
            call_fitness(settings[_FITNESS_KERNEL], offspring[:1], offspring_fitness[:1], fitness_table)
            deme_fitness[changed] = offspring_fitness[0]
            wrong = first_unsound(offspring_fitness[:1])
    return wrong


@subroutine
def _propose(header: Any, now: Any, distance: Any) -> Any:
    """Propose a stop ``distance`` generations from now; return whether it is earlier than any that is known."""
    if now + distance >= header[STOP_AT]:
        return False
    header[STOP_AT] = now + distance
    return True


@subroutine
def _note(table: Any, header: Any, fitness: Any) -> Any:
    """Keep an improvement. There is room: `is_noted` allows at most MOST_BIRTHS."""
    births, count = integers(table, _BIRTHS), integers(table, _BIRTH_COUNT)[0]
    births[count[0], 0], births[count[0], 1] = header[BORN], header[BIRTHPLACE]
    reals(table, _BIRTH_FITNESS)[0, count[0]] = fitness
    count[0] += 1


@subroutine
def _update_message(table: Any, settings: Any, now: Any) -> Any:
    """Put emigrants, champion and proposals of generation ``now`` into the cell's own message; return flags."""
    deme, deme_fitness = octets(table, _DEME), reals(table, _DEME_FITNESS)[0]
    header, fitness = integers(table, _HEADER)[OWN], reals(table, _FITNESS)[OWN]
    genomes, better_at = octets(table, _GENOMES)[: fitness.size], integers(table, _BETTER_AT)[0]
    # Every generation makes the same number of fitness calls, so they need not be counted.
    cell, evaluations = settings[_CELL], settings[_FIRST_EVALUATIONS] + now * settings[_EVALUATIONS]
    target, target_reporter = reals(table, _TARGET)[0, 0], settings[_TARGET_REPORTER]
    flags = 0
    reached = prepare_message(
        deme, deme_fitness, cell, now, evaluations, header, genomes, fitness, better_at, OWN, target, target_reporter
    )
    noted = reals(table, _NOTED_FITNESS)
    if is_noted(header, fitness[-1], better_at, OWN, cell, now, target_reporter, noted):
        _note(table, header, fitness[-1])
    if reached and _propose(header, now, settings[_STOP_DISTANCE]):
        flags |= REACHED
    stalled = settings[_STALL] >= 0 and now - better_at[OWN] >= settings[_STALL]
    if stalled and _propose(header, now, settings[_STOP_DISTANCE]):
        flags |= STALLED
    return flags


@subroutine
def _record(record: Any, now: Any, deme: Any, fitness: Any) -> Any:
    """Write a generation as `node.engine.history.History` does: generation, genomes and fitness, packed without gaps.

    Bytes are written one by one, since the fitness may begin at any offset.
    """
    for place in range(8):
        record[place] = (now >> (8 * place)) & 0xFF
    size = deme.shape[1]
    for individual in range(deme.shape[0]):
        start = 8 + size * individual
        record[start : start + size] = deme[individual]
    record[8 + deme.size :] = fitness.view(np.uint8)


@subroutine
def _encode_message(table: Any, settings: Any, now: Any, flags: Any, done: Any) -> Any:
    """Write the message if this is an exchange generation, and flag the end of the epoch if it has come."""
    header, fitness = integers(table, _HEADER), reals(table, _FITNESS)
    genomes = _message_genomes(table)
    # Async cells share no generation to stop after: a cell that learns of a stop passes it on and stops at once.
    drains = not settings[_LOCKSTEP] and header[OWN, STOP_AT] != settings[_LIMIT]
    stops = drains or now >= header[OWN, STOP_AT]
    if drains or (now % settings[_INTERVAL] == 0 and not stops):
        header[OWN, SENT] += 1
        header[PUBLISHED], genomes[PUBLISHED], fitness[PUBLISHED] = header[OWN], genomes[OWN], fitness[OWN]
        place = header[OWN, SENT] % 2  # as in `Outbox.write`
        champion, out, said = settings[_CHAMPION] != 0, octets(table, _OUT)[place], integers(table, _SAID)[place]
        done[_SIZE] = write_message(header[OWN], genomes[OWN], fitness[OWN], champion, out)
        said[0], said[1] = now, done[_SIZE]
    done[_FLAGS] = flags | STOPS if stops else flags


@subroutine
def lacks(table: Any) -> Any:
    """Return whether the next generation needs a message that has not come; never in async mode."""
    settings, generation = integers(table, _SETTINGS)[0], integers(table, _CLOCK)[0, 0]
    if not settings[_LOCKSTEP] or generation % settings[_INTERVAL] != 0:
        return False
    return integers(table, _COUNTS)[0, LACKING] > 0


@subroutine
def breed_on(table: Any, most: Any) -> Any:
    """Breed until there is something to say or to wait for, but at most ``most`` generations; return how many.

    ``most`` must not exceed the room left in the history. An offspring whose fitness is unsound ends the call, with
    that generation not counted.
    """
    settings, done = integers(table, _SETTINGS)[0], integers(table, _DONE)[0]
    clock, noted = integers(table, _CLOCK)[0], integers(table, _NOTED)[0]
    done[:] = 0
    while done[_BRED] < most and done[_SIZE] == 0 and done[_FLAGS] == 0 and not lacks(table):
        now = clock[0] + 1
        source_row = _merge_received(table, settings, now)
        done[_WRONG] = _breed(table, settings, source_row, now)
        if done[_WRONG] >= 0:
            done[_FLAGS] = UNSOUND
            break
        clock[0] = now  # only now: a generation with an unsound offspring does not count
        flags = _update_message(table, settings, now)
        record = octets(table, _RECORDS)[noted[0]]
        _record(record, now, octets(table, _DEME), reals(table, _DEME_FITNESS)[0])
        noted[0] += 1
        done[_BRED] += 1
        _encode_message(table, settings, now, flags, done)
    return done[_BRED]


@subroutine
def inbox_of(table: Any) -> Any:
    """Return the table of the cell's inbox."""
    return integers(table, _INBOX)


@subroutine
def nothing_bred(table: Any) -> Any:
    """Leave the outcome that `breed_on` leaves when it breeds no generation."""
    integers(table, _DONE)[0, :] = 0


@subroutine
def next_message_replaces_it(table: Any) -> Any:
    """Return whether the next generation's message can replace the one that `breed_on` has just written.

    Not if there is anything to say beside it, if the history is full, or if the next generation is the last one, which
    sends no message.
    """
    settings, done = integers(table, _SETTINGS)[0], integers(table, _DONE)[0]
    room = integers(table, _NOTED)[0, 0] < octets(table, _RECORDS).shape[0]
    plain = done[_FLAGS] == 0 and done[_SIZE] > 0
    return plain and room and integers(table, _CLOCK)[0, 0] + 1 < settings[_LIMIT]


@subroutine
def take_back(table: Any) -> Any:
    """In async mode give the number of the latest message, which was sent to nobody, to the next one.

    Otherwise receivers would count the gap as a lost message.
    """
    integers(table, _HEADER)[OWN, SENT] -= 1


@subroutine
def only_a_message(table: Any) -> Any:
    """Return the bytes of the latest message if `breed_on` had nothing else to say; otherwise an empty array."""
    done, place = integers(table, _DONE)[0], integers(table, _HEADER)[OWN, SENT] % 2
    return octets(table, _OUT)[place][: done[_SIZE] if done[_FLAGS] == 0 else 0]


@kernel(types.void(TABLE, PAYLOAD, types.int64), may_be_long=True)
def take_in_and_breed(table: Table, news: bytes, most: int) -> None:
    """Take in the messages ``news``, then `breed_on`; other threads may run Python meanwhile."""
    refused = len(news) > 0 and hear(news, integers(table, _INBOX)) > 0
    breed_on(table, most)
    if refused:  # set afterwards, since `breed_on` clears the outcome first, and a flag would end it
        integers(table, _DONE)[0, _FLAGS] |= REFUSED


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
        addresses = (variation.address, 0 if mutate_one_bit is None else mutate_one_bit.address, fitness_kernel.address)
        self.offspring = np.zeros((2 * couples, plan.coding.genome_bytes), np.uint8)
        done = np.zeros((1, 4), np.int64)
        self._births, self._birth_fitness = np.zeros((MOST_BIRTHS, 2), np.int64), np.zeros(MOST_BIRTHS)
        self._birth_count = np.zeros(1, np.int64)
        arrays = (
            *rows.messages,
            inbox.source_rows,
            inbox.latest,
            inbox.counts,
            inbox.used,
            inbox.staleness,
            rows.genomes,
            rows.fitness,
            rows.better_at,
            np.zeros_like(self.offspring),  # the couples: two parents need the room of two offspring
            np.zeros((couples, 2), np.int64),
            self.offspring,
            np.zeros(2 * couples),
            history.records,
            history.counts,
            outbox.room,
            outbox.said,
            variation.table,
            variation.table if mutate_one_bit is None else mutate_one_bit.table,
            fitness_kernel.table,
            inbox.table,
            _settings(plan, rows, champion, addresses),
            np.array([rows.target]),
            rows.clock,
            done,
            rows.noted,
            self._births,
            self._birth_fitness,
            self._birth_count,
        )
        assert len(arrays) == PLACES, "each has its place"
        # The table holds bare addresses, so everything that they point to must live as long as this object.
        self._kept = (variation, mutate_one_bit, fitness_kernel, arrays, inbox)
        self.table = pointers(*arrays)
        self._live_on = partial(entry(take_in_and_breed), self.table)
        self._done = done[0].data

    def __call__(self, news: Sequence[tuple[int, bytes]], most: int) -> None:
        """Take in ``news`` and breed at most ``most`` generations, see `take_in_and_breed`; then ask `done`."""
        self._live_on(packed(news) if news else b"", most)

    def done(self) -> list[int]:
        """Return the outcome of the latest call, or of `breed_on` called by other compiled code.

        Returns:
            The number of generations bred, the flags, the size of the message to send in bytes (0: there is none), and
            after `UNSOUND` the index of the offspring whose fitness is unsound.
        """
        done: list[int] = self._done.tolist()
        return done

    def births(self) -> list[Birth]:
        """Return the improvements noted in compiled generations; that of generation 0 is in `Rows.births`."""
        noted = slice(self._birth_count.item())
        births, fitness = self._births[noted].tolist(), self._birth_fitness[noted].tolist()
        return [Birth(born, cell, its) for (born, cell), its in zip(births, fitness, strict=True)]


def _settings(plan: Plan, rows: Rows, champion: bool, addresses: tuple[int, int, int]) -> Any:
    """Return the settings in the order of the columns at the top of this module."""
    run = plan.run
    return np.array(
        [
            *addresses,
            run.emigrants,
            plan.recipe.replacement == "elitist",
            plan.seed.astype(np.int64),  # the same 64 bits, which the kernel reads as unsigned again
            rows.cells[0],
            run.deme,
            plan.evaluations_per_generation,
            run.interval,
            run.mode == "lockstep",
            champion,
            rows.target_reporter,
            -1 if rows.stall is None else rows.stall,
            plan.stop_distance,
            rows.limit,
            plan.recipe.renewal is None,
            plan.recipe.pairing == "better-half",
            plan.recipe.most_selections,
        ],
        np.int64,
    )
