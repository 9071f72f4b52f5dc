"""The compiled rules for what cells know and publish: champions, stops, emigrants, improvements and staleness.

``header``, ``genomes`` and ``fitness`` are the arrays of `wire.exchange.Messages`. What a cell knows (its champion, the
least stop) is stored nowhere else than in its own message.

Most rules exist twice: as a subroutine for one row, which `node.engine.rule` calls within its own kernels, and as a
kernel for many rows, which `node.engine.rows` calls from Python. The kernel only loops over the subroutine, so both
give the same bits.
"""

from typing import Any

import numpy as np

from genetics import Cells, Fitness, Genomes
from genetics.randomness import DELAY, draw, unit
from lowlevel.compiled import kernel, subroutine
from wire.exchange_layout import BIRTHPLACE, BORN, EVALUATIONS, GENERATION, SENT, STOP_AT, Header
from wire.report import MOST_BIRTHS

OWN, PUBLISHED = 0, 1
"""Rows of a cell's messages: its own, which changes in every generation, and that as it was published last."""

NOTED_ALL, NOTED_EACH = 256, 64
"""Numbers of improvements: see `is_noted`."""


@subroutine
def _is_better(heard: Any, heard_header: Any, known: Any, header: Any) -> Any:
    """Return whether a received champion precedes the known one, by (fitness, generation, cell) of birth.

    The order is total, so all cells end up with the same champion whatever the order of messages.
    """
    if heard == known:
        if heard_header[BORN] == header[BORN]:
            return heard_header[BIRTHPLACE] < header[BIRTHPLACE]
        return heard_header[BORN] < header[BORN]
    return heard < known


@subroutine
def merge_champion(
    header: Any,
    genomes: Any,
    fitness: Any,
    better_at: Any,
    row: Any,
    now: Any,
    heard_header: Any,
    heard_genomes: Any,
    heard_fitness: Any,
    source_row: Any,
) -> Any:
    """`merge_champions` for one row."""
    last = fitness.shape[1] - 1
    for sender in source_row:
        # The stop is taken even from a message without a champion.
        header[row, STOP_AT] = min(header[row, STOP_AT], heard_header[sender, STOP_AT])
        heard, known = heard_fitness[sender, last], fitness[row, last]
        if heard == np.inf or not _is_better(heard, heard_header[sender], known, header[row]):
            continue
        if heard < known:  # the same fitness born earlier is another champion, but does not end a stall
            better_at[row] = now
        fitness[row, last] = heard
        genomes[row, last] = heard_genomes[sender, last]
        header[row, BORN] = heard_header[sender, BORN]
        header[row, BIRTHPLACE] = heard_header[sender, BIRTHPLACE]


@kernel(
    "void(int64[:,::1], uint8[:,:,::1], float64[:,::1], int64[::1], int64,"
    "int64[:,::1], uint8[:,:,::1], float64[:,::1], int64[:,::1])"
)
def merge_champions(
    header: Header,
    genomes: Genomes,
    fitness: Fitness,
    better_at: Cells,
    now: int,
    heard_header: Header,
    heard_genomes: Genomes,
    heard_fitness: Fitness,
    source_row: Cells,
) -> None:
    """Let each row keep the least stop and the best champion of those it knows and those its slots' messages carry.

    ``source_row``, (rows, slots), is for each slot the row of its message among the received ones.
    """
    for row in range(source_row.shape[0]):
        merge_champion(
            header,
            genomes,
            fitness,
            better_at,
            row,
            now,
            heard_header,
            heard_genomes,
            heard_fitness,
            source_row[row],
        )


@subroutine
def update_champion(
    deme: Any, deme_fitness: Any, first: Any, cell: Any, now: Any, header: Any, genomes: Any, fitness: Any
) -> Any:
    """Make a deme's best individual, of index ``first``, the champion if it is fitter; return whether it was."""
    last = fitness.size - 1
    if not deme_fitness[first] < fitness[last]:  # of two equally fit ones the earlier born stays
        return False
    genomes[last] = deme[first]
    fitness[last] = deme_fitness[first]
    header[BORN] = now
    header[BIRTHPLACE] = cell
    return True


@subroutine
def pack_emigrants(deme: Any, deme_fitness: Any, first: Any, genomes: Any, fitness: Any) -> Any:
    """Put the best individuals of a deme, best first, into the row's message as emigrants."""
    count = fitness.size - 1
    if count == 1:  # the usual case, without a sort
        genomes[0] = deme[first]
        fitness[0] = deme_fitness[first]
    else:
        order = np.argsort(deme_fitness, kind="mergesort")  # stable, so that ties are the same everywhere
        for place in range(count):
            genomes[place] = deme[order[place]]
            fitness[place] = deme_fitness[order[place]]


@subroutine
def prepare_message(
    deme: Any,
    deme_fitness: Any,
    cell: Any,
    now: Any,
    evaluations: Any,
    header: Any,
    genomes: Any,
    fitness: Any,
    better_at: Any,
    row: Any,
    target: Any,
    target_reporter: Any,
) -> Any:
    """`prepare_messages` for one row; return whether it is the one to propose a stop because the target is reached."""
    first = np.argmin(deme_fitness)
    header[GENERATION] = now
    header[EVALUATIONS] = evaluations
    born = update_champion(deme, deme_fitness, first, cell, now, header, genomes, fitness)
    if born:
        better_at[row] = now
    pack_emigrants(deme, deme_fitness, first, genomes, fitness)
    return fitness[-1] <= target and (born if target_reporter < 0 else cell == target_reporter)


@subroutine
def is_noted(
    header: Any, fitness: Any, better_at: Any, row: Any, cell: Any, now: Any, target_reporter: Any, noted: Any
) -> Any:
    """Return whether the row's champion is an improvement of generation ``now`` to be noted, and count it if so.

    ``noted``, (rows, 2), holds for each row the fitness noted last and the number of notes; it is updated.

    A cell notes champions born on it. Under the paper's spy only the cell ``target_reporter`` notes, namely every
    champion that it learns of. After a cell's first `NOTED_ALL` improvements only larger ones count: at least 2^-10 of
    the fitness noted last, and twice that share after each further `NOTED_EACH`. So a cell notes at most `MOST_BIRTHS`,
    however long it runs. A share of the fitness needs no scale. Keeping the latest improvements instead would lose the
    beginning of the run.
    """
    if target_reporter >= 0:
        is_new = cell == target_reporter and better_at[row] == now
    else:
        is_new = header[BORN] == now and header[BIRTHPLACE] == cell
    if not is_new:
        return False
    before, count = noted[row, 0], noted[row, 1]
    if count >= MOST_BIRTHS or not fitness < before:
        return False
    if count >= NOTED_ALL and before != np.inf:
        share = 2.0 ** ((count - NOTED_ALL) // NOTED_EACH - 10.0)
        if before - fitness < share * abs(before):
            return False
    noted[row, 0] = fitness
    noted[row, 1] = count + 1
    return True


@kernel(
    "int64(uint8[:,:,::1], float64[:,::1], int64[::1], int64, int64, int64[:,::1], uint8[:,:,::1], float64[:,::1],"
    "int64[::1], float64, int64, int64[::1], float64[:,::1], int64[::1])"
)
def prepare_messages(
    demes: Genomes,
    deme_fitness: Fitness,
    cells: Cells,
    now: int,
    evaluations: int,
    header: Header,
    genomes: Genomes,
    fitness: Fitness,
    better_at: Cells,
    target: float,
    target_reporter: int,
    reached: Cells,
    noted: Fitness,
    improved: Cells,
) -> int:
    """Put the champions and emigrants of the demes into the rows' messages; return how many rows ``reached`` holds.

    Fills ``reached`` with the rows that are to propose a stop because their champion meets the target: those that bred
    it in this generation, or only the row of the cell ``target_reporter`` unless that is negative. Fills ``improved``,
    (rows + 1,), with the number of rows that note an improvement (see `is_noted`), then with those rows.
    """
    count = 0
    improved[0] = 0
    for row in range(cells.size):
        if prepare_message(
            demes[row],
            deme_fitness[row],
            cells[row],
            now,
            evaluations,
            header[row],
            genomes[row],
            fitness[row],
            better_at,
            row,
            target,
            target_reporter,
        ):
            reached[count] = row
            count += 1
        if is_noted(header[row], fitness[row, -1], better_at, row, cells[row], now, target_reporter, noted):
            improved[0] += 1
            improved[improved[0]] = row
    return count


@kernel("void(int64[:,::1], int64[::1], int64, int64[::1], int64[::1])")
def note_staleness(header: Header, source_row: Cells, now: int, used: Cells, staleness: Cells) -> None:
    """Count one cell's immigrants in async mode, how many generations they are behind, and which are used again.

    ``used``, (slots,), is the number of the message that each slot gave last time. ``staleness``, (4,), holds the
    counts of `wire.report.Staleness`. A slot that names the cell itself, or whose neighbour has sent nothing, brings
    no immigrant.
    """
    for slot in range(source_row.size):
        sender = source_row[slot]
        if sender <= PUBLISHED:
            continue
        behind = max(0, now - header[sender, GENERATION])  # a neighbour may be ahead
        staleness[0] += 1
        staleness[1] += behind
        staleness[2] = max(staleness[2], behind)
        staleness[3] += header[sender, SENT] == used[slot]
        used[slot] = header[sender, SENT]


@kernel("float64(uint64, int64, int64, int64)")
def delay(seed: np.uint64, cell: int, generation: int, index: int) -> float:
    """Draw an exponentially distributed time of mean 1, for the simulator's model of asynchronous nodes."""
    return float(-np.log1p(-unit(draw(seed, cell, generation, DELAY, index, 0))))
