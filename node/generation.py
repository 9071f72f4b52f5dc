"""A whole generation of a cell with a single individual as one compiled call.

What a generation of a lone individual costs is mostly what Python costs between kernels. So here the rules of the other
modules follow one another without a step into Python: believe, mate, judge, replace, tell, propose, note and encode
(Ahuactzin et al. 1992, §6). The call finds what it works on by a table of pointers: handing over an array costs as much
as breeding with it.
"""

from typing import Any

import numpy as np

from genetics.arrays import Genomes
from genetics.compiled import kernel, subroutine
from genetics.operators import Table, call_fitness, call_mating, integers, octets, pointers, reals
from genetics.selection import first_unsound, take_place
from node.history import History
from node.inbox import NEXT, Inbox, turn
from node.kernels import TOLD, believe_one, note_staleness, tell_one
from node.plan import Plan
from node.rows import Rows
from wire.exchange_kernels import SENT, STOP_AT, write_message

REACHED, STALLED, STOPS = 1, 2, 4
"""What a cell has to say beside its message: it proposes to stop for the target or for a stall; it stops now."""

_FLAGS = 40  # a message is shorter than 2**40 bytes
_SIZE = (1 << _FLAGS) - 1

# Places in the table.
(
    _HEADER,
    _GENOMES,
    _FITNESS,
    _DEME,
    _DEME_FITNESS,
    _OFFSPRING,
    _OFFSPRING_FITNESS,
    _WHENCE,
    _LATEST,
    _COUNTS,
    _BETTER_AT,
    _USED,
    _STALENESS,
    _RECORDS,
    _OUT,
    _MATING_TABLE,
    _JUDGING_TABLE,
    _SETTINGS,
    _TARGET,
) = range(19)

# Columns of the settings.
(
    _MATING,
    _JUDGING,
    _EACH,
    _ELITIST,
    _SEED,
    _CELL,
    _FIRST_EVALUATIONS,
    _EVALUATIONS,
    _INTERVAL,
    _LOCKSTEP,
    _CHAMPION,
    _WITNESS,
    _STALL,
    _STOP_DISTANCE,
    _LIMIT,
) = range(15)


@subroutine
def _propose(header: Any, now: Any, distance: Any) -> Any:
    """Propose a stop; whether it is earlier than any that is known."""
    if now + distance >= header[STOP_AT]:
        return False
    header[STOP_AT] = now + distance
    return True


@subroutine
def _record(record: Any, now: Any, deme: Any, fitness: Any) -> Any:
    """As `node.history.History` notes a generation, byte by byte, since fitness need not be aligned there."""
    size = deme.size
    number = np.array([now])
    record[:8] = number.view(np.uint8)
    record[8 : 8 + size] = deme
    record[8 + size :] = fitness.view(np.uint8)


@subroutine
def _breed(table: Any, settings: Any, deme: Any, deme_fitness: Any, whence: Any, now: Any) -> Any:
    """Mate, judge and replace; returns the index of an offspring whose fitness is none, or -1."""
    fitness = reals(table, _FITNESS)
    genomes = octets(table, _GENOMES).reshape(fitness.shape[0], fitness.shape[1], deme.shape[1])
    offspring, offspring_fitness = octets(table, _OFFSPRING), reals(table, _OFFSPRING_FITNESS)[0]
    seed, cell = np.uint64(settings[_SEED]), settings[_CELL]
    mating_table, each = integers(table, _MATING_TABLE), settings[_EACH]
    call_mating(settings[_MATING], deme[0], genomes, whence, each, offspring, seed, cell, now, mating_table)
    call_fitness(settings[_JUDGING], offspring, offspring_fitness, integers(table, _JUDGING_TABLE))
    wrong = first_unsound(offspring_fitness)
    if wrong < 0:
        take_place(deme, deme_fitness, offspring, offspring_fitness, settings[_ELITIST] != 0)
    return wrong


@subroutine
def _listen(table: Any, settings: Any, now: Any, counts: Any) -> Any:
    """Believe what neighbours said for this generation; returns which message came to each slot.

    Between exchanges the individual breeds with the immigrants that it had last.
    """
    whence = integers(table, _WHENCE)
    exchanges = whence.shape[0]
    if (now - 1) % settings[_INTERVAL] != 0:
        return whence[(counts[NEXT] - 1) % exchanges]
    row = whence[counts[NEXT] % exchanges]
    header, fitness = integers(table, _HEADER), reals(table, _FITNESS)
    genomes = octets(table, _GENOMES).reshape(fitness.shape[0], fitness.shape[1], octets(table, _DEME).shape[1])
    if settings[_LOCKSTEP]:
        turn(integers(table, _LATEST), counts)
    else:
        note_staleness(header, row, now - 1, integers(table, _USED)[0], integers(table, _STALENESS)[0])
    better_at = integers(table, _BETTER_AT)[0]
    believe_one(header, genomes, fitness, better_at, 0, now, header, genomes, fitness, row)
    return row


@kernel("int64(int64[:,::1], int64, int64)", may_be_long=True)
def live_on(table: Table, now: int, place: int) -> int:
    """Breed generation ``now``, note it at a ``place`` of the history, and write the cell's message.

    Returns the message's bytes, 0 if none is to be sent, with flags above them; or -1 - the index of an offspring whose
    fitness is none, and then nothing has been replaced.
    """
    settings, counts = integers(table, _SETTINGS)[0], integers(table, _COUNTS)[0]
    deme, deme_fitness = octets(table, _DEME), reals(table, _DEME_FITNESS)[0]
    whence = _listen(table, settings, now, counts)
    wrong = _breed(table, settings, deme, deme_fitness, whence, now)
    if wrong >= 0:
        return int(-1 - wrong)

    header, fitness = integers(table, _HEADER)[0], reals(table, _FITNESS)[0]
    genomes, better_at = octets(table, _GENOMES)[: fitness.size], integers(table, _BETTER_AT)[0]
    cell, evaluations = settings[_CELL], settings[_FIRST_EVALUATIONS] + now * settings[_EVALUATIONS]
    target, witness = reals(table, _TARGET)[0, 0], settings[_WITNESS]
    flags = 0
    told = tell_one(deme, deme_fitness, cell, now, evaluations, header, genomes, fitness, better_at, 0, target, witness)
    if told and _propose(header, now, settings[_STOP_DISTANCE]):
        flags |= REACHED
    stalled = settings[_STALL] >= 0 and now - better_at[0] >= settings[_STALL]
    if stalled and _propose(header, now, settings[_STOP_DISTANCE]):
        flags |= STALLED
    _record(octets(table, _RECORDS)[place], now, deme[0], deme_fitness)

    # Without lockstep there is no common generation to stop after: who hears of a stop passes it on and stops.
    drains = not settings[_LOCKSTEP] and header[STOP_AT] != settings[_LIMIT]
    stops = drains or now >= header[STOP_AT]
    size = 0
    if drains or (now % settings[_INTERVAL] == 0 and not stops):
        header[SENT] += 1
        integers(table, _HEADER)[TOLD] = header
        reals(table, _FITNESS)[TOLD] = fitness
        octets(table, _GENOMES)[fitness.size * TOLD : fitness.size * (TOLD + 1)] = genomes
        size = write_message(header, genomes, fitness, settings[_CHAMPION] != 0, octets(table, _OUT)[0])
    if stops:
        flags |= STOPS
    return int(size | flags << _FLAGS)


class OneCall:
    """`live_on` for one cell.

    Args:
        plan: of the job; its problem must have a compiled fitness (`Problem.judging`), and its demes one individual.
        rows: the cell's.
        inbox: the cell's.
        history: the cell's.
        champion: whether the cell tells its champion.
        out: room for a message.
    """

    def __init__(self, plan: Plan, rows: Rows, inbox: Inbox, history: History, champion: bool, out: Genomes) -> None:
        mating, judging = plan.coding.mating(plan.recipe), plan.problem.judging
        assert judging is not None, "only for a compiled fitness"
        run, limits, messages = plan.run, plan.limits, rows.messages
        count = 2 * plan.slots * run.emigrants
        settings = np.zeros(15, np.int64)
        settings[:] = (
            mating.address,
            judging.address,
            run.emigrants,
            plan.recipe.replacement == "elitist",
            np.uint64(run.seed).astype(np.int64),
            rows.cells[0],
            run.deme,
            plan.evaluations_per_generation,
            run.interval,
            run.mode == "lockstep",
            champion,
            rows.witness,
            -1 if rows.stall is None else rows.stall,
            plan.stop_distance,
            rows.limit,
        )
        self.offspring = np.zeros((count, limits.genome_bytes), np.uint8)
        arrays = (
            messages.header,
            messages.genomes,
            messages.fitness,
            rows.genomes,
            rows.fitness,
            self.offspring,
            np.zeros(count),
            inbox.whences,
            inbox.latest,
            inbox.counts,
            rows.better_at,
            inbox.used,
            inbox.staleness,
            history.records,
            out,
            mating.table,
            judging.table,
            settings,
            np.array([rows.target]),
        )
        self._kept = (mating, judging, arrays)
        self._table = pointers(*arrays)

    def __call__(self, now: int, place: int) -> tuple[int, int]:
        """The bytes of the message to send, or -1 - an index, see `live_on`; and the flags."""
        told = live_on(self._table, now, place)
        return (told, 0) if told < 0 else (told & _SIZE, told >> _FLAGS)
