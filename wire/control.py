"""Commands to nodes and to the spy, and their answers.

Every command is answered: with `Done`, with `Refused`, or, for `Begin`, with the node's `Report` when it stops.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from wire.exchange import VERSION, Champion
from wire.report import Reason, reason_of
from wire.strict import Rejected, count, fields, fitness, of, pack, unpack


@dataclass(frozen=True)
class Prepare:
    """Get ready for a job: its number, and the problem file as JSON; ``log`` is where the spy keeps its run log."""

    name: ClassVar[str] = "prepare"
    job: int
    file: str
    log: str | None = None


@dataclass(frozen=True)
class Begin:
    """Every node is prepared: go."""

    name: ClassVar[str] = "begin"
    job: int


@dataclass(frozen=True)
class ProposeStop:
    """Propose that all cells stop."""

    name: ClassVar[str] = "propose stop"
    job: int
    reason: Reason


@dataclass(frozen=True)
class Drop:
    """Forget a job that failed elsewhere."""

    name: ClassVar[str] = "drop"
    job: int


@dataclass(frozen=True)
class Missed:
    """From a neighbour: your message of this generation has not come; the answer is that message."""

    name: ClassVar[str] = "missed"
    job: int
    generation: int


@dataclass(frozen=True)
class Finish:
    """To the spy: all nodes have stopped, or one has failed.

    Attributes:
        champion: the best that they know.
        generation: after which they stopped, the median in async mode.
        reasons: of the stops proposed for that generation.
        error: why a node failed, or None.
    """

    name: ClassVar[str] = "finish"
    job: int
    champion: Champion | None
    generation: int
    reasons: tuple[Reason, ...]
    error: str | None = None


Command = Prepare | Begin | ProposeStop | Drop | Missed | Finish


@dataclass(frozen=True)
class Done:
    """The command was carried out; ``note`` is what there is to say of it, as JSON."""

    note: str = "null"


@dataclass(frozen=True)
class Refused:
    """The command was not carried out; ``blame`` is "input" if the user's input is at fault, else "failure"."""

    message: str
    blame: str = "failure"


def encode(command: Command) -> bytes:
    """As msgpack."""
    values = [getattr(command, field.name) for field in dataclasses.fields(command)]
    return pack([VERSION, command.name, *values])


def decode(payload: bytes) -> Command:
    """The inverse of `encode`.

    Raises:
        Rejected: whatever is wrong with it.
    """
    version, name, *values = _at_least_two(unpack(payload))
    if version != VERSION or type(version) is not int:
        raise Rejected("other version")
    match name, values:
        case "prepare", [job, file, log]:
            return Prepare(count(job), of(str, file), None if log is None else of(str, log))
        case "begin", [job]:
            return Begin(count(job))
        case "propose stop", [job, reason]:
            return ProposeStop(count(job), reason_of(reason))
        case "drop", [job]:
            return Drop(count(job))
        case "missed", [job, generation]:
            return Missed(count(job), count(generation))
        case "finish", [job, champion, generation, reasons, error]:
            return Finish(
                count(job),
                None if champion is None else _champion(champion),
                count(generation),
                tuple(reason_of(reason) for reason in of(list, reasons)),
                None if error is None else of(str, error),
            )
    raise Rejected("no such command")


def encode_answer(answer: Done | Refused) -> bytes:
    """As msgpack."""
    if isinstance(answer, Done):
        return pack(["done", answer.note])
    return pack(["refused", answer.message, answer.blame])


def decode_answer(payload: bytes) -> Done | Refused:
    """The inverse of `encode_answer`.

    Raises:
        Rejected: whatever is wrong with it.
    """
    match unpack(payload):
        case ["done", str(note)]:
            return Done(note)
        case ["refused", str(message), str(blame)]:
            return Refused(message, blame)
    raise Rejected("no such answer")


def _at_least_two(value: list[Any]) -> list[Any]:
    if len(value) < 2:
        raise Rejected("wrong shape")
    return value


def _champion(value: object) -> Champion:
    its_fitness, generation, cell, genome = fields(value, 4)
    return Champion(fitness(its_fitness), count(generation), count(cell), of(bytes, genome))
