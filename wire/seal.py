"""Seals on commands: a process obeys only who knows the secret of its cluster.

A seal is a message authentication code (keyed BLAKE2b, RFC 7693) over the key expression that is asked, the sender, a
number that the sender counts up, and the command. Whoever reaches the router without the secret cannot make up a
command, change one, address an overheard one to another process, or give it to the same process again. He can still
read commands, keep them from arriving, answer in the place of a node, and give an overheard command to a process that
was forked after it (in the place of a dead one). The secret itself is never sent.
"""

import hashlib
import hmac
import itertools
import os

from wire.strict import Rejected

NOT_OURS = "not of this cluster"
"""Why a command without the right seal is rejected."""

SECRET_BYTES = 32
_MAC_BYTES = 32
_SENDER_BYTES = 8
_NUMBER_BYTES = 8
_HEAD_BYTES = _MAC_BYTES + _SENDER_BYTES + _NUMBER_BYTES
_LATE = 1024  # commands: so many may overtake another one of the same sender


class Seal:
    """Seals and opens the commands of one process; to be made after the last fork, since each sender is another.

    Args:
        secret: that of the cluster, `SECRET_BYTES` long.
    """

    def __init__(self, secret: bytes) -> None:
        self._secret = secret
        self._sender = os.urandom(_SENDER_BYTES)
        self._numbers = itertools.count()
        self._heard: dict[bytes, _Heard] = {}  # by sender

    def close(self, key: str, payload: bytes) -> bytes:
        """Return ``payload`` sealed for whoever is asked by the key expression ``key``."""
        signed = self._sender + next(self._numbers).to_bytes(_NUMBER_BYTES, "big") + payload
        return self._mac(key, signed) + signed

    def open(self, key: str, sealed: bytes) -> bytes:
        """Return what `close` was given, with the same secret and key expression.

        Raises:
            Rejected: "not of this cluster" or "repeated".
        """
        signed = sealed[_MAC_BYTES:]
        if len(sealed) < _HEAD_BYTES or not hmac.compare_digest(sealed[:_MAC_BYTES], self._mac(key, signed)):
            raise Rejected(NOT_OURS)
        sender = signed[:_SENDER_BYTES]
        number = int.from_bytes(sealed[_MAC_BYTES + _SENDER_BYTES : _HEAD_BYTES], "big")
        if not self._heard.setdefault(sender, _Heard()).is_new(number):
            raise Rejected("repeated")
        return sealed[_HEAD_BYTES:]

    def _mac(self, key: str, signed: bytes) -> bytes:
        code = hashlib.blake2b(key.encode() + b"\0", key=self._secret, digest_size=_MAC_BYTES)
        code.update(signed)
        return code.digest()


class _Heard:
    """Which numbers of one sender have been heard: the sliding window of RFC 6479, as one integer."""

    def __init__(self) -> None:
        self._highest = -1
        self._bits = 0  # bit i: number `_highest` - i was heard

    def is_new(self, number: int) -> bool:
        """Note a number; return whether it was not heard before. One that is too old to tell counts as heard."""
        ahead = number - self._highest
        if ahead > 0:
            self._bits = ((self._bits << min(ahead, _LATE)) | 1) & ((1 << _LATE) - 1)
            self._highest = number
            return True
        if -ahead >= _LATE or self._bits >> -ahead & 1:
            return False
        self._bits |= 1 << -ahead
        return True
