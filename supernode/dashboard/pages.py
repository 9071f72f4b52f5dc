"""The dashboard's pages, with their scripts and styles."""

import asyncio
import gzip
from collections.abc import Awaitable, Callable
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from problems.registry import kinds
from supernode.dashboard.packing import COMPRESSION, answer_of

_HERE = Path(__file__).parent
templates = Jinja2Templates(_HERE / "templates")


def routes(single: bool) -> list[Route | Mount]:
    """Return the routes of pages, scripts and styles; ``single``: of a cluster that has one run and ends with it."""
    static = [Route("/plotly.min.js", _plotly), Mount("", StaticFiles(directory=_HERE / "static"))]
    return [
        Route("/", _page("cluster.html", single)),
        Route("/jobs", _page("jobs.html", single)),
        Route("/jobs/{job}", _page("job.html", single)),
        Route("/compare", _page("compare.html", single)),
        Mount("/static", routes=static, middleware=[Middleware(GZipMiddleware, compresslevel=COMPRESSION)]),
    ]


def _page(name: str, single: bool) -> Callable[[Request], Awaitable[Response]]:
    async def page(request: Request) -> Response:
        told = {
            "job": request.path_params.get("job"),
            "kinds": kinds(),
            "single": single,
            "access": request.scope["access"],
            "logged_in": request.scope["logged_in"],
        }
        return templates.TemplateResponse(request, name, told)

    return page


@lru_cache(1)
def _plotly_script() -> bytes:
    """Return plotly's script, compressed once: each of its 70 pieces would wait for a core that nodes keep busy."""
    return gzip.compress((files("plotly") / "package_data" / "plotly.min.js").read_bytes(), COMPRESSION)


async def _plotly(request: Request) -> Response:
    script = await asyncio.to_thread(_plotly_script)
    return answer_of(script, request, "text/javascript", {"Cache-Control": "private, max-age=86400"})
