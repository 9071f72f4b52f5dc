"""Exchange messages as objects, some that are right, and a slow reader of any, written with the msgpack library."""

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

import msgpack
import numpy as np
from hypothesis import strategies as st
from lists import Lists, items_of

from genetics import BitString, Permutation, RealVector
from genetics.coding import Alphabet
from lowlevel.compiled import kernel
from wire.champion import Champion
from wire.exchange import NEVER, VERSION, Messages
from wire.exchange_writer import write_message
from wire.limits import Limits, most_bytes
from wire.strict import Rejected


class Emigrant(NamedTuple):
    """An individual on its way to a neighbour."""

    genome: bytes
    fitness: float


@dataclass(frozen=True, slots=True)
class Exchange:
    """One node's news of one generation.

    Attributes:
        job: number of the job.
        epoch: number of the epoch that the fitness values belong to.
        generation: of the sender.
        stop_at: the least generation of a stop that the sender knows, None if nobody proposed one.
        emigrants: its best individuals, best first.
        champion: None under the paper's spy, or while nothing feasible is known.
        sent: how many messages the sender has published for this job, this one included.
        evaluations: how many fitness calls it has made.
    """

    job: int
    epoch: int
    generation: int
    stop_at: int | None
    emigrants: tuple[Emigrant, ...]
    champion: Champion | None
    sent: int
    evaluations: int

    @staticmethod
    def of(messages: Messages, row: int) -> "Exchange":
        """One of the messages."""
        job, epoch, generation, stop_at, sent, evaluations, *_ = messages.header[row].tolist()
        emigrants = zip(messages.genomes[row, :-1], messages.fitness[row].tolist(), strict=False)
        return Exchange(
            job,
            epoch,
            generation,
            None if stop_at == NEVER else stop_at,
            tuple(Emigrant(genome.tobytes(), its_fitness) for genome, its_fitness in emigrants),
            messages.champion(row),
            sent,
            evaluations,
        )

    def encode(self) -> bytes:
        """As msgpack."""
        genome_bytes = len(self.emigrants[0].genome)
        messages = Messages.room(1, genome_bytes, len(self.emigrants))
        stop_at = NEVER if self.stop_at is None else self.stop_at
        champion = self.champion or Champion(math.inf, 0, 0, bytes(genome_bytes))
        counts = (self.job, self.epoch, self.generation, stop_at, self.sent, self.evaluations)
        messages.header[0] = (*counts, champion.generation, champion.cell)
        everyone = [*self.emigrants, Emigrant(champion.genome, champion.fitness)]
        messages.genomes[0] = [np.frombuffer(each.genome, np.uint8) for each in everyone]
        messages.fitness[0] = [each.fitness for each in everyone]
        room = most_bytes(genome_bytes, len(self.emigrants))
        return encoded(messages, 0, True, np.empty(room, np.uint8))


def encoded(messages: Messages, row: int, champion: bool, room) -> bytes:
    """One row of the arrays as msgpack, by what a cell writes its messages with."""
    return room[: _encode(*messages, row, champion, room)].tobytes()


@kernel("int64(int64[:,::1], uint8[:,:,::1], float64[:,::1], int64, boolean, uint8[::1])")
def _encode(header, genomes, fitness, row, champion, out):
    return write_message(header[row], genomes[row], fitness[row], champion, out)


def decode(payload: bytes, limits: Limits) -> Exchange:
    """The message in ``payload``.

    Raises:
        Rejected: whatever is wrong with it; nothing else is ever raised.
    """
    messages = Messages.room(1, limits.genome_bytes, limits.emigrants)
    reason = messages.decode(0, payload, limits)
    if reason is not None:
        raise Rejected(reason)
    return Exchange.of(messages, 0)


BITS = BitString(3, 5)
REALS = RealVector(2, -1.0, 1.0)
LISTS = Lists(0, 3)
ORDERS = Permutation(4)
MOST = NEVER - 1


def limits_of(coding, emigrants=2, cells=16):
    return Limits(coding.genome_bytes, emigrants, cells, coding.alphabet)


def anything(genome_bytes, emigrants=1, cells=16):
    """Limits that leave the genomes free but for their size."""
    return Limits(genome_bytes, emigrants, cells, Alphabet.of_bits(np.full(genome_bytes, 0xFF, np.uint8)))


LIMITS = limits_of(BITS)

edges = sorted({(1 << bits) - 1 for bits in range(63)} | {1 << bits for bits in range(62)})
counts = st.integers(0, MOST) | st.sampled_from(edges)
fitnesses = st.floats(allow_nan=False).filter(lambda value: value != -math.inf)
bit_genomes = st.lists(st.integers(0, 31), min_size=3, max_size=3).map(lambda row: BITS.encode([row])[0].tobytes())
real_genomes = st.lists(st.floats(-1, 1), min_size=2, max_size=2).map(lambda genes: struct.pack("2d", *genes))
list_genomes = items_of(LISTS).map(lambda items: LISTS.encode(np.array(items, np.int64)).tobytes())

order_genomes = st.permutations(range(4)).map(lambda order: ORDERS.encode(np.array(order)).tobytes())


def exchanges(genomes, emigrants, cells):
    """Messages of that many emigrants; a champion is feasible."""
    champions = st.builds(Champion, fitnesses.filter(math.isfinite), counts, st.integers(0, cells - 1), genomes)
    return st.builds(
        Exchange,
        job=counts,
        epoch=counts,
        generation=counts,
        stop_at=st.none() | counts,
        emigrants=st.tuples(*[st.builds(Emigrant, genomes, fitnesses)] * emigrants),
        champion=st.none() | champions,
        sent=counts,
        evaluations=counts,
    )


MESSAGE = Exchange(
    job=3,
    epoch=1,
    generation=300,
    stop_at=70_000,
    emigrants=(Emigrant(bytes([0x12, 0x34]), 1.5), Emigrant(bytes([0xFF, 0xFE]), math.inf)),
    champion=Champion(0.25, 17, 15, bytes([0x80, 0x02])),
    sent=301,
    evaluations=2408,
)


def values_of(message):
    """What travels, as nested lists of plain values: genomes go without the zeros at their ends."""
    emigrants = [[genome.rstrip(b"\0"), its_fitness] for genome, its_fitness in message.emigrants]
    champion = None if message.champion is None else [*message.champion[:3], message.champion.genome.rstrip(b"\0")]
    counters = [message.sent, message.evaluations]
    return [VERSION, message.job, message.epoch, message.generation, message.stop_at, emigrants, champion, counters]


def read_slowly(payload, limits):
    """The message in ``payload``, or None if it is none: the protocol's rules in plain Python."""

    def is_count(value, below=NEVER):
        return type(value) is int and 0 <= value < below

    def is_fitness(value):
        return type(value) is float and not math.isnan(value) and value != -math.inf

    def whole(genome):
        return genome.ljust(limits.genome_bytes, b"\0")

    def is_genome(value):
        return type(value) is bytes and limits.alphabet.admits(np.frombuffer(bytearray(whole(value)), np.uint8))

    def has(value, size):
        return type(value) is list and len(value) == size

    def is_message(value):
        return (
            (has(value, 8) or (has(value, 9) and type(value[8]) is bytes))
            and (type(value[0]), value[0]) == (int, VERSION)
            and all(is_count(each) for each in value[1:4])
            and (value[4] is None or is_count(value[4]))
            and has(value[5], limits.emigrants)
            and all(has(each, 2) and is_genome(each[0]) and is_fitness(each[1]) for each in value[5])
            and (value[6] is None or (has(value[6], 4) and is_champion(*value[6])))
            and has(value[7], 2)
            and all(is_count(each) for each in value[7])
        )

    def is_champion(fitness, generation, cell, genome):
        return is_fitness(fitness) and is_count(generation) and is_count(cell, limits.cells) and is_genome(genome)

    if len(payload) > limits.most_bytes:
        return None
    try:
        value = msgpack.unpackb(payload)
    except (ValueError, TypeError, RecursionError, msgpack.UnpackException):
        return None
    if not is_message(value):
        return None
    _, job, epoch, generation, stop_at, emigrants, champion, (sent, evaluations) = value[:8]
    # A champion of infinite fitness stands for none.
    best = None if champion is None or champion[0] == math.inf else Champion(*champion[:3], whole(champion[3]))
    told = tuple(Emigrant(whole(genome), its_fitness) for genome, its_fitness in emigrants)
    return Exchange(job, epoch, generation, stop_at, told, best, sent, evaluations)
