"""Seals on commands: a process obeys a command only if its sender knows the cluster's secret.

A seal is a message authentication code (keyed BLAKE2b, RFC 7693) over the key expression that is asked, the sender, a
number that the sender counts up, and the command.

An attacker who reaches the router but does not know the secret cannot make up a command, change one, address a recorded
one to another process, or repeat it to the same process. The attacker can still read commands, keep them from arriving,
answer in the place of a node, and send a recorded command to a process that was forked later (in the place of a dead
one). The secret itself is never sent.
"""

import hashlib
import hmac
import itertools
import os

from wire.strict import Rejected

NOT_OURS = "not of this cluster"
"""The reason for which a command without a valid seal is rejected."""

SECRET_BYTES = 32
_MAC_BYTES = 32
_SENDER_BYTES = 8
_NUMBER_BYTES = 8
HEAD_BYTES = _MAC_BYTES + _SENDER_BYTES + _NUMBER_BYTES
"""A sealed command has so many bytes before its payload."""

_LATE = 1024  # commands of the same sender that may overtake a command; beyond that, the overtaken one is rejected


class Seal:
    """Seals the commands that one process sends, and opens those that it receives.

    Any thread may call `close`; only one may call `open`.

    Create it after the last fork. Two processes that shared a sender would count the same numbers, and receivers would
    reject the commands of one of them as repeated.

    Args:
        secret: the cluster's secret, `SECRET_BYTES` long.
    """

    def __init__(self, secret: bytes) -> None:
        self._secret = secret
        self._sender = os.urandom(_SENDER_BYTES)
        self._numbers = itertools.count()
        self._heard: dict[bytes, _Received] = {}  # by sender; only senders with a valid seal get an entry

    def close(self, key: str, payload: bytes) -> bytes:
        """Return ``payload`` with a seal that is valid for the key expression ``key`` only."""
        signed = self._sender + next(self._numbers).to_bytes(_NUMBER_BYTES, "big") + payload
        return self._mac(key, signed) + signed

    def open(self, key: str, sealed: bytes) -> bytes:
        """Return the payload that `close` was given, with the same secret and key expression.

        A command that is opened twice is rejected the second time.

        Raises:
            Rejected: "not of this cluster" or "repeated".
        """
        signed = sealed[_MAC_BYTES:]
        # The seal first: until it is verified, sender and number are claims of a stranger and must not be noted.
        if len(sealed) < HEAD_BYTES or not hmac.compare_digest(sealed[:_MAC_BYTES], self._mac(key, signed)):
            raise Rejected(NOT_OURS)
        sender = signed[:_SENDER_BYTES]
        number = int.from_bytes(sealed[_MAC_BYTES + _SENDER_BYTES : HEAD_BYTES], "big")
        if not self._heard.setdefault(sender, _Received()).is_new(number):
            raise Rejected("repeated")
        return sealed[HEAD_BYTES:]

    def _mac(self, key: str, signed: bytes) -> bytes:
        # The zero byte marks where the key expression ends: without it, bytes could move between key and message.
        code = hashlib.blake2b(key.encode() + b"\0", key=self._secret, digest_size=_MAC_BYTES)
        code.update(signed)
        return code.digest()


class _Received:
    """The numbers received from one sender: the sliding window of RFC 6479, kept in one integer.

    A window rather than the highest number alone, since queries may overtake each other on their way.
    """

    def __init__(self) -> None:
        self._highest = -1
        self._bits = 0  # bit i is set if number `_highest` - i was received

    def is_new(self, number: int) -> bool:
        """Record a number; return whether it is new. A number older than the window counts as received."""
        ahead = number - self._highest
        if ahead > 0:
            self._bits = ((self._bits << min(ahead, _LATE)) | 1) & ((1 << _LATE) - 1)
            self._highest = number
            return True
        if -ahead >= _LATE or self._bits >> -ahead & 1:
            return False
        self._bits |= 1 << -ahead
        return True
