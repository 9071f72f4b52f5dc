"""A checkpoint of a job: everything from which it can go on after all its processes have ended.

As bytes it is a line that names the format and its version, the SHA-256 of the rest, and the rest as msgpack. So a
checkpoint that was written in part, or changed since, is noticed before anything of it is used.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from node.fingerprint import fingerprint
from problems import BadInput, ProblemFile
from problems.modules import Modules
from spy.past import SEVERAL, Past
from wire.news import Improvement
from wire.strict import count, fields, fitness, of, pack, table, unpack

KEPT = 3
"""How many checkpoints of a job are kept: if the latest is damaged, the one before is used."""

CHECKPOINT_EVERY = 30.0
"""Seconds from one checkpoint to the next, unless a user wants another time."""

_MAGIC = b"supernode checkpoint "
_VERSION = b"3"
_DIGEST_BYTES = 32


@dataclass(frozen=True)
class Checkpoint:
    """A job as it was when all its cells were in the same generation; in async mode when each had sent its state.

    Attributes:
        first: the problem file with which the job began.
        file: the problem file of its latest epoch.
        epoch: the number of that epoch.
        why: the directive that led to that epoch; empty for the first.
        past: the sum of the earlier epochs.
        lived_before: generations of the job when it last began with new demes.
        best: the best verified answer; None if there was none.
        seconds: how long the job had been running.
        states: for each cell its generation and its state (`node.engine.state`). Empty if no cell had sent one yet:
            then the job begins the epoch anew.
        versions: of the software, and the processor, on which the job ran (`node.fingerprint`); by default, the present
            ones.
    """

    first: ProblemFile
    file: ProblemFile
    epoch: int = 0
    why: Mapping[str, Any] = field(default_factory=dict)
    past: Past = field(default_factory=Past)
    lived_before: int = 0
    best: Improvement | None = None
    seconds: float = 0.0
    states: tuple[tuple[int, bytes], ...] = ()
    versions: Mapping[str, str] = field(default_factory=fingerprint)

    def other_versions(self) -> list[str]:
        """Return what is another version here than where the checkpoint was made: then bits may differ."""
        here = fingerprint()
        names = sorted(self.versions.keys() | here.keys())
        return [
            f"{name} {here.get(name, 'none')} instead of {self.versions.get(name, 'none')}"
            for name in names
            if here.get(name) != self.versions.get(name)
        ]

    @property
    def generation(self) -> int:
        """The job's generations so far; in async mode those of the slowest cell."""
        return self.past.generations + min((generation for generation, _ in self.states), default=0)

    def file_on(self, topology: str | None) -> ProblemFile:
        """Return the problem file of the latest epoch, on another topology if one is given.

        Raises:
            BadInput: if there is no such topology, or the checkpoint has no demes that other cells could begin with.
        """
        file = self.file.with_run(topology=topology)
        if file.run.topology != self.file.run.topology and self.epoch > 0 and not self.states:
            raise BadInput(
                f"topology: expected {self.file.run.topology}, since no cell had told its deme yet, found {topology}"
            )
        return file

    def encode(self) -> bytes:
        """Return the checkpoint as bytes."""
        content = pack(
            [
                self.first.to_json(),
                self.file.to_json(),
                self.epoch,
                json.dumps(dict(self.why)),
                self.past.to_json(),
                self.past.texts,
                self.lived_before,
                None if self.best is None else self.best.encode(),
                self.seconds,
                self.states,
                json.dumps(dict(self.versions)),
            ]
        )
        return _MAGIC + _VERSION + b"\n" + hashlib.sha256(content).digest() + content

    @staticmethod
    def decode(data: bytes, modules: Modules) -> "Checkpoint":
        """Return the checkpoint in ``data``, the inverse of `encode`.

        Args:
            data: the bytes.
            modules: the users' modules that may be run.

        Raises:
            BadInput: says what was expected and what was found.
        """
        content = _checked(data)
        try:
            return _read(content, modules)
        except BadInput:  # of the problem file in it
            raise
        except ValueError as error:
            raise BadInput(f"expected a checkpoint, found one that is damaged ({error})") from None


def _checked(data: bytes) -> bytes:
    """Return what follows the digest.

    Raises:
        BadInput: if it is no checkpoint, of another version, or not what was written.
    """
    head, _, rest = data.partition(b"\n")
    if not head.startswith(_MAGIC):
        raise BadInput("expected a checkpoint, found another file")
    if (version := head.removeprefix(_MAGIC)) != _VERSION:
        found = version[:10].decode("ascii", "replace")
        raise BadInput(f"expected a checkpoint of version {_VERSION.decode()}, found version {found}")
    content = rest[_DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != rest[:_DIGEST_BYTES]:
        raise BadInput("expected a whole checkpoint, found one that is damaged: its SHA-256 is another one")
    return content


def _read(content: bytes, modules: Modules) -> Checkpoint:
    values = fields(unpack(content, most_bytes=len(content)), 11)
    first, file, epoch, why, past, directives, lived_before, best, seconds, states, versions = values
    cells = [fields(each, 2) for each in of(list, states)]
    return Checkpoint(
        modules.read(of(str, first)),
        modules.read(of(str, file)),
        count(epoch),
        table(why),
        Past.from_json(of(str, past)).led_on(*map(_directive, of(list, directives))),
        count(lived_before),
        None if best is None else Improvement.decode(of(bytes, best)),
        fitness(seconds),
        tuple((count(generation), of(bytes, state)) for generation, state in cells),
        {name: of(str, its) for name, its in table(versions).items()},
    )


def _directive(text: Any) -> dict[str, Any]:
    """Return the directive in a text, with the fields that all have."""
    directive = table(text)
    of(str, directive.get("do"))
    count(directive.get("epoch"))
    count(directive.get("generation"))
    if "fields" in directive or directive["do"] in ("update", "retry", SEVERAL):
        of(dict, directive.get("fields"))
    return directive
