"""The dashboard's web server: pages, the data that their scripts ask for, live updates, metrics."""

import asyncio
import contextlib
import gzip
import json
import math
import re
import socket
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from coordinator.errors import ClusterFailed
from problems import BadInput, ProblemFile
from problems.errors import shorten
from problems.registry import find_built_in, kinds
from supernode.client.async_job import AsyncClientJob
from supernode.client.cluster_info import Place
from supernode.dashboard.ending import CancellableApp, Server
from supernode.dashboard.guard import Guard
from supernode.dashboard.listen_address import ListenAddress
from supernode.dashboard.metrics import Metrics
from supernode.dashboard.parsing import Parser
from supernode.dashboard.scenes import Form, Scenes
from supernode.dashboard.streams import Streams
from supernode.live.view import View, shape_of
from supernode.live.watcher import PATIENCE, Watcher
from wire import jobs as wire

NICENESS = 5  # of the dashboard's process: nodes come first
MOST_BODY = wire.MOST_FILE_BYTES  # bytes
_MOST_CONNECTIONS = 400
_MOST_NAME = 200  # characters
_MOST_SEED = (1 << 64) - 1
_MOST_RECORD = 1 << 62
_FIELDS = ("file", "name", "id", "priority", "seed", "seconds")  # of the form that submits a job
_HERE = Path(__file__).parent
_FRESH = 0.5  # seconds for which an answer of the cluster is shared by all requests that ask the same
_KEPT = 256  # such answers
_SHOW_EVERY = 1.0  # seconds between two questions about a job, at least: each answer holds whole problem files
_SHOW_AGAIN = 5.0  # seconds after which a job is asked for again although nothing was received about it
_SHOWN = 16  # answers about jobs that are kept, each with its problem file
_MADE = 8  # parsed problem files that are kept
_SHORT = 200  # characters of JSON; longer fields of a problem are not sent to pages
_COMPRESSION = 5  # zlib's level


@dataclass(frozen=True)
class _Shown:
    """The cluster's answer about a job, with when it was asked for (loop time) and what was known of the job then."""

    heard: Any
    asked: float
    answer: asyncio.Task[dict[str, Any]]

    def is_good(self, heard: Any, now: float) -> bool:
        """Return whether the answer may be used, given what is known of the job now."""
        if now < self.asked:  # the question waits for its turn; whoever asks now waits with it
            return True
        if self.answer.done() and (self.answer.cancelled() or self.answer.exception() is not None):
            return False
        return self.heard == heard and now - self.asked < _SHOW_AGAIN


class Dashboard:
    """The state that all requests of one dashboard share; only the server's loop may use it."""

    def __init__(self, place: Place) -> None:
        self.view = View()
        self.watcher = Watcher(place, self.view)
        self.streams = Streams(self.view.snapshot, self.view.news, self.view.improvements)
        self.scenes = Scenes()
        self.metrics = Metrics(self.view)
        self.parser = Parser()
        self._answers: dict[wire.Request, tuple[float, asyncio.Task[Any]]] = {}
        self._shown: OrderedDict[str, _Shown] = OrderedDict()

    async def ask(self, request: wire.Request) -> Any:
        """Return the cluster's answer, at most half a second old: many viewers cost the cluster no more than one."""
        now = asyncio.get_running_loop().time()
        asked, answer = self._answers.get(request, (-_FRESH, None))
        if answer is None or now - asked >= _FRESH:
            self._answers = {key: each for key, each in self._answers.items() if now - each[0] < _FRESH}
            if len(self._answers) >= _KEPT:
                raise ClusterFailed("too many questions at once")
            answer = asyncio.create_task(self.watcher.client.ask(request, PATIENCE))
            self._answers[request] = (now, answer)
        return await asyncio.shield(answer)  # shared: a viewer that leaves must not cancel it for the others

    async def show(self, job: str) -> Mapping[str, Any]:
        """Return all about a job; one answer serves all viewers until something new is received about the job.

        Its best answer is the latest improvement that was received, if the cluster's answer does not have it yet.
        """
        heard, now = self.view.heard_of(job), asyncio.get_running_loop().time()
        known = self._shown.get(job)
        if known is None or not known.is_good(heard, now):
            due = now if known is None else max(now, known.asked + _SHOW_EVERY)
            known = self._shown[job] = _Shown(heard, due, asyncio.create_task(self._show(job, due - now)))
            self._shown.move_to_end(job)
            while len(self._shown) > _SHOWN:
                self._shown.popitem(last=False)
        return self.view.completed(await asyncio.shield(known.answer))  # shared as well

    async def _show(self, job: str, after: float) -> dict[str, Any]:
        await asyncio.sleep(after)
        view: dict[str, Any] = await self.watcher.client.ask(wire.Show(job), PATIENCE)
        return {name: value for name, value in view.items() if name not in ("file", "epochs")}


def application(place: Place, single: bool, broke: Callable[[BaseException], None]) -> Starlette:
    """Return the ASGI application behind the guard.

    Args:
        place: where the cluster is.
        single: whether the cluster has one run and ends with it.
        broke: called with an error that ends the background work: from then on all pages would be frozen.
    """

    def look_at(task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            broke(error)

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        dashboard = app.state.dashboard = Dashboard(place)
        tasks = [asyncio.create_task(work.run()) for work in (dashboard.watcher, dashboard.streams)]
        for task in tasks:
            task.add_done_callback(look_at)
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        dashboard.scenes.close()

    return Starlette(
        routes=_routes(single),
        exception_handlers={BadInput: _bad_input, ClusterFailed: _cluster_failed, HTTPException: _http},
        lifespan=lifespan,
    )


def serve(
    place: Place,
    listen_address: ListenAddress,
    sock: socket.socket,
    end: Callable[[uvicorn.Server], None] | None = None,
    single: bool = False,
) -> None:
    """Serve on ``sock`` until a signal; raise the error if the background work of the pages breaks.

    ``end`` receives the server before it runs, so that something other than a signal can end it.
    """
    broken: list[BaseException] = []

    def give_up(error: BaseException) -> None:
        broken.append(error)
        server.should_exit = True

    app = CancellableApp(Guard(application(place, single, give_up), listen_address))
    config = uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        timeout_graceful_shutdown=1,
        ws="none",
        proxy_headers=False,
    )
    server = Server(app, config)
    if end is not None:
        end(server)
    server.run(sockets=[sock])
    if broken:
        raise broken[0]


def _routes(single: bool) -> list[Route | Mount]:
    return [
        Route("/", _page("cluster.html", single)),
        Route("/jobs", _page("jobs.html", single)),
        Route("/jobs/{job}", _page("job.html", single)),
        Route("/compare", _page("compare.html", single)),
        Route("/events", _Events(), methods=["GET"]),
        Route("/metrics", _metrics),
        Route("/healthz", _healthz),
        Route("/jobs/{job}/scene.png", _scene("png", "image/png")),
        Route("/api/nodes/{node:int}", _node),
        Route("/api/templates/{kind}", _template),
        Route("/api/jobs", _submit, methods=["POST"]),
        Route("/api/jobs/{job}", _job),
        Route("/api/jobs/{job}/history", _history),
        Route("/api/jobs/{job}/spaces", _scene("spaces", "application/json")),
        Route("/api/jobs/{job}/cancel", _cancel, methods=["POST"]),
        Mount("/static", routes=_static, middleware=[Middleware(GZipMiddleware, compresslevel=_COMPRESSION)]),
    ]


def _of(request: Request) -> Dashboard:
    dashboard: Dashboard = request.app.state.dashboard
    return dashboard


# Pages ----------------------------------------------------------------------------------------------------------------
_templates = Jinja2Templates(_HERE / "templates")


def _page(name: str, single: bool) -> Callable[[Request], Awaitable[Response]]:
    async def page(request: Request) -> Response:
        told = {"job": request.path_params.get("job"), "kinds": kinds(), "single": single}
        return _templates.TemplateResponse(request, name, told)

    return page


@lru_cache(1)
def _plotly_script() -> bytes:
    """Return plotly's script, compressed once: each of its 70 pieces would wait for a core that nodes keep busy."""
    return gzip.compress((files("plotly") / "package_data" / "plotly.min.js").read_bytes(), _COMPRESSION)


async def _plotly(request: Request) -> Response:
    script, headers = await asyncio.to_thread(_plotly_script), {"Cache-Control": "private, max-age=86400"}
    if "gzip" in request.headers.get("Accept-Encoding", ""):
        headers |= {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
    else:
        script = gzip.decompress(script)
    return Response(script, headers=headers, media_type="text/javascript")


_static = [Route("/plotly.min.js", _plotly), Mount("", StaticFiles(directory=_HERE / "static"))]


class _Events:
    """Passes requests to the streams, which exist only once the application has begun."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await scope["app"].state.dashboard.streams(scope, receive, send)


# Data for scripts -----------------------------------------------------------------------------------------------------
async def _node(request: Request) -> Response:
    found = _of(request).view.node(request.path_params["node"])
    if found is None:
        raise BadInput(f"there is no node {request.path_params['node']}")
    return JSONResponse(found)


async def _template(request: Request) -> Response:
    kind = await asyncio.to_thread(find_built_in, request.path_params["kind"])  # its import takes a second
    return PlainTextResponse(kind.template)


async def _job(request: Request) -> Response:
    view = await _of(request).show(request.path_params["job"])
    rows, columns = shape_of(view["topology"])
    told = {key: value for key, value in view.items() if key != "file_now"}
    return JSONResponse(told | _made_of(view["file_now"]) | {"rows": rows, "columns": columns})


async def _history(request: Request) -> Response:
    """Answer with the records of a job that are newer than those that the page has."""
    job, pages = request.path_params["job"], {}
    for kind in ("improvements", "history", "statistics"):
        after = _whole(request.query_params.get(kind, "0"), kind, _MOST_RECORD)
        pages[kind] = await _of(request).ask(wire.Records(kind, job, after))
    return JSONResponse(pages)


def _scene(form: Form, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    async def scene(request: Request) -> Response:
        dashboard = _of(request)
        view = await dashboard.show(request.path_params["job"])
        return Response(await dashboard.scenes.drawn(view, form), media_type=media_type)

    return scene


async def _submit(request: Request) -> Response:
    """Submit a problem file with settings that replace those in it; empty fields replace nothing."""
    given = {field: value for field, value in (await _given(request)).items() if value not in (None, "")}
    unknown = given.keys() - _FIELDS
    if unknown:
        raise BadInput(f"expected {', '.join(_FIELDS)}, found {shorten(min(unknown))}")
    text, name = _text(given, "file", ""), _text(given, "name", "form.toml", _MOST_NAME)
    job, priority = _text(given, "id", "") or None, _whole(given.get("priority", 0), "priority", wire.MOST_PRIORITY)
    settings = {"seed": _whole(given["seed"], "seed", _MOST_SEED)} if "seed" in given else {}
    seconds = {"seconds": _number(given["seconds"], "seconds")} if "seconds" in given else {}
    file = (await _of(request).parser.read(text, name)).with_run(**settings, **seconds)
    handed_in = await _of(request).watcher.client.submit(file, id=job, priority=priority)
    return JSONResponse({"job": handed_in.id}, 201)


async def _cancel(request: Request) -> Response:
    job: AsyncClientJob = await _of(request).watcher.client.job(request.path_params["job"])
    return JSONResponse({"job": job.id, "status": await job.cancel()})


async def _given(request: Request) -> dict[str, Any]:
    """Return the fields of a form or of a JSON object."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    body = await _body(request)
    try:
        if kind == "application/x-www-form-urlencoded":
            return dict(parse_qsl(body.decode(), keep_blank_values=True, strict_parsing=True, max_num_fields=16))
        if kind != "application/json":
            raise HTTPException(415, "expected JSON or a form")
        given = json.loads(body)
    except (ValueError, RecursionError):
        raise BadInput("expected a JSON object or a form, found something else") from None
    if not isinstance(given, dict):
        raise BadInput("expected a JSON object, found something else")
    return given


async def _body(request: Request) -> bytes:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_BODY:
            raise HTTPException(413, f"expected at most {MOST_BODY} bytes")
    return bytes(body)


def _text(given: Mapping[str, Any], field: str, default: str, most: int | None = None) -> str:
    text = given.get(field, default)
    if not isinstance(text, str) or text != wire.encodable(text):
        raise BadInput(f"{field}: expected text, found {shorten(text)}")
    if most is not None and len(text) > most:
        raise BadInput(f"{field}: expected at most {most} characters, found {len(text)}")
    return text


def _whole(given: Any, field: str, most: int) -> int:
    """Return a whole number; a form sends it as text, and so does a script that sends a form as JSON."""
    number = int(given) if isinstance(given, str) and re.fullmatch(r"\s*[+-]?[0-9]{1,20}\s*", given) else given
    if type(number) is not int or abs(number) > most:
        raise BadInput(f"{field}: expected a whole number, at most {most}, found {shorten(given)}")
    return number


def _number(given: Any, field: str) -> float:
    try:
        number = math.nan if isinstance(given, bool) else float(given)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise BadInput(f"{field}: expected a number, found {shorten(given)}")
    return number


@lru_cache(_MADE)
def _made_of(file: str) -> dict[str, Any]:
    """Return what a page shows of a problem file; large fields such as maps and meshes are left out."""
    told = ProblemFile.from_json(file)
    short = {field: value for field, value in told.fields.items() if len(json.dumps(value)) <= _SHORT}
    return {"name": told.name, "problem": short, "run": told.run.model_dump()}  # with the defaults, such as the seed


# For machines ---------------------------------------------------------------------------------------------------------
async def _metrics(request: Request) -> Response:
    return PlainTextResponse(_of(request).metrics.text(), media_type="text/plain; version=0.0.4")


async def _healthz(request: Request) -> Response:
    """Answer whether the cluster answers. Anybody may ask, so nothing else is said."""
    if _of(request).view.answers:
        return PlainTextResponse("the cluster answers\n")
    return PlainTextResponse("the cluster does not answer\n", 503)


# Errors ---------------------------------------------------------------------------------------------------------------
def _refusal(text: str, status: int) -> Response:
    return JSONResponse({"error": wire.encodable(text)}, status)


async def _bad_input(_: Request, error: Exception) -> Response:
    return _refusal(str(error), 400)


async def _cluster_failed(_: Request, error: Exception) -> Response:
    return _refusal(str(error), 503)


async def _http(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _refusal(error.detail, error.status_code)
