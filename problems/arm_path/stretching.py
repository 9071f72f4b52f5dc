"""Shorten Manhattan motions by dropping and shortening moves (Ahuactzin et al. 1992, §4, fourth reason).

The basic change transfers a part of one move's turn to the next move of the same joint, which shifts all moves between
them along that joint. After each change the whole path is tested again against the legal ranges of its moves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Path = NDArray[np.float64]  # (rows, links), rad, unwrapped

_NO_TURN = 1e-9  # rad
_HALVINGS = 10  # of the interval in which the longest legal slide is searched


class Move(NamedTuple):
    """A turn of one joint."""

    joint: int
    turn: float  # rad


_Moves = list[Move]
IsLegal = Callable[[Path, _Moves], bool]
"""Whether moves are legal, one after another; the configurations before the first and after each are given too."""


def stretched(path: Path, is_legal: IsLegal) -> Path:
    """Return a legal path between the same ends with as many moves or fewer, and a sum of turns that is no greater."""
    start = path[0]
    moves = _merged([Move(int(np.argmax(np.abs(turns))), float(turns.sum())) for turns in np.diff(path, axis=0)])
    while (better := _dropped(start, moves, is_legal) or _slid(start, moves, is_legal)) is not None:
        moves = better
    return _rows(start, moves)


def _merged(moves: _Moves) -> _Moves:
    """Return the moves without those that turn nothing, and with consecutive moves of one joint merged."""
    kept: _Moves = []
    for move in moves:
        if abs(move.turn) <= _NO_TURN:
            continue
        if kept and kept[-1].joint == move.joint:
            turn = kept.pop().turn + move.turn
            kept += [Move(move.joint, turn)] if abs(turn) > _NO_TURN else []
        else:
            kept.append(move)
    return kept


def _rows(start: Path, moves: _Moves) -> Path:
    """Return the configurations before the first and after each move."""
    rows = np.tile(start, (len(moves) + 1, 1))
    for number, move in enumerate(moves, start=1):
        rows[number:, move.joint] += move.turn
    return rows


def _pairs(moves: _Moves) -> Iterator[tuple[int, int]]:
    """Yield the indices of each move and of the next one of the same joint."""
    for first, move in enumerate(moves):
        for second in range(first + 1, len(moves)):
            if moves[second].joint == move.joint:
                yield first, second
                break


def _transferred(moves: _Moves, first: int, second: int, turn: float) -> _Moves:
    """Return the moves with ``turn``, rad, transferred from the first of two moves of a joint to the second."""
    changed = list(moves)
    changed[first] = moves[first]._replace(turn=moves[first].turn - turn)
    changed[second] = moves[second]._replace(turn=moves[second].turn + turn)
    return _merged(changed)


def _length(moves: _Moves) -> float:
    return sum(abs(move.turn) for move in moves)


def _dropped(start: Path, moves: _Moves, is_legal: IsLegal) -> _Moves | None:
    """Return the moves with two of a joint replaced by one, if that is legal and no longer; None if no pair allows."""
    for first, second in _pairs(moves):
        for turn in (moves[first].turn, -moves[second].turn):
            fewer = _transferred(moves, first, second, turn)
            if _length(fewer) <= _length(moves) + _NO_TURN and is_legal(_rows(start, fewer), fewer):
                return fewer
    return None


def _slid(start: Path, moves: _Moves, is_legal: IsLegal) -> _Moves | None:
    """Return the moves with two opposite moves of a joint shortened as far as is legal; None if no pair allows.

    The search halves an interval, as if legality ended at one length. If that is not so, the result is still legal.
    """
    for first, second in _pairs(moves):
        forth, back = moves[first].turn, moves[second].turn
        if forth * back >= 0.0:
            continue
        low, high = 0.0, np.copysign(min(abs(forth), abs(back)), forth)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            shorter = _transferred(moves, first, second, middle)
            if is_legal(_rows(start, shorter), shorter):
                low = middle
            else:
                high = middle
        if abs(low) > abs(forth) * 2.0**-_HALVINGS and abs(low) > _NO_TURN * 1e3:
            return _transferred(moves, first, second, low)
    return None
