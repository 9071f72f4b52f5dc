"""Tell what a visitor may do, by a token or by the session that a browser got for a token.

A session is a cookie that only the dashboard can make: when it ends, a random number, and a code (HMAC) over both and
the token, keyed with a secret of this run. What a session allows is looked up by its token. So a cookie gives neither
the token away nor more access than the token has. A dashboard that replaces one that died knows the same secret, so
browsers stay logged in.
"""

import hashlib
import hmac
import secrets
import time
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers

from supernode.dashboard.limits import Limit
from supernode.dashboard.tokens import Access

_COOKIE = "supernode_session"  # the port that the browser sees is appended: a host's ports share their cookies
_LASTS = 7 * 24 * 3600  # seconds that a session lasts at most; it also ends with the browser
_WRONG_AT_ONCE, _WRONG_A_SECOND = 10, 1 / 6  # wrong tokens from one address
_KEPT = 1000  # sessions that were ended by hand


class TooManyGuessesError(Exception):
    """An address has sent too many wrong tokens.

    Attributes:
        wait: seconds until the next token from there is looked at.
    """

    def __init__(self, wait: float) -> None:
        super().__init__(wait)
        self.wait = wait


class Credentials:
    """The tokens of a dashboard and its sessions.

    Args:
        tokens: what each token allows.
        session_key: the secret that makes sessions.
    """

    def __init__(self, tokens: Mapping[str, Access], session_key: str) -> None:
        self._tokens = {_digest(token): access for token, access in tokens.items()}
        self._session_key = session_key.encode()
        self._wrong = Limit(_WRONG_A_SECOND, _WRONG_AT_ONCE)
        self._ended: dict[str, None] = {}  # cookies of sessions that were ended by hand, the oldest first

    def access_of_token(self, token: str, address: str) -> Access | None:
        """Return what a token from an address allows; None if it is wrong.

        Raises:
            TooManyGuessesError: if the address has sent too many wrong ones; then not even a right one is looked at.
        """
        self._check(address)
        digest = self._known(token)
        if digest is None:
            self._wrong.count(address)
            return None
        return self._tokens[digest]

    def begun(self, token: str, address: str) -> str | None:
        """Return the cookie of a new session for a token; None if the token is wrong.

        Raises:
            TooManyGuessesError: see `access_of_token`.
        """
        if self.access_of_token(token, address) is None:
            return None
        rest = f"{int(time.time()) + _LASTS}.{secrets.token_hex(8)}"
        return f"{rest}.{self._code(rest, _digest(token))}"

    def access_of_session(self, cookie: str) -> Access | None:
        """Return what a session allows; None if there is no such session, or it has ended."""
        rest, _, code = cookie.rpartition(".")
        access: Access | None = None
        for digest, allowed in self._tokens.items():  # all, so that the time tells nothing about which one it is
            if hmac.compare_digest(code.encode(), self._code(rest, digest).encode()):
                access = allowed
        if access is None or cookie in self._ended or int(rest.partition(".")[0]) < time.time():
            return None
        return access

    def end(self, cookie: str) -> None:
        """End a session, for whoever else has its cookie too."""
        if self.access_of_session(cookie) is not None:
            self._ended[cookie] = None
            if len(self._ended) > _KEPT:
                del self._ended[next(iter(self._ended))]

    def _check(self, address: str) -> None:
        wait = self._wrong.wait(address)
        if wait > 0:
            raise TooManyGuessesError(wait)

    def _known(self, token: str) -> bytes | None:
        """Return the digest of a token if it is known, in a time that does not depend on the tokens."""
        given, found = _digest(token), None
        for digest in self._tokens:
            if hmac.compare_digest(given, digest):
                found = digest
        return found

    def _code(self, rest: str, digest: bytes) -> str:
        return hmac.digest(self._session_key, rest.encode() + digest, "sha256").hex()


def cookie_name(headers: Headers) -> str:
    """Return the name of the cookie that holds the session of a browser that sends these headers."""
    try:
        port = urlsplit(f"//{headers.get('host', '')}").port
    except ValueError:
        port = None
    return _COOKIE if port is None else f"{_COOKIE}_{port}"


def cookie_in(headers: Headers) -> str:
    """Return the cookie that holds a browser's session; "" if there is none."""
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(cookie_name(headers))
    except CookieError:
        return ""
    return "" if found is None else found.value


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode()).digest()
