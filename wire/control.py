"""Commands to nodes and to the spy, and their answers.

Every command is answered: with `Done`, with `Refused`, or, for `Begin`, with the node's `Report` when it stops.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from wire.exchange import VERSION, Champion
from wire.report import Reason, reason_of
from wire.strict import Kind, Rejected, count, fields, of, pack, unpack


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
        states: what cells, by their numbers, have to say of their problems' states.
    """

    name: ClassVar[str] = "finish"
    job: int
    champion: Champion | None
    generation: int
    reasons: tuple[Reason, ...]
    error: str | None = None
    states: tuple[tuple[int, bytes], ...] = ()


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


@dataclass(frozen=True)
class Judged:
    """The spy's answer to `Finish`: what the run came to.

    Attributes:
        best: the best verified answer, an encoded `wire.news.Improvement`.
        words: the solution in words.
        target: the fitness that counts as solved.
    """

    status: str
    feasible: bool
    message: str | None
    best: bytes | None
    words: str | None
    target: float | None


Answer = Done | Judged | Refused


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
        case "finish", [job, champion, generation, reasons, error, states]:
            return Finish(
                count(job),
                None if champion is None else Champion.of(champion),
                count(generation),
                tuple(reason_of(reason) for reason in of(list, reasons)),
                None if error is None else of(str, error),
                tuple(_state(each) for each in of(list, states)),
            )
    raise Rejected("no such command")


def encode_answer(answer: Answer) -> bytes:
    """As msgpack."""
    values = [getattr(answer, field.name) for field in dataclasses.fields(answer)]
    return pack([type(answer).__name__.lower(), *values])


def decode_answer(payload: bytes) -> Answer:
    """The inverse of `encode_answer`.

    Raises:
        Rejected: whatever is wrong with it.
    """
    match unpack(payload):
        case ["done", str(note)]:
            return Done(note)
        case ["refused", str(message), str(blame)]:
            return Refused(message, blame)
        case ["judged", str(status), bool(feasible), message, best, words, target]:
            return Judged(
                status, feasible, _maybe(str, message), _maybe(bytes, best), _maybe(str, words), _maybe(float, target)
            )
    raise Rejected("no such answer")


def _state(value: object) -> tuple[int, bytes]:
    cell, state = fields(value, 2)
    return count(cell), of(bytes, state)


def _maybe(kind: type[Kind], value: object) -> Kind | None:
    return None if value is None else of(kind, value)


def _at_least_two(value: list[Any]) -> list[Any]:
    if len(value) < 2:
        raise Rejected("wrong shape")
    return value
