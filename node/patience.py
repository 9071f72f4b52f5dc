"""How long a lockstep cell waits for its neighbours' messages before it asks for them: a message may have been lost."""

_PATIENCE = 1.0  # s that a cell waits at least
_USUALLY = 4  # times as long as it usually takes; on a busy machine each exchange may take seconds
_LEAST_USUAL = 0.01  # s
# A cell that waits asks less and less often, up to this pause: a neighbour may have been cut off, and be back.
_LONGEST_PAUSE = 5.0  # s
# A process that takes a dead one's place misses what its neighbours send before they know that it listens, and a
# neighbour that is new itself has nothing to answer with before it has begun. So it soon asks again, for a while.
_HASTY, _HASTY_FOR = 0.1, 5.0  # s


class Patience:
    """Decides when a cell asks for messages. It never looks at the clock itself; times are on the monotonic clock.

    Attributes:
        due: when to look whether the cell waits for too long.
    """

    def __init__(self) -> None:
        self.due = 0.0
        self._hasty_until = 0.0
        self._usual = 0.0  # s from one exchange to the next

    @property
    def is_hasty(self) -> bool:
        """Whether the cell should ask as soon as it is due, not only when the main thread is awake anyhow."""
        return self.due < self._hasty_until

    def begin(self, now: float, took_over: bool) -> None:
        """Note that the cell begins; ``took_over``: in the place of one whose process has died, while others wait."""
        self._hasty_until = now + _HASTY_FOR if took_over else 0.0
        self.due = now + (_HASTY if took_over else _PATIENCE)

    def note(self, now: float, gap: float) -> None:
        """Note that the cell goes on, after an exchange of so many seconds.

        A long one is the usual one only if more of them follow. Otherwise a cell that has waited long for one lost
        message would wait four times as long for the next one.
        """
        self._usual = min(gap, max(2 * self._usual, _LEAST_USUAL))
        self.due = min(self.due, now + self._patience)

    def is_over(self, now: float, waits_since: float) -> bool:
        """Return whether the cell should ask now; else, or if it goes on waiting, it is due later.

        Each pause is as long as the wait before it, but not longer than `_LONGEST_PAUSE`, or the patience if that is.
        """
        waited, patience = now - waits_since, self._patience
        self.due = now + max(patience - waited, min(waited, max(patience, _LONGEST_PAUSE)))
        return waited >= patience

    @property
    def _patience(self) -> float:
        return max(_HASTY if self.is_hasty else _PATIENCE, _USUALLY * self._usual)
