"""Events and actions of `node.cell.Cell`: the input of a cell, and its requests to whatever drives it."""

from dataclasses import dataclass
from typing import NamedTuple

from genetics import Genomes
from wire.report import Reason, Report


# Events ---------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Start:
    """Begin, since every cell is prepared; with the given deme, shape (deme, genome_bytes), or with a random one."""

    deme: Genomes | None = None


@dataclass(frozen=True)
class Halt:
    """Stop at once, whatever generation the other cells are in."""


class Answered(NamedTuple):
    """A neighbour has answered the question for its message, which was lost or is late."""

    sender: int
    payload: bytes


@dataclass(frozen=True)
class Propose:
    """Propose that all cells stop, for a reason from outside the cell."""

    reason: Reason


@dataclass(frozen=True)
class Waited:
    """No message has come for a while."""


@dataclass(frozen=True)
class Asked:
    """A neighbour asks for this cell's message of a generation; ``question`` is what the driver needs to answer it."""

    generation: int
    question: object


Event = Start | Halt | Answered | Propose | Waited | Asked


# Actions --------------------------------------------------------------------------------------------------------------
Publish = bytes
"""An encoded message for all neighbours. Plain bytes: an object around them would be made in each generation."""


@dataclass(frozen=True)
class Ask:
    """Ask a neighbour for its message of a generation."""

    neighbour: int
    generation: int


@dataclass(frozen=True)
class Answer:
    """Answer a neighbour's question with the message that it asked for."""

    question: object
    payload: bytes


@dataclass(frozen=True)
class Complain:
    """Report that a neighbour's messages are refused; once for each neighbour and reason."""

    sender: int
    reason: str


Message = tuple[int, bytes]
"""A neighbour's encoded message, after the number of its cell."""

Action = Publish | Ask | Answer | Complain | Report
