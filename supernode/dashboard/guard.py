"""Decide which requests are let in: each one passes here before anything else sees it.

A page of another site must not be able to make a browser submit or cancel jobs, or log it in with a foreign token. So a
request that changes anything must come from the dashboard's own pages, as its ``Origin`` tells. Reading changes
nothing: a token in an address is ignored. A page of another site may lead the browser here, but have nothing loaded, as
``Sec-Fetch-Site`` tells: it could not read what is loaded, but measure it, or take up the streams.

A foreign host name can be made to resolve to this machine (DNS rebinding); a page under that name would count as the
dashboard's own. Without a token the dashboard therefore answers only under loopback names, as ``Host`` tells. With a
token that is not needed: under a foreign name the browser has no cookie.
"""

from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from supernode.dashboard.credentials import Credentials, TooManyGuessesError, cookie_in
from supernode.dashboard.limits import Limit, subscriber
from supernode.dashboard.listen_address import ListenAddress
from supernode.dashboard.login import LOGIN, LOGOUT, login_address, retry_after, too_many_words
from supernode.dashboard.tokens import Access

_REQUESTS_A_SECOND, _REQUESTS_AT_ONCE = 100, 1000  # from one address; behind a proxy all browsers have one
_HARMLESS = ("GET", "HEAD")
_HERE = ("same-origin", "none")  # the values of Sec-Fetch-Site of own pages, and of what people type
# Open to all: whether the cluster answers, and the login page with what it shows.
_OPEN = ("/healthz", LOGIN, "/static/style.css", "/static/icon.svg")
_HEADERS = {
    # Plotly writes style elements into the page, hence 'unsafe-inline'.
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    # Not "no-referrer": with that, browsers send "Origin: null" with the forms of these pages.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), display-capture=(), geolocation=(), microphone=(), payment=(), usb=()",
}
_HTTPS_FROM_NOW_ON = "max-age=31536000"  # seconds, a year


class Guard:
    """Refuses requests that are not allowed, and tells browsers what the pages may load and do.

    It tells the application in the scope what the visitor may do (``access``), whether by a session that can be ended
    (``logged_in``), and by a function whether that still holds (``is_still_allowed``).

    Args:
        app: the application to guard.
        listen_address: the names that a request must have, and whether a token is needed.
        credentials: who may do what.
    """

    def __init__(self, app: ASGIApp, listen_address: ListenAddress, credentials: Credentials) -> None:
        self.app = app
        self._listen_address = listen_address
        self._credentials = credentials
        self._requests = Limit(_REQUESTS_A_SECOND, _REQUESTS_AT_ONCE)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that is refused; pass any other to the application."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = Headers(scope=scope)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers[name] = value
                # It holds for all ports of a name, and under "localhost" there are other servers.
                if scope["scheme"] == "https" and _name_in(given) != "localhost":
                    headers["Strict-Transport-Security"] = _HTTPS_FROM_NOW_ON
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        refusal = self._refusal(scope, given)
        await (refusal or self.app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope, headers: Headers) -> Response | None:
        """Return the answer that refuses the request; None if it is allowed."""
        address = subscriber(scope["client"][0])
        return (
            self._refusal_of_many(address)
            or self._refusal_of_foreign(scope, headers)
            or self._refusal_of_unknown(scope, headers, address)
        )

    def _refusal_of_many(self, address: str) -> Response | None:
        wait = self._requests.wait(address)
        if wait > 0:
            return PlainTextResponse("too many requests from this address\n", 429, retry_after(wait))
        self._requests.count(address)
        return None

    def _refusal_of_foreign(self, scope: Scope, headers: Headers) -> Response | None:
        if not self._listen_address.tokens and _name_in(headers) not in self._own_names():
            return PlainTextResponse("this is not a name of the dashboard\n", 421)
        is_harmless = scope["method"] in _HARMLESS
        if not (_may_be_read(headers) if is_harmless else _is_from_here(headers, scope["scheme"])):
            return PlainTextResponse("refused: the request comes from another site\n", 403)
        return None

    def _refusal_of_unknown(self, scope: Scope, headers: Headers, address: str) -> Response | None:
        """Return the refusal of a visitor who may not do this; else tell the application what the visitor may do."""
        if scope["path"] in _OPEN:
            return None
        try:
            access, logged_in = self._access(headers, address)
        except TooManyGuessesError as error:
            return PlainTextResponse(too_many_words(error) + "\n", 429, retry_after(error.wait))
        if access is None:
            return _without_access(scope, headers)
        if access == "read" and scope["method"] not in _HARMLESS and scope["path"] != LOGOUT:
            return PlainTextResponse("refused: this token is for reading only\n", 403)
        cookie = cookie_in(headers)
        scope["access"], scope["logged_in"] = access, logged_in
        scope["is_still_allowed"] = lambda: not logged_in or self._credentials.access_of_session(cookie) is not None
        return None

    def _own_names(self) -> set[str]:
        return {"localhost", "127.0.0.1", "::1", self._listen_address.host}

    def _access(self, headers: Headers, address: str) -> tuple[Access | None, bool]:
        """Return what the sender of a request may do, if anything, and whether a browser's session says so."""
        if not self._listen_address.tokens:
            return "full", False
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self._credentials.access_of_token(token.strip(), address), False
        return self._credentials.access_of_session(cookie_in(headers)), True


def _without_access(scope: Scope, headers: Headers) -> Response:
    """Return the way to the login page to a browser that opens a page; to anybody else that a token is needed."""
    if scope["method"] in _HARMLESS and "text/html" in headers.get("accept", ""):
        query = scope["query_string"].decode("latin-1")
        path = scope["raw_path"].decode("latin-1")
        return RedirectResponse(login_address(path + ("?" + query if query else "")), 303)
    return PlainTextResponse("a token is needed: Authorization: Bearer TOKEN\n", 401, {"WWW-Authenticate": "Bearer"})


def _name_in(headers: Headers) -> str | None:
    try:
        return urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:
        return None


def _may_be_read(headers: Headers) -> bool:
    """Return whether a request that changes nothing comes from here, or from a program, or leads a browser here."""
    return headers.get("sec-fetch-site", "none") in _HERE or headers.get("sec-fetch-mode") == "navigate"


def _is_from_here(headers: Headers, scheme: str) -> bool:
    """Return whether a request comes from the dashboard's own pages or from a program.

    Programs send no Origin; browsers always send one with a request that may change something. Behind a proxy with TLS
    pages have another scheme than the request; but where the dashboard itself speaks TLS, all its pages do.
    """
    if headers.get("sec-fetch-site", "none") not in _HERE:
        return False
    origin, host = headers.get("origin"), headers.get("host")
    return origin is None or origin == f"https://{host}" or (scheme == "http" and origin == f"http://{host}")
