"""What a cell's state says without the cell, for a coordinator that goes on from a checkpoint.

See `node.engine.state` for the layout.
"""

import numpy as np

from node.engine.history import digests_of
from node.engine.sha256 import STATE
from node.engine.state_size import MOST_IMPROVEMENTS, births_of, bytes_without_genomes
from wire.exchange_layout import EVALUATIONS, GENERATION, HEADER, JOB, SENT
from wire.report import Birth, Report, Staleness


def report_of(state: bytes, cell: int, deme: int, emigrants: int) -> Report:
    """Return the report of a cell as if it had stopped in the generation of a state.

    A state does not tell the received messages. The champion is left out too: a checkpoint has the best answer.

    Args:
        state: a state that `node.engine.state.write_state` has written.
        cell: the cell.
        deme: the number of individuals on each cell.
        emigrants: the number of individuals in each message.

    Raises:
        ValueError: if no state of such a cell has that size.
    """
    count = min(state[0], MOST_IMPROVEMENTS) if state else 0
    genome_bytes, rest = divmod(len(state) - bytes_without_genomes(deme, emigrants, count), emigrants + 1 + deme)
    if rest or genome_bytes < 1:
        raise ValueError(f"a cell's state of {deme} individuals does not have {len(state)} bytes")
    numbers = np.frombuffer(state, np.int64, HEADER + 1 + STATE, 1)
    births_at = bytes_without_genomes(deme, emigrants, 0)
    births = births_of(np.frombuffer(state, np.int64, count, births_at))
    fitness = np.frombuffer(state, np.float64, count, births_at + 8 * count)
    (digest,) = digests_of(numbers[None, HEADER + 1 :].copy())
    return Report(
        cell=cell,
        generation=numbers.item(GENERATION),
        digest=digest,
        evaluations=numbers.item(EVALUATIONS),
        sent=numbers.item(SENT),
        received=0,
        lost=0,
        rejected=0,
        staleness=Staleness(0, 0, 0, 0),
        champion=None,
        proposals=(),
        births=tuple(Birth(born, at, its) for (born, at), its in zip(births.tolist(), fitness.tolist(), strict=True)),
        deme=state[len(state) - deme * genome_bytes :],
        state=b"",
        error=None,
    )


def of_job(state: bytes, job: int) -> bytes:
    """Return a state as one of another job, which is to go on from it."""
    numbers = np.frombuffer(state, np.int64, HEADER, 1).copy()
    numbers[JOB] = job
    return state[:1] + numbers.tobytes() + state[1 + numbers.nbytes :]
