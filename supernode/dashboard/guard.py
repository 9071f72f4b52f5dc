"""Decide which requests are let in: each one passes here before anything else sees it.

A page of another site must not be able to make a browser submit or cancel jobs. So a request that changes anything must
come from the dashboard's own pages, as its ``Origin`` tells.

A foreign host name can be made to resolve to this machine (DNS rebinding); a page under that name would count as the
dashboard's own. Without a token the dashboard therefore answers only under loopback names, as ``Host`` tells. With a
token that is not needed: under a foreign name the browser has no cookie.
"""

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from supernode.dashboard.listen_address import ListenAddress

_COOKIE = "supernode_token"  # the port that the browser sees is appended: a host's ports share their cookies
_HARMLESS = ("GET", "HEAD")
_OPEN = "/healthz"  # open to all, since it tells nothing but whether the cluster answers
_HEADERS = {
    # Plotly writes style elements into the page, hence 'unsafe-inline'.
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Guard:
    """Refuses requests that are not allowed, and tells browsers what the pages may load and do.

    Args:
        app: the application to guard.
        listen_address: the names and the token that a request must have.
    """

    def __init__(self, app: ASGIApp, listen_address: ListenAddress) -> None:
        self.app = app
        self._listen_address = listen_address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that is refused; pass any other to the application."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        refusal = self._refusal(scope)
        await (refusal or self.app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the answer that refuses the request; None if it is allowed."""
        headers = Headers(scope=scope)
        if self._listen_address.token is None and _name_in(headers) not in self._own_names():
            return PlainTextResponse("this is not a name of the dashboard\n", 421)
        if scope["method"] not in _HARMLESS and not _is_from_here(headers):
            return PlainTextResponse("refused: the request comes from another site\n", 403)
        if self._listen_address.token is None or scope["path"] == _OPEN:
            return None
        return self._without_token(scope, headers, self._listen_address.token)

    def _own_names(self) -> set[str]:
        return {"localhost", "127.0.0.1", "::1", self._listen_address.host}

    def _without_token(self, scope: Scope, headers: Headers, token: str) -> Response | None:
        """Return None if the request has the token; else a refusal, or a redirect that stores the token in a cookie."""
        if _is(headers.get("authorization", "").removeprefix("Bearer "), token) or _is(_cookie(headers), token):
            return None
        query = parse_qsl(scope["query_string"].decode("latin-1"))
        if scope["method"] not in _HARMLESS or not _is(dict(query).get("token", ""), token):
            return PlainTextResponse("a token is needed: /?token=…\n", 401, {"WWW-Authenticate": "Bearer"})
        rest = urlencode([each for each in query if each[0] != "token"])
        path = "/" + scope["path"].lstrip("/\\")  # one slash, so that the redirect cannot lead to another site
        response = RedirectResponse(path + ("?" + rest if rest else ""), 303)
        response.set_cookie(_cookie_name(headers), token, httponly=True, samesite="strict", path="/")
        return response


def _name_in(headers: Headers) -> str | None:
    try:
        return urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:
        return None


def _cookie_name(headers: Headers) -> str:
    try:
        port = urlsplit(f"//{headers.get('host', '')}").port
    except ValueError:
        port = None
    return _COOKIE if port is None else f"{_COOKIE}_{port}"


def _is_from_here(headers: Headers) -> bool:
    """Return whether a request comes from the dashboard's own pages or from a program.

    Programs send no Origin; browsers always send one with a request that may change something.
    """
    if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
        return False
    origin = headers.get("origin")
    return origin is None or origin.partition("://")[2] == headers.get("host")


def _cookie(headers: Headers) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(_cookie_name(headers))
    except CookieError:
        return ""
    return "" if found is None else found.value


def _is(given: str, token: str) -> bool:
    # In constant time, so that the time of an answer tells nothing about the token.
    return hmac.compare_digest(given.encode(), token.encode())
