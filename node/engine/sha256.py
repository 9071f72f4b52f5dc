"""SHA-256 (FIPS 180-4) in compiled code, with a state that can be stored.

A digest of `hashlib` cannot be written down and gone on with elsewhere. That is what exact recovery needs: the process
that takes a dead one's place goes on with its predecessor's digest (`node.engine.state`). It also lets compiled
generations digest what they record, without a step into Python.

A state is a row of int64 numbers: the eight words, how many bytes have been digested, and room for one block with
those bytes that do not fill it yet.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import subroutine

_BLOCK = 64  # bytes
_LENGTH = 8  # the column of the number of bytes
_REST = 9  # the first column of the bytes that do not fill a block yet, eight in a column
STATE = _REST + _BLOCK // 8
"""Columns of a state."""


def _primes(count: int) -> list[int]:
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % prime for prime in found):
            found.append(number)
        number += 1
    return found


def _root_bits(number: int, degree: int) -> int:
    """Return the first 32 bits of the fractional part of a root; exact, by integers."""
    scaled, root = number << (32 * degree), 0
    for bit in reversed(range(40)):
        if (root | 1 << bit) ** degree <= scaled:
            root |= 1 << bit
    return root & 0xFFFFFFFF


_FIRST = np.array([_root_bits(prime, 2) for prime in _primes(8)], np.int64)
_CONSTANTS = np.array([_root_bits(prime, 3) for prime in _primes(64)], np.uint32)


@subroutine
def _turn(word: Any, bits: Any) -> Any:
    """Rotate a word right."""
    return np.uint32((word >> np.uint32(bits)) | (word << np.uint32(32 - bits)))


@subroutine
def _schedule(data: Any, start: Any, words: Any) -> Any:
    """Expand the block at ``start`` into 64 words."""
    for place in range(16):
        at = start + 4 * place
        high = (np.uint32(data[at]) << np.uint32(24)) | (np.uint32(data[at + 1]) << np.uint32(16))
        words[place] = high | (np.uint32(data[at + 2]) << np.uint32(8)) | np.uint32(data[at + 3])
    for place in range(16, 64):
        early, late = words[place - 15], words[place - 2]
        small = _turn(early, 7) ^ _turn(early, 18) ^ (early >> np.uint32(3))
        large = _turn(late, 17) ^ _turn(late, 19) ^ (late >> np.uint32(10))
        words[place] = np.uint32(words[place - 16] + small + words[place - 7] + large)


@subroutine
def _digest_block(state: Any, data: Any, start: Any) -> Any:
    """Digest the 64 bytes of ``data`` from ``start`` on."""
    words = np.empty(64, np.uint32)
    _schedule(data, start, words)
    a, b, c, d = np.uint32(state[0]), np.uint32(state[1]), np.uint32(state[2]), np.uint32(state[3])
    e, f, g, h = np.uint32(state[4]), np.uint32(state[5]), np.uint32(state[6]), np.uint32(state[7])
    for place in range(64):
        choice, majority = (e & f) ^ (~e & g), (a & b) ^ (a & c) ^ (b & c)
        mixed = _turn(e, 6) ^ _turn(e, 11) ^ _turn(e, 25)
        first = np.uint32(h + mixed + choice + _CONSTANTS[place] + words[place])
        second = np.uint32((_turn(a, 2) ^ _turn(a, 13) ^ _turn(a, 22)) + majority)
        h, g, f, e, d, c, b, a = g, f, e, np.uint32(d + first), c, b, a, np.uint32(first + second)
    state[0], state[1] = np.uint32(np.uint32(state[0]) + a), np.uint32(np.uint32(state[1]) + b)
    state[2], state[3] = np.uint32(np.uint32(state[2]) + c), np.uint32(np.uint32(state[3]) + d)
    state[4], state[5] = np.uint32(np.uint32(state[4]) + e), np.uint32(np.uint32(state[5]) + f)
    state[6], state[7] = np.uint32(np.uint32(state[6]) + g), np.uint32(np.uint32(state[7]) + h)


@subroutine
def begin(state: Any) -> Any:
    """Begin a digest."""
    state[:] = 0
    state[:8] = _FIRST


@subroutine
def update(state: Any, data: Any) -> Any:
    """Digest ``data``, a row of uint8."""
    kept, rest, at = state[_REST:].view(np.uint8), state[_LENGTH] % _BLOCK, 0
    state[_LENGTH] += data.size
    if rest + data.size >= _BLOCK and rest > 0:
        at = _BLOCK - rest
        for place in range(at):
            kept[rest + place] = data[place]
        _digest_block(state, kept, 0)
        rest = 0
    while at + _BLOCK <= data.size:
        _digest_block(state, data, at)
        at += _BLOCK
    for place in range(at, data.size):
        kept[rest] = data[place]
        rest += 1


@subroutine
def finish(state: Any, digest: Any) -> Any:
    """Write the digest, 32 bytes, of all that was digested; the state stays as it is, so more may follow."""
    rest, bits = state[_LENGTH] % _BLOCK, 8 * state[_LENGTH]
    last = np.zeros(2 * _BLOCK, np.uint8)
    last[:rest] = state[_REST:].view(np.uint8)[:rest]
    last[rest] = 0x80
    size = _BLOCK if rest < _BLOCK - 8 else 2 * _BLOCK
    for place in range(8):
        last[size - 1 - place] = (bits >> (8 * place)) & 0xFF
    copy = state.copy()
    for start in range(0, size, _BLOCK):
        _digest_block(copy, last, start)
    for place in range(32):
        digest[place] = (copy[place // 4] >> (24 - 8 * (place % 4))) & 0xFF
