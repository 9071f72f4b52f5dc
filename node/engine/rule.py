"""The rule of one cell's generation, step by step, on the arrays of its table (`node.engine.cell_table`).

A generation merges what the neighbours know, couples, varies, evaluates, replaces, and prepares the message (Ahuactzin
et al. 1992, §3.1 and §6). Varying and evaluating are calls of a coding's and a problem's functions. So the rule has
three parts, `make_couples`, `replace` and `finish`, and these calls lie in between: `node.engine.generation` makes them
from Python, `node.engine.compiled_generation` from compiled code. `genetics.breeding` and `node.engine.rows`, by which
the simulator breeds many cells at once, have the same rule independently of this one, with the same bits.
"""

from typing import Any

import numpy as np

from genetics.replacement import admit_row, replace_families_row, replace_local_row, replace_worst_row
from genetics.selection import pair, pair_with
from lowlevel.compiled import subroutine
from lowlevel.pointers import blocks, integers, octets, reals
from node.engine import cell_table as at
from node.engine import ring
from node.engine.flags import REACHED, STALLED, STOPS
from node.engine.history import digest_generation
from node.engine.inbox import MISSING, NEXT, next_exchange
from node.engine.kernels import OWN, PUBLISHED, is_noted, merge_champion, note_staleness, prepare_message
from node.engine.state import write_state
from wire.exchange_layout import BIRTHPLACE, BORN, SENT, STATE_HEAD, STOP_AT
from wire.exchange_writer import write_message, write_state_head


@subroutine
def _message_genomes(table: Any) -> Any:
    """Return the genomes of all messages, shape (rows, emigrants + 1, genome_bytes)."""
    return blocks(table, at.GENOMES, reals(table, at.FITNESS).shape[1])


@subroutine
def _merge_received(table: Any, settings: Any, now: Any) -> Any:
    """Merge what the neighbours know into the cell's own message, if generation ``now`` follows an exchange.

    Returns the row of each slot's message; between exchanges that of the last exchange.
    """
    counts, source_rows = integers(table, at.COUNTS)[0], integers(table, at.SOURCE_ROWS)
    exchanges = source_rows.shape[0]  # kept apart: two in lockstep, one in async mode
    if (now - 1) % settings[at.INTERVAL] != 0:
        return source_rows[(counts[NEXT] - 1) % exchanges]  # `next_exchange` has moved NEXT on already
    source_row = source_rows[counts[NEXT] % exchanges]
    header, genomes = integers(table, at.HEADER), _message_genomes(table)
    fitness, better_at = reals(table, at.FITNESS), integers(table, at.BETTER_AT)[0]
    if settings[at.LOCKSTEP]:
        next_exchange(integers(table, at.LATEST), counts)
    else:
        note_staleness(header, source_row, now - 1, integers(table, at.USED)[0], integers(table, at.STALENESS)[0])
    merge_champion(header, genomes, fitness, better_at, OWN, now, header, genomes, fitness, source_row)
    return source_row


@subroutine
def make_couples(table: Any, now: Any) -> Any:
    """Merge what the neighbours know, and fill and return the couples of generation ``now``.

    A single individual is paired with each of its immigrants. An island first admits its immigrants after an exchange,
    then pairs its own individuals.
    """
    settings = integers(table, at.SETTINGS_ROW)[0]
    source_row = _merge_received(table, settings, now)
    deme, deme_fitness, paired = octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0], blocks(table, at.COUPLES, 2)
    heard, each = _message_genomes(table), settings[at.EMIGRANTS]
    seed, cell = np.uint64(settings[at.SEED]), settings[at.CELL]
    if deme_fitness.size == 1:
        pair_with(deme[0], heard, source_row, each, paired)
        return paired
    if (now - 1) % settings[at.INTERVAL] == 0:
        admit_row(deme, deme_fitness, heard, reals(table, at.FITNESS), source_row, each, OWN, seed, cell, now)
    parents, better_half = integers(table, at.PARENTS), settings[at.BETTER_HALF] != 0
    pair(deme_fitness, seed, cell, now, better_half, settings[at.MOST_SELECTIONS], parents)
    for couple in range(parents.shape[0]):
        paired[couple, 0], paired[couple, 1] = deme[parents[couple, 0]], deme[parents[couple, 1]]
    return paired


@subroutine
def replace(table: Any, now: Any) -> Any:
    """Let the offspring, which have been evaluated, replace individuals of the deme."""
    settings = integers(table, at.SETTINGS_ROW)[0]
    deme, deme_fitness = octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0]
    offspring, offspring_fitness = octets(table, at.OFFSPRING), reals(table, at.OFFSPRING_FITNESS)[0]
    seed, cell, elitist = np.uint64(settings[at.SEED]), settings[at.CELL], settings[at.ELITIST] != 0
    if deme_fitness.size == 1:
        replace_local_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)
    elif settings[at.FAMILIES]:
        parents = integers(table, at.PARENTS)
        replace_families_row(deme, deme_fitness, parents, offspring, offspring_fitness, elitist, seed, cell, now)
    else:
        replace_worst_row(deme, deme_fitness, offspring, offspring_fitness, elitist, seed, cell, now)


@subroutine
def finish(table: Any, now: Any) -> Any:
    """Count generation ``now``, update the cell's own message, and record and publish the generation."""
    integers(table, at.CLOCK)[0, 0] = now
    record_and_publish(table, now, _update_message(table, integers(table, at.SETTINGS_ROW)[0], now))
    integers(table, at.OUTCOME_ROW)[0, at.BRED] += 1


@subroutine
def record_and_publish(table: Any, now: Any, flags: Any) -> Any:
    """Record a generation, and write its message if it is an exchange; this is all that generation 0 needs."""
    digest, record = integers(table, at.DIGEST)[0], octets(table, at.RECORD)[0]
    digest_generation(digest, record, now, octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0])
    _encode_message(table, integers(table, at.SETTINGS_ROW)[0], now, flags, integers(table, at.OUTCOME_ROW)[0])


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
    births, count = integers(table, at.BIRTHS), integers(table, at.BIRTH_COUNT)[0]
    births[count[0], 0], births[count[0], 1] = header[BORN], header[BIRTHPLACE]
    reals(table, at.BIRTH_FITNESS)[0, count[0]] = fitness
    count[0] += 1


@subroutine
def _update_message(table: Any, settings: Any, now: Any) -> Any:
    """Put emigrants, champion and proposals of generation ``now`` into the cell's own message; return flags."""
    deme, deme_fitness = octets(table, at.DEME), reals(table, at.DEME_FITNESS)[0]
    header, fitness = integers(table, at.HEADER)[OWN], reals(table, at.FITNESS)[OWN]
    genomes, better_at = octets(table, at.GENOMES)[: fitness.size], integers(table, at.BETTER_AT)[0]
    # Every generation makes the same number of fitness calls, so they need not be counted.
    cell, evaluations = settings[at.CELL], settings[at.FIRST_EVALUATIONS] + now * settings[at.EVALUATIONS]
    target, target_reporter = reals(table, at.TARGET)[0, 0], settings[at.TARGET_REPORTER]
    flags = 0
    reached = prepare_message(
        deme, deme_fitness, cell, now, evaluations, header, genomes, fitness, better_at, OWN, target, target_reporter
    )
    noted = reals(table, at.NOTED_FITNESS)
    if is_noted(header, fitness[-1], better_at, OWN, cell, now, target_reporter, noted):
        _note(table, header, fitness[-1])
    if reached and _propose(header, now, settings[at.STOP_DISTANCE]):
        flags |= REACHED
    stalled = settings[at.STALL] >= 0 and now - better_at[OWN] >= settings[at.STALL]
    if stalled and _propose(header, now, settings[at.STOP_DISTANCE]):
        flags |= STALLED
    # Not before: this cell may be the one that proposed that stop, and must do so again.
    if now + settings[at.STOP_DISTANCE] >= settings[at.TOLD_STOP]:
        header[STOP_AT] = min(header[STOP_AT], settings[at.TOLD_STOP])
    return flags


@subroutine
def _encode_message(table: Any, settings: Any, now: Any, flags: Any, done: Any) -> Any:
    """Write the message if this is an exchange generation, and flag the end of the epoch if it has come."""
    header = integers(table, at.HEADER)
    # Async cells share no generation to stop after: a cell that learns of a stop passes it on and stops at once.
    drains = not settings[at.LOCKSTEP] and header[OWN, STOP_AT] != settings[at.LIMIT]
    stops = drains or now >= header[OWN, STOP_AT]
    if drains or (now % settings[at.INTERVAL] == 0 and not stops):
        header[OWN, SENT] += 1
        done[at.SIZE] = publish_message(table, settings, now)
    done[at.FLAGS] = flags | STOPS if stops else flags


@subroutine
def publish_message(table: Any, settings: Any, now: Any) -> Any:
    """Write the cell's message into the outbox, every few times with the cell's state; return its size in bytes."""
    header, fitness = integers(table, at.HEADER), reals(table, at.FITNESS)
    genomes = _message_genomes(table)
    header[PUBLISHED], genomes[PUBLISHED], fitness[PUBLISHED] = header[OWN], genomes[OWN], fitness[OWN]
    # With a stop ahead no state is written: the cell that proposed the stop would not know that it was the one.
    due = (header[OWN, SENT] - 1) % settings[at.STATE_EVERY] == 0 or settings[at.STATE_NEXT] != 0
    with_state = due and header[OWN, STOP_AT] == settings[at.LIMIT] and settings[at.STATE_BYTES] > 0
    settings[at.STATE_NEXT] = 0
    room, entries, marks = octets(table, at.OUT)[0], integers(table, at.OUT_ENTRIES), integers(table, at.OUT_MARKS)[0]
    start = ring.begin(room, entries, marks, settings[at.MOST_BYTES])
    size = write_message(header[OWN], genomes[OWN], fitness[OWN], settings[at.CHAMPION] != 0, room[start:])
    ring.end(entries, marks, start, size, now)
    integers(table, at.OUTCOME_ROW)[0, at.HAS_STATE] = with_state
    return add_state(table, room[start : start + size]) if with_state else size


@subroutine
def add_state(table: Any, message: Any) -> Any:
    """Write the message and the cell's state after it; return the size of both. The outbox keeps the message alone."""
    out, size = octets(table, at.OUT_WITH_STATE)[0], message.size
    out[:size] = message
    state_size = write_state(table, out[size + STATE_HEAD :])
    return write_state_head(out, size, state_size) + state_size


@subroutine
def is_missing_any(table: Any) -> Any:
    """Return whether the next generation needs a message that has not come; never in async mode."""
    settings, generation = integers(table, at.SETTINGS_ROW)[0], integers(table, at.CLOCK)[0, 0]
    if not settings[at.LOCKSTEP] or generation % settings[at.INTERVAL] != 0:
        return False
    return integers(table, at.COUNTS)[0, MISSING] > 0
