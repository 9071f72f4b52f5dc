"""Commands to nodes and to the spy, and their answers.

A command travels as a query, sealed (`wire.seal`), and its answer as the reply. The answers are:

- `Done` or `Refused`, at once;
- `Judged`, the spy's answer to `Finish`;
- a node's `wire.report.Report`, after `Begin` and `Halt`, once its cell has stopped;
- exchange messages, after `Missed`;
- `KeptStates`, after `TellStates`.

A command for all nodes of a job is one query to all nodes of the cluster. Nodes that are not at that job drop the query
without an answer, so the sender must know how many answers to expect.

A job runs as a sequence of epochs, numbered from 0. The first has the problem and the topology as submitted, each later
one what an update or another change made of them. Every epoch has its own beginning and its own stop. Its demes go on
in the next epoch.
"""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from wire.champion import Champion
from wire.exchange_layout import VERSION
from wire.report import Reason, reason_of
from wire.strict import Kind, Rejected, count, fields, of, pack, table, unpack
from wire.takeover import KeptStates, Takeover


@dataclass(frozen=True)
class Wiring:
    """Which node is at which cell, and how the nodes reach each other.

    Attributes:
        number: identifies a set of links. A node that already has the links of this number keeps them; another number
            makes it open new ones.
        nodes: the number of each cell's node.
        hosts: the host of each cell's node; nodes of one host share a folder of Unix sockets. Empty: all are on one.
        endpoints: the endpoint at which each cell's node listens for nodes of other hosts; "" for one that does not.
    """

    number: int
    nodes: tuple[int, ...]
    hosts: tuple[str, ...] = ()
    endpoints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Prepare:
    """Prepare an epoch of a job: read the problem and open the links.

    The cell of the epoch before, if there is one, keeps breeding meanwhile.

    Attributes:
        job: the job's number.
        epoch: the epoch's number in the job.
        file: the problem file as JSON; its run settings name the topology.
        wiring: the node of each cell, and the links.
        since: how many generations the job has bred before this epoch. None: as many as the node itself has bred; then
            the node goes on with its own deme.
        deme: the individuals to begin with, for a node that has no deme of its own: each at full length, one after the
            other.
        best: for the spy, the best answer to the same problem so far, an encoded `wire.news.Improvement`; empty if
            there is none.
        cluster_nodes: the number of nodes in the whole cluster, busy or not. The more there are, the less often each
            sends counters.
        fresh: whether all cells draw new individuals instead of going on with a deme; then ``since`` is given.
        takeover: for a node that takes the place of one that has died, in an epoch that the others are in already.
        anew: whether the job begins again, since all its demes are lost; a node that has one after all forgets it.
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
    takeover: Takeover | None = None
    anew: bool = False


@dataclass(frozen=True)
class Begin:
    """Begin the epoch once the previous one has stopped; every node is prepared. The answer is the cell's report.

    It may be repeated, for example by a coordinator that takes over. Then only the latest query gets the report.

    Attributes:
        job: the job's number.
        epoch: the epoch's number in the job.
        wiring: the number of the epoch's wiring. A node that was prepared with another one, by a coordinator that died
            before the epoch had begun, ignores the command. None: any, since the epoch has begun and the number is not
            known; or for the spy.
    """

    name: ClassVar[str] = "begin"
    job: int
    epoch: int
    wiring: int | None = None


@dataclass(frozen=True)
class ProposeStop:
    """Let a cell propose that all cells stop, after a generation by which every cell knows of it."""

    name: ClassVar[str] = "propose stop"
    job: int
    epoch: int
    reason: Reason


@dataclass(frozen=True)
class Halt:
    """Stop at once, in whatever generation: a node has died, and its neighbours would wait for it for ever.

    Attributes:
        wiring: the number of the epoch's wiring. A cell with another one, of a job that has begun again elsewhere while
            its nodes were cut off, ignores the command. None: any, since the number is not known.
    """

    name: ClassVar[str] = "halt"
    job: int
    epoch: int
    wiring: int | None = None


@dataclass(frozen=True)
class Look:
    """Ask which nodes are at a job. Each answers at once: see `Done`."""

    name: ClassVar[str] = "look"
    job: int


@dataclass(frozen=True)
class Drop:
    """Forget a job that has ended or has failed elsewhere."""

    name: ClassVar[str] = "drop"
    job: int


@dataclass(frozen=True)
class Missed:
    """Ask a neighbour for its exchange message of a generation, which has not arrived.

    The answer is an array of its messages since then, one for each exchange; it is empty if the first is not kept.
    """

    name: ClassVar[str] = "missed"
    job: int
    epoch: int
    generation: int


@dataclass(frozen=True)
class Finish:
    """To the spy: all nodes have stopped, or one has failed. Verify and judge the epoch; the answer is `Judged`.

    Attributes:
        champion: the best individual that any of the nodes knows of, or None.
        generation: the generation after which the nodes stopped; in async mode the median.
        reasons: the reasons of the stops that were proposed for that generation.
        error: why a node failed, or None.
        states: pairs of a cell and what its problem reports about its state.
        since: how many generations the job had bred before this epoch.
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


@dataclass(frozen=True)
class TellStates:
    """Ask the cells of an epoch which states of their neighbours they keep; each answers with `KeptStates`.

    Attributes:
        once: whether the states of each cell are to come from one neighbour only, the first that it names.
        wiring: the number of the epoch's wiring, as in `Halt`.
    """

    name: ClassVar[str] = "tell states"
    job: int
    epoch: int
    once: bool = False
    wiring: int | None = None


Command = Prepare | Begin | ProposeStop | Halt | Look | Drop | Missed | Finish | TellStates


@dataclass(frozen=True)
class Done:
    """The command was carried out.

    Attributes:
        note: JSON: for `Prepare` to a node, the versions that its results depend on; for `Look`, these, the node, the
            cell, the epoch, and the numbers of the wirings whose links are open; the node, and null as the cell, if it
            has no cell of the job. For `Drop` to the spy, its best answer of the job (`wire.news.Improvement`), in
            hexadecimal digits, or null.
    """

    note: str = "null"


@dataclass(frozen=True)
class Refused:
    """The command was not carried out.

    Attributes:
        message: why, one sentence for people.
        blame: "input" if the user's input is at fault; "stranger" if the command is about a job that this process does
            not know, because it started later; else "failure".
    """

    message: str
    blame: str = "failure"


@dataclass(frozen=True)
class Judged:
    """The spy's answer to `Finish`: the result of the run.

    Attributes:
        status: how the run ended, see `spy.result.Result`.
        feasible: whether the planner's independent check accepts the best answer.
        message: why the run failed, or what the check found wrong with the best answer; or None.
        best: the best verified answer, an encoded `wire.news.Improvement`, or None.
        words: the solution in words.
        target: the fitness that counts as solved, or None.
        clearance: the solution's clearance: ``"least"``, ``"where"``, ``"required"`` and ``"unit"``, see
            `spy.result.Result`.
        next_attempt: if the job is to begin anew, the fields of the problem that change, as JSON; else None.
        solved_when: what the target means, in words.
        advice: if the run has stalled, the settings that may help, one line each.
        has_oracle: whether the problem has an oracle that can find out whether a solution exists.
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


Answer = Done | Judged | KeptStates | Refused


def encode(command: Command) -> bytes:
    """Return a command as msgpack: version, name, and the fields in the order of their definition."""
    values = [_plain(getattr(command, field.name)) for field in dataclasses.fields(command)]
    return pack([VERSION, command.name, *values])


def _plain(value: object) -> object:
    """Return a field's value in the form in which it travels."""
    if isinstance(value, dict):
        return json.dumps(value)
    if not isinstance(value, Wiring):
        return value
    places = (value.hosts, value.endpoints)
    return (value.number, value.nodes, *(places if value.hosts else ()))


def decode(payload: bytes) -> Command:
    """Return the command in ``payload``, the inverse of `encode`.

    Raises:
        Rejected: if the payload is not a valid command.
    """
    version, name, *values = _at_least_two(unpack(payload))
    if version != VERSION or type(version) is not int:
        raise Rejected("other version")
    if not isinstance(name, str) or name not in _COMMANDS:
        raise Rejected("no such command")
    kind, readers = _COMMANDS[name]
    return kind(*(read(value) for read, value in zip(readers, fields(values, len(readers)), strict=True)))


def encode_answer(answer: Answer) -> bytes:
    """Return an answer as msgpack."""
    values = [_plain(getattr(answer, field.name)) for field in dataclasses.fields(answer)]
    return pack([type(answer).__name__.lower(), *values])


def decode_answer(payload: bytes) -> Answer:
    """Return the answer in ``payload``, the inverse of `encode_answer`.

    Raises:
        Rejected: if the payload is not a valid answer.
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
        case ["keptstates", *others]:
            return KeptStates.of(others)
    raise Rejected("no such answer")


def _wiring(value: object) -> Wiring:
    """Read a wiring: two fields, or four if the nodes are on several hosts."""
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
    Prepare.name: (
        Prepare,
        (count, count, _text, _wiring, _maybe_count, _octets, _octets, count, _flag, Takeover.of, _flag),
    ),
    Begin.name: (Begin, (count, count, _maybe_count)),
    ProposeStop.name: (ProposeStop, (count, count, reason_of)),
    Halt.name: (Halt, (count, count, _maybe_count)),
    Look.name: (Look, (count,)),
    Drop.name: (Drop, (count,)),
    Missed.name: (Missed, (count, count, count)),
    TellStates.name: (TellStates, (count, count, _flag, _maybe_count)),
    Finish.name: (Finish, (count, count, _champion, count, _reasons, _maybe_text, _states, count)),
}
"""The class of each command, and the readers of its fields in the order of their definition: fields travel by position,
without names."""
