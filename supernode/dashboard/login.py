"""Log a browser in by a token, and out again."""

import math
from collections.abc import Mapping
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route

from supernode.dashboard.credentials import Credentials, TooManyGuessesError, cookie_in, cookie_name
from supernode.dashboard.fields import fields_of, text_of
from supernode.dashboard.limits import subscriber
from supernode.dashboard.pages import templates

LOGIN, LOGOUT = "/login", "/logout"
_MOST_BODY = 8192  # bytes


def routes(credentials: Credentials) -> list[Route]:
    """Return the routes of the login page and of what its forms do."""

    async def page(request: Request) -> Response:
        return _page(request, request.query_params.get("next", "/"))

    async def log_in(request: Request) -> Response:
        given = await fields_of(request, _MOST_BODY)
        token, then = text_of(given, "token", "").strip(), text_of(given, "next", "/")
        assert request.client is not None, "visitors come by TCP"
        try:
            cookie = credentials.begun(token, subscriber(request.client.host))
        except TooManyGuessesError as error:
            return _page(request, then, too_many_words(error), 429, retry_after(error.wait))
        if cookie is None:
            return _page(request, then, "This token is not known here.", 401, {"WWW-Authenticate": "Bearer"})
        response = RedirectResponse(_own(then), 303)
        # The browser's own word: behind a proxy with TLS only the browser knows that it speaks TLS.
        is_secure = request.url.scheme == "https" or request.headers.get("origin", "").startswith("https://")
        name = cookie_name(request.headers)
        response.set_cookie(name, cookie, httponly=True, samesite="strict", path="/", secure=is_secure)
        return response

    async def log_out(request: Request) -> Response:
        credentials.end(cookie_in(request.headers))
        response = RedirectResponse(LOGIN, 303)
        response.delete_cookie(cookie_name(request.headers), path="/")
        return response

    return [
        Route(LOGIN, page),
        Route(LOGIN, log_in, methods=["POST"]),
        Route(LOGOUT, log_out, methods=["POST"]),
    ]


def login_address(then: str) -> str:
    """Return the address of the login page that leads to ``then``, a path with its query."""
    return LOGIN if then == "/" else f"{LOGIN}?next={quote(then, safe='/')}"


def retry_after(wait: float) -> Mapping[str, str]:
    """Return the headers of an answer that asks to come again after ``wait`` seconds."""
    return {"Retry-After": str(math.ceil(wait))}


def too_many_words(error: TooManyGuessesError) -> str:
    """Return what to say to somebody who has sent too many wrong tokens."""
    return f"Too many wrong tokens came from this address. Try again in {math.ceil(error.wait)} s."


def _page(
    request: Request, then: str, trouble: str = "", status: int = 200, headers: Mapping[str, str] | None = None
) -> Response:
    told = {"next": _own(then), "trouble": trouble}
    return templates.TemplateResponse(request, "login.html", told, status, headers)


def _own(path: str) -> str:
    """Return a path of this dashboard: with one slash in front, it cannot lead to another site."""
    return "/" + path.lstrip("/\\")
