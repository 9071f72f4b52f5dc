"""Commands to nodes and to the spy, and their answers.

Commands to all nodes of a job reach every node of the cluster; those that are not at it do not answer. Every other
command is answered: with `Done`, with `Refused`, or, for `Begin` and `Halt`, with the node's `Report` when it stops.

A job lives in a row of epochs, numbered from 0: its problem, and who lives where and neighbours whom, in the first one;
then whatever an update changes. Each epoch has a beginning and a stop of its own, and passes its demes on to the next.
"""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from wire.exchange import VERSION, Champion
from wire.report import Reason, reason_of
from wire.strict import Kind, Rejected, count, fields, of, pack, table, unpack


@dataclass(frozen=True)
class Wiring:
    """Who lives on which cell, and by which links.

    Attributes:
        number: nodes that have the links of this number keep them.
        nodes: the numbers of the nodes, cell by cell.
        hosts: where they live, cell by cell: those on one host share a folder of Unix sockets. Empty: all on one host.
        endpoints: where each, cell by cell, listens to nodes on other hosts; "" for one who does not.
    """

    number: int
    nodes: tuple[int, ...]
    hosts: tuple[str, ...] = ()
    endpoints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Prepare:
    """Get ready for an epoch of a job.

    Attributes:
        file: the problem file as JSON; its run settings name the topology.
        since: generations of the job before this epoch; None: as many as the node has bred, with the deme that it has.
        deme: to begin with, for a node that has none of its own: each individual whole, one after the other.
        fresh: whether the cells draw new individuals, and none goes on with a deme; then ``since`` is said.
        best: for the spy: the best answer to the same problem so far, as an improvement travels; empty without any.
        cluster_nodes: how many nodes the whole cluster has, at any job or at none: the more, the less often each tells.
    """

    name: ClassVar[str] = "prepare"
    job: int
    epoch: int
    file: str
    wiring: Wiring
    since: int | None = None
    deme: bytes = b""
    best: bytes = b""
    cluster_nodes: int = 0
    fresh: bool = False


@dataclass(frozen=True)
class Begin:
    """Every node is prepared: go, once the epoch before has stopped. Asked again, it is answered to who asked last."""

    name: ClassVar[str] = "begin"
    job: int
    epoch: int


@dataclass(frozen=True)
class ProposeStop:
    """Propose that all cells stop."""

    name: ClassVar[str] = "propose stop"
    job: int
    epoch: int
    reason: Reason


@dataclass(frozen=True)
class Halt:
    """Stop at once, wherever you are: a node has died, and the others would wait for it."""

    name: ClassVar[str] = "halt"
    job: int
    epoch: int


@dataclass(frozen=True)
class Look:
    """Are you at this job? Those who are answer with their cells."""

    name: ClassVar[str] = "look"
    job: int


@dataclass(frozen=True)
class Drop:
    """Forget a job that failed elsewhere, or has ended."""

    name: ClassVar[str] = "drop"
    job: int


@dataclass(frozen=True)
class Missed:
    """From a neighbour: your message of this generation has not come; the answer is that message."""

    name: ClassVar[str] = "missed"
    job: int
    epoch: int
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
        since: generations of the job before this epoch.
    """

    name: ClassVar[str] = "finish"
    job: int
    epoch: int
    champion: Champion | None
    generation: int
    reasons: tuple[Reason, ...]
    error: str | None = None
    states: tuple[tuple[int, bytes], ...] = ()
    since: int = 0


Command = Prepare | Begin | ProposeStop | Halt | Look | Drop | Missed | Finish


@dataclass(frozen=True)
class Done:
    """The command was carried out; ``note`` is what there is to say of it, as JSON."""

    note: str = "null"


@dataclass(frozen=True)
class Refused:
    """The command was not carried out.

    Attributes:
        blame: "input" if the user's input is at fault; "stranger" if it is about a job that this process, being
            younger, has never heard of; else "failure".
    """

    message: str
    blame: str = "failure"


@dataclass(frozen=True)
class Judged:
    """The spy's answer to `Finish`: what the run came to.

    Attributes:
        best: the best verified answer, an encoded `wire.news.Improvement`.
        words: the solution in words.
        target: the fitness that counts as solved.
        clearance: of the solution: ``"least"``, ``"where"``, ``"required"`` and ``"unit"``, see `spy.result.Result`.
        next_attempt: if the job is to begin anew, the fields of the problem to change, as JSON.
        solved_when: what the target means, in words.
        advice: what to turn, if the run has stalled.
        has_oracle: whether the problem has an oracle that can tell whether there is a way.
    """

    status: str
    feasible: bool
    message: str | None
    best: bytes | None
    words: str | None
    target: float | None
    clearance: dict[str, Any] | None = None
    next_attempt: str | None = None
    solved_when: str | None = None
    advice: tuple[str, ...] = ()
    has_oracle: bool = False


Answer = Done | Judged | Refused


def encode(command: Command) -> bytes:
    """As msgpack."""
    values = [_plain(getattr(command, field.name)) for field in dataclasses.fields(command)]
    return pack([VERSION, command.name, *values])


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return json.dumps(value)
    if not isinstance(value, Wiring):
        return value
    places = (value.hosts, value.endpoints)
    return (value.number, value.nodes, *(places if value.hosts else ()))


def decode(payload: bytes) -> Command:
    """The inverse of `encode`.

    Raises:
        Rejected: whatever is wrong with it.
    """
    version, name, *values = _at_least_two(unpack(payload))
    if version != VERSION or type(version) is not int:
        raise Rejected("other version")
    if not isinstance(name, str) or name not in _COMMANDS:
        raise Rejected("no such command")
    kind, readers = _COMMANDS[name]
    return kind(*(read(value) for read, value in zip(readers, fields(values, len(readers)), strict=True)))


def encode_answer(answer: Answer) -> bytes:
    """As msgpack."""
    values = [_plain(getattr(answer, field.name)) for field in dataclasses.fields(answer)]
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
        case ["judged", str(status), bool(feasible), *others]:
            message, best, words, target, clearance, attempt, when, advice, oracle = fields(others, 9)
            texts = _maybe(str, message), _maybe(bytes, best), _maybe(str, words)
            told = _maybe(str, attempt), _maybe(str, when)
            lines = tuple(of(str, line) for line in of(list, advice))
            figures = _maybe(float, target), _clearance(clearance)
            return Judged(status, feasible, *texts, *figures, *told, lines, of(bool, oracle))
    raise Rejected("no such answer")


def _wiring(value: object) -> Wiring:
    number, nodes, *places = fields(value, 4 if type(value) is list and len(value) > 2 else 2)
    numbers = tuple(count(node) for node in of(list, nodes))
    told = [tuple(of(str, each) for each in of(list, texts)) for texts in places]
    if {len(texts) for texts in told} - {0, len(numbers)}:
        raise Rejected("wrong shape")
    return Wiring(count(number), numbers, *told)


def _clearance(value: object) -> dict[str, Any] | None:
    if value is None:
        return None
    clearance = table(value)
    if clearance.keys() != {"least", "where", "required", "unit"}:
        raise Rejected("wrong shape")
    _maybe(float, clearance["least"])
    of(dict, clearance["where"])
    of(float, clearance["required"])
    of(str, clearance["unit"])
    return clearance


def _state(value: object) -> tuple[int, bytes]:
    cell, state = fields(value, 2)
    return count(cell), of(bytes, state)


def _states(value: object) -> tuple[tuple[int, bytes], ...]:
    return tuple(_state(each) for each in of(list, value))


def _reasons(value: object) -> tuple[Reason, ...]:
    return tuple(reason_of(reason) for reason in of(list, value))


def _champion(value: object) -> Champion | None:
    return None if value is None else Champion.of(value)


def _maybe(kind: type[Kind], value: object) -> Kind | None:
    return None if value is None else of(kind, value)


def _maybe_count(value: object) -> int | None:
    return None if value is None else count(value)


def _at_least_two(value: list[Any]) -> list[Any]:
    if len(value) < 2:
        raise Rejected("wrong shape")
    return value


_text, _octets, _flag, _maybe_text = partial(of, str), partial(of, bytes), partial(of, bool), partial(_maybe, str)
_COMMANDS: dict[str, tuple[Callable[..., Command], tuple[Callable[[Any], Any], ...]]] = {
    Prepare.name: (Prepare, (count, count, _text, _wiring, _maybe_count, _octets, _octets, count, _flag)),
    Begin.name: (Begin, (count, count)),
    ProposeStop.name: (ProposeStop, (count, count, reason_of)),
    Halt.name: (Halt, (count, count)),
    Look.name: (Look, (count,)),
    Drop.name: (Drop, (count,)),
    Missed.name: (Missed, (count, count, count)),
    Finish.name: (Finish, (count, count, _champion, count, _reasons, _maybe_text, _states, count)),
}
"""How each command's fields are read, in order."""
