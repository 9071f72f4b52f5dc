"""Events and actions of `node.cell.Cell`: the input of a cell, and its requests to whatever drives it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from genetics import Genomes
from wire.report import Reason, Report
from wire.takeover import KeptStates, Takeover


# Events ---------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Start:
    """Begin, since every cell is prepared.

    Attributes:
        deme: the first deme, shape (deme, genome_bytes); None for a random one.
        takeover: in lockstep, what to go on from in the place of a process that has died; None if the others begin too.
    """

    deme: Genomes | None = None
    takeover: Takeover | None = None


@dataclass(frozen=True)
class Halt:
    """Stop at once, whatever generation the other cells are in."""


class Answered(NamedTuple):
    """A neighbour has answered the question for its message, which was lost or is late.

    Attributes:
        sender: the neighbour.
        generation: the generation that was asked for.
        payloads: its messages since then, one for each exchange.
    """

    sender: int
    generation: int
    payloads: Sequence[bytes]


@dataclass(frozen=True)
class Propose:
    """Propose that all cells stop, for a reason from outside the cell."""

    reason: Reason


@dataclass(frozen=True)
class Waited:
    """No message has come for a while."""


@dataclass(frozen=True)
class Asked:
    """A neighbour asks for this cell's messages since a generation; the driver needs ``question`` to answer it."""

    generation: int
    question: object


@dataclass(frozen=True)
class AskedForStates:
    """The coordinator asks for the neighbours' states that this cell keeps.

    Attributes:
        question: as in `Asked`.
        once: whether to leave out a neighbour that names another cell first, since that cell tells its states.
    """

    question: object
    once: bool = False


Event = Start | Halt | Answered | Propose | Waited | Asked | AskedForStates


# Actions --------------------------------------------------------------------------------------------------------------
Publish = bytes
"""An encoded message for all neighbours. Plain bytes: an object around them would be made in each generation."""


@dataclass(frozen=True)
class Ask:
    """Ask a neighbour for its messages since a generation."""

    neighbour: int
    generation: int


@dataclass(frozen=True)
class Answer:
    """Answer a neighbour's question with the messages that it asked for."""

    question: object
    payloads: Sequence[bytes]


@dataclass(frozen=True)
class AnswerStates:
    """Answer the coordinator's question for the states that this cell keeps."""

    question: object
    kept: KeptStates


@dataclass(frozen=True)
class Complain:
    """Report that a neighbour's messages are refused; once for each neighbour and reason."""

    sender: int
    reason: str


Message = tuple[int, bytes]
"""A neighbour's encoded message, after the number of its cell."""

Action = Publish | Ask | Answer | AnswerStates | Complain | Report
