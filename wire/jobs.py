"""Messages between clients and the coordinator: requests, their answers, and changes of jobs' states.

Clients may be programs in any language (docs/protocol.md), unlike nodes. So arguments have names, refusals are
sentences, and a request of another version is refused with an explanation instead of being dropped.
"""

import dataclasses
import json
import math
import re
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

from wire.plain import plain
from wire.strict import MOST_ELEMENTS, Rejected, count, fields, of, pack, unpack

VERSION = 1  # of this protocol
MOST_FILE_BYTES = 8 << 20  # of a problem file, in UTF-8
MOST_LISTED = 10_000  # jobs in one answer
WATCH, SUBMIT, CHANGE, DOWN = RIGHTS = ("watch", "submit", "change", "down")
"""What a client may be allowed to do: look at jobs, submit some, change or cancel any, and end the cluster."""

MOST_PRIORITY = 1_000_000  # in either direction

_MOST_REQUEST_BYTES = MOST_FILE_BYTES + 4096
_MOST_ANSWER_BYTES = 8 * MOST_FILE_BYTES  # room for a problem file before and after, the changes, and a result
_MOST_ARGUMENTS = 16
_MOST_NAME = 64
_MOST_TOPOLOGY = 256
_MOST_RECORD = 1 << 62
_MOST_NODE = 1 << 20
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_Of = TypeVar("_Of")


@dataclass(frozen=True)
class Submit:
    """Submit a job.

    Attributes:
        file: the problem file, as `ProblemFile.to_json` writes it.
        id: the job's id, chosen by the client, so that a repeated request does not make a second job. None: the
            coordinator chooses one.
        priority: of two queued jobs, the one with the higher priority runs first.
    """

    name: ClassVar[str] = "submit"
    right: ClassVar[str] = SUBMIT
    file: str
    id: str | None = None
    priority: int = 0


@dataclass(frozen=True)
class ListJobs:
    """List the newest ``limit`` jobs, the newest last; None: `MOST_LISTED`."""

    name: ClassVar[str] = "list"
    right: ClassVar[str] = WATCH
    limit: int | None = None


@dataclass(frozen=True)
class Show:
    """Describe one job; ``brief`` leaves out the parts that may be large, such as the problem file."""

    name: ClassVar[str] = "show"
    right: ClassVar[str] = WATCH
    job: str
    brief: bool = False


@dataclass(frozen=True)
class Records:
    """Return a page of a job's records, oldest first.

    Attributes:
        kind: "improvements", "history" or "statistics".
        job: the job's id.
        after: the id of the last record that the client has; the page begins after it.
    """

    name: ClassVar[str] = "records"
    right: ClassVar[str] = WATCH
    kind: str
    job: str
    after: int = 0


@dataclass(frozen=True)
class Logs:
    """Return a page of the processes' log records, as `Records` does; of one ``job`` or ``node`` only, if given."""

    name: ClassVar[str] = "logs"
    right: ClassVar[str] = WATCH
    job: str | None = None
    node: int | None = None
    after: int = 0


@dataclass(frozen=True)
class Cancel:
    """End a job; its result is the best answer so far."""

    name: ClassVar[str] = "cancel"
    right: ClassVar[str] = CHANGE
    job: str


@dataclass(frozen=True)
class Update:
    """Change a job's problem: each top-level key of ``patch``, a JSON object, replaces that of the problem."""

    name: ClassVar[str] = "update"
    right: ClassVar[str] = CHANGE
    job: str
    patch: str


@dataclass(frozen=True)
class Rewire:
    """Give a job another topology while it runs."""

    name: ClassVar[str] = "rewire"
    right: ClassVar[str] = CHANGE
    job: str
    topology: str


@dataclass(frozen=True)
class Status:
    """Return the state of the cluster."""

    name: ClassVar[str] = "status"
    right: ClassVar[str] = WATCH


@dataclass(frozen=True)
class Down:
    """End the whole cluster."""

    name: ClassVar[str] = "down"
    right: ClassVar[str] = DOWN


Request = Submit | ListJobs | Show | Records | Logs | Cancel | Update | Rewire | Status | Down

_REQUESTS: dict[str, type[Request]] = {
    request.name: request for request in (Submit, ListJobs, Show, Records, Logs, Cancel, Update, Rewire, Status, Down)
}


@dataclass(frozen=True)
class Done:
    """The request was carried out; ``value`` consists of plain values, see docs/protocol.md."""

    value: Any


@dataclass(frozen=True)
class Refused:
    """The request was not carried out; ``blame`` is "input" if the client's input is at fault, else "failure"."""

    message: str
    blame: str = "input"


Answer = Done | Refused


@dataclass(frozen=True)
class JobState:
    """A change of a job's state, as the coordinator publishes it.

    Attributes:
        job: the job's id.
        number: the job's number, by which `wire.news.Improvement` names the job.
        status: the new state.
        fitness: the fitness of the best verified answer so far, or None.
        message: why the job failed, or another remark for people, or None.
        at: the time of the change, Unix time in seconds.
    """

    job: str
    number: int
    status: str
    fitness: float | None
    message: str | None
    at: float

    def encode(self) -> bytes:
        """Return the change as msgpack."""
        message = None if self.message is None else encodable(self.message)
        return pack([VERSION, self.job, self.number, self.status, plain(self.fitness), message, self.at])

    @staticmethod
    def decode(payload: bytes) -> "JobState":
        """Return the change in ``payload``, the inverse of `encode`.

        Raises:
            Rejected: if the payload is not a valid change.
        """
        version, job, number, status, fitness, message, at = fields(unpack(payload), 7)
        if type(version) is not int or version != VERSION:
            raise Rejected("other version")
        return JobState(
            job_id(job),
            count(number),
            of(str, status),
            None if fitness is None else _number(fitness),
            None if message is None else of(str, message),
            _number(at),
        )


def encode(request: Request) -> bytes:
    """Return a request as msgpack, without the arguments that have their default values.

    So an older coordinator still accepts a request whose new arguments are not used.
    """
    given = {field.name: getattr(request, field.name) for field in dataclasses.fields(request)}
    defaults = {field.name: field.default for field in dataclasses.fields(request)}
    return pack([VERSION, request.name, {name: value for name, value in given.items() if value != defaults[name]}])


def decode(payload: bytes) -> Request:
    """Return the request in ``payload``, the inverse of `encode`. Arguments that have a default may be missing.

    Raises:
        Rejected: if the payload is not a valid request; the reason is a sentence for the client's user.
    """
    if len(payload) > _MOST_REQUEST_BYTES:
        raise Rejected(f"expected a request of at most {_MOST_REQUEST_BYTES} bytes, found {len(payload)}")
    try:
        message = unpack(payload, _MOST_REQUEST_BYTES, _MOST_ARGUMENTS, _MOST_ARGUMENTS)
    except Rejected as error:
        raise Rejected(f"expected a request [version, name, arguments] in msgpack, but it is {error.reason}") from error
    _check_version(message)
    match message:
        case [_, str(name), dict(arguments)]:
            return _request(name, arguments)
    raise Rejected("expected a request [version, name, arguments]")


def encode_answer(answer: Answer) -> bytes:
    """Return an answer as msgpack."""
    match answer:
        case Done(value):
            return pack(["done", value])
        case Refused(message, blame):
            return pack(["refused", encodable(message), blame])


def decode_answer(payload: bytes) -> Answer:
    """Return the answer in ``payload``, the inverse of `encode_answer`.

    Raises:
        Rejected: if the payload is not a valid answer.
    """
    match unpack(payload, _MOST_ANSWER_BYTES, MOST_ELEMENTS, MOST_ELEMENTS):
        case ["done", value]:
            return Done(value)
        case ["refused", str(message), "input" | "failure" as blame]:
            return Refused(message, blame)
    raise Rejected("no such answer")


def job_id(value: object) -> str:
    """Return ``value`` if it is a valid job id.

    Raises:
        Rejected: if it is not.
    """
    if type(value) is not str or not _ID.fullmatch(value):
        found = repr(value if type(value) is not str or len(value) <= _MOST_NAME else f"{value[:_MOST_NAME]}…")
        raise Rejected(f"expected a job's id, 1 to 64 of the characters A-Z a-z 0-9 . _ -, found {encodable(found)}")
    return value


def encodable(text: str) -> str:
    """Return ``text`` with "?" for each character that UTF-8 cannot encode: lone surrogates, which JSON allows."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _check_version(message: list[Any]) -> None:
    """Refuse another version before the shape of the message is looked at, which may differ from version to version."""
    version = message[0] if message else None
    if type(version) is not int:
        raise Rejected("expected a request [version, name, arguments], found no version")
    if version != VERSION:
        raise Rejected(f"expected a request of protocol version {VERSION}, which this cluster speaks, found {version}")


def _request(name: str, arguments: dict[str, Any]) -> Request:
    kind = _REQUESTS.get(name)
    if kind is None:
        raise Rejected(f"expected one of {', '.join(_REQUESTS)}, found {_short(name)}")
    known = {field.name: field for field in dataclasses.fields(kind)}
    for unknown in arguments.keys() - known.keys():
        raise Rejected(f"{name}: expected {_listed(known)}, found {_short(unknown)}")
    for field in known.values():
        if field.default is dataclasses.MISSING and field.name not in arguments:
            raise Rejected(f"{name}: expected {_listed(known)}, found no {field.name}")
    # nil in place of an argument whose default is None is the same as leaving the argument out.
    given = {each: value for each, value in arguments.items() if value is not None or known[each].default is not None}
    return kind(**{each: _argument(name, each, value) for each, value in given.items()})


def _argument(request: str, name: str, value: Any) -> Any:
    try:
        return _CHECKS[name](value)
    except Rejected as error:
        raise Rejected(f"{request}: {name}: {error.reason}") from error


def _file(value: object) -> str:
    file = _text(value)
    if len(file.encode()) > MOST_FILE_BYTES:
        raise Rejected(f"expected at most {MOST_FILE_BYTES} bytes, found {len(file.encode())}")
    return file


def _text(value: object) -> str:
    return _a(str, value, "text")


def _patch(value: object) -> str:
    """Return ``value`` if it is the text of a JSON object. Whether the keys are known, only the problem can check."""
    patch = _text(value)
    try:
        table = json.loads(patch)
    except (ValueError, RecursionError) as error:
        raise Rejected(f"expected a JSON object, found {_short(patch)}") from error
    if not isinstance(table, dict) or not table:
        raise Rejected(f"expected a JSON object with keys, found {_short(patch)}")
    return patch


def _topology(value: object) -> str:
    spec = _text(value)
    if len(spec) > _MOST_TOPOLOGY:
        raise Rejected(f"expected at most {_MOST_TOPOLOGY} characters, found {len(spec)}")
    return spec


def _limit(value: object) -> int:
    return _between(value, 0, MOST_LISTED)


def _priority(value: object) -> int:
    return _between(value, -MOST_PRIORITY, MOST_PRIORITY)


_CHECKS = {
    "file": _file,
    "id": job_id,
    "priority": _priority,
    "limit": _limit,
    "job": job_id,
    "brief": lambda value: _a(bool, value, "true or false"),
    "kind": _text,
    "node": lambda value: _between(value, 0, _MOST_NODE),
    "after": lambda value: _between(value, 0, _MOST_RECORD),
    "patch": _patch,
    "topology": _topology,
}


def _between(value: object, low: int, high: int) -> int:
    number = _a(int, value, "a whole number")
    if not low <= number <= high:
        raise Rejected(f"expected a whole number from {low} to {high}, found {number}")
    return number


def _a(kind: type[_Of], value: object, what: str) -> _Of:
    """Return ``value`` if its type is exactly ``kind``; else raise `Rejected`, with ``what`` was expected."""
    if type(value) is not kind:
        raise Rejected(f"expected {what}, found {_short(value)}")
    return value


def _number(value: object) -> float:
    number = of(float, value)
    if not math.isfinite(number):
        raise Rejected("not finite")
    return number


def _listed(names: dict[str, Any]) -> str:
    return f"the arguments {', '.join(names)}" if names else "no arguments"


def _short(value: object) -> str:
    """Return ``value`` as it appears in an error: a client may have sent megabytes."""
    text = repr(value)
    return encodable(text if len(text) <= _MOST_NAME else f"{text[: _MOST_NAME - 1]}…")
