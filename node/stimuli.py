"""A bounded log of the latest stimuli of a cell, which an error prints."""

from collections import deque
from collections.abc import Sequence
from typing import Any

_KEPT = 50


class Stimuli:
    """A bounded log of the latest steps of a cell: what each was given, and in which generation.

    Of messages it keeps only how many there were: a log of all nodes must not hold their genomes. A step costs little
    more than appending to a list, since a node takes thousands of them a second.
    """

    def __init__(self) -> None:
        self._steps: deque[tuple[int, int, str]] = deque(maxlen=_KEPT)

    def note(self, generation: int, messages: int, events: Sequence[Any]) -> None:
        """Note a step that is about to be taken."""
        self._steps.append((generation, messages, ", ".join(map(_in_short, events)) if events else ""))

    def __str__(self) -> str:
        """Return a line for each step, the latest last."""
        return "\n".join(
            f"  in generation {generation}: {messages} messages{'; ' if events else ''}{events}"
            for generation, messages, events in self._steps
        )


def _in_short(event: Any) -> str:
    """Return an event without what may be long or hold memory: genomes, payloads, questions."""
    fields = vars(event) if hasattr(event, "__dict__") else event._asdict()
    told = [f"{name}={value}" for name, value in fields.items() if isinstance(value, int | str)]
    return f"{type(event).__name__}({', '.join(told)})"
