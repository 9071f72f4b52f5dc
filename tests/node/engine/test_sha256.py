"""The digest of compiled code is that of hashlib, in however many pieces, and its state can be stored."""

import hashlib

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lowlevel.compiled import kernel
from node.engine import sha256


@kernel("void(int64[::1])")
def begin(state):
    sha256.begin(state)


@kernel("void(int64[::1], uint8[::1])")
def update(state, data):
    sha256.update(state, data)


@kernel("void(int64[::1], uint8[::1])")
def finish(state, digest):
    sha256.finish(state, digest)


def digest_of(state):
    digest = np.empty(32, np.uint8)
    finish(state, digest)
    return digest.tobytes()


@given(st.lists(st.binary(max_size=200), max_size=6))
def test_it_is_the_digest_of_hashlib_after_each_piece(pieces):
    state, expected = np.zeros(sha256.STATE, np.int64), hashlib.sha256()
    begin(state)
    assert digest_of(state) == expected.digest()
    for piece in pieces:
        update(state, np.frombuffer(bytearray(piece), np.uint8))
        expected.update(piece)
        state = np.frombuffer(bytearray(state.tobytes()), np.int64)  # stored, and read again
        assert digest_of(state) == digest_of(state) == expected.digest()
